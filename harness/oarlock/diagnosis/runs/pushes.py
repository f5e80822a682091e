"""What limits, friction loss and contacts do over a run: when each of them pushes, and how hard."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.mechanics.inequalities import ELLIPTIC, KINDS, Kind, row_name, row_unit

SLIPS = 1.0 - 1e-9
"""Of the friction loss: a force as large as that slips, and is rounded."""


@dataclass
class Push:
    """One limit, one friction loss, or the contact of two geoms over a run.

    Attributes:
        kind: which of the three; name: what it is of, in words.
        first_s, last_s: when it pushed first and last, s.
        steps: in how many steps it pushed.
        stuck: in how many of them a friction was below its loss.
        largest: its largest force; of a contact along the normal, all its points together; unit: N m about a hinge or
            ball, else N.
        geoms: of a contact, the numbers of its two.
    """

    kind: Kind
    name: str
    first_s: float
    last_s: float
    steps: int = 0
    stuck: int = 0
    largest: float = 0.0
    unit: str = "N"
    geoms: tuple[int, ...] = ()


class Pushes:
    """Takes down the pushes of one run, step by step."""

    def __init__(self, model: mujoco.MjModel):
        self._model = model
        self._names: dict[tuple[int, ...], str] = {}
        self._found: dict[tuple[int, ...], Push] = {}

    @property
    def found(self) -> tuple[Push, ...]:
        """In the order in which they began."""
        return tuple(self._found.values())

    def take(self, data: mujoco.MjData) -> None:
        """Takes a state whose forces are known."""
        ne, nefc = data.ne, data.nefc
        if nefc == ne:
            return
        kinds, owners = data.efc_type[ne:nefc].tolist(), data.efc_id[ne:nefc].tolist()
        forces = data.efc_force[ne:nefc]
        together: dict[tuple[int, ...], tuple[int, float]] = {}
        for row, (kind, owner, force) in enumerate(zip(kinds, owners, forces.tolist(), strict=True)):
            of = KINDS[kind]
            if of != "contact":
                together[kind, owner] = row, force
                continue
            geoms = tuple(sorted(int(geom) for geom in data.contact[owner].geom))
            # A friction loss or a limit before it may have the same number.
            across = row > 0 and (kinds[row - 1], owners[row - 1]) == (kind, owner)
            normal = kind != ELLIPTIC or not across
            first, sum_ = together.get((-1, *geoms), (row, 0.0))
            together[(-1, *geoms)] = first, sum_ + (force if normal else 0.0)
        for key, (row, force) in together.items():
            self._add(data, key, ne + row, force)

    def _add(self, data: mujoco.MjData, key: tuple[int, ...], row: int, force: float) -> None:
        if force == 0.0:
            return
        if key not in self._found:
            kind = KINDS[int(data.efc_type[row])]
            self._found[key] = Push(kind, row_name(self._model, data, row), data.time, data.time)
            self._found[key].unit = row_unit(self._model, data, row)
            self._found[key].geoms = key[1:] if kind == "contact" else ()
        push = self._found[key]
        push.last_s, push.largest = data.time, max(push.largest, abs(force))
        push.steps += 1
        push.stuck += push.kind == "friction" and abs(force) < SLIPS * float(data.efc_frictionloss[row])


def pushing_rows(data: mujoco.MjData) -> np.ndarray:
    """Rows of limits, contacts and friction that hold something at a state in a rigid model.

    Those of limits and normals of contacts that push, of friction losses that stick, and all rows of a contact that
    sticks.
    """
    ne, found = data.ne, []
    kinds, owners = data.efc_type.tolist(), data.efc_id.tolist()
    row = ne
    while row < data.nefc:
        kind, force, width = kinds[row], float(data.efc_force[row]), 1
        of = KINDS[kind]
        if of == "friction":
            holds = abs(force) < SLIPS * float(data.efc_frictionloss[row])
            found += [row] if holds else []
        elif kind == ELLIPTIC:
            contact = data.contact[owners[row]]
            width = int(contact.dim)
            across = data.efc_force[row + 1 : row + width] / contact.friction[: width - 1]
            sticks = float(np.linalg.norm(across)) < SLIPS * force
            found += list(range(row, row + (width if sticks else 1))) if force > 0.0 else []
        elif force > 0.0:
            found.append(row)
        row += width
    return np.array(found, dtype=int)
