"""Why a loop drifts: every row is a damped oscillator that its own force drives, and its deviation a sum of causes.

With r̈ = J·qacc + J̇v and MuJoCo's own f, R, K, B and d, at every step and row,

    r̈ + B ṙ + K d r = −R f + m − ε

where m is what MuJoCo's reference acceleration leaves out of J̇v, J̇v itself on joint and tendon rows and 0 on those of
connects and welds, and ε = aref − J·qacc − R f is what its solver left. The law is linear in what stands on the right,
so that r is a sum of parts, each cause filtered by the oscillator on its own; none is taken away before another:

    compliance   −R f*, with f* the force of a solver without error
    curvature    m
    solver       −R (f − f*) − ε
    start        r(0) and ṙ(0), and those of a row at the moment it appears
    stepping     what the integrator did otherwise than the oscillator in one step

Parts are propagated over a step h by the exact map of the oscillator, with K d, B and the right-hand side held over the
step. Under Euler and the implicit integrators that is also how MuJoCo holds its force, and "stepping" is what the
integrator and the change of J within a step add; controls, which are held too, are in it. Under Runge–Kutta the force
is evaluated at four stages, the right-hand side is taken as linear over the step, and "stepping" holds what is left:
the integrator's own error and that of the line, both of second order in h or higher.

The parts of one row may exceed it, and oppose one another.
"""

import copy
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.diagnosis.loops.gaps import widest
from oarlock.diagnosis.runs.recording import Recording
from oarlock.mechanics.engine_version import lacks_curvature
from oarlock.mechanics.folding import fold
from oarlock.mechanics.inertia import whiten
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.closing import close
from oarlock.stepping.projection import Projector
from oarlock.stepping.solvers import REFERENCE, SolverSpec

CAUSES = ("compliance", "curvature", "solver", "start", "stepping")

INSTANTS = 100
"""So many instants of a run at most are looked at for accelerations: each takes a projection."""

FEWEST, WORK = 24, 2_000_000
"""Of many rows they are fewer: so many numbers of J in all, but no fewer instants than that."""

HOLDS = 1e-7
"""Relative. A defect beyond it means that MuJoCo did not compute its rows by this law, as under the discrete
integrator; rounding leaves 1e-13."""

_EXPONENT = 0.5
"""Norm below which the series of the exponential is taken: twelve terms then reach rounding."""


@dataclass(frozen=True)
class Share:
    """The parts of one equality's drift.

    Attributes:
        name: of the equality.
        worst: deviation, m or rad, with sign, of the row that is off most where it opens furthest; row and time_s say
            where and when.
        row: number of that row among all.
        label, unit: of that row.
        parts: cause → part of it, m or rad, with sign; they add up to ``worst``.
        shares: the same relative to ``worst``; they add up to 1.
        over_run: cause → ⟨r_k, r⟩/⟨r, r⟩ over all its rows and steps; they add up to 1.
        rms: cause → root mean square of the part, m or rad; ``total`` that of r.
        work: done by the equality on the mechanism over the run, J: negative where the loop loses energy.
    """

    name: str
    worst: float
    row: int
    label: str
    unit: str
    time_s: float
    parts: dict[str, float]
    shares: dict[str, float]
    over_run: dict[str, float]
    rms: dict[str, float]
    total: float
    work: float

    @property
    def leading(self) -> str:
        """The cause with the largest part at the worst moment, in the direction of the drift."""
        return max(self.shares, key=lambda cause: self.shares[cause])


@dataclass(frozen=True)
class Accelerations:
    """MuJoCo's acceleration less the exact one at the same state, by cause.

    Δa = M⁻¹Jᵀ (J M⁻¹ Jᵀ)⁺ Σ r̈_k, with the rank of A at the state projected onto the constraints.

    Attributes:
        instants: steps that were looked at, (n).
        rank: there, (n).
        parts: (causes, n, nv), rad/s² or m/s².
        exact: the exact accelerations, (n, nv).
    """

    instants: np.ndarray
    rank: np.ndarray
    parts: np.ndarray
    exact: np.ndarray

    @property
    def difference(self) -> np.ndarray:
        """Of all causes together, (n, nv)."""
        return self.parts.sum(axis=0)


