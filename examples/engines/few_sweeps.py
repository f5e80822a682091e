# /// script
# requires-python = ">=3.9"
# dependencies = ["mujoco>=3.3", "numpy"]
#
# [tool.oarlock]
# title = "MuJoCo, ten sweeps of projected Gauss-Seidel"
# package = "mujoco"
# beside = true
# several = true
# questions = ["step", "run"]
# equalities = ["connect", "weld", "joint", "tendon"]
# ///
"""An engine of one's own: MuJoCo as a fast training setting has it, with a solver that stops before it converges.

    oarlock conform boat --engine examples/engines/few_sweeps.py

The head says what it needs and what it can be asked; ``beside`` that it needs no environment of its own where a MuJoCo
is there already, ``several`` that one process answers several questions.
"""

import mujoco
from shared import family

SWEEPS = 10

FIGURES = ("qacc", "qfrc_constraint", "qpos", "qvel")


def sloppy(ask):
    """The model of a question, with few sweeps, whatever accuracy is asked for."""
    model = family.compile_mujoco(mujoco, ask)
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    model.opt.iterations, model.opt.tolerance = SWEEPS, 0.0
    model.opt.noslip_iterations = 0
    return model


def answered(model, data, ask):
    """A row a state, or a row a record of a run: accelerations and forces there, positions and velocities after."""
    run = ask.question == "run"
    every = ask.document["every"] if run else 1
    count = ask.document["steps"] // every if run else len(ask)
    rows = {name: [] for name in ("time", *FIGURES)}
    for row in range(count):
        if row == 0 or not run:
            family.place(mujoco, model, data, ask, row)
        if run:
            mujoco.mj_step(model, data, every)
        mujoco.mj_forward(model, data)
        for name in FIGURES[:2]:
            rows[name].append(getattr(data, name).copy())
        if not run:
            mujoco.mj_step(model, data)
        rows["time"].append(data.time)
        for name in FIGURES[2:]:
            rows[name].append(getattr(data, name).copy())
        family.progress(row + 1, count)
    return rows


def main():
    """Answers every question."""
    for ask, answer in family.questions():
        model = sloppy(ask)
        document = {"engine": "few sweeps", "versions": {"mujoco": mujoco.__version__}, "precision": "float64"}
        document |= {"expressed": ["connect", "weld", "joint", "tendon"], "not_expressible": []}
        document["facts"] = family.model_facts(mujoco, model, ask)
        family.write_answer(answer, document, answered(model, mujoco.MjData(model), ask))


if __name__ == "__main__":
    main()
