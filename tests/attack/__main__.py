"""Runs the attacks, one after another; status 1 if anything fell.

cd tests && ../.venv/bin/python -m attack --only models,cases --seconds 300 --seed 0
"""

import argparse
import os
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
    asked = parser.parse_args(arguments)
    fell = 0
    for name in asked.only.split(","):
        if name == "endings":
            fell += endings.main(["--seconds", str(asked.seconds), "--seed", str(asked.seed)])
            continue
        if name not in MUTATORS:
            parser.error(f"--only {name}, expected some of {', '.join(names)}")
        if not fence.available():
            print(
                f"{name}: not tried; this system has no Landlock, which keeps what is attacked from writing elsewhere"
            )
            continue
        what, attempts = MUTATORS[name]
        with tempfile.TemporaryDirectory(prefix="attack-") as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            until = time.monotonic() + asked.seconds
            fell += endings.report(what, tried(attempts(asked.seed, Path(folder)), Path(folder), until))
    return min(fell, 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
