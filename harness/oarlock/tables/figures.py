"""The columns of a table of steps and the figures of a summary: what each is, how it is judged, where it is shown.

A new figure begins here; which files follow is said in ARCHITECTURE.md.
"""

from dataclasses import dataclass
from typing import Literal

import polars as pl

from oarlock.tables import tolerances as tolerance
from oarlock.tables.reductions import (
    Alone,
    Reduction,
    change,
    largest,
    mean,
    median,
    others,
    ratio,
    ratio_where,
    slope,
    smallest,
    time_of_first,
    total,
    total_after_first,
    total_if_any,
)
from oarlock.tables.tolerances import Tolerance

Walk = Literal["calibration", "lockstep", "one-step", "free", "alone", "mujoco"]
"""What a table is of; ``free`` is a solver's free run, ``alone`` one that is not judged, ``mujoco`` MuJoCo's own."""

Kind = Literal["int", "float", "text", "list"]

DTYPES: dict[Kind, pl.DataType | type[pl.DataType]] = {
    "int": pl.Int64,
    "float": pl.Float64,
    "text": pl.String,
    "list": pl.List(pl.Float64),
}

_EVERY: tuple[Walk, ...] = ("calibration", "lockstep", "one-step", "free", "alone", "mujoco")
_ASKED: tuple[Walk, ...] = ("lockstep", "one-step", "free", "alone", "mujoco")
_SOLVED: tuple[Walk, ...] = ("lockstep", "one-step", "free", "alone")
_LOCKSTEP: tuple[Walk, ...] = ("lockstep",)
_JUDGED: tuple[Walk, ...] = ("lockstep", "free")
_PROJECTED: tuple[Walk, ...] = ("lockstep", "free", "alone")
_FREE: tuple[Walk, ...] = ("free", "alone", "mujoco")
_HALVED: tuple[Walk, ...] = ("free", "alone")


@dataclass(frozen=True)
class Column:
    """A column of a table of steps. Where it does not apply it is null.

    Attributes:
        name: its name.
        kind: what an entry is.
        meaning: what it says, with its unit.
        walks: the walks whose rows have it.
        optional: whether such a walk may be without it: nothing is known, projected or conserved.
    """

    name: str
    kind: Kind
    meaning: str
    walks: tuple[Walk, ...] = _EVERY
    optional: bool = False


