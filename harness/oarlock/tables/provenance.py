"""The provenance of figures, in two parts, so that a report can be reproduced.

``inputs`` (versions, kind of machine, digests of files) is the same whenever the same files are run with the same
versions on the same kind of machine. ``occasion`` (commit, date, machine) is not, and never enters a tracked report.
"""

import datetime
import hashlib
import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oarlock.base import core

if TYPE_CHECKING:
    from oarlock.cases.case import Case

_PACKAGES = ("mujoco", "numpy", "scipy", "polars", "altair", "vl-convert-python")


def _digest(path: Path) -> str | None:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16] if path.is_file() else None


def versions() -> dict[str, Any]:
    """Returns the versions of oarlock, Python and the packages that compute or draw, and the kind of machine."""
    return {
        "oarlock": core.VERSION,
        "core_profile": core.BUILD_PROFILE,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in _PACKAGES},
        "platform": f"{platform.system()} {platform.machine()}",
    }


def inputs(case: "Case") -> dict[str, Any]:
    """Returns the versions, the kind of machine and digests of the case's files."""
    return {
        **versions(),
        "case": case.name,
        "model_sha256": _digest(case.model_path),
        "case_sha256": _digest(case.folder / "case.toml"),
    }


def _commit() -> str | None:
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None  # an installed wheel has no repository
    return described.stdout.strip()


def occasion() -> dict[str, Any]:
    """Returns commit, date, number of cores and kernel of this run."""
    return {
        "commit": _commit(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "cores": os.cpu_count(),
        "kernel": platform.release(),
    }
