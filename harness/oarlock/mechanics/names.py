"""Names, units and equalities of a model."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.cases.equality_kinds import KIND_OF, EqualityKind, unknown
from oarlock.mechanics.coupled import coupled, coupled_ids

_EQUALITY, _JOINT, _GEOM = mujoco.mjtObj.mjOBJ_EQUALITY, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_GEOM
_BODY, _SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE

_NUMBERS = {f"mjEQ_{element.upper()}": kind for element, kind in KIND_OF.items()}
_KINDS = {int(getattr(mujoco.mjtEq, name)): kind for name, kind in _NUMBERS.items() if hasattr(mujoco.mjtEq, name)}


def element_name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """Name of an element. An equality, joint or geom without one goes by its bodies, what else has none by number, #3.

    Such as ``connect of 'coupler' and 'rocker'`` or ``joint of 'crank'``; numbered where several would be alike.
    """
    if name := mujoco.mj_id2name(model, kind, index):
        return name
    describe = _DESCRIBED.get(kind)
    if describe is None or not (said := describe(model, index)):
        return f"#{index}"
    alike = sum(not mujoco.mj_id2name(model, kind, one) and describe(model, one) == said for one in range(index))
    return f"{said} ({alike + 1})" if alike else said


def _equality(model: mujoco.MjModel, index: int) -> str:
    kind = _KINDS[int(model.eq_type[index])]
    if not kind.known:
        return ""
    ids = coupled_ids(model, index)
    sort = _BODY if kind.joins_points else coupled(kind).object_type
    if kind.joins_points and model.eq_objtype[index] == _SITE:
        ids = [int(model.site_bodyid[site]) for site in ids]
    return f"{kind} of {' and '.join(quoted(element_name(model, sort, one)) for one in ids)}"


def _joint(model: mujoco.MjModel, index: int) -> str:
    return f"joint of {quoted(element_name(model, _BODY, int(model.jnt_bodyid[index])))}"


def _geom(model: mujoco.MjModel, index: int) -> str:
    return f"geom of {quoted(element_name(model, _BODY, int(model.geom_bodyid[index])))}"


_DESCRIBED = {_EQUALITY: _equality, _JOINT: _joint, _GEOM: _geom}


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
    kind: EqualityKind
    bodies: tuple[int, int]
    """Body ids of the ends of one that joins points; 0 is the world. (0, 0) for others."""
    sites: tuple[int, int] | None
    """Site ids, where points of sites are joined."""
    unit: str
    """Unit of its rows' deviations."""

    @property
    def rows(self) -> int:
        """Rows that it has while it is active.

        Raises:
            InputError: their number depends on the model (flex).
        """
        if self.kind.rows is None:
            raise unknown(self.name, self.kind)
        return self.kind.rows

    def anchor(self, model: mujoco.MjModel, end: int) -> np.ndarray:
        """Where it joins the body of an end (0 or 1), if it joins no sites: a point in the body's frame, (3), m."""
        # What holds an orientation too keeps the second body's anchor first.
        start = 3 * (1 - end) if self.kind.turns else 3 * end
        return model.eq_data[self.index, start : start + 3].copy()

    def torque_scale(self, model: mujoco.MjModel) -> float:
        """Factor of its rotation rows, m/rad; 0 where it has none."""
        return float(model.eq_data[self.index, 10]) if self.kind.turns else 0.0

    def document(self) -> dict[str, Any]:
        """For JSON; ``rows`` is null where their number depends on the model."""
        return {
            "index": self.index,
            "name": self.name,
            "kind": self.kind.name,
            "bodies": self.bodies,
            "sites": self.sites,
            "rows": self.kind.rows,
            "unit": self.unit,
        }


def equalities(model: mujoco.MjModel) -> list[Equality]:
    """Every equality of the model, active or not."""
    found = []
    for index in range(model.neq):
        kind = _KINDS[int(model.eq_type[index])]
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        bodies, sites = (0, 0), None
        if kind.joins_points:
            bodies = first, second
            if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
                sites = first, second
                bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        name = element_name(model, _EQUALITY, index)
        unit = kind.own_unit or coupled(kind).unit(model, first)
        found.append(Equality(index, name, kind, bodies, sites, unit))
    return found
