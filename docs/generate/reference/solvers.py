"""The solvers, from the registry of the compiled core."""

from oarlock.base import core
from text import code, plain, table
from text import page as written

HEAD = """\
Names for `--solver NAME[:key=value,…]`, for `solvers` in `case.toml` and for `oarlock.make_solver(NAME,
key=value)`. Which one to take when, and what the promise `converged` means, is in [the
theory](../theory.md#solvers); one of your own is a function in
Python or a file in Rust ([how](../how-to/own-solver.md))."""

MEANINGS = {
    "rank_cut": "eigenvalues (or pivots) below this part of the largest of their block count as zero",
    "eps_abs": "the stopping test ‖A x − b‖ ≤ eps_abs",
    "rtol": "the stopping test ‖A x − b‖ ≤ rtol ‖b‖",
    "guard": "updates whose relative denominator is smaller are skipped or replaced",
    "max_iterations": "iterations at most, before a refresh or the end",
    "predict": "how many earlier solutions the start of a solve is extrapolated from",
    "epsilon": "what is added to the diagonal of A, relative to it",
    "warm": "whether a solve starts from the last solution",
}
"""Option → what it says, of every solver that has it."""


def page() -> str:
    """A table of all, and one of the options."""
    known = core.solvers()
    rows = [
        [code(name), plain(summary), ", ".join(code(f"{key}={_short(value)}") for key, value in options.items())]
        for name, (summary, options) in known.items()
    ]
    options = sorted({key for _, given in known.values() for key in given})
    return written(
        "Solvers",
        HEAD,
        table(["name", "what it is", "options, with their defaults"], rows),
        "## Options",
        table(["option", "what it says"], [[code(key), plain(MEANINGS[key])] for key in options]),
    )


def _short(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}"
