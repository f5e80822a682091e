"""What a report consists of, whatever it is written as: chapters of sentences, tables, figures and code.

Texts are plain when they come into a block: on one line, with nothing in them that a terminal or a browser would obey.
What is left to those who write them is to escape them.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from oarlock.base.text import one_line as plain

if TYPE_CHECKING:  # charts take long to import, and a terminal has none
    from oarlock.render.page import Figure

STILL = "mechanism"
"""Name of the drawing that stands for the moving mechanism where nothing moves."""


@dataclass(frozen=True)
class Text:
    """A paragraph.

    Attributes:
        text: one or more sentences.
        detail: whether it explains; a terminal leaves that out.
    """

    text: str
    detail: bool = False
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """A table of texts; every row has as many cells as the head.

    Attributes:
        name: of the table, for those who look for it.
        head: what the columns are called.
        rows: from top to bottom.
        words: so many columns from the left hold words; the others hold numbers.
        short: what a terminal prints in its place; None: nothing.
    """

    name: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    words: int = 1
    short: "Table | None" = None
    kind: str = "table"

    def only(self, *names: str, words: int = 1) -> "Table":
        """The columns of these names, in this order."""
        places = [self.head.index(name) for name in names]
        return Table(self.name, names, [tuple(row[place] for place in places) for row in self.rows], words)


@dataclass(frozen=True)
class Code:
    """Lines to copy, or a formula."""

    text: str
    language: str = "xml"
    kind: str = "code"


@dataclass(frozen=True)
class Picture:
    """A chart."""

    figure: "Figure"
    kind: str = "picture"

    @property
    def name(self) -> str:
        """Of its file."""
        return self.figure.name

    @property
    def caption(self) -> str:
        """What it shows."""
        return self.figure.caption


@dataclass(frozen=True)
class Stage:
    """Where the moving mechanism stands; in print its drawing."""

    caption: str
    name: str = STILL
    kind: str = "stage"


@dataclass(frozen=True)
class Section:
    """A part of an explanation: a heading, which may be empty, and paragraphs and formulas."""

    heading: str
    blocks: tuple[Text | Code, ...]


@dataclass(frozen=True)
class Explanation:
    """What a code of a finding means."""

    code: str
    name: str
    title: str
    sections: tuple[Section, ...]


@dataclass(frozen=True)
class Item:
    """A finding.

    Attributes:
        severity: how bad it is.
        code, name: of the catalogue.
        element: what it is found at; empty: the model as a whole.
        place: file and element.
        line: what was found, with figures.
        explanation: of its code.
    """

    severity: str
    code: str
    name: str
    element: str
    place: str
    line: str
    explanation: Explanation


@dataclass(frozen=True)
class Findings:
    """Findings, the worst first, and what their codes mean, each code once."""

    items: tuple[Item, ...]
    explanations: tuple[Explanation, ...]
    kind: str = "findings"


Block = Text | Table | Code | Picture | Stage | Findings


@dataclass
class Chapter:
    """A heading and what stands under it.

    Attributes:
        name: in one word, as an address within the page.
        title: what it is called.
        number: its place among those that are numbered.
        blocks: from top to bottom.
    """

    name: str
    title: str
    number: int | None = None
    blocks: list[Block] = field(default_factory=list)

    @property
    def heading(self) -> str:
        """Number and title."""
        return self.title if self.number is None else f"{self.number}. {self.title}"

    def say(self, text: str) -> None:
        """Adds a paragraph."""
        self.blocks.append(Text(plain(text)))

    def explain(self, text: str) -> None:
        """Adds a paragraph that a terminal leaves out."""
        self.blocks.append(Text(plain(text), detail=True))

    def table(
        self,
        name: str,
        head: tuple[str, ...],
        rows: list[tuple[str, ...]],
        *,
        words: int = 1,
        short: Table | tuple[str, ...] | None = None,
    ) -> None:
        """Adds a table, unless it is empty.

        Args:
            name: of the table.
            head: what the columns are called.
            rows: with a cell for every column each.
            words: so many columns from the left hold words.
            short: what a terminal prints of it: another table, some of the columns, or nothing.
        """
        if rows:
            whole = Table(name, head, [tuple(map(plain, row)) for row in rows], words)
            if isinstance(short, tuple):
                short = whole.only(*short, words=words)
            elif short is not None:
                short = Table(short.name, short.head, [tuple(map(plain, row)) for row in short.rows], short.words)
            self.blocks.append(Table(name, head, whole.rows, words, short))

    def code(self, text: str) -> None:
        """Adds lines to copy."""
        self.blocks.append(Code(text))

    def illustrate(self, figures: "list[Picture | Stage]") -> None:
        """Adds figures before the first table."""
        places = [place for place, block in enumerate(self.blocks) if isinstance(block, Table)]
        place = places[0] if places else len(self.blocks)
        self.blocks[place:place] = figures
