"""L9: a coupling of two joints that a loop turns against each other by another ratio."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.loops import Group, Loop
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import Equality

DIGITS = 1e-9
"""Relative: a ratio that a rank computes is one of a few digits within that, and is taken for it."""

STILL = 1e-9
"""Of the fastest joint: a coupled joint that is slower does not move."""


def look(view: View) -> Iterator[Remark]:
    """A remark a coupling in a locked loop that moves with another ratio of it."""
    if not any(one.kind.holds == "joints" for one in view.equalities) or not view.loops.closed:
        return
    for number, group in enumerate(view.loops.groups):
        own = [view.loops.loops[member] for member in view.loops.members(number)]
        others = [one.name for one in own if one.freed and one.equality.kind.joins_points]
        if group.dof or not others:
            continue
        for loop in own:
            if (
                loop.freed
                and loop.equality.kind.holds == "joints"
                and (found := _of(view, number, group, loop, others))
            ):
                yield found
                break


def _of(view: View, number: int, group: Group, loop: Loop, others: list[str]) -> Remark | None:
    polynomial = view.model.eq_data[loop.equality.index, :5]
    ids = coupled_ids(view.model, loop.equality.index)
    if len(ids) != 2 or not polynomial[1] or polynomial[2:].any():
        return None
    wanted = _ratio(view, number, loop)
    if wanted is None:
        return None
    model, qpos = view.model, view.loops.qpos
    first, second = (qpos[model.jnt_qposadr[joint]] - model.qpos0[model.jnt_qposadr[joint]] for joint in ids)
    offset = float(first - wanted * second)
    offset = 0.0 if abs(offset) <= DIGITS else offset

    def corrected(changed: mujoco.MjModel, data: mujoco.MjData, equality: Equality) -> None:
        changed.eq_data[equality.index, :2] = offset, wanted

    if not view.freedom(group, loop.equality, corrected):
        return None
    names = few([quoted(name) for name in others])
    so = f"polycoef {offset:.6g} {wanted:.6g}" if abs(offset - polynomial[0]) > DIGITS else f"the ratio {wanted:.6g}"
    said = (
        f"contradicts {names}: the loop turns {quoted(loop.ends[0])} and {quoted(loop.ends[1])} by another ratio, and "
        f"nothing can move; with {so} in place of {polynomial[1]:.6g} it turns"
    )
    return Remark("L9", said, loop.name, figures={"also": others, "ratio": float(polynomial[1]), "wanted": wanted})


def _ratio(view: View, number: int, loop: Loop) -> float | None:
    """By which the rest of a group turns the joints of a coupling at the closed pose; None: by none in particular."""
    assembly, loops = view.assembly, view.loops
    assembly.place(loops.qpos)
    members = [one for one in loops.members(number) if loops.loops[one] is not loop]
    dofs = loops.dofs(number)
    rows = assembly.jacobian()[assembly.rows_of_all(members)][:, dofs]
    motion = np.zeros(view.model.nv)
    # Leaving the coupling out frees one motion, which the least singular value of the rest has.
    motion[dofs] = np.linalg.svd(rows)[2][-1]
    first, second = (motion[view.model.jnt_dofadr[joint]] for joint in coupled_ids(view.model, loop.equality.index))
    if loop.freed != 1 or abs(second) <= STILL * np.abs(motion).max():
        return None
    ratio = float(first / second)
    plain = round(ratio, 6)
    return plain if abs(ratio - plain) <= DIGITS * abs(ratio) else ratio
