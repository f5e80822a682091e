"""Markdown of what is no Markdown."""

import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]

sys.path.insert(0, str(REPOSITORY / "harness"))

WRITTEN = "\n<!-- Written by docs/generate from the sources: a change here is lost. -->\n"

_SPECIAL = re.compile(r"([\\*_|\[\]#])")


def plain(text: str) -> str:
    """Text that means nothing to Markdown or HTML, but for what stands in backquotes."""
    parts = text.replace("``", "`").split("`")
    return "`".join(part if index % 2 else _escaped(part) for index, part in enumerate(parts))


def _escaped(text: str) -> str:
    return _SPECIAL.sub(r"\\\1", text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;"))


def code(text: str) -> str:
    """Text as code in a cell of a table."""
    return f"`{text}`" if text else ""


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are Markdown already; columns that are empty in every row are left out."""
    body = [[re.sub(r"\s+", " ", cell) for cell in row] for row in rows]
    full = [index for index in range(len(titles)) if any(row[index] for row in body)]
    lines = [titles, ["---"] * len(titles), *body]
    return "\n".join(f"| {' | '.join(line[index] for index in full)} |" for line in lines) + "\n"


def page(title: str, head: str, *parts: str) -> str:
    """A page of paragraphs, with a title."""
    return "\n\n".join([f"# {title}{WRITTEN}", head, *parts]) + "\n"


def attributes(docstring: str) -> tuple[str, dict[str, str]]:
    """What a docstring in Google's form says, and what its ``Attributes:`` say: name → text."""
    lead, _, rest = docstring.partition("Attributes:\n")
    section = re.split(r"\n\s*(?:Raises|Returns|Args):\n", rest)[0]
    indent = len(section) - len(section.lstrip()) if section.strip() else 0
    found = re.split(rf"^ {{{indent}}}(\w+): ", section, flags=re.MULTILINE)
    texts = {name: re.sub(r"\s+", " ", text).strip() for name, text in zip(found[1::2], found[2::2], strict=True)}
    return re.sub(r"\s+", " ", re.split(r"\n\s*(?:Raises|Returns|Args):\n", lead)[0]).strip(), texts
