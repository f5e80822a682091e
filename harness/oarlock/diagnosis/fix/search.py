"""Which changes help: each is taken in, then taken out again to see what the others are without it."""

import math
from dataclasses import replace

import mujoco

from oarlock.base.errors import InputError, few
from oarlock.base.text import quoted
from oarlock.diagnosis.edit.changes import Armature, Change, Constants, Exclusion, Keyframe, Settings, Switched
from oarlock.diagnosis.edit.copy import require_room
from oarlock.diagnosis.edit.keyframe import new_name
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.fix.candidates import armatures, closed_keyframe, exclusions, freeing, switched
from oarlock.diagnosis.fix.choice import Choice
from oarlock.diagnosis.fix.offsets import choose_offsets
from oarlock.diagnosis.fix.relposes import choose_relposes
from oarlock.diagnosis.fix.words import drifts
from oarlock.diagnosis.runs.recipe import Recipe
from oarlock.diagnosis.runs.trials import Setting, Trial
from oarlock.mechanics.names import element_name, equalities

HELPS = 0.02
"""Of a drift: what lessens it by less is left out, and what adds so much too."""

DEARER = 4.0
"""Times the evaluations of the settings that hold under the user's controls: others may not cost more."""


def choose_changes(bench: Bench) -> Choice:
    """Tries what might help.

    Raises:
        InputError: as of the runs.
    """
    exam, target = bench.exam, bench.target
    on = dict(switched(exam))
    if not bench.counts and not on:
        raise InputError("no equality is active, and none of them is one to switch on: there is no loop to fix")
    before = bench.run([] if bench.counts else list(on))
    if not bench.counts:  # what holds nothing opens as far as its sides part
        widest = max((one.opening for one in on.values()), key=lambda one: one.largest)
        before = replace(before, drift=widest.largest)
    found = Choice(before, before)
    found.reasons = {id(change): f"whose sides part by {one.opening}" for change, one in on.items()}
    offsets, found.left_out = choose_offsets(bench)
    relposes, said = choose_relposes(bench, [one.change for one in offsets])
    offsets, found.left_out = [*offsets, *relposes], [*found.left_out, *said]
    found.offsets = {id(one.change): one for one in offsets}
    wanted: list[Change] = [*on, *(one.change for one in offsets)]
    found.pose = bench.pose(wanted)
    if (closed := closed_keyframe(bench, wanted)) is not None:
        wanted.append(closed)
    for exclusion, collision in exclusions(exam):
        wanted.append(exclusion)
        found.collisions[id(exclusion)] = collision
    for exclusion, said in freeing(exam):
        if exclusion not in wanted:
            wanted.append(exclusion)
            found.freeing[id(exclusion)] = said
    for armature, said in armatures(exam):
        wanted.append(armature)
        found.reasons[id(armature)] = said
    changes = [change for one in wanted if (change := _with_room(bench, one, found))]
    _settle(bench, found, changes)
    for change in list(changes):  # at the author's settings: stiff ones hide what a collision does
        if isinstance(change, Constants | Switched):  # which was tried, and which the closed pose hangs on
            continue
        if id(change) in found.freeing:  # which was tried, and moves what stood still: no gap measures that
            continue
        rest = [one for one in changes if one is not change]
        with_it, without = bench.run(changes), bench.run(rest)
        if isinstance(change, Keyframe):
            idle = without.opening <= target and not _better(with_it, without)
        elif isinstance(change, Armature):
            idle = not _better(with_it, without) or not math.isfinite(with_it.drift)
        else:
            idle = _worse(with_it, without)
        if idle:
            changes = rest
            found.left_out.append(f"{described(bench, change, found)}: {drifts(with_it)}, without it {drifts(without)}")
    if changes != found.changes:
        _settle(bench, found, changes)
    for change in changes:
        rest = [one for one in changes if one is not change]
        if isinstance(change, Switched):  # how far its sides part is no figure of a run without it
            found.effects[id(change)] = before, bench.run(changes)
        else:
            found.effects[id(change)] = _effect(bench, rest, changes)
    settings = _settings(bench, found, changes, target) or _asked_for(bench)
    if settings is not None:
        found.effects[id(settings)] = _effect(bench, changes, [*changes, settings])
        _settle(bench, found, [*changes, settings])
    return found


def _asked_for(bench: Bench) -> Settings | None:
    return Settings(bench.own) if bench.own != bench.authored else None


def take_settings_out(bench: Bench, found: Choice, wrong: str) -> bool:
    """Takes out settings that nobody asked for, where something is wrong that they do not mend, in words.

    Returns:
        Whether there were any.
    """
    given, asked = [one for one in found.changes if isinstance(one, Settings)], _asked_for(bench)
    if not given or given == [asked]:
        return False
    changes = [one for one in found.changes if not isinstance(one, Settings)]
    said = described(bench, given[0], found)
    found.left_out.append(f"{said}: beside {wrong} stiffer equalities would only hide what is wrong")
    if asked is not None:
        found.effects[id(asked)] = _effect(bench, changes, [*changes, asked])
        changes.append(asked)
    _settle(bench, found, changes)
    return True


