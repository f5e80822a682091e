# /// script
# requires-python = ">=3.10"
# dependencies = ["mujoco-mjx>=3.3,<4", "mujoco>=3.3,<4", "jax", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "MJX, MuJoCo in JAX, on the processor"
# package = "mujoco-mjx"
# together = ["mujoco"]
# several = true
# questions = ["forward", "step", "run"]
# precisions = ["float64", "float32"]
# equalities = ["connect", "weld", "joint", "tendon"]
# settings = ["tolerance", "ls_tolerance", "iterations", "ls_iterations"]
# ///
"""MJX takes the model that its own MuJoCo compiles; one compiled function advances a state by any number of steps."""

import os
from functools import partial
from importlib.metadata import version

os.environ.setdefault("JAX_PLATFORMS", "cpu")
# Steps are few: what compilation saves counts for more than what it makes.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from shared import family

LOOKS = 8
"""Moving states at most whose reference accelerations are looked at."""


def _arrays(data):
    """Where MJX keeps the arrays of its rows, which differs by version."""
    return getattr(data, "_impl", data)


def _jdotv(model, state, ask, row, precision):
    """By the reference accelerations that MJX asks of its rows, beside the law of MuJoCo's own."""
    data = mujoco.MjData(model)
    family.place(mujoco, model, data, ask, row)
    mujoco.mj_forward(model, data)
    joined = [int(getattr(mujoco.mjtEq, "mjEQ_" + kind)) for kind in ("CONNECT", "WELD")]
    ne = data.ne
    try:
        aref, gap = np.array(_arrays(state).efc_aref)[:ne], np.array(_arrays(state).efc_pos)[:ne]
    except AttributeError:
        return "unknown"
    # Both have connects, then welds, then joints in front; where the order of the gaps differs nothing can be said.
    if len(aref) < ne or np.abs(gap - data.efc_pos[:ne]).max(initial=0.0) > 1e-4:
        return "unknown"
    rows = np.isin(model.eq_type[np.asarray(data.efc_id[:ne], int)], joined)
    laws = np.array(data.efc_KBIP[:ne]).reshape(ne, -1)
    return family.has_jdotv(aref[rows], laws[rows], np.array(data.efc_vel[:ne])[rows], gap[rows], precision)


def _placed(start, ask, row):
    states = {name: jnp.asarray(ask.states[name][row]) for name in ("qpos", "qvel", "act", "ctrl")}
    return start.replace(time=jnp.asarray(ask.states["time"][row], dtype=start.time.dtype), **states)


def _compiled():
    """Functions of a device's model and a state: forward, and so many steps. Numbers of the model are arguments too."""

    def step(device, state):
        # A loop wants the types that it was begun with; of tendons MJX widens some numbers of elements.
        after = mjx.step(device, state)
        return jax.tree_util.tree_map(lambda new, old: jnp.asarray(new, old.dtype), after, state)

    def advance(device, state, steps):
        return jax.lax.fori_loop(0, steps, lambda _, one: step(device, one), state)

    return jax.jit(mjx.forward), jax.jit(advance)


def _states(start, ask, forward_of, advance):
    rows = {name: [] for name in ("qacc", "qfrc_constraint", "qacc_again", "qpos", "qvel")}
    for row in range(len(ask)):
        state = _placed(start, ask, row)
        answered = forward_of(state)
        rows["qacc"].append(np.array(answered.qacc))
        rows["qfrc_constraint"].append(np.array(answered.qfrc_constraint))
        rows["qacc_again"].append(np.array(forward_of(answered).qacc))
        after = advance(state, 1) if ask.question == "step" else state
        rows["qpos"].append(np.array(after.qpos))
        rows["qvel"].append(np.array(after.qvel))
        family.progress(row + 1, len(ask))
    return {"time": ask.states["time"], **{name: np.array(values) for name, values in rows.items()}}


def _run(start, ask, forward_of, advance):
    steps, every = ask.document["steps"], ask.document["every"]
    rows = {name: [] for name in ("time", "qacc", "qfrc_constraint", "qpos", "qvel")}
    state, done = _placed(start, ask, 0), 0
    while done < steps:
        count = min(every, steps - done)
        state = advance(state, count)
        done += count
        answered = forward_of(state)
        for name in ("qacc", "qfrc_constraint"):
            rows[name].append(np.array(getattr(answered, name)))
        for name in ("qpos", "qvel"):
            rows[name].append(np.array(getattr(state, name)))
        rows["time"].append(float(ask.states["time"][0]) + done * ask.document["timestep"])
        family.progress(done, steps)
    return {name: np.array(values) for name, values in rows.items()}


def main():
    """Answers every question; functions are compiled once for questions of one model and precision."""
    made = {}
    for ask, answer in family.questions():
        jax.config.update("jax_enable_x64", ask.precision == "float64")
        model = family.compile_mujoco(mujoco, ask)
        document = {"engine": "mjx", "precision": ask.precision, "expressed": ["connect", "weld", "joint", "tendon"]}
        document["versions"] = {
            "mujoco-mjx": version("mujoco-mjx"),
            "mujoco": mujoco.__version__,
            "jax": version("jax"),
        }
        try:
            device = mjx.put_model(model)
            start = mjx.make_data(device)
        except NotImplementedError as error:
            family.refuse(answer, document, [{"element": "model", "why": str(error)}])
            family.end(True)
        if ask.precision not in made:
            made[ask.precision] = _compiled()
        functions = [partial(function, device) for function in made[ask.precision]]
        family.progress(0, 1)
        columns = (_run if ask.question == "run" else _states)(start, ask, *functions)
        moving = np.flatnonzero(ask.states["qvel"].any(axis=1))[:LOOKS]
        states = [functions[0](_placed(start, ask, row)) for row in moving]
        found = [_jdotv(model, state, ask, row, ask.precision) for row, state in zip(moving, states)]  # noqa: B905
        facts = {**family.model_facts(mujoco, model, ask), "jdotv": family.any_jdotv(found)}
        facts["rows"] = int(max((getattr(_arrays(state), "ne", 0) or 0 for state in states), default=0))
        family.write_answer(answer, {**document, "not_expressible": [], "facts": facts}, columns)
    family.end(False)


if __name__ == "__main__":
    main()
