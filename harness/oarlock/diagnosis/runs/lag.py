"""How much of the lag of a coupling its joints' friction makes, told by taking the friction away."""

import copy
import math
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import called
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.mechanics.names import element_name

HALF = 0.5
"""Of its deviation: a coupling that opens by less than that without friction lags because of it."""

PARTS = 4
"""Of a run; the last of them is looked at."""

_JOINT = mujoco.mjtObj.mjOBJ_JOINT


@dataclass(frozen=True)
class Lag:
    """A joint equality that lags behind because its joints rub.

    Attributes:
        equality: its name; joints: those of its joints that rub.
        given: its deviation over the last part of the run, m or rad, as a median; without: that of the same run without
            their friction loss.
        stuck: part of the steps in which their friction holds them.
        unit: of the deviations.
    """

    equality: str
    joints: tuple[str, ...]
    given: float
    without: float
    stuck: float
    unit: str


def find_lags(recording: Recording, visible: float) -> tuple[Lag, ...]:
    """Runs MuJoCo once more for each joint equality that opens by more than ``visible`` and whose joints rub.

    Args:
        recording: MuJoCo's run as configured.
        visible: m or rad.
    """
    model, found = recording.model, []
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS:
        return ()
    stuck = {push.name: push.stuck / recording.steps for push in recording.pushes if push.kind == "friction"}
    for place, equality in enumerate(recording.layout.equalities):
        if model.eq_type[equality.index] != mujoco.mjtEq.mjEQ_JOINT:
            continue
        rows = recording.layout.of_equality(place)
        given = _lasting(np.abs(recording.position[:, rows]).max(axis=1, initial=0.0))
        joints = [int(joint) for joint in (model.eq_obj1id[equality.index], model.eq_obj2id[equality.index])]
        rubbing = [joint for joint in joints if joint >= 0 and model.dof_frictionloss[model.jnt_dofadr[joint]] > 0.0]
        if given <= visible or not rubbing:
            continue
        without = _without(recording, place, rubbing)
        names = tuple(element_name(model, _JOINT, joint) for joint in rubbing)
        if without < HALF * given:
            holds = max(stuck.get(f"friction of {called('joint', name)}", 0.0) for name in names)
            found.append(Lag(equality.name, names, given, without, holds, equality.unit))
    return tuple(found)


def _without(recording: Recording, place: int, joints: list[int]) -> float:
    """Lasting deviation of an equality, by its place, in the same run without the friction loss of some joints.

    Infinite where that run does not stay finite.
    """
    model = copy.deepcopy(recording.model)
    model.dof_frictionloss[model.jnt_dofadr[joints]] = 0.0
    again = rerun(recording, model)
    if again is None:
        return math.inf
    return _lasting(np.abs(again.position[:, recording.layout.of_equality(place)]).max(axis=1))


def _lasting(deviations: np.ndarray) -> float:
    """The median of the last part of a run: what an impact or a start makes has faded."""
    return float(np.median(deviations[-max(1, len(deviations) // PARTS) :])) if len(deviations) else 0.0
