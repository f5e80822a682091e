"""Programs of engines that a test makes up: MuJoCo in this interpreter, with one thing changed."""

from pathlib import Path

from oarlock.engines.registry import Engine, parse_engine

HEAD = """# /// script
# dependencies = []
#
# [tool.oarlock]
# title = "made up"
# several = true
# questions = [{questions}]
# ///
"""

BODY = '''
import os
import subprocess
import sys
import time

import mujoco
import numpy as np
from shared import family


def solved(model, data, curvature=True):
    """Accelerations that the law of MuJoCo gives, by hand, with J̇v or without."""
    ne = data.ne
    J = np.zeros((ne, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(J, data.efc_J, data.efc_J_rownnz[:ne], data.efc_J_rowadr[:ne], data.efc_J_colind)
    else:
        J[:] = data.efc_J[: ne * model.nv].reshape(ne, model.nv)
    terms = data.efc_KBIP[:ne]
    aref = data.efc_aref[:ne].copy()
    if not curvature:
        aref = -terms[:, 1] * data.efc_vel[:ne] - terms[:, 0] * terms[:, 2] * data.efc_pos[:ne]
    back = np.zeros((ne, model.nv))
    mujoco.mj_solveM(model, data, back, J)
    force = np.linalg.solve(back @ J.T + np.diag(data.efc_R[:ne]), aref - J @ data.qacc_smooth)
    return data.qacc_smooth + back.T @ force, J.T @ force


FACTS = {}


def prepare(model):
    pass


def answer(model, data, row):
    return data.qacc.copy(), data.qfrc_constraint.copy()


def again(model, data, row):
    return answer(model, data, row)[0]


def finish(columns, ask):
    return columns


@CHANGED@


def main():
    for ask, folder in family.questions():
        model = family.compile_mujoco(mujoco, ask)
        facts = family.model_facts(mujoco, model, ask)
        prepare(model)
        data = mujoco.MjData(model)
        rows = {name: [] for name in ("time", "qacc", "qfrc_constraint", "qacc_again", "qpos", "qvel")}
        run = ask.question == "run"
        for row in range(ask.document["steps"] // ask.document["every"] if run else len(ask)):
            if row == 0 or not run:
                family.place(mujoco, model, data, ask, row)
            if run:
                mujoco.mj_step(model, data, ask.document["every"])
            mujoco.mj_forward(model, data)
            qacc, force = answer(model, data, row)
            rows["qacc"].append(qacc)
            rows["qfrc_constraint"].append(force)
            rows["qacc_again"].append(again(model, data, row))
            if ask.question == "step":
                mujoco.mj_step(model, data)
            rows["time"].append(data.time)
            rows["qpos"].append(data.qpos.copy())
            rows["qvel"].append(data.qvel.copy())
        document = {"engine": "made up", "versions": {"made up": "1"}, "precision": "float64", "expressed": ["connect"]}
        columns = finish({name: np.array(values) for name, values in rows.items()}, ask)
        family.write_answer(folder, {**document, "not_expressible": [], "facts": {**facts, **FACTS}}, columns)


main()
'''