COLUMNS = (
    Column("step", "int", "number of the step"),
    Column("time_s", "float", "time at its start, s"),
    Column("status", "text", "how its solves ended"),
    Column("solves", "int", "number of solves; RK4 makes four", _ASKED),
    Column("unconverged", "int", "those that did not converge", _ASKED),
    Column("iterations", "int", "iterations of all solves", _ASKED),
    Column("iterations_worst", "int", "of the one that took most", _ASKED),
    Column("products", "int", "products of all solves with A or the carried inverse", _SOLVED),
    Column("refreshes", "int", "recomputed pseudo-inverses", _SOLVED),
    Column("refolds", "int", "new folds", _SOLVED),
    Column("residual_rel", "float", "largest ‖A x − b‖ / ‖b‖", _SOLVED),
    Column("solve_ns", "int", "wall time of the solves, ns", _SOLVED),
    Column("rank", "int", "rank of A", _SOLVED),
    Column("inconsistency", "float", "‖Nᵀ b‖, N a basis of null(A)", _SOLVED),
    Column("rank_margin", "float", "factor between the rank cut and the eigenvalue next to it", _SOLVED),
    Column("rank_rises", "int", "ranks that were held and rose: more stands than open rows explain", _SOLVED),
    Column("min_norm_error", "float", "relative distance from the minimum-norm multipliers", _JUDGED),
    Column("qacc_rel_diff", "float", "relative distance from MuJoCo's acceleration", _LOCKSTEP),
    Column("qfrc_constraint_rel_diff", "float", "relative distance from MuJoCo's constraint force", _LOCKSTEP),
    Column("drift_pos", "float", "largest deviation of a row, m or rad"),
    Column("drift_vel", "float", "largest rate of a row, per s"),
    Column("drift_acc", "float", "largest acceleration of a row, per s²", _ASKED),
    Column("inequalities", "int", "rows of limits, friction loss and contacts", _ASKED, optional=True),
    Column("limit_force", "float", "largest force of a limit, N or N m", _ASKED, optional=True),
    Column("friction_force", "float", "largest force of a friction loss, N or N m", _ASKED, optional=True),
    Column("contact_force", "float", "sum of the normal forces of all contacts, N", _ASKED, optional=True),
    Column("active", "int", "rows of them that push", _SOLVED, optional=True),
    Column("blocked", "int", "limits and contacts that push against loops alone", _SOLVED, optional=True),
    Column("active_changes", "int", "whether rows that push are others than before", _SOLVED, optional=True),
    Column("newton", "int", "Newton iterations for them of all solves", _SOLVED, optional=True),
    Column("newton_worst", "int", "of the one that took most", _SOLVED, optional=True),
    Column("optimality", "float", "relative gradient beyond rounding that their forces leave", _SOLVED, optional=True),
    Column("mujoco_optimality", "float", "the same of MuJoCo's own answer", _LOCKSTEP, optional=True),
    Column("projection", "text", "how the projection at the end of the step ended", _PROJECTED, optional=True),
    Column("projection_rounds", "int", "its corrections of the positions", _PROJECTED, optional=True),
    Column("projection_solves", "int", "its solves", _PROJECTED, optional=True),
    Column("projection_iterations", "int", "their iterations", _PROJECTED, optional=True),
    Column("projection_moved", "float", "largest change of a coordinate by it, rad or m", _PROJECTED, optional=True),
    Column("energy", "float", "potential and kinetic energy, J", _FREE, optional=True),
    Column("kinetic_energy", "float", "kinetic energy, J", _FREE, optional=True),
    Column("trajectory_diff", "float", "distance from MuJoCo's own run, rad or m", ("calibration", "one-step", "free")),
    Column("error_estimate", "float", "how far it is off by itself, rad or m", _HALVED, optional=True),
    Column("truth_error_estimate", "float", "the same of what the outside truth speaks of", _HALVED, optional=True),
    Column("truth_error", "float", "distance from the outside truth, rad or m", optional=True),
    Column("published_position_error", "float", "distance from a printed position, rad or m", _FREE, optional=True),
    Column("published_velocity_error_rel", "float", "the same of a velocity, relative", _FREE, optional=True),
    Column("published_multiplier_error_rel", "float", "the same of multipliers, relative", _FREE, optional=True),
    Column("step_us", "float", "wall time of the step itself, µs"),
    Column("qpos", "list", "positions, nq"),
    Column("qvel", "list", "velocities, nv"),
    Column("ctrl", "list", "controls, nu"),
    Column("residual", "list", "deviations of the rows, ne", _ASKED),
    Column("multipliers", "list", "multipliers, ne", _ASKED),
)
"""In the order of the table."""


@dataclass(frozen=True)
class Figure:
    """A figure of a run: a number of its summary.

    Attributes:
        name: its name.
        of: what of the steps it is.
        tolerance: how it is judged against another run's; None: it only belongs to another figure.
        report: its heading in a case's table of runs, if it stands there.
        sweep: its heading in a sweep's.
    """

    name: str
    of: Reduction | Alone
    tolerance: Tolerance | None
    report: str = ""
    sweep: str = ""


_SETTLED = (pl.col("unconverged") == 0) & (pl.col("refreshes") == 0)

