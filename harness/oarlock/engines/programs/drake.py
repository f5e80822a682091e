# /// script
# requires-python = ">=3.10"
# dependencies = ["drake>=1.40", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "Drake, what its reader of MJCF keeps"
# package = "drake"
# questions = []
# equalities = ["connect"]
# ///
"""Drake reads the MJCF by its own parser: what it keeps of masses and equalities is told, nothing is computed."""

import logging
import sys
from importlib.metadata import version

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from shared import family

ROWS = 3
"""Of a constraint: of equalities its reader makes ball constraints of connects only, and nothing else of any."""


class _Heard(logging.Handler):
    def __init__(self):
        super().__init__()
        self.said = []

    def emit(self, record):
        self.said.append(record.getMessage())


def main():
    """Answers every question by what the reader kept."""
    for ask, answer in family.questions():
        heard = _Heard()
        logging.getLogger("drake").addHandler(heard)
        plant = MultibodyPlant(time_step=0.0)
        Parser(plant).AddModels(str(ask.folder / "model.xml"))
        plant.Finalize()
        world = plant.world_body().index()
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(plant.world_body().model_instance())]
        for number in range(plant.num_model_instances()):
            bodies += [plant.get_body(one) for one in plant.GetBodyIndices(ModelInstanceIndex(number))]
        masses = {body.name(): float(body.default_mass()) for body in bodies if body.index() != world}
        masses = {name: (mass if np.isfinite(mass) else 0.0) for name, mass in masses.items()}
        context = plant.CreateDefaultContext()
        poses = {body.name(): plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies}
        count = int(plant.num_constraints())
        document = {"engine": "drake", "versions": {"drake": version("drake")}, "precision": "float64"}
        document["expressed"] = ["connect"] if count else []
        document["facts"] = {
            "total_mass": float(sum(masses.values())),
            "body_masses": masses,
            "body_places": {name: place.tolist() for name, place in poses.items()},
            "rows": ROWS * count,
            "constraints": {"ball": count} if count else {},
            "velocities": int(plant.num_velocities()),
            "warnings": heard.said[:20],
        }
        why = "only what its reader keeps is looked at: no state is asked of it"
        family.refuse(answer, document, [{"element": f"question '{ask.question}'", "why": why}])
    family.end(True)


if __name__ == "__main__":
    sys.exit(main())
