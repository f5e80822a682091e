"""Logs of states, as a program writes them whose motor is switched."""

import mujoco
import numpy as np
from mechanisms import four_bar

XML = four_bar(
    rest='<actuator><motor name="motor" joint="crank"/></actuator>'
    '<keyframe><key name="home" qvel="3 0 0" ctrl="0"/></keyframe>'
)
STEPS = 120


def logged(force=None, *, xml=XML, every=1):
    """What a loop of one's own writes down: a motor that is switched, and forces that the log does not have."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    rows = {"time": [], "qpos": [], "qvel": [], "ctrl": []}
    for step in range(STEPS):
        data.ctrl[0] = 0.4 if step < 60 else -0.7
        if force is not None:
            data.qfrc_applied[:] = force
        for name, values in rows.items():
            values.append(data.time if name == "time" else getattr(data, name).copy())
        mujoco.mj_step(model, data)
    return {name: np.array(values)[::every] for name, values in rows.items()}


def saved(folder, rows, kind="npz"):
    path = folder / f"log.{kind}"
    if kind == "npz":
        np.savez(path, **rows)
        return path
    columns = {"time": rows["time"][:, None], **{name: rows[name] for name in ("qpos", "qvel", "ctrl")}}
    names = ["time"] + [f"{name}{at}" for name in ("qpos", "qvel", "ctrl") for at in range(columns[name].shape[1])]
    np.savetxt(path, np.hstack(list(columns.values())), delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return path
