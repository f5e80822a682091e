"""Closing loops: from a pose to a near one where every equality row is zero, or to the equalities that prevent it."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.base.text import quoted
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.engine_version import diagonal_approx
from oarlock.mechanics.inequalities import IGNORED
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.projection import Projector, gap
from oarlock.stepping.solvers import REFERENCE, SolverSpec

CLOSED = 1e-12
"""Largest deviation of a row of a closed loop, m or rad: about 1000 rounding errors of a length of 1 m, so that a start
that is already consistent is not changed."""

CONSISTENT = 1e-6
"""m or rad, and per s: what six digits of a file leave open where they cannot be closed beyond, and far less than a
soft loop opens by itself."""

MAX_STEPS = 50
TRUST = 0.5
"""Largest Newton step of a coordinate, rad or m."""

SUSPECTS = 24
"""Maximum number of equalities that are tried one by one when a start cannot be closed; each takes two closings."""


FAR = 1e6
"""A gap, m or rad, that no mechanism closes in ``MAX_STEPS`` steps of ``TRUST``."""


def close(model: mujoco.MjModel, data: mujoco.MjData, rank_cut: float | None) -> bool:
    """Closes the active equalities by changing ``qpos``; the position stage is valid afterwards.

    It takes Newton steps in the metric of M, damped when they do not help (Levenberg–Marquardt), with contacts, limits
    and friction switched off: on its way to a closed pose the mechanism may pass through them.

    Args:
        model: the model.
        data: the pose, which is changed.
        rank_cut: eigenvalues below this part of the largest count as zero; None for the solver's default.

    Returns:
        Whether every row is closed; if not, the pose is the best one found.
    """
    with _loops_only(model):
        mujoco.mj_fwdPosition(model, data)
        projector = Projector(model, rank_cut, SolverSpec(REFERENCE))
        error = gap(data)
        damping = 0.0
        for _ in range(MAX_STEPS):
            if error <= CLOSED:
                return True
            # The step is cut to TRUST: of a gap beyond FAR only the direction matters, and its square may overflow.
            wanted = -data.efc_pos[: data.ne] / max(1.0, error / FAR)
            step = projector.correction(data, wanted, damping)
            step *= min(1.0, TRUST / max(np.abs(step).max(), TRUST))
            before = data.qpos.copy()
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            mujoco.mj_fwdPosition(model, data)
            after = gap(data)
            if after < error:
                error, damping = after, damping / 10.0 if damping > 1e-12 else 0.0
                continue
            data.qpos[:] = before
            mujoco.mj_fwdPosition(model, data)
            if error <= 100 * CLOSED:
                return True  # rounding: long mechanisms cannot do better
            scale = float(np.abs(diagonal_approx(data)[: data.ne]).max())
            damping = max(10.0 * damping, 1e-6 * scale)
        return error <= CLOSED


@contextmanager
def _loops_only(model: mujoco.MjModel) -> Iterator[None]:
    flags = model.opt.disableflags
    model.opt.disableflags |= IGNORED
    try:
        yield
    finally:
        model.opt.disableflags = flags


def culprits(model: mujoco.MjModel, given: mujoco.MjData, rank_cut: float | None) -> str:
    """Says in words which equalities keep a pose from being closed. Each is tried alone, then all but each.

    Args:
        model: the model.
        given: the pose that could not be closed; it is not changed.
        rank_cut: eigenvalues below this part of the largest count as zero; None for the solver's default.
    """
    active = [equality for equality in equalities(model) if given.eq_active[equality.index]]
    trial = mujoco.MjData(model)

    def closes(chosen: list[Equality]) -> bool:
        trial.qpos[:], trial.eq_active[:] = given.qpos, 0
        trial.mocap_pos[:], trial.mocap_quat[:] = given.mocap_pos, given.mocap_quat
        for equality in chosen:
            trial.eq_active[equality.index] = 1
        return close(model, trial, rank_cut)

    if len(active) == 1:
        return "no pose near it brings its two sides together"
    if len(active) > SUSPECTS:
        return f"{len(active)} equalities, too many to try each alone"
    impossible = []
    for equality in active:
        if not closes([equality]):
            impossible.append(f"{quoted(equality.name)} stays open by {gap(trial):.4g} {equality.unit}")
    if impossible:
        return f"even alone {few(impossible)}"
    to_blame = [quoted(one.name) for one in active if closes([other for other in active if other is not one])]
    if to_blame:
        return f"each closes alone, but not all together; the rest closes without {few(to_blame, last='or without')}"
    return "each closes alone, but not all together, and leaving out any single one does not help"


def lacks_memory(data: mujoco.MjData) -> bool:
    """Whether MuJoCo left rows out of a state whose position stage is done, for want of memory."""
    return data.warning[mujoco.mjtWarning.mjWARN_CNSTRFULL].number > 0


def require_memory(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Checks that a state whose position stage is done has all of its rows.

    Raises:
        InputError: the model's memory does not hold them, and MuJoCo left some out.
    """
    if lacks_memory(data):
        raise InputError(
            f"the model's memory of {model.narena} bytes does not hold its constraints, expected a larger "
            '<size memory="…"/>'
        )


def require_rows(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Checks that a pose has equality rows and that they can be computed.

    Raises:
        InputError: no equality has a row at this pose, one is of an unknown kind, its rows are not finite, or the
            model's memory does not hold them, in which case MuJoCo leaves some out.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is named below
        Curvature(model, data)
    with _loops_only(model), collected_warnings():
        mujoco.mj_fwdPosition(model, data)
    require_memory(model, data)
    if data.ne == 0:
        names = few([quoted(equality.name) for equality in equalities(model)])
        raise InputError(f"no active equality rows at the start (equalities: {names}), expected a closed loop")
    finite = np.isfinite(closing_jacobian(model, data)).all(axis=1) & np.isfinite(data.efc_pos[: data.ne])
    if not finite.all():
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, int(data.efc_id[int(finite.argmin())]))
        raise InputError(f"equality {quoted(name)} has rows that are not finite at the start, expected finite numbers")
