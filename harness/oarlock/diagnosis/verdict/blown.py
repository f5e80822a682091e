"""Why a run does not stay finite, and what makes it last."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.mobility import admitted
from oarlock.diagnosis.runs.behind import largest_force
from oarlock.diagnosis.runs.without import FINEST, PARTS
from oarlock.diagnosis.symptoms import start_of
from oarlock.poses.assembly import Assembly

WHOLE = 0.05
"""Of the size of the loops: one that opens by less holds, and a run with shorter steps in which it does is a remedy."""

LEVER = 0.01
"""Of the largest velocity of a motion: a drive whose joint moves less there holds no weight that is worth a word."""

ROUNDS = 1e-9
"""Relative, of a timestep."""

_PARTS = {PARTS: "quarter", FINEST: "sixteenth"}


def reasons(exam: Examination) -> Iterator[str]:
    """What makes a run diverge, unless shorter steps are all that it lacks, and what those make of it."""
    if not _healed(exam):
        yield from _lasts_without(exam)
    yield from _lasts_finer(exam)


def _healed(exam: Examination) -> bool:
    """Whether shorter steps are all that a run which diverges lacks."""
    every = [each for one in exam.without if one.cause == "stepping" for each in one.left.values()]
    return bool(every) and max(each.largest for each in every) <= WHOLE * exam.size


def _lasts_without(exam: Examination) -> Iterator[str]:
    """What makes a run diverge, by a run without it."""
    one = exam.behind
    if one is None or one.equality or one.suspect is None:
        return
    said = f"without {one.suspect.said} it stays finite"
    if one.suspect.sort == "drive" and exam.recording is not None:
        force = largest_force(exam.model, exam.recording, one.suspect.index)
        said = f"{one.suspect.said} gives {force:.3g} {_effort(exam, one.suspect.index)}"
        if (weight := _weight(exam, one.suspect.index)) is not None:
            said += f", where the weight of what it moves takes {weight:.3g}"
        said += ", and without it the run stays finite"
    if one.factor:
        said += f", and with {one.factor:g} times that"
        said += f" {quoted(one.left.equality)} opens by at most {one.left}" if one.left is not None else ""
    yield said


def _effort(exam: Examination, actuator: int) -> str:
    model = exam.model
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT:
        return "N or N m"
    slides = model.jnt_type[model.actuator_trnid[actuator, 0]] == mujoco.mjtJoint.mjJNT_SLIDE
    return "N" if slides else "N m"


def _weight(exam: Examination, actuator: int) -> float | None:
    """What an actuator on a joint of a loop of one freedom holds at the start, N or N m; None of others."""
    model, pose = exam.model, exam.pose
    if model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT or pose is None or not pose.closed:
        return None
    dof = int(model.jnt_dofadr[model.actuator_trnid[actuator, 0]])
    own = [at for at, group in enumerate(pose.loops.groups) if dof in pose.loops.dofs(at) and group.dof == 1]
    if not own:
        return None
    assembly = Assembly(model, start_of(exam))
    (motion,) = admitted(assembly, pose.loops.members(own[0]), pose.loops.dofs(own[0]), pose.qpos)
    data = assembly.data
    data.qvel[:] = 0.0
    mujoco.mj_fwdVelocity(assembly.model, data)
    load = float(motion @ (data.qfrc_bias - data.qfrc_passive))
    return abs(load / motion[dof]) if abs(motion[dof]) > LEVER * np.abs(motion).max() else None


def _lasts_finer(exam: Examination) -> Iterator[str]:
    """What shorter steps make of a run that diverges."""
    for one in exam.without:
        if one.cause == "stepping" and one.left:
            worst = max(one.left.values(), key=lambda opening: opening.largest)
            shorter, recipe = exam.timestep_s / one.parts, exam.recipe
            if exam.behind is not None and exam.behind.factor and worst.largest > WHOLE * exam.size:
                continue  # which is no remedy, beside one that is
            said = f"with a timestep of {shorter:g} s, a {_PARTS[one.parts]} of it, it stays finite"
            # Stiffer rows hold it with no shorter steps than that.
            chosen = recipe.chosen if recipe is not None and recipe.chosen.drift <= exam.target else None
            soft = chosen is not None and chosen.setting.timestep_s >= (1.0 - ROUNDS) * shorter
            softly = ", for it is too soft as well" if soft and worst.largest > exam.target else ""
            yield f"{said}, and {quoted(worst.equality)} opens by {worst}{softly}"
