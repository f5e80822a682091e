"""Every block of code and every command of the documents is run, and shows what they say that it shows."""

from pathlib import Path

import pytest
from fences import blocks
from places import REPOSITORY
from reader import Reader
from shown import missing

DOCUMENTS = [
    REPOSITORY / "README.md",
    *sorted(path for path in (REPOSITORY / "docs").glob("**/*.md") if "decisions" not in path.parts),
]


def _name(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


WITH_BLOCKS = [path for path in DOCUMENTS if blocks(path)]
SLOW = [path for path in WITH_BLOCKS if any(block.note == "slow" for block in blocks(path))]


def test_there_is_something_to_run():
    assert len(WITH_BLOCKS) >= 12
    assert len(SLOW) >= 2
    assert sum(len(blocks(path)) for path in DOCUMENTS) >= 40


@pytest.mark.parametrize("path", WITH_BLOCKS, ids=_name)
def test_a_document(path, tmp_path):
    reader = Reader(tmp_path, slow=False)
    for block in blocks(path):
        reader.play(block)


@pytest.mark.slow
@pytest.mark.parametrize("path", SLOW, ids=_name)
def test_a_document_with_what_takes_long(path, tmp_path):
    reader = Reader(tmp_path, slow=True)
    for block in blocks(path):
        reader.play(block)


@pytest.mark.parametrize("path", DOCUMENTS, ids=_name)
def test_no_block_escapes(path):
    """Every fence is found, and none but those that show text is left out."""
    text = path.read_text(encoding="utf-8")
    fences = [line for line in text.splitlines() if line.startswith("```")]
    shown = [line for line in fences if line.startswith("```text")]
    assert len(fences) % 2 == 0
    assert len(blocks(path)) == len(fences) // 2 - len(shown)


@pytest.mark.parametrize(
    ("shown", "output"),
    [
        (("a 1.00 m",), "a 1.02 m"),
        (("…", "b 2e-05", "…"), "a\nb  2.04e-05\nc"),
        (("rounding 3e-16",), "rounding 1.1e-15"),
        (("begins with 3 rows…",), "begins with 3 rows, rank 2"),
        ((), "whatever"),
    ],
)
def test_what_agrees(shown, output):
    assert missing(shown, output) is None


@pytest.mark.parametrize(
    ("shown", "output"),
    [
        (("a 1.00 m",), "a 1.2 m"),
        (("a 1.00 m",), "a 1.00 rad"),
        (("b",), "a\nb"),
        (("…", "b"), "a\nb\nc"),
        (("3 rows",), "4 rows"),
        (("rounding 3e-16",), "rounding 1e-5"),
    ],
)
def test_what_does_not_agree(shown, output):
    assert missing(shown, output) is not None
