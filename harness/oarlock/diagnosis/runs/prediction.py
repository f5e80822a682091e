"""The drift under another solref and solimp, from one recorded run.

Softness changes the loops' forces little: what they must do to the coordinates, Q = Jᵀλ with the exact multipliers λ
at the recorded states, stays. Redundant rows share it by their compliance, f = argmin fᵀC f with Jᵀf = Q and
C = R/(K d) of the new setting. The rows then answer −R f + m as the oscillators that they
are, one step after another as the integrator takes it, and what the recorded steps added to (r, ṙ) otherwise, because J
changes within a step, is added again. Right to 15 % mostly, and best from a run that was stiff itself.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.row_law import CAUSES, attribute, curvature_missing, ranks_at, step_maps, whitened_rows
from oarlock.diagnosis.runs.stability import RowSettings, refsafe

INSTANTS, FEWEST = 400, 40
"""So many steps of a run at most are solved for forces, and so many of one with many rows, where each takes
milliseconds; in between they are interpolated."""

_WORK = 50_000_000
"""Products of the sizes of all matrices that are decomposed, about a second."""

RANKS = 20
"""So many of these are counted for their rank: it takes a projection."""

ROUNDS = 2
"""d hangs on r, and r on d: so often r is computed."""

_FLOOR = 1e-15
"""MuJoCo's least R."""


@dataclass(frozen=True)
class Prediction:
    """r (steps, rows) and its largest magnitude, m or rad, that a run with these settings is expected to have."""

    settings: RowSettings
    position: np.ndarray

    @property
    def drift(self) -> float:
        """The largest deviation of any row."""
        return float(np.abs(self.position).max(initial=0.0))


