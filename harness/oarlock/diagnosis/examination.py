"""An examination: one model looked at from its loops to what would hold them, each part as soon as it is there."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.diagnosis import symptoms
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.lint import collision, servo
from oarlock.diagnosis.lint.lints import look
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.events import rank_events
from oarlock.diagnosis.loops.extent import extent
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.diagnosis.loops.stops import find_stops
from oarlock.diagnosis.loops.uniqueness import find_uniqueness
from oarlock.diagnosis.loops.wrenches import wrenches
from oarlock.diagnosis.runs.behind import find_blower
from oarlock.diagnosis.runs.borne import GAINS, largest_borne
from oarlock.diagnosis.runs.branch import find_branch
from oarlock.diagnosis.runs.deadpoint import TORN, find_dead_point
from oarlock.diagnosis.runs.drifts import VISIBLE, find_drifts
from oarlock.diagnosis.runs.exact import record_exact
from oarlock.diagnosis.runs.fights import find_fight
from oarlock.diagnosis.runs.lag import find_lags
from oarlock.diagnosis.runs.lasting import find_lasting
from oarlock.diagnosis.runs.leverless import find_leverless
from oarlock.diagnosis.runs.overdriven import find_overdriven
from oarlock.diagnosis.runs.pace import find_pace
from oarlock.diagnosis.runs.parted import find_parted
from oarlock.diagnosis.runs.recipe import recipe
from oarlock.diagnosis.runs.recording import record
from oarlock.diagnosis.runs.rotors import find_rotors
from oarlock.diagnosis.runs.row_law import Attribution, attribute
from oarlock.diagnosis.runs.separation import drifts_without
from oarlock.diagnosis.runs.slips import find_slips
from oarlock.diagnosis.runs.stability import stability
from oarlock.diagnosis.runs.stopped import find_stopped
from oarlock.diagnosis.runs.stuck import find_stuck
from oarlock.diagnosis.runs.trials import Start
from oarlock.diagnosis.runs.undriven import find_undriven
from oarlock.diagnosis.runs.without import find_fed, find_finer, find_without, starving
from oarlock.mechanics import controls
from oarlock.mechanics.flexes import flex_equalities, flex_names, joined, without_flexes
from oarlock.mechanics.load import takes_degrees
from oarlock.stepping.closing import CONSISTENT
from oarlock.stepping.start import carried

POSES = 60
"""So many poses of the motion at most are looked at for unique reactions."""

MOVED = "it is not looked for where a mocap body moves"

ASTRAY = "the steps of the log are not those of this model (R3)"
"""Why a part is missing: what it is measured by takes a closed pose for closed at any time."""

LAGS = (
    f"{MOVED}. MuJoCo's rows take that body for standing still, so that one lags by its damping over its stiffness, "
    "2 timeconst dampratio² for a solref of positive numbers, times the body's speed"
)
"""Why there are no causes, and what is known all the same: 0 = −b J v − k d r."""

PARTS = ("loops", "start", "run", "causes", "remedy", "forces")
"""What is looked at, in this order."""


def examine(found: Examination) -> Iterator[str]:
    """Fills an examination part by part; gives the name of each as soon as it is there (``PARTS``).

    A part that cannot be found out leaves its reason in ``missing``; the others go on.
    """
    data = symptoms.start_of(found)
    if found.options.lint:
        _lint(found)
        found.settings = stability(found.model)
        return
    found.pose = nearest_closed(found.model, found.qpos, found.qvel, data, hold=found.options.hold)
    found.size = extent(found.model, found.pose.loops, data)
    if found.moved and found.pose.closed:
        driven = controls.drive(found.model, found.laws)
        found.pose = replace(found.pose, qvel=carried(found.model, found.pose.qpos, found.qvel, driven))
    _lint(found)
    yield "loops"
    found.settings = stability(found.model)
    yield "start"
    _run(found)
    yield "run"
    _causes(found)
    yield "causes"
    _remedy(found)
    yield "remedy"
    _forces(found)
    yield "forces"


def _lint(found: Examination) -> None:
    """What can be seen without a run."""
    view = View(found.model, symptoms.start_of(found), found.pose)
    found.collisions = collision.find(view)
    found.remarks = look(view)


def _collisions(found: Examination) -> None:
    """What the bodies that collide cost: the same run without their contacts."""
    recording = found.recording
    if recording is None or not recording.steps:
        return
    view = View(found.model, symptoms.start_of(found), found.pose)
    every = [*found.collisions, *collision.later(view, recording.pushes, found.collisions)]
    if every:
        pairs = {one.bodies for one in every}
        without = drifts_without(recording, pairs)
        found.collisions = collision.measured(every, found.drifts, without)
        found.remarks["collision"] = list(collision.tell(found.collisions))


def _run(found: Examination) -> None:
    assert found.pose is not None
    with _Reason(found, "run"):
        own, given = (found.model, found.qpos, found.qvel, found.laws, found.steps), found.states
        found.recording = record(*own, act=found.act, states=given)
    astray = found.recording.astray if found.recording is not None else ""
    if astray:
        found.missing["exact"] = found.missing["remedy"] = ASTRAY
    elif found.closed:
        with _Reason(found, "exact"):
            model, pose = _exact_model(found), found.pose
            since = found.states.start_s if found.states is not None else 0.0
            given = (model, pose.qpos, pose.qvel, found.laws, found.steps)
            found.exact = record_exact(*given, act=found.act, start_s=since)
            if doubt := found.exact.doubt:
                found.exact = None
                found.missing["exact"] = doubt
            elif not found.moved:
                found.fight = find_fight(found.model, found.exact)
        data = symptoms.start_of(found)
        data.qpos[:] = found.pose.qpos
        found.stops = find_stops(found.model, data)
    else:
        found.missing["exact"] = "there is no closed start to run it from"
    if found.recording is None and found.model.neq and not found.moved:
        with _Reason(found, "parted"):
            found.parted = symptoms.all_parted(found)
    if found.recording is not None:
        found.drifts = find_drifts(found.recording, found.exact)
        if not astray:
            with _Reason(found, "targets"):
                symptoms.targets(found)
        if astray:  # what follows is measured by runs of the model, beside which these steps do not belong
            return
        with _Reason(found, "collisions"):
            _collisions(found)
        if found.closed and found.recording.steps:
            least = max(found.target, VISIBLE)
            found.stopped = find_stopped(found.recording, found.drifts, found.pose.loops, least)
            found.overdriven = find_overdriven(found.recording, found.drifts, found.pose.loops, least)
        found.lags = find_lags(found.recording, VISIBLE)
        if not found.moved:
            found.parted = find_parted(found.recording, TORN * found.size)
        found.pace = find_pace(found.recording, found.exact, found.pose.loops, TORN * found.size)
        if found.closed and found.recording.steps and not found.moved:
            loops = found.pose.loops
            with _Reason(found, "undriven"):
                found.undriven = find_undriven(
                    found.recording, loops, found.pose.mobility, found.size, partial(symptoms.coupled, found)
                )
            found.stuck = find_stuck(found.recording, loops, found.size, partial(takes_degrees, found.path))
            with _Reason(found, "missed"):
                symptoms.missed(found)
            found.leverless = find_leverless(found.recording, loops, found.pose.mobility, found.size)
            with _Reason(found, "slips"):
                found.slips = find_slips(found.recording, loops)
            dead = find_dead_point(found.recording, found.exact, loops, found.size, symptoms.start_of(found))
            stuck = {name for one in found.pose.mobility if one.locked for name in one.equalities}
            # What is locked (S3) never leaves its start, and comes to no dead point.
            found.dead_point = dead if dead is not None and stuck.isdisjoint(dead.equalities) else None


def _exact_model(found: Examination) -> mujoco.MjModel:
    """The model of the exact run: without its flexes, where nothing joins them to the loops.

    Raises:
        InputError: something does.
    """
    assert found.pose is not None
    loops = found.pose.loops
    touched = found.recording is not None and any("flex" in push.name for push in found.recording.pushes)
    dofs = sorted({dof for number in range(len(loops.groups)) for dof in loops.dofs(number)})
    if flex_equalities(found.model) and (touched or joined(found.model, dofs)):
        names = few([f"'{name}'" for name in flex_names(found.model)])
        raise InputError(f"the flex {names} is left as MuJoCo has it, and acts on the loops")
    return without_flexes(found.model)


def _causes(found: Examination) -> None:
    if found.recording is None or not found.recording.steps:
        return
    if found.moved:
        found.missing["causes"] = LAGS
        return
    if found.recording.astray:
        found.missing["causes"] = ASTRAY
        return
    if found.recording.end.how == "diverged":
        with _Reason(found, "gains"):
            found.remarks["servo"] = [_borne(found, one) for one in found.remarks.get("servo", [])]
        found.without = find_fed(found.recording, found.steps)
        if not any(one.left for one in found.without) and not _known(found):
            found.without += find_finer(found.recording, found.steps)
            with _Reason(found, "behind"):
                found.behind = find_blower(found.recording, found.steps, found.size)
    with _Reason(found, "causes"):
        attribution = attribute(found.recording)
        if attribution.holds:
            found.attribution = attribution
            found.accelerations = attribution.accelerations()
            _taken_away(found, attribution)
        else:
            found.missing["causes"] = (
                f"MuJoCo's rows do not follow the law of an oscillator (defect {attribution.defect:.1g}), "
                f"as under the integrator '{found.recording.integrator}'"
            )


def _borne(found: Examination, remark: Remark) -> Remark:
    """What is said of a servo's gains with the loops, by the run and not by a step at its start."""
    assert found.recording is not None
    names = [remark.element, *remark.figures["also"]]
    numbers = [controls.actuators(found.model).index(name) for name in names]
    for gain in GAINS:
        if (most := remark.figures.get(f"{gain}_with_loops")) is not None:
            bounds = remark.figures[f"{gain}_stable"], min(most, remark.figures[gain])
            remark = servo.measured(remark, gain, largest_borne(found.recording, numbers, gain, *bounds, found.steps))
    return remark


