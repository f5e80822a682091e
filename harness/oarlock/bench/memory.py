"""How much memory walks take: each in a process of its own, whose peak is read where it ends."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError
from oarlock.base.progress import Progress
from oarlock.bench.budget import LEAST
from oarlock.bench.families import Family, families
from oarlock.bench.growth import SOLVERS
from oarlock.bench.steps import BARE, Track

WALKERS = (BARE, "auto", "sr1-tracked", "pinv")

_PEAK = "VmHWM:"


def peak_mb() -> float | None:
    """The largest resident memory of this process so far, MB; None where the system does not tell.

    Not that of ``getrusage``, which counts what a process was before it became this program.
    """
    try:
        lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(_PEAK)), None)


def walk(family: Family, size: int, name: str, steps: int) -> dict[str, float | None]:
    """Takes a walk in this process: what it took at most before the first step and at the end, MB."""
    track = Track(family.model_at(size), steps, family.start)
    runs = track.bare_runs() if name == BARE else track.free_runs(name)
    run, before = runs(steps), peak_mb()
    run.walk(True)
    return {"before_mb": before, "peak_mb": peak_mb()}


def bench_memory(growth: dict[str, Any], progress: Progress | None = None, steps: int = LEAST) -> list[dict[str, Any]]:
    """A row a family and contender at the largest size: before_mb and peak_mb of a process of its own.

    Raises:
        InputError: such a process failed.
    """
    progress, rows = progress or Progress(), []
    chosen = families([family["name"] for family in growth["families"]])
    progress.begin("memory", len(chosen) * len(WALKERS))
    for family in chosen:
        own = [row for row in growth["rows"] if row["family"] == family.name]
        largest = max(row["size"] for row in own)
        for name in WALKERS:
            (row,) = (row for row in own if (row["size"], row["name"]) == (largest, name))
            if not row["left_out"]:
                figures = _child(family, largest, name, steps)
                rows.append({"family": family.name, "model": row["model"], "name": name, "steps": steps, **figures})
            progress.advance(1)
    return rows


def _child(family: Family, size: int, name: str, steps: int) -> dict[str, Any]:
    command = [sys.executable, "-m", __name__, family.name, str(size), name, str(steps)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = done.stderr.strip().splitlines()
        raise InputError(f"walk of {family.model_at(size)} by {name} failed: {said[-1] if said else done.returncode}")
    return json.loads(done.stdout)


def main(arguments: list[str]) -> None:
    """Prints the figures of one walk: of a family, a size, who walks, and so many steps."""
    name, size, who, steps = arguments
    assert who in (BARE, *SOLVERS)
    print(json.dumps(walk(families([name])[0], int(size), who, int(steps))))


if __name__ == "__main__":
    main(sys.argv[1:])
