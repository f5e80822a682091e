"""``oarlock diff``: what changed between two folders of results beyond its tolerance, worst first.

Runs are matched by what they are (case, mode, walker, solver, form, integrator, settings, stabilisation, timestep,
steps, point of a sweep). A run without such a counterpart is matched with one that was run differently, if only one is
possible: then the difference is named and the figures are compared all the same. That is how two settings are compared.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.errors import InputError, few, one_line
from oarlock.compare.figures import (
    VERDICTS,
    Comparison,
    compare_figures,
    compare_gates,
    compare_unmatched,
    number,
    worded,
)
from oarlock.compare.folders import KEYS, Run, Side, match, read_side, require_same_schema
from oarlock.tables.folder import OCCASION, believing

SAME_NUMBER = 1e-9
"""Relative, and absolute in m or rad. Computed numbers of ``case.json`` differ by as much between machines."""


@dataclass(frozen=True)
class Origin:
    """A difference in where the figures of the two folders come from.

    Attributes:
        kind: ``provenance`` (versions, platform, files), ``case`` (case file, model) or ``run`` (how it was run).
        key: name of what differs.
        before: its value in the first folder.
        after: its value in the second folder.
        where: the cases or runs that it concerns.
    """

    kind: str
    key: str
    before: Any
    after: Any
    where: tuple[str, ...]

    def line(self, runs: int = 0) -> str:
        """Describes the difference in one line.

        Args:
            runs: number of runs that were compared; a difference of all of them names none.
        """
        where = "every run" if self.kind == "run" and len(self.where) == runs > 1 else few(self.where)
        return one_line(f"{self.key}: {worded(self.before)} → {worded(self.after)} ({where})")


@dataclass(frozen=True)
class Difference(Answer):
    """What changed between two folders of results.

    Attributes:
        before: the first folder.
        after: the second one.
        comparisons: every figure of every run, worst first.
        origins: differences in where the figures come from.
        matched: number of runs that have a counterpart.
        allow_missing: whether what disappeared counts as no loss.
    """

    FRAMES = ("figures",)

    before: str
    after: str
    comparisons: list[Comparison]
    origins: list[Origin]
    matched: int
    allow_missing: bool = False

    @property
    def worse(self) -> list[Comparison]:
        """Comparisons that got worse or that disappeared, unless that is allowed."""
        bad = ("worse",) if self.allow_missing else ("worse", "disappeared")
        return [one for one in self.comparisons if one.verdict in bad]

    @property
    def changes(self) -> list[Comparison]:
        """Comparisons that changed beyond their tolerance, worst first."""
        return [one for one in self.comparisons if one.verdict not in ("same", "not judged")]

    @property
    def counts(self) -> dict[str, int]:
        """Verdict → number of comparisons."""
        return {verdict: sum(one.verdict == verdict for one in self.comparisons) for verdict in VERDICTS}

    @property
    def figures(self) -> pl.DataFrame:
        """One row per figure, worst first. Values that are no numbers are in words in ``was`` and ``became``."""
        rows = [
            {
                **asdict(one),
                "before": number(one.before),
                "after": number(one.after),
                "was": None if one.before is None else worded(one.before),
                "became": None if one.after is None else worded(one.after),
            }
            for one in self.comparisons
        ]
        names = [*Comparison.__dataclass_fields__, "was", "became"]
        numeric = ("before", "after", "factor", "time_s")
        return pl.DataFrame(rows, schema={name: pl.Float64 if name in numeric else pl.String for name in names})

    @property
    def timings(self) -> dict[str, float]:
        """Timing that was not judged → after over before, the median over all runs."""
        found: dict[str, list[float]] = {}
        for one in self.comparisons:
            if one.verdict == "not judged" and one.factor is not None:
                found.setdefault(one.figure, []).append(one.factor)
        return {figure: median(factors) for figure, factors in found.items()}

    def document(self) -> dict[str, Any]:
        """Returns the comparison as a document for JSON."""
        return {
            "before": self.before,
            "after": self.after,
            "matched": self.matched,
            "worse": len(self.worse),
            "counts": self.counts,
            "origins": [asdict(origin) for origin in self.origins],
            "changes": [one.document() for one in self.changes],
            "not_judged": [one.document() for one in self.comparisons if one.verdict == "not judged"],
        }

    def summary(self) -> str:
        """The comparison in one line."""
        said = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items() if count)
        return f"{self.matched} runs compared: {said or 'nothing to compare'}"

    def report(self, folder: str | Path) -> Path:
        """Writes a page of what changed, as ``oarlock diff --report``."""
        from oarlock.compare.page import write_page

        changes = [cells(one) for one in self.changes]
        return write_page(Path(folder), self._head(), self._lines(), COLUMNS, changes, self.timings)

    def _repr_html_(self) -> str:
        return html_table(self._head(), COLUMNS, [cells(one) for one in self.changes], self._lines())

    def _head(self) -> str:
        return one_line(f"{self.before} → {self.after}. {self.summary()}")

    def _lines(self) -> list[str]:
        return [origin.line(self.matched) for origin in self.origins]


COLUMNS = ("", "case", "run", "figure", "before", "after", "×", "at")
"""Headings of a table of comparisons."""


def cells(one: Comparison) -> list[str]:
    """Returns the cells of a comparison in a table with the headings ``COLUMNS``."""
    factor = "" if one.factor is None else f"{one.factor:.3g}"
    time = "" if one.time_s is None else f"{one.time_s:g} s"
    values = [one.case, one.run, one.figure, worded(one.before), worded(one.after)]
    return [one.verdict, *(one_line(value) for value in values), factor, time]


def diff(
    before: str | Path, after: str | Path, *, timings: float | None = None, allow_missing: bool = False
) -> Difference:
    """Compares two folders of results.

    Args:
        before: a folder that ``oarlock run --out`` or ``oarlock suite --out`` wrote, or a published one.
        after: another such folder.
        timings: factor by which timings may grow; None to report them without judging.
        allow_missing: whether what disappeared counts as no loss, because the second folder was meant to hold less.

    Raises:
        InputError: a folder is missing or holds no results, a file is damaged, the schemas differ, or the factor is
            not above 1.
    """
    if timings is not None and not (math.isfinite(timings) and timings > 1.0):
        raise InputError(f"timings = {timings:g}, expected a factor > 1")
    with believing(Path(before)):
        one = read_side(Path(before))
    with believing(Path(after)):
        other = read_side(Path(after))
        pairs, gone, new = match(one.runs, other.runs)
        require_same_schema(one, other, pairs)
        comparisons = [found for pair in pairs for found in compare_figures(*pair, timings)]
        comparisons += compare_unmatched(gone, other, gone_from_here=True)
        comparisons += compare_unmatched(new, one, gone_from_here=False)
        comparisons += compare_gates(one, other, pairs)
        comparisons.sort(key=_badness)
        origins = _origins(one, other, pairs)
    return Difference(str(before), str(after), comparisons, origins, len(pairs), allow_missing)


def _badness(one: Comparison) -> tuple[int, bool, float]:
    factor = one.factor if one.factor and one.factor > 0 else 1.0
    return VERDICTS.index(one.verdict), one.group not in ("status", "gate"), -abs(math.log(factor))


# Where they come from.


def _origins(one: Side, other: Side, pairs: list[tuple[Run, Run]]) -> list[Origin]:
    found: dict[tuple[str, str, str, str], tuple[Any, Any, dict[str, None]]] = {}

    def note(kind: str, key: str, before: Any, after: Any, where: str) -> None:
        known = found.setdefault((kind, key, json.dumps(before), json.dumps(after)), (before, after, {}))
        known[2][where] = None

    cases = {(before.case, after.case): None for before, after in pairs}
    for mine, theirs in cases:
        left, right = one.provenance.get(mine, {}), other.provenance.get(theirs, {})
        for key in (key for key in dict.fromkeys((*left, *right)) if key not in OCCASION):
            if left.get(key) != right.get(key):
                note("provenance", key, left.get(key), right.get(key), theirs)
        if mine in one.cases and theirs in other.cases:
            known, new = dict(_leaves(one.cases[mine])), dict(_leaves(other.cases[theirs]))
            for key in dict.fromkeys((*known, *new)):
                if not _alike(known.get(key), new.get(key)):
                    note("case", key, known.get(key), new.get(key), theirs)
    for before, after in pairs:
        for key in KEYS:
            if key not in ("run", "status") and before.row[key] != after.row[key]:
                note("run", key, before.row[key], after.row[key], f"{after.case} {after.name}")
    return [Origin(kind, key, a, b, tuple(where)) for (kind, key, *_), (a, b, where) in found.items()]


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if entries is None:
        yield path, value
        return
    for key, entry in entries:
        yield from _leaves(entry, f"{path}.{key}" if path else str(key))


def _alike(before: Any, after: Any) -> bool:
    low, high = number(before), number(after)
    if low is None or high is None:
        return before == after
    return math.isclose(low, high, rel_tol=SAME_NUMBER, abs_tol=SAME_NUMBER)