FAKES = {
    "true": "",
    "wrong": "def answer(model, data, row):\n    return 1.01 * data.qacc, data.qfrc_constraint.copy()",
    "without_jdotv": "def answer(model, data, row):\n    return solved(model, data, curvature=False)",
    "single": """
def answer(model, data, row):
    return data.qacc.astype(np.float32), data.qfrc_constraint.astype(np.float32)
""",
    "single_without_jdotv": """
def answer(model, data, row):
    qacc, force = solved(model, data, curvature=False)
    return qacc.astype(np.float32), force.astype(np.float32)
""",
    "drops_a_row": "def prepare(model):\n    model.eq_active0[0] = 0",
    "exact": """
def prepare(model):
    model.eq_solimp[:, :2] = 1.0 - 1e-15

def answer(model, data, row):
    J = data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv)
    terms = data.efc_KBIP[: data.ne]
    aref = data.efc_aref[: data.ne] + terms[:, 1] * data.efc_vel[: data.ne]
    aref = aref + terms[:, 0] * terms[:, 2] * data.efc_pos[: data.ne]
    back = np.zeros(J.shape)
    mujoco.mj_solveM(model, data, back, J)
    force = np.linalg.pinv(back @ J.T, rcond=1e-12) @ (aref - J @ data.qacc_smooth)
    return data.qacc_smooth + back.T @ force, J.T @ force
""",
    "softer": "def prepare(model):\n    model.eq_solref[:, 0] = 0.2",
    "narrower": "def prepare(model):\n    model.eq_solimp[:, 1] = model.eq_solimp[:, 0]",
    "other_forces": "def answer(model, data, row):\n    return data.qacc.copy(), -3.0 * data.qfrc_constraint",
    "torn_run": """
def finish(columns, ask):
    if ask.question == "run":
        columns["qpos"] = columns["qpos"] + np.linspace(0.0, 1.0, len(columns["qpos"]))[:, None] * np.arange(1, 4)
    return columns
""",
    "longer_step": """
def finish(columns, ask):
    if ask.question == "step":
        columns["qvel"] = ask.states["qvel"] + 5.0 * (columns["qvel"] - ask.states["qvel"])
    return columns
""",
    "wild_run": """
def finish(columns, ask):
    if ask.question == "run":
        columns["qpos"][-1] = np.nan
        columns["qvel"][-1] = np.inf
    return columns
""",
    "other_cone": """
def prepare(model):
    kinds = mujoco.mjtCone
    elliptic = int(model.opt.cone) == int(kinds.mjCONE_ELLIPTIC)
    model.opt.cone = kinds.mjCONE_PYRAMIDAL if elliptic else kinds.mjCONE_ELLIPTIC
""",
    "lighter": """
def prepare(model):
    model.body_mass[1] *= 0.5
    model.body_inertia[1] *= 0.5
    mujoco.mj_setConst(model, mujoco.MjData(model))
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in range(1, model.nbody)]
    FACTS["body_masses"] = dict(zip(names, model.body_mass[1:].tolist()))
    FACTS["total_mass"] = float(model.body_mass.sum())
""",
    "other_weights": """
def prepare(model):
    model.body_invweight0 *= 3.0
    FACTS["compiled_apart"] = {"body_invweight0": model.body_invweight0.ravel().tolist()}
""",
    "remembers": """
def answer(model, data, row):
    return solved(model, data, curvature=False)

def again(model, data, row):
    return data.qacc.copy()
""",
    "crashes": "print('a word before', file=sys.stderr)\nprint('it is broken', file=sys.stderr)\nsys.exit(7)",
    "dies": "os.kill(os.getpid(), 9)",
    "hangs": """
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open(os.environ["OARLOCK_TEST_NOTES"], "a").write(f"{os.getpid()} {child.pid}\\n")
time.sleep(600)
""",
    "nan": """
def answer(model, data, row):
    return data.qacc * (np.nan if row == 1 else 1.0), data.qfrc_constraint.copy()
""",
    "half": """
def finish(columns, ask):
    return {name: values[: len(values) // 2] for name, values in columns.items()}
""",
    "wrong_size": "def answer(model, data, row):\n    return data.qacc[:-1], data.qfrc_constraint.copy()",
    "cannot": """
for ask, folder in family.questions():
    family.refuse(folder, {"engine": "made up", "versions": {}, "precision": "float64"},
                  [{"element": "equality 'pin'", "why": "no such thing"}])
family.end(True)
""",
}


def program(folder: Path, name: str, questions: str = '"forward", "step", "run"') -> Path:
    """Writes a made-up program; returns its path."""
    path = folder / f"{name}.py"
    folder.mkdir(parents=True, exist_ok=True)
    text = HEAD.format(questions=questions) + BODY.replace("@CHANGED@", FAKES[name])
    path.write_text(text, encoding="utf-8")
    return path


def engine(folder: Path, name: str) -> Engine:
    """A made-up engine."""
    return parse_engine(str(program(folder, name)))
