"""What a report consists of, whatever it is written as: chapters of sentences, tables, figures and code."""

from dataclasses import dataclass, field

from oarlock.base.errors import one_line
from oarlock.render.page import Figure


def plain(text: object) -> str:
    """A text on one line; characters that do not print, or that turn the direction of writing, by their number."""
    line = one_line(text)
    return line if line.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True)
class Table:
    """A table of texts; every row has as many cells as the head."""

    name: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    kind: str = "table"


@dataclass(frozen=True)
class Code:
    """Lines to copy."""

    text: str
    kind: str = "code"


@dataclass(frozen=True)
class Picture:
    """A chart."""

    figure: Figure
    kind: str = "picture"


@dataclass(frozen=True)
class Stage:
    """Where the moving mechanism stands."""

    caption: str
    kind: str = "stage"


Block = Text | Table | Code | Picture | Stage


@dataclass
class Chapter:
    """A heading and what stands under it."""

    name: str
    title: str
    blocks: list[Block] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Adds a paragraph."""
        self.blocks.append(Text(text))

    def table(self, name: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
        """Adds a table, unless it is empty."""
        if rows:
            self.blocks.append(Table(name, head, rows))

    def code(self, text: str) -> None:
        """Adds lines to copy."""
        self.blocks.append(Code(text))

    def picture(self, figure: Figure | None) -> None:
        """Adds a figure, if there is one."""
        if figure is not None:
            self.blocks.append(Picture(figure))
