"""``oarlock close``: what it says of loops that it closes, and its exit status."""

from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from oarlock.base.errors import InputError
from oarlock.cli.console import GATE_FAILED, JsonOption, emit_json, ends, one_of, say

if TYPE_CHECKING:
    from oarlock.closing.closing import Closing
    from oarlock.closing.joining import Kind

KINDS: tuple["Kind", ...] = ("connect", "ball", "hinge", "weld")

_BETWEEN = "\0"
"""Between two names in one word: no argument of a process has it."""


class Reader(TyperCommand):
    """Takes two words after ``--pair``, for which typer has no form where it may be repeated."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Joins them to one."""
        words, joined = list(args), list[str]()
        while words and words[0] != "--":
            joined.append(words.pop(0))
            if joined[-1] == "--pair":
                names = list(takewhile(lambda word: not word.startswith("-"), words[:2]))
                joined += [_BETWEEN.join(names)] if names else []
                del words[: len(names)]
        return super().parse_args(ctx, [*joined, *words])


@ends()
def close(
    file: Annotated[Path, typer.Argument(metavar="FILE.xml|FILE.urdf", help="An open tree: MJCF, or URDF.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="OUT.xml", help="The closed model, MJCF.")],
    pair: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A B",
            help="Sites, frames or bodies that meet; may be repeated [default: each closing_NAME_1, closing_NAME_2].",
        ),
    ] = None,
    kind: Annotated[
        str,
        typer.Option(
            "--as",
            metavar="KIND",
            help=f"{one_of(KINDS)} connect and ball join the two origins; hinge also a second point, 0.1 m along z of "
            "both frames (two connects, as onshape-to-robot); weld all of the frames.",
        ),
    ] = "connect",
    at: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Where two bodies meet in the model's own pose, in the world, m [default: the second one's origin].",
        ),
    ] = None,
    as_json: JsonOption = None,
) -> None:
    """Closes the loops of an open tree: adds the equalities, finds the closed pose, writes it as a keyframe, and lints.

    A body without joint, geom and child is a frame, as URDF has them: its origin is meant. Two other bodies are joined
    as they are drawn. Status 1: no pose closes the loops, and nothing is written; or the lint found an error.
    """
    from oarlock.base.errors import choose
    from oarlock.closing import closing as loops
    from oarlock.diagnosis.checked import check

    pairs = [_pair(text) for text in pair or ()]
    closing = loops.close(file, out, pairs, kind=choose("kind", kind, KINDS), at=None if at is None else _point(at))
    if not closing.reached:
        say(f"oarlock: {file}: {_open(closing)}; nothing is written")
        raise typer.Exit(GATE_FAILED)
    checked = check(out, lint=True, keyframe=closing.keyframe)
    if as_json:
        emit_json({**closing.document(), "lint": checked.document()["findings"]}, as_json)
    if as_json != "-":
        from oarlock.cli.blocks import print_chapter, print_line
        from oarlock.diagnosis.page.chapters.findings import findings

        for line in closing.told():
            print_line(line)
        print_chapter(findings(checked.verdict))
    for path in closing.files:
        say(f"oarlock: written: {path}")
    if any(finding.severity == "error" for finding in checked.verdict):
        raise typer.Exit(GATE_FAILED)


def _pair(text: str) -> tuple[str, str]:
    first, between, second = text.partition(_BETWEEN)
    if not between:
        raise InputError(f"--pair {first} without another name, expected two: --pair A B")
    return first, second


def _point(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or not all(abs(value) < float("inf") for value in values):
        raise InputError(f"--at {text}, expected X,Y,Z, three finite numbers in m")
    return values


def _open(closing: "Closing") -> str:
    worst = max(closing.pose.left, key=lambda one: one.largest)
    said = f"no pose closes the loops: {worst.equality} stays open by {closing.gap:.3g} m or rad at best"
    if any(one.name == worst.equality and one.kind == "weld" for one in closing.joinings):
        said += "; a weld holds the orientation too, expected --as hinge or --as connect where the joint turns"
    return said
