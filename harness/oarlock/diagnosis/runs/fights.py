"""Which limits and contacts push against loops alone in the exact run, against which loops, and how hard.

Such a row w is in the range of the equality rows, w = J_eᵀ c: exact loops keep J a of it at zero, so that its force is
D aref, and c names the equalities that bear it.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.mechanics.inequalities import ELLIPTIC, KINDS, row_name, row_unit
from oarlock.mechanics.names import element_name
from oarlock.mechanics.reactions import VANISHES
from oarlock.mechanics.rows import jacobian

LOOKS = 32
"""Steps that are looked at, of those in which something is fought: the first, the last and some between."""

COUNTS = 1e-6
"""Of the largest force of such a push, and of all forces of the run: less is the rounding of a pose at which something
just touches."""


@dataclass(frozen=True)
class Fight:
    """What pushes against loops alone.

    Attributes:
        others: the limits and contacts, in words; equalities: the names of those that bear it.
        first_s: since when; largest: the largest force of one of them, of a contact along the normal; unit: of it.
    """

    others: tuple[str, ...]
    equalities: tuple[str, ...]
    first_s: float
    largest: float
    unit: str


def find_fight(model: mujoco.MjModel, exact: ExactRun) -> Fight | None:
    """Looks at states of the exact run; None if nothing is fought."""
    fought = np.flatnonzero(exact.blocked)
    if not len(fought):
        return None
    data = mujoco.MjData(model)
    others: dict[str, float] = {}
    equalities: dict[str, float] = {}
    units: dict[str, str] = {}
    for look in dict.fromkeys(np.linspace(0, len(fought) - 1, LOOKS).astype(int).tolist()):
        data.qpos[:] = exact.qpos[fought[look]]
        mujoco.mj_forward(model, data)
        pushes, bears = _look(model, data, units)
        for known, new in ((others, pushes), (equalities, bears)):
            for name, force in new.items():
                known[name] = max(known.get(name, 0.0), force)
    largest = max(others.values(), default=0.0)
    whole = max(float(np.abs(exact.force).max(initial=0.0)), float(np.abs(exact.loads).max(initial=0.0)))
    if largest <= COUNTS * whole:
        return None
    told = tuple(name for name, force in others.items() if force > COUNTS * largest)
    bearing = tuple(name for name, force in equalities.items() if force > COUNTS * largest)
    return Fight(
        told, bearing, float(exact.time[fought[0]]), largest, units[max(others, key=lambda name: others[name])]
    )


def _look(
    model: mujoco.MjModel, data: mujoco.MjData, units: dict[str, str]
) -> tuple[dict[str, float], dict[str, float]]:
    """Forces at one state of those that push against loops alone, by name, and what each equality bears of them.

    Puts their units into ``units``.
    """
    ne, kinds, owners = data.ne, data.efc_type.tolist(), data.efc_id.tolist()
    rows = jacobian(model, data)
    sizes = np.linalg.norm(rows, axis=1)
    held = np.flatnonzero(sizes[:ne] > 0.0)
    if not len(held) or data.nefc == ne:
        return {}, {}
    unit = (rows[held] / sizes[held, None]).T
    borne = np.linalg.lstsq(unit, rows[ne:].T, rcond=VANISHES)[0].T
    left = np.linalg.norm(borne @ unit.T - rows[ne:], axis=1)
    pushes: dict[str, float] = {}
    bears: dict[str, float] = {}
    for row in range(ne, data.nefc):
        across = kinds[row] == ELLIPTIC and (kinds[row - 1], owners[row - 1]) == (
            kinds[row],
            owners[row],
        )
        force = float(data.efc_D[row] * data.efc_aref[row])
        if KINDS[kinds[row]] == "friction" or across or force <= 0.0 or not sizes[row]:
            continue
        if left[row - ne] > VANISHES * sizes[row]:
            continue
        parts = borne[row - ne]
        name = row_name(model, data, row)
        pushes[name] = pushes.get(name, 0.0) + force
        units[name] = row_unit(model, data, row)
        for part, equality in zip(parts.tolist(), data.efc_id[held].tolist(), strict=True):
            if abs(part) > COUNTS * sizes[row]:
                named = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, equality)
                bears[named] = max(bears.get(named, 0.0), force)
    return pushes, bears
