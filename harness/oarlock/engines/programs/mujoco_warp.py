# /// script
# requires-python = ">=3.10"
# dependencies = ["mujoco-warp>=3.5", "mujoco>=3.5", "warp-lang", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "MuJoCo Warp, on the processor"
# package = "mujoco-warp"
# together = ["mujoco"]
# several = true
# questions = ["forward", "step", "run"]
# precisions = ["float32"]
# equalities = ["connect", "weld", "joint", "tendon"]
# settings = ["tolerance", "ls_tolerance", "iterations", "ls_iterations"]
# ///
"""MuJoCo Warp takes the model that its own MuJoCo compiles; states are worlds of one batch."""

import mujoco
import mujoco_warp
import numpy as np
import warp
from shared import family

warp.config.quiet = True


def _written(array, values):
    array.assign(np.asarray(values, dtype=np.float32).reshape(array.shape))


class Engine:
    """A model on the processor, and a batch of worlds."""

    def __init__(self, model, worlds):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self.model = mujoco_warp.put_model(model)
        # Room for every row that the model can have: that of one pose may be less.
        room = {"njmax": max(64, 4 * (data.nefc + 16)), "nconmax": max(64, 4 * (data.ncon + 8))}
        self.data = mujoco_warp.put_data(model, data, nworld=worlds, **room)

    def place(self, states, row=None):
        """Writes the states of all worlds, or one state to all."""
        chosen = slice(None) if row is None else slice(row, row + 1)
        worlds = self.data.qpos.shape[0]
        for name in ("qpos", "qvel", "act", "ctrl"):
            values = states[name][chosen]
            if values.shape[1]:
                _written(getattr(self.data, name), np.repeat(values, worlds // len(values), axis=0))
        _written(self.data.time, np.repeat(states["time"][chosen], worlds // len(states["time"][chosen])))
        self.data.qacc_warmstart.zero_()

    def read(self, name):
        """An array of all worlds."""
        return getattr(self.data, name).numpy().astype(float)


def _jdotv(model, engine, ask, row):
    data = mujoco.MjData(model)
    family.place(mujoco, model, data, ask, row)
    mujoco.mj_forward(model, data)
    joined = [int(getattr(mujoco.mjtEq, "mjEQ_" + kind)) for kind in ("CONNECT", "WELD")]
    ne = data.ne
    try:
        aref, gap = (getattr(engine.data.efc, name).numpy()[row][:ne] for name in ("aref", "pos"))
    except (AttributeError, IndexError):
        return "unknown"
    if len(aref) < ne or np.abs(gap - data.efc_pos[:ne]).max(initial=0.0) > 1e-4:
        return "unknown"
    # Rows of several equalities may come in another order than MuJoCo's: laws are told by the sum over all.
    rows = np.isin(model.eq_type[np.asarray(data.efc_id[:ne], int)], joined)
    laws = np.array(data.efc_KBIP[:ne]).reshape(ne, -1)
    if not rows.all() or np.ptp(laws[:, :2], axis=0).max() > 0.0:
        return "unknown"
    return family.has_jdotv(aref, laws, np.array(data.efc_vel[:ne]), gap, "float32")


def _states(engine, ask):
    engine.place(ask.states)
    mujoco_warp.forward(engine.model, engine.data)
    columns = {name: engine.read(name) for name in ("qacc", "qfrc_constraint")}
    engine.place(ask.states)
    mujoco_warp.forward(engine.model, engine.data)
    columns["qacc_again"] = engine.read("qacc")
    if ask.question == "step":
        engine.place(ask.states)
        mujoco_warp.step(engine.model, engine.data)
    columns |= {name: engine.read(name) for name in ("qpos", "qvel")}
    return {"time": ask.states["time"], **columns}


def _run(engine, ask):
    steps, every = ask.document["steps"], ask.document["every"]
    rows = {name: [] for name in ("time", "qacc", "qfrc_constraint", "qpos", "qvel")}
    engine.place(ask.states, 0)
    for step in range(1, steps + 1):
        mujoco_warp.step(engine.model, engine.data)
        if step % every and step != steps:
            continue
        for name in ("qacc", "qfrc_constraint", "qpos", "qvel"):
            rows[name].append(engine.read(name)[0])
        rows["time"].append(float(ask.states["time"][0]) + step * ask.document["timestep"])
        family.progress(step, steps)
    return {name: np.array(values) for name, values in rows.items()}


def main():
    """Answers every question."""
    refused = False
    for ask, answer in family.questions():
        model = family.compile_mujoco(mujoco, ask)
        document = {"engine": "mujoco_warp", "precision": "float32"}
        document["expressed"] = ["connect", "weld", "joint", "tendon"]
        versions = {"mujoco-warp": mujoco_warp.__version__, "mujoco": mujoco.__version__}
        document["versions"] = {**versions, "warp-lang": warp.__version__}
        try:
            engine = Engine(model, 1 if ask.question == "run" else len(ask))
        except NotImplementedError as error:
            family.refuse(answer, document, [{"element": "model", "why": str(error)}])
            refused = True
            continue
        family.progress(0, 1)
        facts = {**family.model_facts(mujoco, model, ask), "rows": int(np.max(engine.data.ne.numpy()))}
        if ask.question == "run":
            columns, facts["jdotv"] = _run(engine, ask), "unknown"
        else:
            columns = _states(engine, ask)
            engine.place(ask.states)
            mujoco_warp.forward(engine.model, engine.data)
            # Asked twice: its rows take J̇v from the velocities of the call before.
            mujoco_warp.forward(engine.model, engine.data)
            moving = np.flatnonzero(ask.states["qvel"].any(axis=1))
            facts["jdotv"] = family.any_jdotv([_jdotv(model, engine, ask, row) for row in moving])
        family.write_answer(answer, {**document, "not_expressible": [], "facts": facts}, columns)
    family.end(refused)


if __name__ == "__main__":
    main()
