"""``oarlock diff``: what changed between two folders of results beyond its tolerance, worst first.

Runs are matched by what they are (case, mode, walker, solver, form, integrator, settings, stabilisation, timestep,
steps, point of a sweep). What finds no counterpart may differ in how it was run, if there is only one that it can be:
then the difference is named, and the figures are compared all the same. That is how two settings are compared.
"""

import html
import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl

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
from oarlock.tables.provenance import OCCASION

SAME_NUMBER = 1e-9
"""Relative, and absolute in m or rad, of a number of ``case.json``: as far as it was computed, another machine's."""


@dataclass(frozen=True)
class Origin:
    """Something that differs in where the figures come from.

    Attributes:
        kind: ``provenance`` (versions, platform, files), ``case`` (case file, model) or ``run`` (how it was run).
        key: what.
        before: its value.
        after: its value.
        where: the cases or runs that it concerns.
    """

    kind: str
    key: str
    before: Any
    after: Any
    where: tuple[str, ...]

    def line(self, runs: int = 0) -> str:
        """One line; ``runs`` is how many were compared, so that not all of them need be named."""
        where = "every run" if self.kind == "run" and len(self.where) == runs > 1 else few(self.where)
        return one_line(f"{self.key}: {worded(self.before)} → {worded(self.after)} ({where})")


@dataclass(frozen=True)
class Difference:
    """What changed between two folders of results.

    Attributes:
        before: the first folder.
        after: the second one.
        comparisons: every figure of every run, worst first.
        origins: what differs in where they come from.
        matched: runs that have a counterpart.
        allow_missing: whether what disappeared is no loss.
    """

    before: str
    after: str
    comparisons: list[Comparison]
    origins: list[Origin]
    matched: int
    allow_missing: bool = False

    @property
    def worse(self) -> list[Comparison]:
        """What got worse, or can no longer be seen."""
        bad = ("worse",) if self.allow_missing else ("worse", "disappeared")
        return [one for one in self.comparisons if one.verdict in bad]

    @property
    def changes(self) -> list[Comparison]:
        """What changed beyond its tolerance, worst first."""
        return [one for one in self.comparisons if one.verdict not in ("same", "not judged")]

    @property
    def counts(self) -> dict[str, int]:
        """Verdict → how many."""
        return {verdict: sum(one.verdict == verdict for one in self.comparisons) for verdict in VERDICTS}

    @property
    def frame(self) -> pl.DataFrame:
        """A row a comparison, worst first; what is no number is in words in ``was`` and ``became``."""
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
        """Timing that was not judged → after over before, the median over the runs."""
        found: dict[str, list[float]] = {}
        for one in self.comparisons:
            if one.verdict == "not judged" and one.factor is not None:
                found.setdefault(one.figure, []).append(one.factor)
        return {figure: median(factors) for figure, factors in found.items()}

    def document(self) -> dict[str, Any]:
        """For JSON."""
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
        """In one line."""
        said = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items() if count)
        return f"{self.matched} runs compared: {said or 'nothing to compare'}"

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{html.escape(origin.line(self.matched))}</li>" for origin in self.origins)
        head = "".join(f"<th>{name}</th>" for name in COLUMNS)
        body = "".join(
            f"<tr>{''.join(f'<td>{html.escape(text)}</td>' for text in cells(one))}</tr>" for one in self.changes
        )
        return (
            f"<div><p>{html.escape(one_line(f'{self.before} → {self.after}. {self.summary()}'))}</p>"
            f"<ul>{lines}</ul><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        )


COLUMNS = ("", "case", "run", "figure", "before", "after", "×", "at")
"""Of a table of comparisons."""


def cells(one: Comparison) -> list[str]:
    """A row of such a table."""
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
        after: another one.
        timings: timings are judged, and may grow by this factor; None: they are reported only.
        allow_missing: what disappeared is no loss, for the second folder was meant to hold less.

    Raises:
        InputError: no such folder, not one of results, a file that is not whole, different schemas, or a factor that
            is not above 1.
    """
    if timings is not None and not (math.isfinite(timings) and timings > 1.0):
        raise InputError(f"timings = {timings:g}, expected a factor > 1")
    one, other = read_side(Path(before)), read_side(Path(after))
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
