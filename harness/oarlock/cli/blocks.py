"""The chapters of an examination on a terminal: sentences and short tables, without explanations and figures."""

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.cells import cell_len
from rich.table import Table as Grid
from rich.text import Text as Line

from oarlock.base.errors import few
from oarlock.base.text import visible
from oarlock.cli.console import console, shown

if TYPE_CHECKING:
    from oarlock.diagnosis.page.blocks import Chapter, Item, Table

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def print_line(text: str) -> None:
    """Prints a line, however long it is."""
    console().print(shown(text), soft_wrap=True)


def print_chapter(chapter: "Chapter") -> None:
    """Prints what a chapter has for a terminal."""
    heading = chapter.title if chapter.number is None else f"{chapter.number}  {chapter.title}"
    console().print(Line(heading, style="bold"))
    for block in chapter.blocks:
        if block.kind == "text" and not block.detail:
            print_line(block.text)
        elif block.kind == "table" and block.short is not None:
            _print_table(block.short)
        elif block.kind == "code":
            for line in block.text.splitlines():
                print_line(f"    {line}")
        elif block.kind == "findings":
            _print_findings(block.items)


def _print_table(table: "Table") -> None:
    if not sys.stdout.isatty():
        _print_plainly(table)
        return
    grid = Grid(box=None, header_style="bold", pad_edge=False)
    for place, title in enumerate(table.head):
        grid.add_column(title, justify="left" if place < table.words else "right", overflow="fold")
    for row in table.rows:
        grid.add_row(*map(shown, row))
    console().print(grid)


def _print_plainly(table: "Table") -> None:
    """Prints a table as a terminal wide enough would show it, to whoever reads files: laid out in far less time."""
    lines = [list(map(str, table.head)), *([visible(cell) for cell in row] for row in table.rows)]
    widths = [max(map(cell_len, column)) for column in zip(*lines, strict=True)]
    for line in lines:
        room = [" " * (width - cell_len(cell)) for cell, width in zip(line, widths, strict=True)]
        cells = [c + r if at < table.words else r + c for at, (c, r) in enumerate(zip(line, room, strict=True))]
        print("  ".join(cells))


def _print_findings(items: "Sequence[Item]") -> None:
    """A line each; of one code and severity the first, and where the others are."""
    groups: dict[tuple[str, str], list[Item]] = {}
    for item in items:
        groups.setdefault((item.severity, item.code), []).append(item)
    for (severity, code), (first, *others) in groups.items():
        text = Line(f"{severity:8}", style=_COLOURS[severity])
        text.append_text(shown(f"{code} {first.name}  {first.element + ': ' if first.element else ''}{first.line}"))
        console().print(text, soft_wrap=True)
        if others:
            names = list(dict.fromkeys(item.element for item in others if item.element))
            print_line(f"{'':8}   and {len(others)} more{f': {few(names, most=6)}' if names else ''}")
    print_line(f"oarlock explain {items[0].code} says what that means, how it is measured, and what to do")
