"""What the same run would drift by more under versions of MuJoCo that leave J̇v out of connects and welds too."""

import numpy as np

from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.row_law import step_maps
from oarlock.mechanics.engine_version import lacks_curvature

OLDER = 3.0
"""Times the drift: so much more a version without J̇v must make of it to be worth a word."""


def without_curvature(recording: Recording) -> np.ndarray:
    """The response of every row of a connect or weld to J̇v, (steps, rows), m or rad; 0 on other rows.

    r̈ + B ṙ + K d r = J̇v by the exact map of a step, with the right-hand side held over it: along the recorded motion,
    which a drift of this size would change in turn.
    """
    h, layout = recording.timestep_s, recording.layout
    kinds = [layout.equalities[owner].kind for owner in layout.owner]
    ours = np.array([kind.known and not lacks_curvature(kind) for kind in kinds], dtype=bool)
    found = np.zeros_like(recording.position)
    if not ours.any() or recording.steps < 2:
        return found
    forced = np.square(h) * (recording.curvature * recording.present)[:, ours]
    spring = (recording.stiffness * recording.impedance)[:, ours]
    maps, gains, _ = step_maps(spring, recording.damping[:, ours], h)
    maps, forcing = maps.transpose(0, 2, 3, 1), gains.transpose(0, 2, 1) * forced[:, None]
    state, kept = np.zeros((2, forced.shape[1])), np.zeros_like(forced)
    lasting = recording.present[:, ours]
    for step in range(recording.steps - 1):
        (first, second), (r, rate) = maps[step], state
        state = forcing[step] + np.stack([first[0] * r + first[1] * rate, second[0] * r + second[1] * rate])
        state *= lasting[step + 1]
        kept[step + 1] = state[0]
    found[:, ours] = kept
    return found