@dataclass(frozen=True)
class Attribution:
    """The parts of every row's deviation, for the causes of ``CAUSES``.

    Attributes:
        position: r_k, (causes, steps, rows), m or rad; their sum is r.
        velocity: ṙ_k; acceleration: r̈_k.
        defect: of the row law, relative to the largest of its terms on the rows of the same equality.
        work: cumulated work of each equality on the mechanism, (steps, equalities), J.
        shares: an entry an equality, in the order of the layout; those without a row throughout are left out.
    """

    recording: Recording
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    defect: float
    work: np.ndarray
    shares: list[Share]

    @property
    def holds(self) -> bool:
        """Whether the row law describes this run; where it does not, the parts say nothing."""
        return self.defect <= HOLDS

    @cached_property
    def worst(self) -> Share:
        """The equality that opens furthest."""
        return max(self.shares, key=lambda share: abs(share.worst))

    def accelerations(self, instants: np.ndarray | None = None) -> Accelerations:
        """MuJoCo's acceleration difference at some steps, or at evenly spaced ones and the worst moments."""
        return _accelerations(self, instants)


def attribute(recording: Recording) -> Attribution:
    """Splits the drift of a recorded run by the exact row law.

    Raises:
        InputError: the run diverged before its first step.
    """
    if recording.steps == 0:
        raise InputError(f"nothing to attribute: {recording.end.message}")
    missing, residue = curvature_missing(recording), _solver_residue(recording)
    inputs = np.zeros((len(CAUSES), *recording.position.shape))
    inputs[0] = -recording.softness * recording.exact_force
    inputs[1] = missing
    inputs[2] = -recording.softness * (recording.force - recording.exact_force) - residue
    inputs *= recording.present
    position, velocity = _propagate(recording, inputs)
    spring, damping = recording.stiffness * recording.impedance, recording.damping
    acceleration = inputs - damping * velocity - spring * position
    work = _work(recording)
    return Attribution(
        recording=recording,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        defect=_defect(recording, missing, residue),
        work=work,
        shares=_shares(recording, position, work),
    )


def curvature_missing(recording: Recording) -> np.ndarray:
    """The m of the row law, (steps, rows): J̇v on the rows where MuJoCo leaves it out of its reference acceleration."""
    kinds = [recording.layout.equalities[owner].kind for owner in recording.layout.owner]
    return np.where([lacks_curvature(kind) for kind in kinds], recording.curvature, 0.0)


def _solver_residue(recording: Recording) -> np.ndarray:
    return recording.aref - recording.reached - recording.softness * recording.force


def _defect(recording: Recording, missing: np.ndarray, residue: np.ndarray) -> float:
    terms = [
        recording.reached + recording.curvature,
        recording.damping * recording.velocity,
        recording.stiffness * recording.impedance * recording.position,
        recording.softness * recording.force,
        -missing,
        residue,
    ]
    left = np.abs(sum(terms) * recording.present).max(axis=0, initial=0.0)
    size = np.abs(terms).max(axis=(0, 1), initial=0.0)
    worst = 0.0
    for place in range(len(recording.layout.equalities)):
        rows = recording.layout.of_equality(place)
        scale = size[rows].max()
        if scale > 0.0:
            worst = max(worst, float(left[rows].max() / scale))
    return worst


# Propagation.


