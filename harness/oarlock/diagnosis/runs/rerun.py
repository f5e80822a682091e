"""The same run of a model in which something was changed: what a cause costs is what is left without it."""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.walking import walk
from oarlock.mechanics.controls import drive
from oarlock.mechanics.load import collected_warnings
from oarlock.poses.layout import RowColumns


@dataclass(frozen=True)
class Rerun:
    """What a run was at the start of each step of the recording.

    Attributes:
        position: deviations of all rows, (steps, rows), m or rad.
        qpos: coordinates, (steps, nq).
    """

    position: np.ndarray
    qpos: np.ndarray


def rerun(recording: Recording, model: mujoco.MjModel, *, parts: int = 1, steps: int | None = None) -> Rerun | None:
    """Makes the run of a recording again: the same start and controls, and its rows by its own layout.

    Args:
        recording: MuJoCo's run as configured.
        model: a changed copy of its model, with the same joints, equalities and actuators.
        parts: steps of the model for one of the recording.
        steps: of the recording; all that it has if left out.

    Returns:
        None where the run does not stay finite.
    """
    steps = recording.steps if steps is None else steps
    if not steps:
        return None
    data, columns = recording.restart(model), RowColumns(recording.layout)
    position, qpos = np.zeros((steps, recording.layout.rows)), np.zeros((steps, model.nq))
    taken = 0
    with np.errstate(all="ignore"), collected_warnings():  # of a run that diverges
        for step in walk(model, data, drive(model, recording.laws), parts * steps):
            if step % parts == 0:
                position[step // parts, columns.of(data)] = data.efc_pos[columns.rows(data)]
                qpos[step // parts] = data.qpos
            taken = step + 1
    return Rerun(position, qpos) if taken == parts * steps else None
