"""The page of a comparison: what changed between two folders of results, as Markdown and as HTML."""

from collections.abc import Sequence
from pathlib import Path

from oarlock.base.files import write_text
from oarlock.render.folder import require_report, write_whole
from oarlock.render.page import page
from oarlock.render.template import render

CONTENTS = ("README.md", "index.html")
"""What the page consists of. A folder that holds anything else is not replaced."""


def write_page(
    folder: Path,
    head: str,
    origins: Sequence[str],
    titles: Sequence[str],
    changes: Sequence[Sequence[str]],
    timings: dict[str, float],
) -> Path:
    """Writes README.md and index.html.

    Args:
        folder: a new one, or an old page of this kind.
        head: what was compared, in a sentence.
        origins: what differs in where the figures come from, a line each.
        titles: of the columns of the table.
        changes: its rows.
        timings: timing that was not judged → after over before.

    Raises:
        InputError: the folder cannot be written, or is not such a page.
    """
    require_report(folder, CONTENTS)
    text = render("diff.md.j2", head=head, origins=origins, titles=titles, changes=changes, timings=timings)

    def write(new: Path) -> None:
        write_text(new / "README.md", text)
        write_text(new / "index.html", page("What changed", text, [], {}))

    return write_whole(folder, write)
