"""What is measured with one version of MuJoCo: that which this process imports. Prints a JSON document."""

import json
import sys
import traceback
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
from oarlock import InputError, check, run
from oarlock.cases.case import load_case, model_names
from oarlock.experiments.task import Task
from oarlock.mechanics.load import load_model
from oarlock.stepping import native_path
from oarlock.stepping.solvers import SolverSpec
from walks import require_equal

FIXTURE = Path(__file__).parents[1] / "fixtures" / "check" / "damped_gripper.xml"

NEW = """<mujoco><worldbody><body name="arm"><joint name="pin" springyield="1"/><geom size=".1"/></body></worldbody>
  <equality><joint joint1="pin"/></equality></mujoco>"""
"""A model that only the newest version knows."""

STEPS = 200
"""Of an exact run against the outside truth; whole runs would take the Python path minutes."""

WHOLE_RUN = "four_bar"
"""The model that takes all of its steps."""

LARGE = 40
"""Velocities of a model beyond which steps in Python take long."""

COUNTED = "boat", "stewart", "four_bar"
"""Models whose iterations are counted along an exact run, in which nothing hangs on the version."""


def main() -> None:
    """Measures everything and prints it."""
    warnings.simplefilter("ignore")
    found: dict[str, Any] = {"version": mujoco.__version__, "refusal": native_path.refusal()}
    try:
        found["unknown"] = _unknown()
        found |= {"loads": _loads(), "truth": _truth(), "iterations": _iterations(), "findings": _findings()}
        found["differing"] = [] if found["refusal"] else _differing()
    except Exception:
        found["traceback"] = traceback.format_exc()
    json.dump(found, sys.stdout)


def _loads() -> dict[str, str]:
    """Model of the gallery → why it cannot be had; empty if it can."""
    found = {}
    for name in model_names():
        case = load_case(name)
        try:
            load_model(case.model_path, case.parameters)
            found[name] = ""
        except InputError as error:
            found[name] = str(error)
    return found


def _unknown() -> str:
    """What is said of a model with an attribute of the newest version; empty if it loads."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "new.xml"
        path.write_text(NEW, encoding="utf-8")
        try:
            load_model(path)
        except InputError as error:
            return str(error)
    return ""


def _small() -> list[str]:
    return [name for name in model_names() if int(load_case(name).expected().get("nv", 0)) <= LARGE]


def _duration(name: str, steps: int = STEPS) -> float | None:
    asked = load_case(name).file.run
    if name == WHOLE_RUN or asked.timestep_s is None:
        return None
    return min(steps * asked.timestep_s, asked.duration_s)


def _truth() -> dict[str, float]:
    """Model with an outside truth → how far an exact run is from it."""
    found = {}
    for name in _small():
        if load_case(name).truth_path is not None:
            (row,) = _rows(name, mode="free", solver=["auto"], form="hard", duration=_duration(name))
            found[name] = row["truth_error_max"]
    return found


def _iterations() -> dict[str, Any]:
    """Model → mean and largest number of iterations of sr1 along an exact run."""
    found = {}
    for name in COUNTED:
        asked: dict[str, Any] = {"mode": "lockstep", "walker": "pinv", "solver": ["sr1"], "form": "hard"}
        (row,) = _rows(name, **asked, duration=min(0.1, _duration(name) or 0.1))
        found[name] = [row["iterations_mean"], row["iterations_max"]]
    return found


def _rows(name: str, **asked: Any) -> list[dict[str, Any]]:
    """The rows of the summary that are the asked solver's."""
    rows = run(name, **asked).document()["runs"]
    return [row for row in rows if row["solver"] == asked["solver"][0]]


def _findings() -> list[str]:
    """Codes of what is found in a file that is not oarlock's own."""
    document = check(FIXTURE, duration=0.2).document()
    return sorted({finding["code"] for finding in document["findings"]})


def _differing() -> list[str]:
    """Models on which the native path does not give the bits of the Python path."""
    found = []
    mine, theirs = SolverSpec("auto"), SolverSpec("mujoco")
    for name in _small():
        case = load_case(name)
        integrator = case.file.run.integrator
        try:
            require_equal(case, Task("lockstep", theirs, ("matched", "hard"), (mine,), integrator, "default"), 40)
            stabilisation = case.file.run.stabilisation
            require_equal(case, Task("free", mine, ("hard",), (mine,), integrator, "default", stabilisation), 40)
        except AssertionError as error:
            found.append(f"{name}: {error}")
    return found


if __name__ == "__main__":
    main()
