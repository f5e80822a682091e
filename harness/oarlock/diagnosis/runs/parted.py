"""Equalities that are switched off, whose sides are together at the start and part in the run.

Only connects and welds between parts of mechanisms: what joins a body that is free, or that a program moves, is how a
grasp is written, which is switched on later.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.loops.gaps import Opening, opening, widest
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, equalities

LOOKS = 500
"""States of the run that are looked at, evenly."""

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True)
class Parted:
    """An equality that is switched off.

    Attributes:
        opening: how far its sides are apart at the worst moment; at_s: that moment.
        held: the same of a run with it switched on; None where that does not stay finite.
    """

    opening: Opening
    at_s: float
    held: Opening | None

    @property
    def equality(self) -> str:
        """Its name."""
        return self.opening.equality


def find_parted(recording: Recording, apart: float) -> tuple[Parted, ...]:
    """Looks at the poses of MuJoCo's run, and makes it again with each equality whose sides part.

    Args:
        recording: MuJoCo's run as configured.
        apart: m or rad; sides that are closer at the start are together, those that come to be further have parted.
    """
    model = recording.model
    idle = [one for one in equalities(model) if not model.eq_active0[one.index] and _joins_parts(model, one)]
    if not idle or not recording.steps:
        return ()
    return _parted(recording, idle, recording.qpos, apart)


def find_all_parted(held: Recording, apart: float) -> tuple[Parted, ...]:
    """The same of a model all of whose equalities are switched off.

    Args:
        held: a run of it with those on that join points or couple joints.
        apart: as of ``find_parted``.
    """
    model = copy.deepcopy(held.model)
    idle = list(held.layout.equalities)
    model.eq_active0[:] = 0
    fallen = rerun(held, model)
    if fallen is None:
        return ()
    return tuple(one for one in _parted(held, idle, fallen.qpos, apart) if one.held is not None)


def _parted(recording: Recording, idle: Sequence[Equality], qpos: np.ndarray, apart: float) -> tuple[Parted, ...]:
    model = recording.model
    steps = np.unique(np.linspace(0, len(qpos) - 1, LOOKS).astype(int))
    found = []
    for one, rows in zip(idle, _rows(model, idle, qpos[steps]), strict=True):
        if not rows.size or opening(model, one, rows[0]).largest > apart:
            continue
        worst = widest(model, one, rows)
        wide = opening(model, one, rows[worst])
        if wide.largest > apart:
            found.append(Parted(wide, float(recording.time[steps[worst]]), _held(recording, one)))
    return tuple(found)


def _joins_parts(model: mujoco.MjModel, equality: Equality) -> bool:
    return equality.kind.joins_points and not any(_moved_by_others(model, body) for body in equality.bodies)


def _moved_by_others(model: mujoco.MjModel, body: int) -> bool:
    """Whether a body is free, or a mocap body, or rigidly joined to one."""
    root = int(model.body_weldid[body])
    free = bool(model.body_jntnum[root]) and int(model.jnt_type[model.body_jntadr[root]]) == _FREE
    return free or max(model.body_mocapid[body], model.body_mocapid[root]) >= 0


def _rows(model: mujoco.MjModel, idle: Sequence[Equality], poses: np.ndarray) -> list[np.ndarray]:
    """Deviations of the rows of equalities, as if they were on, (poses, rows) each."""
    data = mujoco.MjData(model)
    data.eq_active[:] = 0
    for one in idle:
        data.eq_active[one.index] = 1
    found: list[list[np.ndarray]] = [[] for _ in idle]
    with collected_warnings():
        for pose in poses:
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeConstraint(model, data)
            for one, rows in zip(idle, found, strict=True):
                rows.append(data.efc_pos[: data.ne][data.efc_id[: data.ne] == one.index].copy())
    return [np.array(rows) for rows in found]


def _held(recording: Recording, equality: Equality) -> Opening | None:
    model = copy.deepcopy(recording.model)
    model.eq_active0[equality.index] = 1
    data = recording.restart(model)
    rows, taken = [], 0
    with np.errstate(all="ignore"), collected_warnings():  # of a run that diverges
        for step in walk(model, data, drive(model, recording.laws), recording.steps):
            rows.append(data.efc_pos[: data.ne][data.efc_id[: data.ne] == equality.index].copy())
            taken = step + 1
    if taken < recording.steps:
        return None
    deviations = np.array(rows)
    return opening(model, equality, deviations[widest(model, equality, deviations)])
