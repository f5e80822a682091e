"""Runs ``core.py`` with one version of MuJoCo after another, each in a folder and a process of its own.

Arguments: versions, in place of ``TESTED``. Prints a line a version, and fails if one fails.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

TESTED = ("3.3.0", "3.3.7", "3.6.0", "3.7.0", "3.10.0", "3.12.0", "3.17.0", "4.0.0")

NEWEST = "4.0.0"
"""What the others are compared with."""

NATIVE_SINCE = (3, 10)
"""The first version that steps natively."""

FACTOR = 2.0
"""So much farther from the outside truth than with the newest version an exact run may be."""

ROUNDING = 1e-12
"""Distances from the truth below which versions differ by the order of their sums."""

TESTS = Path(__file__).parents[1]
FOLDERS = TESTS.parent / "build" / "versions"


def folder_of(version: str) -> Path:
    """The folder with a version's packages, which are downloaded once."""
    folder = FOLDERS / version
    if not list(folder.glob("mujoco/_structs*")):
        core = [f"mujoco-core=={version}"] if int(version.partition(".")[0]) >= 4 else []
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
        subprocess.run([*pip, "--upgrade", "--target", folder, f"mujoco=={version}", *core], check=True)
    return folder


def measured(version: str) -> dict[str, Any]:
    """What ``core.py`` prints with a version."""
    before = os.environ.get("PYTHONPATH")
    places = [str(folder_of(version)), str(TESTS), *([before] if before else [])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places)}
    script = [sys.executable, Path(__file__).with_name("core.py")]
    done = subprocess.run(script, env=environment, capture_output=True, encoding="utf-8", check=False)
    try:
        return json.loads(done.stdout)
    except ValueError:
        return {"version": version, "traceback": done.stderr}


def failures(version: str, found: dict[str, Any], newest: dict[str, Any]) -> list[str]:
    """What a version does not do as the newest does."""
    if "traceback" in found:
        return [found["traceback"]]
    wrong = [] if found["version"] == version else [f"MuJoCo {found['version']} was imported"]
    native = tuple(map(int, version.split("."))) >= NATIVE_SINCE
    if native == bool(found["refusal"]):
        wrong.append(f"native stepping: {found['refusal'] or 'taken'}")
    wrong += [f"{name}: the paths differ" for name in found["differing"]]
    wrong += [line for line in found["loads"].values() if line]
    expected = "" if version == NEWEST else f"; this is MuJoCo {version}, a newer one may know it"
    if not found["unknown"].endswith(expected) or "\n" in found["unknown"] or bool(found["unknown"]) != bool(expected):
        wrong.append(f"of an attribute of {NEWEST} is said: '{found['unknown']}'")
    for name, error in found["truth"].items():
        if not error <= max(FACTOR * newest["truth"][name], ROUNDING):
            wrong.append(f"{name}: {error:.3g} from the truth, {newest['truth'][name]:.3g} with {NEWEST}")
    for name, counts in found["iterations"].items():
        if counts != newest["iterations"][name]:
            wrong.append(f"{name}: {counts} iterations, {newest['iterations'][name]} with {NEWEST}")
    if not found["findings"]:
        wrong.append("no findings")
    return wrong


def main(versions: list[str]) -> int:
    """Measures the versions and says of each what came out."""
    newest = measured(NEWEST)
    failed = False
    for version in versions or TESTED:
        found = newest if version == NEWEST else measured(version)
        wrong = failures(version, found, newest)
        failed |= bool(wrong)
        path = "Python path" if found.get("refusal") else "native"
        loads, truth = found.get("loads", {}), found.get("truth", {})
        farther = [error / max(newest["truth"][name], ROUNDING) for name, error in truth.items()]
        said = [
            f"{sum(not line for line in loads.values())} of {len(loads)} models load",
            f"{len(truth)} exact runs at most {max(farther, default=0.0):.4f} times as far off as with {NEWEST}",
            f"findings {' '.join(found.get('findings', []))}",
            path,
        ]
        print(f"MuJoCo {version}: {'FAILED' if wrong else 'ok'}: {'; '.join(said)}", *wrong, sep="\n  ", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
