"""Welds that ask for another pose than was meant: a relpose in the wrong order or from elsewhere, or none.

A relpose that neither a pose nor the drawing explains (S7) is written as it was meant. A weld without one holds the
relative pose of the model's own pose: where nothing near a keyframe meets that inside of all ranges, the keyframe is
what was meant (S6), and its relative pose is written; and so it is where the keyframe stands open by more than ``FAR``
of the loops' size, and its servos are told to stay in it. Else the pose is moved, as of a coupling. Nothing is taken
with which the run opens further; of what S7 names, with which it opens more than ``NAMED`` times as far.
"""

from collections.abc import Iterator, Sequence

import mujoco

from oarlock.base.errors import InputError
from oarlock.base.text import quoted
from oarlock.diagnosis.edit.changes import Constants, RelativePose
from oarlock.diagnosis.edit.copy import require_room
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.fix.candidates import NAMED, UNMET, Offset, closes_inside, run_closed
from oarlock.diagnosis.fix.words import drifts
from oarlock.diagnosis.lint.defined import relative_pose
from oarlock.diagnosis.symptoms import start_of
from oarlock.mechanics.names import Equality, equalities
from oarlock.mechanics.servos import servos

FAR = 0.1
"""Of the size of the loops: a keyframe that stands open by more was posed so, and a weld is to hold it there."""

POSED = 1e-3
"""rad or m: a servo that is told where its joint stands in a keyframe, to so much, holds it there."""

HELD = "it has none of its own, and the servos hold the keyframe, which was posed elsewhere (S6)"

_MEANT = {4: "its quaternion was written as x y z w (S7)", 3: "that is how the bodies are drawn (S7)"}
"""How many numbers of a relpose a remark corrects → what speaks for them."""


def choose_relposes(bench: Bench, taken: Sequence[Constants]) -> tuple[list[Offset], list[str]]:
    """The relative poses that are off, and what is said of those that are not taken.

    Args:
        bench: runs the model.
        taken: constants of other equalities that are taken already.

    Raises:
        InputError: as of the runs.
    """
    chosen, said = list[Offset](), list[str]()
    if bench.exam.moved or bench.exam.pose is None:
        return chosen, said
    for one in [*_misread(bench), *_undefined(bench)]:
        now = [*taken, *(each.change for each in chosen)]
        try:
            require_room(bench.base.path, one.change)
        except InputError as error:
            said.append(f"{one}: {error}")
            continue
        if one.why == UNMET and not closes_inside(bench, now, one.change):
            said.append(f"{one}, which would close the start: the closed pose holds the weld as it is")
            continue
        without, with_it = run_closed(bench, now), run_closed(bench, [*now, one.change])
        most = NAMED * without.drift if one.why in _MEANT.values() else without.drift
        if with_it.drift > max(bench.target, most):
            said.append(f"{one}: {drifts(with_it)} with it, {drifts(without)} without it")
        else:
            chosen.append(one)
    return chosen, said


def _misread(bench: Bench) -> Iterator[Offset]:
    """Of welds that ask for what nobody drew."""
    for remark in bench.exam.remarks.get("relpose", []):
        one, wanted = _weld(bench, remark.element), list(remark.figures["wanted"])
        given = _given(bench, one)
        values = (*given[:3], *wanted) if len(wanted) == 4 else (*wanted, *given[3:])
        yield Offset(one, given, RelativePose(one.index, values), _MEANT[len(wanted)])


def _undefined(bench: Bench) -> Iterator[Offset]:
    """Of welds whose pose nobody wrote, and that the keyframe of the start has in another one."""
    data = bench.data(bench.base.model)
    mujoco.mj_kinematics(bench.base.model, data)
    for remark in bench.exam.remarks.get("defined", []):
        if "wanted" in remark.figures and f"keyframe {quoted(remark.figures['keyframe'])}" == bench.base.begins:
            one = _weld(bench, remark.element)
            values = tuple(float(f"{value:.12g}") for value in relative_pose(bench.base.model, data, one))
            why = HELD if remark.figures["gap"] > FAR * bench.exam.size and _posed(bench) else UNMET
            yield Offset(one, _given(bench, one), RelativePose(one.index, values), why)


def _posed(bench: Bench) -> bool:
    """Whether there are servos, and each is told where its joint stands at the start."""
    model, told = bench.base.model, start_of(bench.base).ctrl
    every = [(one, float(bench.base.qpos[model.jnt_qposadr[one.joint]])) for one in servos(model)]
    return bool(every) and all(
        abs(one.reached(one.told(model, float(told[one.index]))) - place) <= POSED for one, place in every
    )


def _weld(bench: Bench, name: str) -> Equality:
    return next(one for one in equalities(bench.base.model) if one.name == name)


def _given(bench: Bench, one: Equality) -> tuple[float, ...]:
    return tuple(bench.base.model.eq_data[one.index, RelativePose.at].tolist())
