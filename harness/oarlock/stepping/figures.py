"""Figures of steps. Of many steps at once, arrays have a leading axis of steps."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from oarlock.base.arrays import largest
from oarlock.base.core import Info
from oarlock.base.vectors import times
from oarlock.stepping.projection import Projector
from oarlock.stepping.state import State


def drift(state: State, qacc: np.ndarray) -> tuple[float, float, float]:
    """How open the worst row is: position r, velocity J v, acceleration J a + J̇v (m or rad, per s, per s²)."""
    acceleration = times(state.jacobian, qacc) + state.curvature
    return float(largest(state.residual)), float(largest(state.rate)), float(largest(acceleration))


def solving(infos: Sequence[Sequence[Info]], references: Sequence[Info] | None) -> dict[str, Any]:
    """What the solves of each step took.

    ``references`` are the pseudo-inverse's infos on the first solve's question: they give the rank and the
    inconsistency, which are the question's and not every solver knows them.
    """
    every = [info for step in infos for info in step]
    begins = np.cumsum([0, *map(len, infos[:-1])])
    wrong = [[info.status for info in step if info.status != "converged"] for step in infos]
    known = references or [step[0] for step in infos]
    iterations = np.array([info.iterations for info in every])
    return {
        "status": [statuses[0] if statuses else "converged" for statuses in wrong],
        "solves": [len(step) for step in infos],
        "unconverged": [len(statuses) for statuses in wrong],
        "iterations": np.add.reduceat(iterations, begins),
        "iterations_worst": np.maximum.reduceat(iterations, begins),
        "products": np.add.reduceat([info.products for info in every], begins),
        # A new fold changes the size, and a solver has to start from something: that is counted apart.
        "refreshes": np.add.reduceat([int(info.refreshed and not info.refolded) for info in every], begins),
        "refolds": np.add.reduceat([int(info.refolded) for info in every], begins),
        "residual_rel": np.maximum.reduceat([info.residual_rel for info in every], begins),
        "solve_ns": np.add.reduceat([info.elapsed_ns for info in every], begins),
        "rank": [info.rank for info in known],
        "inconsistency": [info.inconsistency for info in known],
    }


def projecting(projector: Projector | None) -> dict[str, object]:
    """What the projection at the end of the step took; nothing if there is none."""
    if projector is None or projector.last is None:
        return {}
    last = projector.last
    return {
        "projection": last.status,
        "projection_rounds": last.rounds,
        "projection_solves": last.solves,
        "projection_iterations": last.iterations,
        "projection_moved": last.moved,
    }
