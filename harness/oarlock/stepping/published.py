"""Values that others published, compared with a run at exactly the step of their time."""

from collections import defaultdict
from collections.abc import Sequence

import mujoco
import numpy as np

from oarlock.base.arrays import largest
from oarlock.base.errors import InputError, choose
from oarlock.cases.equality_kinds import KNOWN
from oarlock.cases.published import Published
from oarlock.mechanics.names import equalities
from oarlock.mechanics.observed import Observed

ON_GRID = 1e-9
"""Part of a timestep by which the time of a value may differ from that of a step; no state is interpolated."""


def componentwise(value: np.ndarray, published: np.ndarray) -> float:
    """Computes the largest relative difference of any component.

    Where a published component is 0, the difference is relative to the largest one; where all are 0, it is absolute.
    """
    scale = np.abs(published)
    scale[scale == 0] = scale.max() or 1.0
    return float(largest((value - published) / scale))


class PublishedValues:
    """The published values of a model's motion by the step of their time.

    Args:
        model: the model.
        values: what is published of its motion.
        where: where they are written down, for messages.
        own: whether the timestep is the one that the values were chosen for. At any other one, values between two
            steps are left out.

    Raises:
        InputError: a value names something that the model does not have, or lies between two of their own steps.
    """

    def __init__(self, model: mujoco.MjModel, values: Sequence[Published], where: str, *, own: bool = True):
        timestep = float(model.opt.timestep)
        all_of = equalities(model)
        names = [equality.name for equality in all_of]
        self._due: dict[int, list[tuple[Published, Observed | int]]] = defaultdict(list)
        for value in values:
            step = round(value.time_s / timestep)
            if abs(value.time_s / timestep - step) > ON_GRID:
                if own:
                    raise InputError(
                        f"{where}: time_s = {value.time_s:g} is no multiple of the timestep {timestep:g} s, "
                        "expected the time of a step"
                    )
                continue
            if value.equality is not None:
                observed = names.index(choose(f"equality in {where}", value.equality, names))
                kind, given = all_of[observed].kind, len(value.multipliers or ())
                if not kind.known:
                    raise InputError(f"{where}: multipliers of '{value.equality}', a {kind}, expected {KNOWN}")
                rows = kind.rows
                if given != rows:
                    raise InputError(f"{where}: {given} multipliers of '{value.equality}', expected {rows}, one a row")
            else:
                observed = Observed(model, where, joint=value.joint, site=value.site)
            self._due[step].append((value, observed))

    @property
    def last_step(self) -> int:
        """Step of the latest value; −1 if there are no values."""
        return max(self._due, default=-1)

    @property
    def steps(self) -> list[int]:
        """Steps that have published values."""
        return sorted(self._due)

    def errors(self, step: int, data: mujoco.MjData) -> dict[str, float]:
        """Computes how far the state at a step is from the values published for it.

        Returns:
            For positions the largest absolute difference, rad or m; for velocities and multipliers (those in
            ``data.efc_force``) the largest relative difference of any component. Empty if the step has no values.
        """
        found: dict[str, float] = {}

        def worse(figure: str, error: float) -> None:
            found[figure] = float(np.maximum(found.get(figure, 0.0), error))  # unlike max(), it keeps a NaN

        for value, observed in self._due.get(step, ()):
            if isinstance(observed, int):
                rows = data.efc_id[: data.ne] == observed
                multipliers, printed = data.efc_force[: data.ne][rows], np.array(value.multipliers)
                same = len(multipliers) == len(printed)  # MuJoCo drops an equality whose rows are all zero
                worse("published_multiplier_error_rel", componentwise(multipliers, printed) if same else np.nan)
                continue
            if value.position is not None:
                apart = observed.position(data) - np.atleast_1d(value.position)
                worse("published_position_error", float(largest(apart)))
            if value.velocity is not None:
                printed = np.array([value.velocity])
                worse("published_velocity_error_rel", componentwise(np.array([observed.velocity(data)]), printed))
        return found
