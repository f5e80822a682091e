"""How far joints turn within a step of a run, and how far that may be."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.base.text import quoted
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.loops.loops import Loops
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.recording import Recording
from oarlock.mechanics.names import element_name

OFF = 0.005
"""Of the length of a link that turns about a joint: so far a step may leave the circle that its end moves on."""

_HINGE, _BALL = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_BALL)
_FREE, _SLIDE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


@dataclass(frozen=True)
class Pace:
    """The joint that turns furthest within a step.

    Attributes:
        joint: its name.
        per_step: rad; bound: how far a step of this integrator may turn, rad.
        rate: rad/s; time_s: when.
        driver: the actuator that gives most, of those on joints of the same loops, in words; empty if there is none.
        force: that force over MuJoCo's run; unit: of it.
        actuator: its number; -1: there is none.
    """

    joint: str
    per_step: float
    bound: float
    rate: float
    time_s: float
    driver: str = ""
    force: float = 0.0
    unit: str = "N m"
    actuator: int = -1

    @property
    def too_fast(self) -> bool:
        """Whether the bound is exceeded."""
        return self.per_step > self.bound


def bound(integrator: str) -> float:
    """Turn (rad) at which a step of an integrator of order p leaves a circle by ``OFF`` of its radius.

    That is θ^(p+1)/(p+1)!, the first term of the circle that such a step does not have.
    """
    terms = INTEGRATORS[integrator].order + 1
    return (OFF * math.factorial(terms)) ** (1.0 / terms)


def find_pace(
    recording: Recording, exact: ExactRun | None, loops: Loops | None = None, torn: float = math.inf
) -> Pace | None:
    """Of MuJoCo's run; where a loop opens in it by more than ``torn`` (m or rad), of the exact one that is known.

    Where no exact one is known to the end, it is MuJoCo's up to that moment; None where nothing turns.
    """
    model, h = recording.model, recording.timestep_s
    qpos, times = recording.qpos, recording.time
    beyond = ~(np.abs(recording.position).max(axis=1, initial=0.0) <= torn)
    if beyond.any():
        known = exact is not None and exact.end.how == "finished" and not exact.doubt and len(exact.qpos) > 1
        whole = int(beyond.argmax()) + 1
        qpos, times = (exact.qpos, exact.time) if exact is not None and known else (qpos[:whole], times[:whole])
    turns = np.zeros((max(0, len(qpos) - 1), model.njnt))
    for joint, kind in enumerate(model.jnt_type.tolist()):
        first = int(model.jnt_qposadr[joint])
        if kind == _HINGE:
            turns[:, joint] = np.abs(np.diff(qpos[:, first]))
        elif kind in (_BALL, _FREE):
            first += 3 if kind == _FREE else 0
            turned = qpos[:, first : first + 4]
            turned = turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), mujoco.mjMINVAL)
            cosine = np.abs((turned[1:] * turned[:-1]).sum(axis=1))
            turns[:, joint] = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    turns[~np.isfinite(turns)] = 0.0
    if not turns.any():
        return None
    step, joint = np.unravel_index(int(turns.argmax()), turns.shape)
    turn = float(turns[step, joint])
    name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, int(joint))
    driver = _driver(recording, loops, int(joint))
    return Pace(name, turn, bound(recording.integrator), turn / h, float(times[step]), *driver)


def _driver(recording: Recording, loops: Loops | None, joint: int) -> tuple[str, float, str, int]:
    """The actuator on a joint of the same group that gives most, in words, with its force, unit and number."""
    model = recording.model
    joints = {joint}
    for number in range(len(loops.groups) if loops is not None else 0):
        assert loops is not None
        group = {int(model.dof_jntid[dof]) for dof in loops.dofs(number)}
        joints |= group if joint in group else set()
    best = ("", 0.0, "N m", -1)
    for actuator in range(model.nu):
        kind, driven = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
        if kind not in _ON_JOINTS or driven not in joints:
            continue
        force = float(recording.driven[actuator] * np.abs(model.actuator_gear[actuator]).max())
        if force > best[1]:
            name = element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
            plain = not (model.actuator_biastype[actuator] or model.actuator_dyntype[actuator])
            slides = int(model.jnt_type[driven]) == _SLIDE
            best = f"{'motor' if plain else 'actuator'} {quoted(name)}", force, "N" if slides else "N m", actuator
    return best
