"""What lints say of models in tests, and plain MuJoCo beside it."""

import mujoco
import numpy as np
from oarlock.diagnosis.lint.lints import look
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.load import collected_warnings, load_model
from places import FIXTURES

CHECK = FIXTURES / "check"


def view_of(model: mujoco.MjModel, key: int | None = None) -> View:
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    return View(model, data)


def of_text(text: str, key: int | None = None) -> list[Remark]:
    found = look(view_of(mujoco.MjModel.from_xml_string(text), key))
    return [one for remarks in found.values() for one in remarks]


def of_file(name: str) -> list[Remark]:
    model = load_model(CHECK / name)
    found = look(view_of(model, 0 if model.nkey else None))
    return [one for remarks in found.values() for one in remarks]


def text_of(name: str) -> str:
    return (CHECK / name).read_text(encoding="utf-8")


def only(remarks: list[Remark], code: str) -> Remark:
    (one,) = [one for one in remarks if one.code == code]
    return one


def runs(text: str, seconds: float = 1.0, key: int | None = 0, timestep: float | None = None):
    """States of a run of plain MuJoCo, as (model, data) after each step; it ends where a number is not finite."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    model.opt.timestep = timestep or model.opt.timestep
    data = mujoco.MjData(model)
    if key is not None and model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, key)
    with collected_warnings():
        for _ in range(round(seconds / model.opt.timestep)):
            mujoco.mj_step(model, data)
            if not np.isfinite(data.qpos).all() or np.abs(data.qvel).max() > 1e8:
                return
            yield model, data


def lasts(text: str, seconds: float = 1.0, **given) -> bool:
    model = mujoco.MjModel.from_xml_string(text)
    steps = round(seconds / (given.get("timestep") or model.opt.timestep))
    return sum(1 for _ in runs(text, seconds, **given)) == steps


def opens(text: str, seconds: float) -> float:
    """Largest distance of the two points of the first connect."""
    return max(float(np.linalg.norm(data.efc_pos[:3])) for _, data in runs(text, seconds))


def chain(couplings: str, joints: str = "abcd", ref: str = "") -> str:
    bodies = "".join(
        f'<body name="{name}" pos="0 {n} 0"><joint name="{name}" axis="0 1 0" {ref}/><geom size="0.1" mass="1"/></body>'
        for n, name in enumerate(joints)
    )
    return f"""<mujoco><option gravity="0 0 0"/><default><geom contype="0" conaffinity="0"/></default>
      <worldbody>{bodies}</worldbody><equality>{couplings}</equality></mujoco>"""
