"""What a solve of exact constraints costs, solver by solver, where several answer the same question."""

from collections.abc import Iterator
from typing import Any

from oarlock.base.numbers import figure
from oarlock.report.tables import Tables

Row = dict[str, Any]


def question(row: Row) -> tuple[str, ...] | None:
    """What a run asks its solver, in words for a heading; None if it is no question of exact constraints.

    In lockstep somebody walks and all answer the same systems. In the loop every solver walks for itself, and its next
    system is what its own answers led to.
    """
    if row["form"] != "hard" or row["solver"] == "mujoco" or row["mode"] not in ("lockstep", "free"):
        return None
    walker = "MuJoCo" if row["walker"] == "mujoco" else row["walker"]
    where = f"along {walker}" if row["mode"] == "lockstep" else "in the loop"
    held = () if row["stabilisation"] == "baumgarte" else (row["stabilisation"],)
    settings = () if row["settings"] == "default" else (row["settings"],)
    return (where, row["integrator"], *held, *settings)


class Costs:
    """A table with a row a solver and a column a question.

    Attributes:
        questions: those that two solvers or more answer, one of them by iterations.
        solvers: those who answer them, in the order of the runs.
    """

    def __init__(self, tables: Tables):
        self._asked: dict[tuple[str, ...], dict[str, Row]] = {}
        for row in tables.rows:
            if asked := question(row):
                self._asked.setdefault(asked, {})[row["solver"]] = row
        self.questions = [
            asked
            for asked, answers in self._asked.items()
            if len(answers) > 1 and any(row["iterations_max"] for row in answers.values())
        ]
        named = (solver for asked in self.questions for solver in self._asked[asked])
        self.solvers = list(dict.fromkeys(named))

    def __bool__(self) -> bool:
        """Whether there is more than one question: a single one is told by the table of solves."""
        return len(self.questions) > 1

    def rows(self, solver: str) -> Iterator[Row | None]:
        """The run of a solver for each question; None where it was not asked."""
        for asked in self.questions:
            yield self._asked[asked].get(solver)

    def iterations(self, row: Row | None) -> str:
        """Iterations a solve of a run, and what did not converge."""
        if row is None:
            return figure(None)
        said = figure(row["iterations_mean"])
        if row["unconverged"]:
            said += f"; {figure(row['unconverged'])} of {figure(row['solves'])} not converged"
        return said if row["status"] in ("done", "unconverged") else f"{said}; {row['status']}"

    @property
    def shared(self) -> tuple[str, ...]:
        """The question that most solvers answer; of several the first."""
        return max(self.questions, key=lambda asked: len(self._asked[asked]))

    def products(self, solver: str) -> float | None:
        """Products a solve of the shared question; None where the solver was not asked."""
        row = self._asked[self.shared].get(solver)
        return row["products_mean"] if row else None

    def per_iteration(self, solver: str) -> float | None:
        """Products that one more iteration takes: of the shared question, or of the first one that can tell."""
        first = self._asked[self.shared].get(solver)
        told = (row["products_per_iteration"] for row in (first, *self.rows(solver)) if row)
        return next((found for found in told if found is not None), None)


def times_of_reference(tables: Tables) -> dict[str, float]:
    """By run, its median time a solve over that of the pseudo-inverse on the same question, where both are known."""
    asked = {row["run"]: question(row) for row in tables.rows}
    reference = {asked[row["run"]]: row["solve_ns_median"] for row in tables.rows if row["solver"] == "pinv"}
    found = {}
    for row in tables.rows:
        base = reference.get(asked[row["run"]]) if asked[row["run"]] else None
        if base and row["solve_ns_median"]:
            found[row["run"]] = row["solve_ns_median"] / base
    return found