def _known(found: Examination) -> bool:
    """Whether a row, a servo or a damper is unstable by itself: then that is what makes a run diverge."""
    remarks = [one for lint in ("servo", "damper", "feeding") for one in found.remarks.get(lint, [])]
    return any(one.severity != "note" for one in remarks) or not all(one.stable for one in found.settings)


def _taken_away(found: Examination, attribution: Attribution) -> None:
    """What is measured by runs without a cause."""
    recording = attribution.recording
    if recording.end.how != "finished" or found.pose is None:
        return
    drifting = {one.equality for one in found.drifts if one.level == "position" and one.largest > found.target}
    found.without = find_fed(recording, found.steps) if drifting else []
    if any(one.leading == "stepping" and one.name in drifting - starved(found) for one in attribution.shares):
        found.without += find_without(recording)
    soft = {one.name for one in attribution.shares if one.leading == "compliance"}
    visible = {one.equality for one in found.drifts if one.level == "position" and one.largest > VISIBLE}
    named = soft & visible & drifting
    found.rotors = find_rotors(recording, [one for one in recording.layout.equalities if one.name in named])
    with _Reason(found, "behind"):
        symptoms.behind(found, recording)
    opened = {one.equality for one in found.pose.openings if one.largest > CONSISTENT}
    if opened and found.closed:
        least = max(found.target, VISIBLE)
        found.lasting = find_lasting(attribution, opened, least)


