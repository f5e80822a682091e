"""Findings, as a linter has them: a stable code, a severity, a place, one line with figures; and the list of codes.

What a code means, how it is measured and what to do about it is prose, and stands in ``findings.toml``.
"""

import difflib
import textwrap
import tomllib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

from oarlock.base.errors import choose, one_line

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
"""The worst first. An error: the model cannot do what it is meant to, or the user's bound is exceeded."""

CATALOGUE = Path(__file__).with_name("findings.toml")

WIDTH = 100
"""Columns of prose at most: longer lines are hard to read."""

_LONGEST_CODE = 3
"""Letters and digits; what is longer is meant to be a name."""

FORMULA = "    "
"""Lines of an entry that begin with it are formulas and stay as they are."""


@dataclass(frozen=True)
class Entry:
    """A code of the catalogue.

    Attributes:
        code: such as ``D1``; the letter is its group.
        name: the same in a word or two, such as ``compliance``.
        severity: unless a finding says otherwise.
        title: what is the matter, in one sentence.
        meaning: the same in plain words, at length.
        measured: the formula that decides, with its tolerance.
        remedy: what to do.
    """

    code: str
    name: str
    severity: Severity
    title: str
    meaning: str
    measured: str
    remedy: str

    def document(self) -> dict[str, str]:
        """For JSON."""
        return asdict(self)

    def text(self, width: int = WIDTH) -> str:
        """For a terminal of so many columns."""
        columns = max(20, min(width, WIDTH))
        parts = {"What it means": self.meaning, "How it is measured": self.measured, "What to do": self.remedy}
        lines = textwrap.wrap(f"{self.code} {self.name} ({self.severity}): {self.title}", columns)
        for heading, prose in parts.items():
            lines += ["", heading, *_wrapped(prose, columns)]
        return "\n".join(lines)


def _wrapped(prose: str, columns: int) -> list[str]:
    lines = []
    for line in prose.splitlines():
        if line.startswith(FORMULA):
            lines.append(FORMULA + line)
        else:
            lines += textwrap.wrap(line, columns, initial_indent="  ", subsequent_indent="  ")
    return lines


@cache
def catalogue() -> dict[str, Entry]:
    """Code → entry, in the order of the catalogue."""
    contents: dict[str, Any] = tomllib.loads(CATALOGUE.read_text(encoding="utf-8"))
    return {
        code: Entry(code, **{name: value.strip("\n") for name, value in entry.items()})
        for code, entry in contents.items()
    }


def look_up(text: str) -> Entry:
    """The entry of a code or name, in capitals or not.

    Raises:
        InputError: there is none; the message lists names that are spelt alike, or all codes.
    """
    named = {entry.name: entry for entry in catalogue().values()}
    known = {**catalogue(), **named}
    for spelt in (text, text.upper(), text.lower()):
        if spelt in known:
            return known[spelt]
    alike = difflib.get_close_matches(text.lower(), named, n=4) if len(text) > _LONGEST_CODE else []
    codes = sorted(catalogue(), key=lambda code: (code[0], int(code[1:])))
    return known[choose("finding", one_line(text), alike or codes)]


@dataclass(frozen=True)
class Finding:
    """Something that was found in a model. Made by ``found``, which takes the severity from the catalogue.

    Attributes:
        code: of the catalogue.
        severity: how bad.
        file: the model's, as it was given.
        element: name of the equality (or other element); empty: the model as a whole.
        line: one line in plain words, with figures and their units.
        figures: the same for a program: name → number, text or None.
        cost: how far the loops stand open because of it, m, of an angle times their size; 0: it is about
            something else.
    """

    code: str
    severity: Severity
    file: str
    element: str
    line: str
    figures: dict[str, Any] = field(default_factory=dict)
    cost: float = 0.0

    @property
    def name(self) -> str:
        """The code in words."""
        return catalogue()[self.code].name

    @property
    def place(self) -> str:
        """File and element, on one line whatever the element is called."""
        return one_line(f"{self.file}: {self.element}" if self.element else self.file)

    def __str__(self) -> str:
        return f"{self.place}: {self.severity} {self.code} {self.name}: {self.line}"

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {"name": self.name, **asdict(self)}


def found(
    code: str, file: str | Path, line: str, *, element: str = "", severity: Severity | None = None, **figures: Any
) -> Finding:
    """A finding of the catalogue.

    Raises:
        InputError: the catalogue does not have the code.
    """
    entry = catalogue()[choose("code of a finding", code, list(catalogue()))]
    return Finding(code, severity or entry.severity, str(file), element, one_line(line), figures)


def worst_first(findings: Iterable[Finding]) -> list[Finding]:
    """Errors, then warnings, then notes; of one severity the dearest, and at one cost in the order given."""
    return sorted(findings, key=lambda finding: (SEVERITIES.index(finding.severity), -finding.cost))
