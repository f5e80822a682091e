# /// script
# requires-python = ">=3.9"
# dependencies = ["mujoco>=3.3", "numpy"]
#
# [tool.oarlock]
# title = "MuJoCo, C, any version"
# package = "mujoco"
# beside = true
# several = true
# questions = ["forward", "step", "run"]
# equalities = ["connect", "weld", "joint", "tendon", "flex"]
# settings = ["tolerance", "ls_tolerance", "iterations", "ls_iterations"]
# ///
"""MuJoCo itself, of any version: compiles the model anew, and asks ``mj_forward`` and ``mj_step``."""

import mujoco
import numpy as np
from shared import family


def _jdotv(model, data):
    joined = [int(getattr(mujoco.mjtEq, "mjEQ_" + kind)) for kind in ("CONNECT", "WELD")]
    ne = data.ne
    rows = np.isin(model.eq_type[np.asarray(data.efc_id[:ne], int)], joined) if ne else np.zeros(0, bool)
    aref, rate, gap = (np.array(array[:ne])[rows] for array in (data.efc_aref, data.efc_vel, data.efc_pos))
    laws = np.array(data.efc_KBIP[:ne]).reshape(ne, -1)[rows]
    return family.has_jdotv(aref, laws, rate, gap, "float64")


def _facts(model, data, ask):
    """What the rows hold, measured; also at velocities that no loop allows: closed ones may have J̇v = 0."""
    found, rows = [], 0
    numbers = np.random.default_rng(0)
    for row in np.flatnonzero(ask.states["qvel"].any(axis=1)):
        family.place(mujoco, model, data, ask, row)
        fastest = np.abs(data.qvel).max()
        for velocity in (data.qvel.copy(), fastest * numbers.uniform(-1.0, 1.0, model.nv)):
            data.qvel[:] = velocity
            mujoco.mj_forward(model, data)
            found.append(_jdotv(model, data))
        rows = max(rows, int(data.ne))
    return {**family.model_facts(mujoco, model, ask), "rows": rows, "jdotv": family.any_jdotv(found)}


def _states(model, data, ask):
    rows = {name: [] for name in ("qacc", "qfrc_constraint", "qacc_again", "qpos", "qvel")}
    for row in range(len(ask)):
        family.place(mujoco, model, data, ask, row)
        mujoco.mj_forward(model, data)
        rows["qacc"].append(data.qacc.copy())
        rows["qfrc_constraint"].append(data.qfrc_constraint.copy())
        mujoco.mj_forward(model, data)
        rows["qacc_again"].append(data.qacc.copy())
        if ask.question == "step":
            mujoco.mj_step(model, data)
        rows["qpos"].append(data.qpos.copy())
        rows["qvel"].append(data.qvel.copy())
    return {"time": ask.states["time"], **{name: np.array(values) for name, values in rows.items()}}


def _run(model, data, ask):
    steps, every = ask.document["steps"], ask.document["every"]
    rows = {name: [] for name in ("time", "qacc", "qfrc_constraint", "qpos", "qvel", "loop_error")}
    family.place(mujoco, model, data, ask, 0)
    widest = 0.0
    for step in range(1, steps + 1):
        mujoco.mj_step(model, data)
        if step % every and step != steps:
            mujoco.mj_fwdPosition(model, data)
        else:
            mujoco.mj_forward(model, data)
        widest = max(widest, float(np.abs(data.efc_pos[: data.ne]).max(initial=0.0)))
        if step % every and step != steps:
            continue
        for name in ("qacc", "qfrc_constraint", "qpos", "qvel"):
            rows[name].append(getattr(data, name).copy())
        rows["time"].append(data.time)
        rows["loop_error"].append(widest)
        widest = 0.0
        family.progress(step, steps)
    return {name: np.array(values) for name, values in rows.items()}


def main():
    """Answers every question."""
    for ask, answer in family.questions():
        model = family.compile_mujoco(mujoco, ask)
        data = mujoco.MjData(model)
        document = {"engine": "mujoco", "versions": {"mujoco": mujoco.__version__}, "precision": "float64"}
        document |= {"expressed": ["connect", "weld", "joint", "tendon", "flex"], "not_expressible": []}
        document["facts"] = _facts(model, data, ask)
        columns = _run(model, data, ask) if ask.question == "run" else _states(model, data, ask)
        family.write_answer(answer, document, columns)


if __name__ == "__main__":
    main()
