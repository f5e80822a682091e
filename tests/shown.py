"""What a document shows of an output, held against the output: words to the letter, numbers to a tolerance."""

import re

ELLIPSIS = "…"

FIGURES = 0.05
"""Relative. Shown figures have two or three digits; another processor changes the last, and a peak's time by a step."""

ROUNDING = 1e-11
"""What is smaller is rounding, and differs by factors between processors; so may a dash for nothing."""

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)", re.IGNORECASE)


def missing(shown: tuple[str, ...], output: str) -> str | None:
    """The first shown line that the output does not have in its place; None: all are there.

    A line ``…`` stands for any lines, and one that ends with it for the beginning of one. Where nothing is shown,
    anything may be printed.
    """
    lines = [line for line in output.splitlines() if line.strip()]
    position, anywhere = 0, False
    for line in shown:
        if not line.strip():
            continue
        if line.strip() == ELLIPSIS:
            anywhere = True
            continue
        places = range(position, len(lines)) if anywhere else range(position, min(position + 1, len(lines)))
        found = next((place for place in places if _agrees(line, lines[place])), None)
        if found is None:
            return line
        position, anywhere = found + 1, False
    if shown and not anywhere and position < len(lines):
        return f"nothing more, got: {lines[position]}"
    return None


def _agrees(shown: str, line: str) -> bool:
    begins = shown.endswith(ELLIPSIS)
    shown, line = (" ".join(text.removesuffix(ELLIPSIS).split()) for text in (shown, line))
    words, numbers = _NUMBER.sub("#", shown), _NUMBER.findall(shown)
    there, printed = _NUMBER.sub("#", line), _NUMBER.findall(line)
    if begins:
        printed = printed[: len(numbers)]
        if not there.startswith(words):
            return False
    elif words != there:
        return False
    return len(numbers) == len(printed) and all(map(_close, numbers, printed))


def _close(shown: str, printed: str) -> bool:
    a, b = float(shown), float(printed)
    if shown == printed or max(abs(a), abs(b)) < ROUNDING:
        return True
    return abs(a - b) <= FIGURES * max(abs(a), abs(b))