def _effect(bench: Bench, rest: list[Change], changes: list[Change]) -> tuple[Trial, Trial]:
    """Runs without and with a change: under the user's controls, or under those for whose sake it was made."""
    for seed in (None, *bench.seeds):
        if _better(bench.run(changes, seed), bench.run(rest, seed)):
            return bench.run(rest, seed), bench.run(changes, seed)
    return bench.run(rest), bench.run(changes)


def _with_room(bench: Bench, change: Change, found: Choice) -> Change | None:
    """The change, or one in its place, that the text has room for."""
    try:
        require_room(bench.base.path, change)
    except InputError as error:
        if isinstance(change, Keyframe) and change.key is not None:  # of an attached model
            return replace(change, key=None, name=new_name(bench.base.model), like=change.key)
        found.left_out.append(f"{described(bench, change, found)}: {error}")
        return None
    return change


def _settle(bench: Bench, found: Choice, changes: list[Change]) -> None:
    found.changes, found.after = changes, bench.run(changes)
    found.elsewhere = [bench.run(changes, seed) for seed in bench.seeds]


def _worse(with_it: Trial, without: Trial) -> bool:
    return with_it.drift > (1.0 + HELPS) * without.drift


def _better(with_it: Trial, without: Trial) -> bool:
    return with_it.drift < (1.0 - HELPS) * without.drift or not math.isfinite(with_it.drift)


def _settings(bench: Bench, found: Choice, changes: list[Change], target: float) -> Settings | None:
    """Settings that hold under the user's controls and, where that costs little, under others too."""
    exam = bench.exam
    if max(one.drift for one in (found.after, *found.elsewhere)) <= target:
        return None
    best: Settings | None = None
    if found.after.drift > target:
        found.recipe = _recipe(bench, found, changes)
        if found.recipe is None:
            return None
        wanted = Settings(found.recipe.chosen.setting)
        if wanted.setting == bench.own or not _better(bench.run([*changes, wanted]), found.after):
            return None
        best = wanted
    first = bench.setting([best] if best else [])
    for seed in bench.seeds:
        now = [*changes, best] if best else changes
        trial = bench.run(now, seed)
        if trial.drift <= target or exam.options.budget <= 0:
            continue
        wanted = Settings(bench.recipe(changes, seed).chosen.setting)
        dear = _evaluations(bench, wanted.setting) > DEARER * _evaluations(bench, first)
        if dear or _worse(bench.run([*changes, wanted]), bench.run(now)):
            continue
        if _better(bench.run([*changes, wanted], seed), trial):
            best = wanted
    return best


def _evaluations(bench: Bench, setting: Setting) -> int:
    return setting.steps(bench.exam.duration_s) * setting.evaluations


def _recipe(bench: Bench, found: Choice, changes: list[Change]) -> Recipe | None:
    """That of the examination where it is of the same model from the same start; otherwise a new one."""
    exam = bench.exam
    if exam.options.budget <= 0 or not found.closed:
        return None
    if exam is bench.base and exam.recipe is not None and all(isinstance(change, Keyframe) for change in changes):
        return exam.recipe
    return bench.recipe(changes)


# In words.


def described(bench: Bench, change: Change, found: Choice) -> str:
    """A change in words."""
    base = bench.base
    if isinstance(change, Keyframe):
        moves = f", which moves {quoted(found.pose.moved_joint)} most" if found.pose and found.pose.moved else ""
        if change.key is None:
            return f"a keyframe '{change.name}' with the nearest closed pose{moves}"
        name = element_name(base.model, mujoco.mjtObj.mjOBJ_KEY, change.key)
        return f"the nearest closed pose in keyframe '{name}'{moves}"
    if isinstance(change, Exclusion):
        names = [element_name(base.model, mujoco.mjtObj.mjOBJ_BODY, body) for body in (change.body1, change.body2)]
        apart = f"no contacts of '{names[0]}' and '{names[1]}'"
        if (said := found.freeing.get(id(change))) is not None:
            return f"{apart}, {said}"
        one = found.collisions[id(change)]
        joins = f", which {quoted(one.equality)} joins and which collide" + (
            f" by {one.depth * 1e3:.2g} mm" if one.depth else ""
        )
        return f"{apart}{joins}"
    if isinstance(change, Constants):
        offset = found.offsets[id(change)]
        return f"{offset}, for {offset.why}"
    if isinstance(change, Armature):
        joints = few([quoted(element_name(base.model, mujoco.mjtObj.mjOBJ_JOINT, joint)) for joint in change.joints])
        return f'armature "{change.value:g}" of joint {joints}, {found.reasons[id(change)]}'
    if isinstance(change, Switched):
        return f'active "true" of {quoted(equalities(base.model)[change.equality].name)}, {found.reasons[id(change)]}'
    if isinstance(change, Settings):
        return _settings_in_words(bench, change)
    return type(change).__name__


def _settings_in_words(bench: Bench, change: Settings) -> str:
    own = bench.authored.option_attributes()
    options = [
        f"{name} {value}" + (f" in place of {own[name]}" if name in own else "")
        for name, value in change.setting.option_attributes().items()
        if own.get(name) != value
    ]
    given = [f'{name} "{value}"' for name, value in change.setting.equality_attributes().items()]
    count = sum(1 for one in equalities(bench.base.model) if one.kind.known)
    of = f" of {'the equality' if count == 1 else f'{count} equalities'}" if given else ""
    return ", ".join([*options, *([" and ".join(given) + of] if given else [])])
