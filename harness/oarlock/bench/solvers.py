"""Solvers side by side: one recorded sequence a size, interleaved rounds, medians, ratios.

The reference of the ratios is the fastest right pseudo-inverse that nalgebra or faer offers. Right is who gives the
minimum norm to 1e-6, also where redundant rows contradict one another.
"""

from collections.abc import Iterator
from typing import Any

from oarlock.base import core
from oarlock.tables.provenance import occasion

ROUNDS = 9


def _with_ratios(table: list[dict[str, Any]]) -> list[dict[str, Any]]:
    for time, ratio in (("solve_ns", "solve_ratio"), ("given_ns", "given_ratio")):
        reference = min(row[time] for row in table if row["library"] and row["right"])
        best = min(row[time] for row in table if row["right"])
        for row in table:
            row[ratio] = row[time] / reference
            row[f"{ratio}_to_best"] = row[time] / best
    return table


def bench(sizes: list[int] | None = None, rounds: int = ROUNDS) -> Iterator[list[dict[str, Any]]]:
    """The table of each size as soon as it is measured.

    Every row has name, n, library, right, solve_ns (from the assembled step), given_ns (from A and b), the ratios of
    both to the reference (``solve_ratio``, ``given_ratio``) and to the fastest right row (``…_to_best``),
    min_norm_error, contradicted_error and products a solve.

    Raises:
        InputError: a size is not a multiple of 6.
    """
    for n in sizes or core.bench_sizes():
        yield _with_ratios(core.bench_solvers(n, rounds))


def document(
    rows: list[dict[str, Any]], steps: list[dict[str, Any]], growth: dict[str, Any] | None = None
) -> dict[str, Any]:
    """What ``oarlock bench --json`` writes: rows of the solvers, those of ``bench_stepping``, and ``bench_growth``."""
    provenance = {"oarlock": core.VERSION, "core_profile": core.BUILD_PROFILE, **occasion()}
    return {"provenance": provenance, "rows": rows, "stepping": steps, "growth": growth}
