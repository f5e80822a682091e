"""L9: a coupling that loops, or couplings of another kind, turn against each other by another ratio."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.lever import Lever, find_lever
from oarlock.diagnosis.loops.loops import Loop
from oarlock.diagnosis.loops.mobility import admitted
from oarlock.diagnosis.loops.odd import Ask, oddest
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import Equality

DIGITS = 1e-9
"""Relative: a ratio that a rank computes is one of a few digits within that, and is taken for it."""

STILL = 1e-9
"""Of the fastest joint: a coupled joint that is slower does not move."""

ALL = "nothing can move"

SIDE, PATH = 0.5, 1.5
"""Oddness of a tendon that another side of a pulley mends, and of one of which only the lever is known."""


def look(view: View) -> Iterator[Remark]:
    """A remark a set of equalities that hold what is driven, or a whole group, and of which one moves otherwise."""
    if all(one.kind.joins_points for one in view.equalities) or not view.loops.closed:
        return
    for number, members, still in _sets(view):
        kinds = {view.loops.loops[one].equality.kind.holds for one in members}
        if len(kinds) > 1:  # rings of one kind are followed without a pose
            yield from _of(view, number, members, still)


def _sets(view: View) -> Iterator[tuple[int, list[int], str]]:
    """Groups with equalities that hold what is driven there, or else all of it, and what they hold in words."""
    seen: set[int] = set()
    for one in view.held:
        seen.add(one.group)
        names = few([quoted(name) for name in view.joints(one.dofs)], last="and")
        yield one.group, list(one.members), f"{names} cannot move" if view.loops.groups[one.group].dof else ALL
    for number, group in enumerate(view.loops.groups):
        if not group.dof and number not in seen:
            yield number, [member for member in view.loops.members(number) if view.loops.loops[member].freed], ALL


def _of(view: View, number: int, members: list[int], still: str) -> Iterator[Remark]:
    loops = view.loops.loops
    asked = [(one, ask) for one in members if (ask := _ask(view, number, loops[one], _others(members, one)))]
    asked = [asked[at] for at in oddest([ask for _, ask in asked], _beside(view, members))]
    levers = [
        (one, lever)
        for one in members
        if (lever := find_lever(view.assembly, view.loops, loops[one], _others(members, one)))
    ]
    ways: list[tuple[float, Callable[[], Remark | None]]] = [
        (ask.oddness, partial(_remark, view, number, (one, members), ask, still)) for one, ask in asked
    ]
    ways += [
        (SIDE if lever.sidesite else PATH, partial(_of_lever, view, (one, members), lever, still))
        for one, lever in levers
    ]
    for _, tell in sorted(ways, key=lambda way: way[0]):
        if found := tell():
            yield found
            return


def _of_lever(view: View, held: tuple[int, list[int]], lever: Lever, still: str) -> Remark:
    one, members = held
    said = f"contradicts {_named(view, members, one)}: {still}; {lever}"
    figures = {"also": _names(view, members, one), "lever": lever.given, "wanted": lever.wanted}
    return Remark("L9", said, view.loops.loops[one].name, figures=figures)


def _beside(view: View, members: Sequence[int]) -> list[Ask]:
    """The other straight couplings of two joints, with the ratios that they have."""
    own, found = {view.loops.loops[one].equality.index for one in members}, []
    for one in view.equalities:
        if one.index not in own and (given := _straight(view, one)):
            found.append(Ask(*given, wanted=given[1]))
    return found


def _others(members: Sequence[int], one: int) -> list[int]:
    return [other for other in members if other != one]


def _names(view: View, members: Sequence[int], one: int) -> list[str]:
    return [view.loops.loops[other].name for other in members if other != one]


def _named(view: View, members: Sequence[int], one: int) -> str:
    return few([quoted(name) for name in _names(view, members, one)], last="and")


def _ask(view: View, number: int, loop: Loop, rest: list[int]) -> Ask | None:
    """A straight coupling of two joints with the ratio by which the others of a set turn them; None of others."""
    given = _straight(view, loop.equality)
    if given is None:
        return None
    wanted = _ratio(view, number, coupled_ids(view.model, loop.equality.index), rest)
    return None if wanted is None else Ask(*given, wanted)


def _straight(view: View, one: Equality) -> tuple[tuple[int, int], float] | None:
    """Types of the two joints of a straight coupling, and its ratio; None of others."""
    polynomial = view.model.eq_data[one.index, :5]
    ids = coupled_ids(view.model, one.index) if one.kind.holds == "joints" else []
    if len(ids) != 2 or not polynomial[1] or polynomial[2:].any():
        return None
    return (int(view.model.jnt_type[ids[0]]), int(view.model.jnt_type[ids[1]])), float(polynomial[1])


def _ratio(view: View, number: int, ids: list[int], rest: list[int]) -> float | None:
    """By which some equalities turn two joints at the closed pose; None: by none in particular."""
    free = admitted(view.assembly, rest, view.loops.dofs(number), view.loops.qpos)
    both = free[:, [int(view.model.jnt_dofadr[joint]) for joint in ids]]
    sizes, directions = np.linalg.svd(both)[1:]
    if not len(sizes) or sizes[0] <= STILL or (len(sizes) > 1 and sizes[1] > STILL * sizes[0]):
        return None
    first, second = directions[0]
    if abs(second) <= STILL * abs(first) or abs(first) <= STILL * abs(second):
        return None
    ratio = float(first / second)
    plain = round(ratio, 6)
    return plain if abs(ratio - plain) <= DIGITS * abs(ratio) else ratio


def _remark(view: View, number: int, held: tuple[int, list[int]], ask: Ask, still: str) -> Remark | None:
    """What is said of a coupling with which its group moves once it has the other ratio; None where it does not."""
    (one, members), group = held, view.loops.groups[number]
    loop = view.loops.loops[one]
    polynomial = view.model.eq_data[loop.equality.index, :5]
    model, qpos = view.model, view.loops.qpos
    ids = coupled_ids(model, loop.equality.index)
    first, second = (qpos[model.jnt_qposadr[joint]] - model.qpos0[model.jnt_qposadr[joint]] for joint in ids)
    offset = float(first - ask.wanted * second)
    offset = 0.0 if abs(offset) <= DIGITS else offset

    def corrected(changed: mujoco.MjModel, data: mujoco.MjData, equality: Equality) -> None:
        changed.eq_data[equality.index, :2] = offset, ask.wanted

    if view.freedom(group, loop.equality, corrected) <= group.dof:
        return None
    given = float(polynomial[1])
    so = f"polycoef {offset:.6g} {ask.wanted:.6g}" if abs(offset - polynomial[0]) > DIGITS else ""
    so = so or f"the ratio {ask.wanted:.6g}"
    said = f"contradicts {_named(view, members, one)}: the rest turns {quoted(loop.ends[0])} and "
    said += f"{quoted(loop.ends[1])} by another ratio, and {still}; "
    if ask.swapped and not offset and not polynomial[0]:
        said += f"its {given:.6g} is that of {quoted(loop.ends[1])} by {quoted(loop.ends[0])}: with "
        said += f'joint1="{loop.ends[1]}" joint2="{loop.ends[0]}" it turns'
    else:
        said += f"with {so} in place of {given:.6g} it turns"
    also = _names(view, members, one)
    return Remark("L9", said, loop.name, figures={"also": also, "ratio": given, "wanted": ask.wanted})
