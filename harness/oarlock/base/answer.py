"""What the public functions give: answers of one family."""

import html
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, ClassVar

import polars as pl

from oarlock.base.numbers import short

SHOWN = 100
"""Rows of a table that a notebook is given; of more it is told how many there are."""


class Answer(ABC):
    """An answer: of ``run``, ``check``, ``suite`` and others. In a notebook it shows itself.

    Attributes:
        FRAMES: names of the attributes that are tables, as polars frames.
    """

    FRAMES: ClassVar[tuple[str, ...]]

    @property
    def frames(self) -> dict[str, pl.DataFrame]:
        """All its tables by their names."""
        return {name: getattr(self, name) for name in self.FRAMES}

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """As the command's ``--json``: dictionaries, lists, strings and finite numbers."""

    @abstractmethod
    def report(self, folder: str | Path) -> Path:
        """Writes its page to a folder, as the command's ``--report``: README.md with drawings, and index.html.

        Args:
            folder: a new one, or an old report, which is replaced.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be written, or holds something else.
        """

    @abstractmethod
    def _repr_html_(self) -> str: ...


def html_table(head: str, titles: Sequence[str], rows: Iterable[Sequence[Any]], notes: Iterable[str] = ()) -> str:
    """A heading, notes and a table as HTML. All of them are text, whatever is in them.

    Args:
        head: a sentence before the table.
        titles: of its columns.
        rows: its cells; of more than ``SHOWN`` only so many are shown.
        notes: a list between the two.
    """
    every = [[html.escape(short(value)) for value in row] for row in rows]
    parts = [f"<p>{html.escape(head)}</p>"]
    listed = "".join(f"<li>{html.escape(note)}</li>" for note in notes)
    parts += [f"<ul>{listed}</ul>"] if listed else []
    if every:
        top = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
        body = "".join(f"<tr>{''.join(f'<td>{text}</td>' for text in row)}</tr>" for row in every[:SHOWN])
        parts.append(f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>")
    if len(every) > SHOWN:
        parts.append(f"<p>and {len(every) - SHOWN} more</p>")
    return f"<div>{''.join(parts)}</div>"
