"""The fenced blocks of a document."""

import re
from dataclasses import dataclass
from pathlib import Path

_FENCE = re.compile(
    r"^(?:<!-- (?P<note>slow|arguments|syntax|append to \S+) -->\n)?^```(?P<language>\w+)[^\n]*\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)

SHOWN_ONLY = {"text"}
"""Languages of blocks that are no code: figures, trees, output of something that is run elsewhere."""


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        language: what stands behind its fence.
        text: what is in it.
        line: of its first line in the document.
        note: how it is run, of a comment just above: ``slow``; ``arguments``, parsed only, for what takes minutes;
            ``syntax``, compiled only, for what needs a program that is not there; ``append to PATH``.
    """

    language: str
    text: str
    line: int
    note: str


def blocks(path: Path) -> list[Block]:
    """All blocks of a document but those that only show something."""
    text = path.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        line = text.count("\n", 0, match.start("text")) + 1
        found.append(Block(match["language"], match["text"], line, match["note"] or ""))
    return [block for block in found if block.language not in SHOWN_ONLY]


@dataclass(frozen=True)
class Command:
    """A command of a block, with the lines that are shown after it."""

    text: str
    shown: tuple[str, ...]


def commands(block: Block) -> list[Command]:
    """The commands of a ``console`` block, behind ``$``, or of an ``sh`` block, line by line."""
    lines = block.text.splitlines()
    if block.language == "sh":
        return [Command(line, ()) for line in _joined(lines) if line.strip() and not line.startswith("#")]
    assert lines, f"line {block.line}: an empty block"
    assert lines[0].startswith("$ "), f"line {block.line}: a console begins with a command"
    found: list[tuple[str, list[str]]] = []
    for line in _joined(lines):
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return [Command(text, tuple(shown)) for text, shown in found]


def _joined(lines: list[str]) -> list[str]:
    """Lines, those that end with a backslash with the next one."""
    return re.sub(r" *\\\n\s*", " ", "\n".join(lines)).split("\n")
