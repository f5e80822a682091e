"""The chapters of an examination on a terminal: sentences and short tables, without explanations and figures."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.text import Text as Line

from oarlock.base.errors import few
from oarlock.cli.console import console, shown
from oarlock.cli.tables import print_table

if TYPE_CHECKING:
    from oarlock.diagnosis.page.blocks import Chapter, Item

MOST = 5
"""Errors and warnings of one code that are printed; of more the first, and where the others are."""

_COLOURS = {"error": "red", "warning": "yellow", "note": "cyan"}


def print_line(text: str) -> None:
    """Prints a line, however long it is."""
    console().print(shown(text), soft_wrap=True)


def print_heading(text: str) -> None:
    """Prints a line that stands over others."""
    console().print(Line(shown(text).plain, style="bold"), soft_wrap=True)


def print_chapter(chapter: "Chapter") -> None:
    """Prints what a chapter has for a terminal."""
    heading = chapter.title if chapter.number is None else f"{chapter.number}  {chapter.title}"
    console().print(Line(heading, style="bold"))
    for block in chapter.blocks:
        if block.kind == "text" and not block.detail:
            print_line(block.text)
        elif block.kind == "table" and block.short is not None:
            print_table(block.short.head, block.short.rows, block.short.words)
        elif block.kind == "code":
            for line in block.text.splitlines():
                print_line(f"    {line}")
        elif block.kind == "findings":
            _print_findings(block.items)


def _print_findings(items: "Sequence[Item]") -> None:
    """A line each; of notes of one code, and of many warnings, the first, and where the others are."""
    groups: dict[tuple[str, str], list[Item]] = {}
    for item in items:
        groups.setdefault((item.severity, item.code), []).append(item)
    for (severity, code), (first, *others) in groups.items():
        text = Line(f"{severity:8}", style=_COLOURS[severity])
        text.append_text(shown(f"{code} {first.name}  {first.element + ': ' if first.element else ''}{first.line}"))
        console().print(text, soft_wrap=True)
        shown_, others = (others, []) if severity != "note" and len(others) < MOST else ([], others)
        for item in shown_:
            print_line(f"{'':8}   {item.element + ': ' if item.element else ''}{item.line}")
        if others:
            names = list(dict.fromkeys(item.element for item in others if item.element))
            where = f": {few(names, most=6)}" if names else ""
            print_line(f"{'':8}   and {len(others)} more{where} (--report and --json have each)")
    print_line(f"oarlock explain {items[0].code} says what that means, how it is measured, and what to do")
