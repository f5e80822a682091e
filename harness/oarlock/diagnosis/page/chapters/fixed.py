"""What a fix changed, line by line, and what that does."""

from collections.abc import Mapping
from typing import Any

from oarlock.base.errors import few
from oarlock.base.numbers import figure
from oarlock.diagnosis.page.blocks import Chapter

LINES = 60
"""Of a file that are shown, at most."""


def fixed(fix: Mapping[str, Any]) -> Chapter:
    """What a fix changed, line by line, and what that does.

    Args:
        fix: the document of a fix, as in ``--json``.
    """
    chapter = Chapter("fixed", "What the fix changed", 7)
    lines = fix["lines"]
    if not fix["changes"]:
        chapter.say(f"{fix['file']} is the model as it was: nothing that was tried helps.")
    else:
        chapter.say(f"{fix['file']} is the model with these changes; the rest of the text is as it was.")
    if fix["mended"]:
        chapter.say(f"Not found any more: {few(fix['mended'])}.")
    for reason in filter(None, (fix["reason"], fix["elsewhere_reason"])):
        chapter.say(f"Not reached: {reason}.")
    chapter.table(
        "changed lines",
        ("file", "line", "before", "after"),
        [(one["file"], str(one["number"]), one["before"] or "", one["after"] or "") for one in lines[:LINES]],
        words=4,
    )
    if len(lines) > LINES:
        chapter.say(f"and {len(lines) - LINES} more lines.")
    chapter.explain(
        "What each change does, tried by itself: of settings with all others, of all others before the settings change."
    )
    chapter.table(
        "changes",
        ("change", "controls", "without", "with"),
        [
            (one["what"], one["controls"], _drift(one, "drift_without"), _drift(one, "drift_with"))
            for one in fix["changes"]
        ],
        words=2,
    )
    runs = [{"controls": fix["controls"], **fix}, *fix["elsewhere"]]
    chapter.say(f"The file begins with {fix['begins']}; wanted are {figure(fix['target'])} m or rad.")
    chapter.table(
        "drift of the fix",
        ("controls", "before", "after"),
        [(one["controls"], _drift(one, "drift_before"), _drift(one, "drift")) for one in runs],
    )
    chapter.table(
        "limits that the fix overruns otherwise",
        ("limit", "controls", "overrun before", "after"),
        [_overrun(one) for one in runs if one["overrun"]],
        words=2,
    )
    chapter.table(
        "left by the fix",
        ("code", "at", "left"),
        [(f"{one['code']} {one['name']}", one["element"], one["line"]) for one in fix["left"]],
        words=3,
    )
    return chapter


def _overrun(run: Mapping[str, Any]) -> tuple[str, ...]:
    one = run["overrun"]
    return one["limit"], run["controls"], *(figure(one[name], one["unit"]) for name in ("before", "after"))


def _drift(run: Mapping[str, Any], name: str) -> str:
    return "diverged" if run[name] is None else figure(run[name], run["unit"])