def starved(found: Examination) -> set[str]:
    """Equalities that open mostly because MuJoCo's solver stops early, by a run with one that is enough."""
    worst = {one.equality: one.largest for one in found.drifts if one.level == "position"}
    return {name for name, largest in worst.items() if starving(found.without, name, largest) is not None}


def _remedy(found: Examination) -> None:
    if "remedy" in found.missing:
        return
    if not found.closed or found.pose is None:
        found.missing["remedy"] = "there is no closed start to try settings from"
    elif found.options.budget <= 0:
        found.missing["remedy"] = "a budget of 0 asks for none"
    elif found.recording is not None:
        start = Start(found.pose.qpos, found.pose.qvel, found.act)
        with _Reason(found, "remedy"):
            found.recipe = recipe(
                found.model,
                start,
                found.laws,
                found.target,
                found.duration_s,
                budget_s=found.options.budget,
                made=found.made,
            )


def _forces(found: Examination) -> None:
    assert found.pose is not None
    data = symptoms.start_of(found)
    if found.moved:
        found.missing |= dict.fromkeys(("rank", "forces"), MOVED)
        with _Reason(found, "reactions"):
            found.reactions = find_uniqueness(found.model, None, data)
        return
    path, times = _motion(found)
    with _Reason(found, "rank"):
        if len(path) > 1 and found.closed:
            found.history = rank_events(found.model, path, times, data)
    _branch(found)
    every = max(1, len(path) // POSES)
    with _Reason(found, "reactions"):
        found.reactions = find_uniqueness(found.model, path[::every] if len(path) > 1 else None, data)
    with _Reason(found, "forces"):
        if found.recording is not None and found.recording.steps:
            found.given = wrenches(found.model, found.recording.qpos, found.recording.force, data)
        if found.exact is not None and len(found.exact.qpos):
            found.determined = wrenches(found.model, found.exact.qpos, found.exact.force, data)


def _branch(found: Examination) -> None:
    """Looked for where the motion comes near a singular pose, or the loops are torn."""
    if found.recording is None or found.exact is None or found.pose is None or found.dead_point is not None:
        return
    events = found.history.events if found.history is not None else ()
    near = {name for event in events for name in event.equalities}
    near |= {one.equality for one in found.drifts if one.level == "position" and one.largest > TORN * found.size}
    if near:
        others = found.exact, found.pose.loops, near, found.size, symptoms.start_of(found)
        found.branch = find_branch(found.recording, *others)
        if found.branch is not None and (again := symptoms.as_recommended(found)) is not None:
            found.branch = replace(found.branch, kept=find_branch(again, *others) is None)
        if found.branch is not None:
            symptoms.crossing(found)


def _motion(found: Examination) -> tuple[np.ndarray, np.ndarray]:
    """Poses (T, nq) and times (T) of the exact motion, or of MuJoCo's where that is longer than half of it."""
    runs = [run for run in (found.exact, found.recording) if run is not None and len(run.qpos)]
    if not runs:
        return np.zeros((0, found.model.nq)), np.zeros(0)
    run = max(runs, key=lambda run: len(run.qpos))
    finite = np.isfinite(run.qpos).all(axis=1)
    return run.qpos[finite], run.time[finite]


class _Reason:
    """Keeps the reason why a part of an examination cannot be had."""

    def __init__(self, found: Examination, part: str):
        self._found, self._part = found, part

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type | None, error: BaseException | None, _trace: object) -> bool:
        if isinstance(error, InputError):
            self._found.missing[self._part] = str(error)
            return True
        return False