FIGURES = (
    Figure("solves", total("solves"), None),
    Figure("unconverged", total("unconverged"), tolerance.GIVEN_UP),
    Figure("iterations_mean", ratio("iterations", "solves"), tolerance.MEAN, sweep="iterations a solve"),
    Figure("iterations_max", largest("iterations_worst"), tolerance.MOST),
    Figure("products_mean", ratio("products", "solves"), tolerance.MEAN),
    # Of solves that went as they should: one that gives up has products of its own.
    Figure("products_per_iteration", slope("products", "iterations", _SETTLED), tolerance.MEAN),
    # The first solve of a fold has to start from something; the folds after the first are counted apart.
    Figure("refreshes", total_after_first("refreshes"), tolerance.RESTARTS),
    Figure("refolds", total_if_any("refolds"), tolerance.RESTARTS),
    Figure("rank_min", smallest("rank"), tolerance.WHOLE),
    Figure("rank_max", largest("rank"), tolerance.WHOLE),
    Figure("rank_margin_min", smallest("rank_margin"), tolerance.MARGIN),
    Figure("rank_rises", total_if_any("rank_rises"), tolerance.WHOLE),
    Figure("rank_rises_at_s", time_of_first("rank_rises"), tolerance.EVENT),
    Figure("min_norm_error_max", largest("min_norm_error"), tolerance.NORM, sweep="min-norm error"),
    Figure("min_norm_error_median", median(pl.col("min_norm_error")), tolerance.NORM),
    Figure("residual_rel_max", largest("residual_rel"), tolerance.RESIDUAL),
    Figure("inconsistency_max", largest("inconsistency"), tolerance.QUESTION),
    Figure("qacc_rel_diff_max", largest("qacc_rel_diff"), tolerance.PARITY, report="qacc against MuJoCo"),
    Figure(
        "qfrc_constraint_rel_diff_max",
        largest("qfrc_constraint_rel_diff"),
        tolerance.PARITY,
        report="constraint force against MuJoCo",
    ),
    Figure("drift_pos_max", largest("drift_pos"), tolerance.DRIFT, report="drift: position", sweep="drift"),
    Figure("drift_vel_max", largest("drift_vel"), tolerance.DRIFT_VEL, report="velocity"),
    Figure("drift_acc_max", largest("drift_acc"), tolerance.DRIFT_ACC, report="acceleration"),
    Figure("limit_force_max", largest("limit_force"), tolerance.FORCE),
    Figure("friction_force_max", largest("friction_force"), tolerance.FORCE),
    Figure("contact_force_max", largest("contact_force"), tolerance.FORCE),
    Figure("active_max", largest("active"), tolerance.MOST),
    Figure("active_changes", total_if_any("active_changes"), tolerance.RESTARTS),
    Figure("blocked_max", largest("blocked"), tolerance.WHOLE),
    Figure("newton_mean", ratio_where("newton", "solves"), tolerance.MEAN),
    Figure("newton_max", largest("newton_worst"), tolerance.MOST),
    Figure("optimality_max", largest("optimality"), tolerance.RESIDUAL),
    Figure("mujoco_optimality_max", largest("mujoco_optimality"), tolerance.RESIDUAL),
    Figure("unprojected", others("projection", "landed"), tolerance.GIVEN_UP),
    Figure("projection_rounds_mean", mean("projection_rounds"), tolerance.MEAN),
    Figure("projection_rounds_max", largest("projection_rounds"), tolerance.MOST),
    Figure("projection_iterations_mean", ratio("projection_iterations", "projection_solves"), tolerance.MEAN),
    Figure("projection_moved_max", largest("projection_moved"), tolerance.DRIFT),
    Figure("energy_drift_rel", change("energy", "kinetic_energy"), tolerance.ENERGY, report="energy drift"),
    Figure("error_estimate_max", largest("error_estimate"), tolerance.ESTIMATE, report="own error", sweep="own error"),
    Figure("truth_error_estimate_max", largest("truth_error_estimate"), tolerance.ESTIMATE),
    Figure(
        "truth_error_max", largest("truth_error"), tolerance.TRUTH, report="distance from truth", sweep="from truth"
    ),
    Figure("published_position_error_max", largest("published_position_error"), tolerance.TRUTH),
    Figure("published_velocity_error_rel_max", largest("published_velocity_error_rel"), tolerance.TRUTH),
    Figure("published_multiplier_error_rel_max", largest("published_multiplier_error_rel"), tolerance.TRUTH),
    Figure(
        "trajectory_diff_max",
        largest("trajectory_diff"),
        tolerance.WALK,
        report="from MuJoCo's free run",
        sweep="from MuJoCo",
    ),
    Figure("solve_ns_median", median(pl.col("solve_ns") / pl.col("solves")), tolerance.TIME),
    Figure("step_us_median", median(pl.col("step_us")), tolerance.TIME),
)
"""In the order of the summary."""

TIMING_FIGURES = tuple(figure.name for figure in FIGURES if figure.tolerance is tolerance.TIME)
"""Figures that change from run to run on the same machine."""


def shown(where: Literal["report", "sweep"]) -> dict[str, str]:
    """Figures of a table of runs, with their headings."""
    return {figure.name: heading for figure in FIGURES if (heading := getattr(figure, where))}
