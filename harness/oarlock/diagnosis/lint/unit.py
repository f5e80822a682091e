"""A2: numbers that look like degrees where MuJoCo takes radians, or the other way round.

MuJoCo's compiler converts ranges, ``ref`` and ``springref`` of hinges where angle="degree", the default; never a
ctrlrange, a polycoef or a keyframe. Only numbers are judged that would be strange as what MuJoCo makes of them, and
that are plain ones as what they are then taken for.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.diagnosis.lint.view import JOINT, Remark, View
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import Equality, element_name
from oarlock.mechanics.servos import servos
from oarlock.stepping.closing import CONSISTENT

TURN = 2.0 * math.pi

PLAIN = 5.0
"""Degrees: numbers that people write are multiples of it."""

LEAST = 10.0
"""rad. What looks like degrees is at least that much: joints that turn once and a half are rare."""

MOST = 360.0
"""rad. Nobody writes more degrees: so much is a winch."""

EXACT = 1e-9
"""Relative, of a number that was written as a whole one."""

PART = math.pi / 12.0
"""rad. Numbers that people write in radians are multiples of it."""

ROUNDED = 2e-3
"""Relative: 3.14, 1.57, 0.785 and 2.09 are multiples of π/12 within that, 0.52 is not."""

CLOSES = 0.01
"""Relative, of a constant that closes a coupling once it is read in degrees: what the digits of a keyframe leave."""

ROOM = 2.0
"""Times what a hinge can do: so many degrees are a target beyond it, more are counts."""

MM = 1000.0

VAST = 30.0
"""m. Links of a mechanism that weight moves are shorter, in m."""

STEEP = 10.0
"""Of what a slide has to go: a coupling that takes it further within a radian is in another unit."""

PLACES = 64
"""Of a range at which a polynomial is looked at."""

_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def degrees(value: float) -> bool:
    """Whether an angle in rad is a plain number of degrees that was not converted."""
    size = abs(value)
    if not LEAST <= size <= MOST or abs(size / math.pi - round(size / math.pi)) < ROUNDED:
        return False  # whole turns are written out
    return abs(size / PLAIN - round(size / PLAIN)) <= EXACT * size


def radians(value: float) -> bool:
    """Whether an angle in rad was a plain number of radians that was taken for degrees."""
    written = abs(math.degrees(value))
    parts = round(written / PART)
    return 1 <= parts <= 24 and abs(written - parts * PART) <= ROUNDED * written


def look(view: View) -> Iterator[Remark]:
    """A remark a sort of number and a wrong unit, with all elements that have it."""
    yield from _of_joints(view)
    yield from _of_told(view)
    yield from _of_controls(view)
    yield from _of_couplings(view)
    yield from _of_keyframes(view)
    yield from _of_lengths(view)


def _remark(what: str, names: list[str], said: str) -> Remark:
    others = f"; the same of {few([repr(name) for name in names[1:]])}" if names[1:] else ""
    return Remark("A2", f"{what} {said}{others}", names[0], figures={"also": names[1:]})


def _of_joints(view: View) -> Iterator[Remark]:
    model = view.model
    wide, narrow, referred = [], [], []
    for joint in np.flatnonzero(model.jnt_type == _HINGE):
        name = element_name(model, JOINT, int(joint))
        low, high = model.jnt_range[joint].tolist()
        if model.jnt_limited[joint]:
            ends = [end for end in (low, high) if end]
            if ends and any(map(degrees, ends)) and all(degrees(end) or abs(end) >= 1.0 for end in ends):
                wide.append((name, low, high))
            elif ends and all(map(radians, ends)) and high - low < math.radians(TURN + ROUNDED):
                narrow.append((name, math.degrees(low), math.degrees(high)))
        address = model.jnt_qposadr[joint]
        for attribute, value in (("ref", model.qpos0[address]), ("springref", model.qpos_spring[address])):
            if degrees(float(value)):
                referred.append((name, attribute, float(value)))
                break
    if wide:
        name, low, high = wide[0]
        said = f"{low:g} {high:g} is in radians, {math.degrees(high - low) / 360:.3g} turns: degrees were meant?"
        yield _remark("range", [one[0] for one in wide], said)
    if narrow:
        name, low, high = narrow[0]
        said = f"{low:.4g} {high:.4g} is in degrees, {math.radians(high - low):.3g} rad in all: radians were meant?"
        yield _remark("range", [one[0] for one in narrow], said)
    if referred:
        name, attribute, value = referred[0]
        said = f"{value:g} is in radians, {abs(value) / TURN:.3g} turns: degrees were meant?"
        yield _remark(attribute, [one[0] for one in referred], said)


def _of_controls(view: View) -> Iterator[Remark]:
    """What position servos on hinges may be told: where it leads to, beside what the joint can do."""
    model, found = view.model, []
    for one in servos(model):
        if not model.actuator_ctrllimited[one.index] or model.jnt_type[one.joint] != _HINGE:
            continue
        low, high = model.actuator_ctrlrange[one.index].tolist()
        ends = [end for end in map(one.reached, (low, high)) if abs(end) > 1e-6]
        if not ends or geared(view, one.joint, max(map(abs, ends))):
            continue
        if all(abs(end) > max(_limit(model, one.joint), TURN) and degrees(end) for end in ends):
            found.append((one.name, low, high, max(map(abs, ends)), one.joint))
    if found:
        _, low, high, most, joint = found[0]
        said = (
            f"{low:g} {high:g} leads the hinge '{element_name(model, JOINT, joint)}' {most / TURN:.3g} turns away: a "
            "ctrlrange is in radians, degrees were meant?"
        )
        yield _remark("ctrlrange", [one[0] for one in found], said)


def _limit(model: mujoco.MjModel, joint: int) -> float:
    return float(np.abs(model.jnt_range[joint]).max()) if model.jnt_limited[joint] else TURN


def _of_told(view: View) -> Iterator[Remark]:
    """What the run itself tells position servos on hinges; the loops that they drive stand open because of it."""
    model, found = view.model, []
    for one in servos(model):
        control = one.told(model, float(view.data.ctrl[one.index]))
        reached = one.reached(control)
        if in_degrees(view, one.joint, reached):
            found.append((one, control, reached))
    if found:
        one, control, reached = found[0]
        said = (
            f"{control:g} leads the hinge '{element_name(model, JOINT, one.joint)}' {abs(reached) / TURN:.3g} turns "
            f"away: controls are in radians, degrees were meant? {control:g}° are {math.radians(control):.6g}"
        )
        remark = _remark("ctrl", [each.name for each, *_ in found], said)
        yield replace(remark, figures={**remark.figures, "loops": view.around(each.joint for each, *_ in found)})


def in_degrees(view: View, joint: int, reached: float) -> bool:
    """Whether a servo is told a plain number of degrees, which as an angle are about what its hinge can do."""
    model, limit = view.model, _limit(view.model, joint)
    hinge = model.jnt_type[joint] == _HINGE and degrees(reached) and abs(reached) > limit
    return bool(hinge and math.radians(abs(reached)) <= ROOM * limit and not geared(view, joint, reached))


def geared(view: View, joint: int, value: float) -> bool:
    """Whether a coupling makes of many turns (rad) of a hinge what its other joint can do: a lead screw, a winch."""
    model = view.model
    if model.jnt_limited[joint]:
        return False
    for one in view.equalities:
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        slope = float(model.eq_data[one.index, 1])
        if len(ids) != 2 or joint not in ids or not slope or model.eq_data[one.index, 2:5].any():
            continue
        other, ratio = (ids[1], 1.0 / slope) if joint == ids[0] else (ids[0], slope)
        if abs(ratio * value) <= (_limit(model, other) if model.jnt_type[other] == _HINGE else _way(view, other)):
            return True
    return False


def _way(view: View, slide: int) -> float:
    """How far a slide may go, m."""
    model = view.model
    return float(np.abs(model.jnt_range[slide]).max()) if model.jnt_limited[slide] else view.size


def _of_couplings(view: View) -> Iterator[Remark]:
    """Where a coupling of hinges begins: beyond what they can do, or where degrees would close it."""
    model, plain = view.model, []
    for one in view.equalities:
        if one.kind.holds != "joints" or model.jnt_type[model.eq_obj1id[one.index]] != _HINGE:
            continue
        offset = float(model.eq_data[one.index, 0])
        meant = math.radians(offset)
        beyond = not met(model, one, offset) and met(model, one, meant)
        closes = abs(offset) > CONSISTENT and _off(view, one, meant) <= CLOSES * abs(meant)
        if beyond or closes:
            ranges = ", which the ranges of its joints do not admit" if beyond else ""
            closed = ", with which it is closed at the start" if closes else ""
            said = f"begins with {offset:g} rad{ranges}; {offset:g}° are {meant:.6g} rad{closed}: degrees were meant?"
            yield Remark("A2", f"polycoef {said}", one.name, "error" if beyond else None, {"also": [], "wanted": meant})
        elif degrees(offset):
            rest = " ".join(f"{value:g}" for value in model.eq_data[one.index, 1:5])
            plain.append((one.name, offset, f"{meant:.6g} {rest}"))
    if plain:
        _, offset, written = plain[0]
        said = f"begins with {offset:g}, in radians {abs(offset) / TURN:.3g} turns: degrees were meant? "
        said += f'{offset:g}° are {math.radians(offset):.6g} rad: polycoef="{written}"'
        remark = _remark("polycoef", [name for name, *_ in plain], said)
        wanted = {} if plain[1:] else {"wanted": math.radians(offset)}
        yield replace(remark, figures=remark.figures | wanted)


def _off(view: View, one: Equality, offset: float) -> float:
    """By how much a coupling would be open at the start with another constant, rad."""
    model = view.model
    first, *second = (
        float(view.data.qpos[model.jnt_qposadr[joint]] - model.qpos0[model.jnt_qposadr[joint]])
        for joint in coupled_ids(model, one.index)
    )
    follows = float(np.polynomial.polynomial.polyval(second[0], model.eq_data[one.index, 1:5])) if second else 0.0
    return abs(first - offset - (second[0] * follows if second else 0.0))


def met(model: mujoco.MjModel, one: Equality, offset: float) -> bool:
    """Whether a coupling with some constant is met somewhere inside the ranges of its joints."""
    ranges = []
    for joint in coupled_ids(model, one.index):
        zero = model.qpos0[model.jnt_qposadr[joint]]
        ranges.append(model.jnt_range[joint] - zero if model.jnt_limited[joint] else np.array([-np.inf, np.inf]))
    first, *second = ranges
    follows = np.zeros(1)
    if second and model.eq_data[one.index, 1:5].any():
        if not np.isfinite(second[0]).all():
            return True
        places = np.linspace(second[0][0], second[0][1], PLACES)
        follows = places * np.polynomial.polynomial.polyval(places, model.eq_data[one.index, 1:5])
    return bool(offset + follows.min() <= first[1] and offset + follows.max() >= first[0])


def _of_lengths(view: View) -> Iterator[Remark]:
    """Of a mechanism, or the slope of a rack or screw, that as metres is out of all proportion and as mm is not."""
    model = view.model
    if view.size > VAST and model.opt.gravity.any():
        said = f"links reach {view.size:.3g} m: lengths are in m, mm were meant? divide every length by 1000"
        names = [name for group in (view.loops.groups if view.equalities else ()) for name in group.equalities]
        if names:
            yield Remark("A2", said, names[0], "error", {"also": names[1:]})
        return
    for one in view.equalities:
        ids = coupled_ids(model, one.index) if one.kind.holds == "joints" else []
        slope = abs(float(model.eq_data[one.index, 1]))
        if len(ids) != 2 or [int(model.jnt_type[joint]) for joint in ids] != [_SLIDE, _HINGE]:
            continue
        reach = _way(view, ids[0])
        if slope > STEEP * reach and slope / MM <= reach:
            names = [element_name(model, JOINT, joint) for joint in ids]
            meant = model.eq_data[one.index, :5] / MM
            if abs(model.eq_data[one.index, 0]) <= reach:
                meant[0] = model.eq_data[one.index, 0]
            said = (
                f"polycoef moves the slide '{names[0]}' by {slope:g} m per rad of '{names[1]}', and has {reach:.3g} m "
                f"to go: mm were meant? {meant[1]:.6g}"
            )
            yield Remark("A2", said, one.name, figures={"also": [], "wanted": meant.tolist()})


def _of_keyframes(view: View) -> Iterator[Remark]:
    model, found = view.model, []
    hinges = np.flatnonzero(model.jnt_type == _HINGE)
    for key in range(model.nkey):
        turned = [
            (int(joint), float(model.key_qpos[key, model.jnt_qposadr[joint]]))
            for joint in hinges
            if degrees(float(model.key_qpos[key, model.jnt_qposadr[joint]]))
        ]
        if turned:
            found.append((element_name(model, mujoco.mjtObj.mjOBJ_KEY, key), *turned[0]))
    if found:
        _, joint, value = found[0]
        said = f"turns the hinge '{element_name(model, JOINT, joint)}' by {value:g} rad: degrees were meant?"
        yield _remark("keyframe", [name for name, *_ in found], said)
