"""Runs the attacks, one after another; status 1 if anything fell.

cd tests && ../.venv/bin/python -m attack --only models,cases --seconds 300 --seed 0
cd tests && ../.venv/bin/python -m attack --only models --number 18 --keep /tmp/18   # what fell, to look at
"""

import argparse
import os
import shlex
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from attack import case_files, command_lines, endings, fence, folders, models
from attack.trials import Attempt, tried

MUTATORS: dict[str, tuple[str, Callable[[int, Path], Iterator[Attempt]]]] = {
    "models": ("mutated models", models.attempts),
    "cases": ("mutated cases", case_files.attempts),
    "arguments": ("mutated argument lists", command_lines.attempts),
    "folders": ("damaged folders of results", folders.attempts),
    "kept": ("garbled files of finished suites", folders.kept_files),
}
"""Name → what is tried, and what makes the attempts from a seed and a folder for what all have in common."""


def main(arguments: list[str]) -> int:
    """Tries, and prints what was tried and what was right; 1 if anything fell."""
    names = [*MUTATORS, "endings"]
    parser = argparse.ArgumentParser(prog="attack", description="Tries to break oarlock.")
    parser.add_argument("--only", default=",".join(names), help=f"parts, of {', '.join(names)}")
    parser.add_argument("--seconds", type=float, default=600.0, help="time of a part after which nothing new is begun")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tries", type=int, help="attempts of a part at most, from all of it")
    parser.add_argument("--number", type=int, help="with --keep: the attempt to write")
    parser.add_argument("--keep", type=Path, help="write the files of one attempt to this folder, and do not try it")
    asked = parser.parse_args(arguments)
    parts = asked.only.split(",")
    if unknown := [name for name in parts if name not in names]:
        parser.error(f"--only {','.join(unknown)}, expected some of {', '.join(names)}")
    return min(1, sum(_fell(name, asked) for name in parts))


def _fell(name: str, asked: argparse.Namespace) -> int:
    """Tries a part; gives how many fell."""
    if name == "endings":
        most = ["--tries", str(asked.tries), "--pairs", "2"] if asked.tries else []
        return endings.main(["--seconds", str(asked.seconds), "--seed", str(asked.seed), *most])
    if not fence.available():
        print(f"{name}: not tried; this system has no Landlock, which keeps what is attacked from writing elsewhere")
        return 0
    what, attempts = MUTATORS[name]
    with tempfile.TemporaryDirectory(prefix="attack-") as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        until = time.monotonic() + asked.seconds
        every = attempts(asked.seed, Path(folder))
        if asked.keep:
            _keep(list(every)[asked.number], asked.keep)
            return 0
        if asked.tries:
            listed = list(every)
            every = iter(listed[:: max(1, len(listed) // asked.tries)])
        return endings.report(what, tried(every, Path(folder), until))


def _keep(attempt: Attempt, folder: Path) -> None:
    folder.mkdir(parents=True)
    attempt.prepare(folder)
    print(f"cd {folder} && oarlock {shlex.join(attempt.arguments)}")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
