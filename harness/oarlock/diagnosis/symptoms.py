"""What a user sees besides how far the loops open, and what is behind it: parts of an examination made by runs."""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace

import mujoco

from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint.locked import how_bad, lock
from oarlock.diagnosis.lint.view import View
from oarlock.diagnosis.runs.behind import find_behind, find_calmer
from oarlock.diagnosis.runs.branch import alike, find_branch
from oarlock.diagnosis.runs.branch import crossing as crossing_of
from oarlock.diagnosis.runs.deadpoint import TORN
from oarlock.diagnosis.runs.drifts import VISIBLE
from oarlock.diagnosis.runs.missed import find_clipped, find_missed
from oarlock.diagnosis.runs.parted import Parted, find_all_parted
from oarlock.diagnosis.runs.recording import Recording, record
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.targets import find_targets
from oarlock.diagnosis.runs.throttled import find_throttled
from oarlock.diagnosis.runs.undriven import Coupling
from oarlock.mechanics import controls
from oarlock.mechanics.flexes import flex_equalities
from oarlock.mechanics.given import COMPILED
from oarlock.mechanics.load import as_asked, collected_warnings
from oarlock.mechanics.names import equalities
from oarlock.stepping.closing import CONSISTENT

ROUNDS = 1e-9
"""Relative, of a timestep."""


def missed(found: Examination) -> None:
    """Servos that miss, in groups of which nothing else is known to hold them."""
    assert found.pose is not None
    assert found.recording is not None
    loops = found.pose.loops
    found.clipped = find_clipped(found.recording, loops)
    names = {name for one in found.overdriven for name in (one.equality, *one.others)}
    names |= {name for one in found.pose.mobility if one.locked for name in one.equalities}
    said = {one.group for one in found.stuck}
    said |= {number for number, group in enumerate(loops.groups) if not names.isdisjoint(group.equalities)}
    found.throttled = tuple(one for one in find_throttled(found.recording, loops, found.size) if one.group not in said)
    said |= {one.group for one in found.throttled}
    found.missed = find_missed(found.recording, loops, found.size, said)


def coupled(found: Examination, couplings: Sequence[Coupling]) -> mujoco.MjModel | None:
    """The model with more couplings of joints; None where its file is no MJCF, or MuJoCo refuses them."""
    if found.path.suffix == COMPILED or found.path.suffix == ".py":
        return None
    try:
        with collected_warnings():
            spec = mujoco.MjSpec.from_file(str(found.path))
            for one in couplings:
                made = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=one.joint1, name2=one.joint2)
                made.data[:5] = one.offset, one.ratio, 0.0, 0.0, 0.0
            model = spec.compile()
    except (ValueError, RuntimeError, mujoco.FatalError):
        return None
    as_asked(model, found.model)
    return model


def crossing(found: Examination) -> None:
    """Of a run that left its branch where branches cross: when, and a coupling with which it does not."""
    branch, recording, exact, pose = found.branch, found.recording, found.exact, found.pose
    assert branch is not None
    assert recording is not None
    assert exact is not None
    assert pose is not None
    line_s = crossing_of(branch, found.history, found.duration_s)
    if line_s is None:
        return
    found.branch = replace(branch, line_s=line_s)
    coupling = alike(recording, exact, pose.loops, branch.equalities)
    model = coupled(found, [coupling]) if coupling is not None else None
    if model is None:
        return
    again = record(model, found.qpos, found.qvel, found.laws, found.steps, act=found.act)
    others = exact, pose.loops, {*branch.equalities}, found.size, start_of(found)
    own = replace(recording, qpos=again.qpos)
    if again.end.how == "finished" and find_branch(own, *others) is None:
        found.branch = replace(found.branch, coupling=coupling)


def all_parted(found: Examination) -> tuple[Parted, ...]:
    """Of a model whose equalities are all switched off: what comes apart that they would hold."""
    own = [one for one in equalities(found.model) if one.kind.known]
    if found.model.eq_active0[[one.index for one in own]].any():
        return ()
    model = copy.copy(found.model)
    model.eq_active0[[one.index for one in own]] = 1
    held = record(model, found.qpos, found.qvel, found.laws, found.steps, act=found.act)
    view = View(found.model, start_of(found))
    return find_all_parted(held, TORN * view.size) if held.end.how == "finished" else ()


def targets(found: Examination) -> None:
    """Mocap bodies that are not met."""
    assert found.pose is not None
    open_ = {name for one in found.pose.culprits for name in one.equalities}
    least = max(found.target, VISIBLE)
    found.targets = find_targets(
        found.model, start_of(found), found.recording, found.drifts, open_, least, found.laws, found.moved
    )


def behind(found: Examination, recording: Recording) -> None:
    """Looked for where a closed start opens visibly, and no remark names something else."""
    positions = [one for one in found.drifts if one.level == "position"]
    worst = max(positions, key=lambda one: one.largest, default=None)
    if worst is None or worst.largest <= max(found.target, VISIBLE) or found.pose is None or not found.closed:
        return
    own = [one for one in found.pose.mobility if one.locked and worst.equality in one.equalities]
    if any(lock(found.model, found.pose, one) is None for one in own):
        return
    if not found.pose.consistent and not (own and max(one.largest for one in found.pose.openings) <= CONSISTENT):
        return  # a push on what cannot move opens it by its softness, and is no start that is off
    loops = [loop for loop in found.pose.loops.loops if any(loop.name in one.equalities for one in own)]
    rigid = bool(own) and how_bad(found.model, loops, (), 0.0, True) is None
    found.behind = find_behind(recording, worst, found.pose.loops, rigid)
    if found.pace is not None and found.pace.too_fast and found.pace.actuator >= 0:
        found.calmer = find_calmer(recording, worst, found.pace.actuator)


def as_recommended(found: Examination) -> Recording | None:
    """The poses of MuJoCo's run with the settings that hold the loops; None where there are none."""
    recipe, recording = found.recipe, found.recording
    if recipe is None or recording is None or recipe.chosen.drift > recipe.target or found.states is not None:
        return None
    model, h = copy.copy(recording.model), found.timestep_s
    recipe.chosen.setting.apply(model)
    parts = max(1, math.ceil(h / float(model.opt.timestep) * (1.0 - ROUNDS)))
    model.opt.timestep = h / parts
    again = rerun(recording, model, parts=parts)
    return None if again is None else replace(recording, qpos=again.qpos)


def start_of(found: Examination) -> mujoco.MjData:
    """The start with the controls that are constant, and with flexes let go: their rows are not looked at."""
    data = mujoco.MjData(found.model)
    data.eq_active[flex_equalities(found.model)] = 0
    data.qpos[:], data.qvel[:], data.act[:] = found.qpos, found.qvel, found.act
    parsed = found.laws.parsed() if isinstance(found.laws, controls.Laws) else {}
    for index, name in enumerate(controls.actuators(found.model)):
        if name in parsed and parsed[name].is_constant:
            data.ctrl[index] = parsed[name].at(0.0)
    return data
