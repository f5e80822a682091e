"""Names, units and equalities of a model."""

from dataclasses import dataclass

import mujoco
import numpy as np


def element_name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """Name of an element, or its number in ``#`` form where it has none."""
    return mujoco.mj_id2name(model, kind, index) or f"#{index}"


def coordinates(model: mujoco.MjModel) -> list[dict[str, str]]:
    """Name and unit of every entry of qpos: the joint's name, numbered where a joint has several."""
    entries = []
    for index in range(model.njnt):
        name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, index)
        kind = mujoco.mjtJoint(model.jnt_type[index])
        if kind == mujoco.mjtJoint.mjJNT_HINGE:
            entries.append({"name": name, "unit": "rad"})
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            entries.append({"name": name, "unit": "m"})
        else:
            lengths = 3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0
            entries += [{"name": f"{name}[{i}]", "unit": "m" if i < lengths else "–"} for i in range(lengths + 4)]
    return entries


@dataclass(frozen=True)
class Equality:
    """One equality element, for messages, figures and J̇v."""

    index: int
    name: str
    kind: str
    bodies: tuple[int, int]
    """Body ids of the ends of a connect or weld; 0 is the world. (0, 0) for other kinds."""
    sites: tuple[int, int] | None
    """Site ids, for a connect or weld between sites."""
    rows: int
    """Rows that it has while it is active; 0 where they are not known."""
    unit: str
    """Unit of its rows' deviations."""

    def anchor(self, model: mujoco.MjModel, end: int) -> np.ndarray:
        """Anchor of a connect or weld between bodies: the point of that end's body (0 or 1), body frame, (3), m."""
        # A connect keeps the first body's anchor first, a weld the second body's.
        start = 3 * end if self.kind == "connect" else 3 * (1 - end)
        return model.eq_data[self.index, start : start + 3].copy()


_KINDS = {
    mujoco.mjtEq.mjEQ_CONNECT: ("connect", 3),
    mujoco.mjtEq.mjEQ_WELD: ("weld", 6),
    mujoco.mjtEq.mjEQ_JOINT: ("joint", 1),
    mujoco.mjtEq.mjEQ_TENDON: ("tendon", 1),
}


def equalities(model: mujoco.MjModel) -> list[Equality]:
    """Every equality of the model, active or not."""
    found = []
    for index in range(model.neq):
        kind, rows = _KINDS.get(mujoco.mjtEq(model.eq_type[index]), ("flex", 0))
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        bodies, sites = (0, 0), None
        if kind in ("connect", "weld"):
            bodies = first, second
            if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
                sites = first, second
                bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
        found.append(Equality(index, name, kind, bodies, sites, rows, _unit(model, kind, first)))
    return found


def _unit(model: mujoco.MjModel, kind: str, first: int) -> str:
    slides = mujoco.mjtJoint.mjJNT_SLIDE
    if kind == "joint":
        return "m" if model.jnt_type[first] == slides else "rad"
    if kind == "tendon":
        start, count = int(model.tendon_adr[first]), int(model.tendon_num[first])
        if model.wrap_type[start] == mujoco.mjtWrap.mjWRAP_JOINT:
            joints = model.wrap_objid[start : start + count]
            units = {"m" if model.jnt_type[joint] == slides else "rad" for joint in joints}
            return units.pop() if len(units) == 1 else "m or rad"
    return "m or rad" if kind in ("weld", "flex") else "m"
