"""Tables on a terminal and in files: figures stay whole, whatever the width; words are wrapped between words.

What does not fit side by side is stacked: the words of a row on a line of their own, its figures below them, in as
many lines as that takes.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from rich.cells import cell_len
from rich.text import Text

from oarlock.base.text import visible
from oarlock.cli.console import console

GAP = "  "
"""Between two columns."""

TALL = 3
"""Lines that a row may be wrapped into before a table is stacked."""

NARROW = 16
"""Columns of a terminal that words are not wrapped below, where others could be."""


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Attributes:
        text: as it is printed.
        row: number of the row that it belongs to; None: the head.
        first: whether it begins that row.
    """

    text: str
    row: int | None
    first: bool = True


def print_table(
    head: Sequence[str],
    rows: Sequence[Sequence[object]],
    words: int = 1,
    *,
    style: Callable[[Sequence[object]], str] | None = None,
) -> None:
    """Prints a table; one that leaves for a file or a pipe is as wide as it is.

    Args:
        head: titles of the columns, with their units.
        rows: the cells, from top to bottom.
        words: so many columns from the left hold words; the others hold figures.
        style: the colour of the first cell of a row, on a terminal.
    """
    watched = sys.stdout.isatty()
    out = console()
    texts = [[visible(cell) for cell in row] for row in rows]
    for line in laid_out(list(head), texts, words, out.width if watched else None):
        if not watched:
            print(line.text)
            continue
        shown = Text(line.text, style="bold" if line.row is None else "")
        if style and line.row is not None and line.first:
            shown.stylize(style(rows[line.row]), 0, len(texts[line.row][0]))
        out.print(shown, soft_wrap=True)


def laid_out(head: Sequence[str], rows: Sequence[Sequence[str]], words: int, width: int | None) -> Iterator[Line]:
    """The lines of a table.

    Args:
        head: titles of the columns.
        rows: the cells, each on one line.
        words: so many columns from the left hold words.
        width: columns of the terminal; None: as many as it takes.
    """
    table = [list(head), *map(list, rows)]
    natural = [max(map(cell_len, column)) for column in zip(*table, strict=True)]
    if width is None or _total(natural) <= width:
        yield from _side_by_side(table, natural, words)
        return
    widths = _fitted(natural, _least(table, natural, words, NARROW), width)
    if widths is None or _height(table[1:], widths) > TALL:
        if words < len(head):
            yield from _stacked(table, words, width)
            return
        widths = _fitted(natural, _least(table, natural, words, 1), width) or _least(table, natural, words, 1)
    yield from _side_by_side(table, widths, words)


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + len(GAP) * (len(widths) - 1)


def _least(table: list[list[str]], natural: list[int], words: int, narrow: int) -> list[int]:
    """How narrow every column may be: its figures whole, and no word of a title or of words cut."""
    found = []
    for place, column in enumerate(zip(*table, strict=True)):
        title, *cells = column
        least = max(map(cell_len, title.split()), default=0)
        if place < words:
            longest = max((cell_len(word) for cell in cells for word in cell.split()), default=0)
            least = max(least, longest, min(narrow, natural[place]))
        else:
            least = max([least, *map(cell_len, cells)])
        found.append(least)
    return found


def _fitted(natural: list[int], least: list[int], width: int) -> list[int] | None:
    """Widths between the least and the natural ones that fill the width; None: not even the least do."""
    spare = width - _total(least)
    if spare < 0:
        return None
    found = list(least)
    for _ in range(spare):
        most = max(range(len(found)), key=lambda place: natural[place] - found[place])
        if natural[most] <= found[most]:
            break
        found[most] += 1
    return found


def _height(rows: list[list[str]], widths: list[int]) -> int:
    return max((len(_wrapped(cell, width)) for row in rows for cell, width in zip(row, widths, strict=True)), default=1)


def _wrapped(text: str, width: int) -> list[str]:
    """The words of a text in lines; a word that is wider has a line of its own."""
    if cell_len(text) <= width:
        return [text]
    lines = [""]
    for word in text.split(" "):
        joined = f"{lines[-1]} {word}" if lines[-1] else word
        if cell_len(joined) <= width or not lines[-1]:
            lines[-1] = joined
        else:
            lines.append(word)
    return lines


def _side_by_side(table: list[list[str]], widths: list[int], words: int, indent: str = "") -> Iterator[Line]:
    for number, row in enumerate(table):
        yield from _row(row, widths, words, number - 1 if number else None, indent)


def _row(row: list[str], widths: list[int], words: int, number: int | None, indent: str = "") -> Iterator[Line]:
    cells = [_wrapped(cell, width) for cell, width in zip(row, widths, strict=True)]
    height = max(map(len, cells))
    # A title of several lines stands on its figures, words hang from their first line.
    filled = [[""] * (height - len(c)) + c if number is None else c + [""] * (height - len(c)) for c in cells]
    for at in range(height):
        parts = []
        for place, (column, width) in enumerate(zip(filled, widths, strict=True)):
            room = " " * (width - cell_len(column[at]))
            parts.append(column[at] + room if place < words else room + column[at])
        yield Line((indent + GAP.join(parts)).rstrip(), number, at == 0)


def _stacked(table: list[list[str]], words: int, width: int) -> Iterator[Line]:
    figures = [row[words:] for row in table]
    natural = [max(map(cell_len, column)) for column in zip(*figures, strict=True)]
    least = _least(figures, natural, 0, 0)
    room = width - len(GAP)
    groups: list[list[int]] = [[]]
    for place in range(len(least)):
        if groups[-1] and _total([least[one] for one in [*groups[-1], place]]) > room:
            groups.append([])
        groups[-1].append(place)
    fitted = [
        _fitted([natural[one] for one in group], [least[one] for one in group], room) or [least[one] for one in group]
        for group in groups
    ]
    for number, (row, own) in enumerate(zip(table, figures, strict=True)):
        place = number - 1 if number else None
        lead = GAP.join(cell for cell in row[:words] if cell)
        for at, text in enumerate(_wrapped(lead, width)):
            yield Line(text, place, at == 0)
        for group, widths in zip(groups, fitted, strict=True):
            for line in _row([own[one] for one in group], widths, 0, place, GAP):
                yield Line(line.text, place, first=False)
