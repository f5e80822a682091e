# /// script
# requires-python = ">=3.10"
# dependencies = ["newton>=1.0", "mujoco", "mujoco-warp", "warp-lang", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "Newton, what its reader of MJCF keeps"
# package = "newton"
# questions = []
# precisions = ["float32"]
# equalities = ["connect", "weld", "joint"]
# ///
"""Newton reads the MJCF by its own importer: what it keeps of masses and equalities is told, nothing is computed."""

import sys
import warnings

import newton
import numpy as np
import warp
from shared import family

warp.config.quiet = True


KINDS = {0: ("connect", 3), 1: ("weld", 6), 2: ("joint", 1), 3: ("tendon", 1)}
"""Members of mjtEq → name, rows."""


def _rows(builder):
    """Rows of the equalities that were kept, and their kinds. Of connects Newton makes joints that close the loop."""
    attribute = builder.custom_attributes.get("mujoco:equality_constraint_type")
    values = getattr(attribute, "values", None) or []
    numbers = list(values.values()) if isinstance(values, dict) else list(values)
    known = [KINDS[int(number)] for number in numbers if int(number) in KINDS]
    return sum(rows for _, rows in known), [kind for kind, _ in known]


def _velocities(builder):
    """Velocities of the tree, without those of joints that close loops, which are in no articulation."""
    starts = [*map(int, builder.joint_qd_start), int(builder.joint_dof_count)]
    tree = [number for number, owner in enumerate(builder.joint_articulation) if owner >= 0]
    return sum(starts[number + 1] - starts[number] for number in tree)


def main():
    """Answers every question by what the importer kept."""
    for ask, answer in family.questions():
        builder = newton.ModelBuilder()
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            builder.add_mjcf(str(ask.folder / "model.xml"))
        labels = getattr(builder, "body_label", None) or getattr(builder, "body_key", None) or []
        names = [str(label).rsplit("/", 1)[-1] for label in labels]
        masses = [float(mass) for mass in builder.body_mass]
        rows, kept = _rows(builder)
        document = {"engine": "newton", "versions": {"newton": newton.__version__}, "precision": "float32"}
        document["expressed"] = sorted(set(kept))
        document["facts"] = {
            "total_mass": float(np.sum(masses)),
            "body_masses": dict(zip(names, masses)),  # noqa: B905 (lists of one builder)
            "rows": rows,
            "constraints": {kind: kept.count(kind) for kind in sorted(set(kept))},
            "body_places": dict(zip(names, [list(map(float, pose))[:3] for pose in builder.body_q])),  # noqa: B905
            "velocities": _velocities(builder),
            "warnings": [str(one.message)[:200] for one in said[:20]],
        }
        why = "only what its reader keeps is looked at: no state is asked of it"
        family.refuse(answer, document, [{"element": f"question '{ask.question}'", "why": why}])
    family.end(True)


if __name__ == "__main__":
    sys.exit(main())