def predict(recording: Recording, solref: tuple[float, float], solimp: tuple[float, ...]) -> Prediction:
    """Predicts a run with the same start, controls, timestep and integrator, all equalities with the given settings."""
    h = recording.timestep_s
    settings = RowSettings.of(np.array(solref), np.array(solimp), h, refsafe(recording.model))
    size = recording.layout.rows * recording.model.nv * min(recording.layout.rows, recording.model.nv)
    count = min(recording.steps, INSTANTS, max(FEWEST, _WORK // size))
    instants = np.linspace(0, recording.steps - 1, count).astype(int)
    sampled = instants[np.linspace(0, len(instants) - 1, min(RANKS, len(instants))).astype(int)]
    ranks = ranks_at(recording, sampled)[np.abs(instants[:, None] - sampled).argmin(axis=1)]
    needed = _needed(recording, instants, ranks)
    missing = curvature_missing(recording)
    position = recording.position
    added = _added(recording)
    for _ in range(ROUNDS):
        impedance = _impedance(recording, settings, position)
        softness = np.maximum(_FLOOR, (1.0 - impedance) / impedance * recording.diagonal_approx)
        spring = settings.stiffness * impedance
        compliance = softness / spring
        force = _shared(recording, instants, ranks, needed, compliance)
        damping = np.full_like(spring, settings.damping)
        position = _walk(recording, spring, damping, missing - softness * force, added)
    return Prediction(settings, position)


def _impedance(recording: Recording, settings: RowSettings, position: np.ndarray) -> np.ndarray:
    found = np.zeros_like(position)
    for place in range(len(recording.layout.equalities)):
        rows = recording.layout.of_equality(place)
        found[:, rows] = settings.impedance(np.linalg.norm(position[:, rows], axis=1))[:, None]
    return found


Needed = list[tuple[np.ndarray, np.ndarray]]
"""Of each instant: the whitened rows W (ne, nv), and L⁻¹Q (nv)."""


def _needed(recording: Recording, instants: np.ndarray, ranks: np.ndarray) -> Needed:
    model = recording.model
    data = mujoco.MjData(model)
    found: Needed = []
    for step, rank in zip(instants, ranks, strict=True):
        data.qpos[:] = recording.qpos[step]
        mujoco.mj_fwdPosition(model, data)
        rows, _ = whitened_rows(model, data)
        present = recording.present[step]
        # J a₀ from what was recorded: J a₀ = J a − A f.
        free = recording.reached[step, present] - rows @ (rows.T @ recording.force[step, present])
        wanted = -recording.curvature[step, present] - free
        left, sizes, right = np.linalg.svd(rows, full_matrices=False)
        count = min(int(rank), int((sizes > 0.0).sum()))
        found.append((rows, (wanted @ left[:, :count] / sizes[:count]) @ right[:count]))
    return found


def _shared(
    recording: Recording, instants: np.ndarray, ranks: np.ndarray, needed: Needed, compliance: np.ndarray
) -> np.ndarray:
    """Forces f (steps, rows): of those with Jᵀf = Q the one with the least fᵀC f."""
    forces = np.zeros((len(instants), recording.layout.rows))
    for place, (step, rank, (rows, change)) in enumerate(zip(instants, ranks, needed, strict=True)):
        present = recording.present[step]
        scale = 1.0 / np.sqrt(np.maximum(compliance[step, present], 1e-300))
        scale /= scale.max(initial=1e-300)
        left, sizes, right = np.linalg.svd(scale[:, None] * rows, full_matrices=False)
        count = min(int(rank), int((sizes > 0.0).sum()))
        forces[place, present] = scale * ((change @ right[:count].T / sizes[:count]) @ left[:, :count].T)
    steps = np.arange(recording.steps)
    return np.stack([np.interp(steps, instants, column) for column in forces.T], axis=1)


def _added(recording: Recording) -> np.ndarray:
    """What each recorded step added to (r, h ṙ) beyond the integrator's own step of r̈, (steps - 1, 2, rows)."""
    h = recording.timestep_s
    position, velocity = recording.position, h * recording.velocity
    if recording.integrator == "rk4":
        stepping = CAUSES.index("stepping")
        parts = attribute(recording)
        own = np.stack([parts.position[stepping], h * parts.velocity[stepping]], axis=1)
        maps, _, _ = step_maps(recording.stiffness * recording.impedance, recording.damping, h)
        return own[1:] - np.einsum("nrij,njr->nir", maps[:-1], own[:-1])
    acceleration = np.square(h) * (recording.reached + recording.curvature)
    faster = velocity[1:] - velocity[:-1] - acceleration[:-1]
    further = position[1:] - position[:-1] - velocity[1:]
    # Of a velocity that came otherwise the position of the same step has its share.
    return np.stack([further + faster, faster], axis=1)


def _walk(
    recording: Recording, spring: np.ndarray, damping: np.ndarray, inputs: np.ndarray, added: np.ndarray
) -> np.ndarray:
    h = recording.timestep_s
    state = np.stack([recording.position[0], h * recording.velocity[0]])
    found = np.zeros_like(recording.position)
    found[0] = state[0]
    forced = np.square(h) * inputs
    if recording.integrator == "rk4":
        maps, gains, slopes = step_maps(spring, damping, h)
        maps = maps.transpose(0, 2, 3, 1)
        forcing = gains.transpose(0, 2, 1)[:-1] * forced[:-1, None]
        forcing = forcing + slopes.transpose(0, 2, 1)[:-1] * (forced[1:] - forced[:-1])[:, None]
    else:  # ṙ first, then r with the new ṙ
        after = np.stack([-np.square(h) * spring, 1.0 - h * damping], axis=1)
        maps = np.stack([after + np.array([1.0, 0.0])[:, None], after], axis=1)
        forcing = np.stack([forced[:-1], forced[:-1]], axis=1)
    forcing = forcing + added
    for step in range(recording.steps - 1):
        state = np.einsum("ijr,jr->ir", maps[step], state) + forcing[step]
        found[step + 1] = state[0]
    return found