def step_maps(spring: np.ndarray, damping: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What one step makes of an oscillator r̈ + B ṙ + k r = u, by the exponential of its matrix.

    Args:
        spring: k, 1/s², any shape.
        damping: B, 1/s, the same shape.
        timestep_s: h.

    Returns:
        Φ (…, 2, 2), γ₀ and γ₁ (…, 2): (r, h ṙ) goes to Φ (r, h ṙ) + γ₀ h²u + γ₁ h²Δu for a u that grows by Δu within
        the step, linearly.
    """
    # Rows 0 and 1 of the powers of (0 1 0 0 / −h²k −hB 1 0 / 0 0 0 1 / 0 0 0 0), of which the rest is known.
    pull, brake = -np.square(timestep_s) * np.asarray(spring), -timestep_s * np.asarray(damping)
    size = float(np.maximum(np.abs(pull) + np.abs(brake) + 1.0, 1.0).max(initial=1.0))
    halvings = max(0, int(np.ceil(np.log2(size / _EXPONENT)))) if np.isfinite(size) else 0
    scale = 0.5**halvings
    term = np.zeros((4, 2, *np.shape(spring)))  # columns, rows
    term[0, 0] = term[1, 1] = 1.0
    whole = term.copy()
    for order in range(1, 13):
        factor = scale / order
        term = np.stack([pull * term[1], term[0] + brake * term[1], term[1], term[2]])
        term *= factor
        whole += term
    for _ in range(halvings):
        # The lower rows are (0 0 1 s / 0 0 0 1) with what the step is by now, s.
        upper = whole[0][:, None] * whole[:, 0][None] + whole[1][:, None] * whole[:, 1][None]
        upper = upper.swapaxes(0, 1)
        upper[2] += whole[2]
        upper[3] += scale * whole[2] + whole[3]
        whole, scale = upper, 2.0 * scale
    at_end = np.moveaxis(whole, (0, 1), (-1, -2))
    return at_end[..., :2], at_end[..., 2], at_end[..., 3]


def _propagate(recording: Recording, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts r_k and ṙ_k, (causes, steps, rows) each, of the inputs of the causes."""
    h, steps, rows = recording.timestep_s, recording.steps, recording.layout.rows
    causes = len(CAUSES)
    start, stepping = CAUSES.index("start"), CAUSES.index("stepping")
    recorded = np.stack([recording.position, h * recording.velocity])
    parts = np.zeros((steps, 2, causes, rows))
    maps, gains, slopes = step_maps(recording.stiffness * recording.impedance, recording.damping, h)
    lasting = recording.present[1:] & recording.present[:-1]
    forced = np.square(h) * inputs.transpose(1, 0, 2)
    forcing = gains.transpose(0, 2, 1)[:-1, :, None, :] * forced[:-1, None]
    if not recording.holds_force:
        growth = np.where(lasting[:, None], forced[1:] - forced[:-1], 0.0)
        forcing += slopes.transpose(0, 2, 1)[:-1, :, None, :] * growth[:, None]
    maps = maps.transpose(0, 2, 3, 1)
    if steps:
        parts[0, :, start] = recorded[:, 0]
    for step in range(steps - 1):
        now, (first, second) = parts[step], maps[step]
        after = parts[step + 1]
        after[:] = forcing[step]
        after[0] += first[0] * now[0] + first[1] * now[1]
        after[1] += second[0] * now[0] + second[1] * now[1]
        if not lasting[step].all():
            after *= lasting[step]
            after[:, start] += np.where(lasting[step], 0.0, recorded[:, step + 1])
        after[:, stepping] += recorded[:, step + 1] - after.sum(axis=1)
    return parts[:, 0].transpose(1, 0, 2), parts[:, 1].transpose(1, 0, 2) / h


def _work(recording: Recording) -> np.ndarray:
    """Cumulated ∫ f·ṙ dt of each equality, (steps, equalities), J."""
    h, force, velocity = recording.timestep_s, recording.force, recording.velocity
    power = np.zeros_like(force)
    if recording.steps > 1:
        if recording.holds_force:  # what it changes in ½ v·M v is its product with the mean velocity
            power[1:] = force[:-1] * 0.5 * (velocity[1:] + velocity[:-1])
        else:
            power[1:] = 0.5 * (force[1:] * velocity[1:] + force[:-1] * velocity[:-1])
    places = len(recording.layout.equalities)
    by_equality = [power[:, recording.layout.of_equality(place)].sum(axis=1) for place in range(places)]
    return h * np.cumsum(np.stack(by_equality, axis=1), axis=0)


def _worst_row(recording: Recording, place: int) -> tuple[int, int]:
    """The step at which an equality opens furthest, as the drift is told, and the row that is off most there."""
    equality, rows = recording.layout.equalities[place], recording.layout.of_equality(place)
    step = widest(recording.model, equality, recording.position[:, rows])
    own = np.abs(recording.position[step, rows])
    return step, int(rows.start + own.argmax())


def _shares(recording: Recording, position: np.ndarray, work: np.ndarray) -> list[Share]:
    layout, found = recording.layout, []
    for place, equality in enumerate(layout.equalities):
        rows = layout.of_equality(place)
        own = recording.position[:, rows]
        if not recording.present[:, rows].any():
            continue
        step, row = _worst_row(recording, place)
        worst = float(recording.position[step, row])
        parts = {cause: float(part) for cause, part in zip(CAUSES, position[:, step, row], strict=True)}
        own_parts = position[:, :, rows]
        square = float((own * own).sum())
        projected = (own_parts * own).sum(axis=(1, 2)) / square if square > 0.0 else np.zeros(len(CAUSES))
        rms = np.sqrt(np.square(own_parts).mean(axis=(1, 2)))
        found.append(
            Share(
                name=equality.name,
                worst=worst,
                row=row,
                label=layout.labels[row],
                unit=layout.units[row],
                time_s=float(recording.time[step]),
                parts=parts,
                shares={cause: part / worst if worst else 0.0 for cause, part in parts.items()},
                over_run=dict(zip(CAUSES, projected.tolist(), strict=True)),
                rms=dict(zip(CAUSES, rms.tolist(), strict=True)),
                total=float(np.sqrt(np.square(own).mean())),
                work=float(work[-1, place]),
            )
        )
    return found


# Accelerations.


def _accelerations(attribution: Attribution, instants: np.ndarray | None) -> Accelerations:
    recording = attribution.recording
    if instants is None:
        size = max(1, recording.layout.rows * recording.model.nv)
        most = min(INSTANTS, max(FEWEST, WORK // size), recording.steps)
        spaced = np.linspace(0, recording.steps - 1, most).astype(int)
        furthest = sorted(attribution.shares, key=lambda share: -abs(share.worst))[:most]
        worst = [round(share.time_s / recording.timestep_s) for share in furthest]
        instants = np.unique([*spaced, *(min(step, recording.steps - 1) for step in worst)])
    ranks = ranks_at(recording, instants)
    data = mujoco.MjData(recording.model)
    recording.layout.activate(data)
    parts = np.zeros((len(CAUSES), len(instants), recording.model.nv))
    for place, (step, rank) in enumerate(zip(instants, ranks, strict=True)):
        _place(recording, data, step)
        mujoco.mj_fwdPosition(recording.model, data)
        whitened, unwhiten = whitened_rows(recording.model, data)
        folded = fold(whitened)
        left, sizes, right = np.linalg.svd(folded.rows, full_matrices=False)
        count = min(int(rank), int((sizes > 0.0).sum()))
        wanted = folded.gather(attribution.acceleration[:, step, recording.present[step]].T).T
        change = (wanted @ left[:, :count] / sizes[:count]) @ right[:count]
        parts[:, place] = change @ unwhiten.T
    exact = recording.qacc[instants] - parts.sum(axis=0)
    return Accelerations(instants, ranks, parts, exact)


def _place(recording: Recording, data: mujoco.MjData, step: int) -> None:
    """Puts a data at the pose of a step, with the equalities that had rows there."""
    data.qpos[:] = recording.qpos[step]
    for place, equality in enumerate(recording.layout.equalities):
        data.eq_active[equality.index] = recording.present[step, recording.layout.of_equality(place)].any()


def whitened_rows(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """W = J L⁻ᵀ of the equality rows (ne, nv) with M = L Lᵀ, and L⁻ᵀ (nv, nv): A = W Wᵀ, M⁻¹Jᵀ = L⁻ᵀ Wᵀ."""
    jacobian = np.ascontiguousarray(closing_jacobian(model, data))
    half = whiten(model, data, np.eye(model.nv))
    return jacobian @ half, half


def ranks_at(recording: Recording, instants: np.ndarray) -> np.ndarray:
    """Rank of the equality rows at some steps, (n), counted where the state is projected onto the constraints.

    A drifted state opens redundant rows, and gives them singular values that look like small true ones.
    """
    model = copy.deepcopy(recording.model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    recording.layout.activate(data)
    projector = Projector(model, None, SolverSpec(REFERENCE))
    found = np.zeros(len(instants), dtype=int)
    for place, step in enumerate(instants):
        _place(recording, data, step)
        close(model, data, None)  # where it does not succeed, the nearest pose it found is counted at
        mujoco.mj_fwdPosition(model, data)
        if data.ne:
            projector.correction(data, -data.efc_pos[: data.ne])
            found[place] = projector.rank
    return found
