"""A new case around any MJCF file: a folder with ``model.xml``, ``case.toml`` and ``README.md``, and no code.

Nothing in the case is a guess that looks like a fact: what is expected was computed, bounds were measured and say so,
and what only the author can know is left as a comment that says how to add it.
"""

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import polars as pl

from oarlock.base.errors import InputError, RefusedError, few, one_line
from oarlock.base.files import write_text
from oarlock.base.progress import Progress
from oarlock.base.scratch import scratch_folder, sweep_up
from oarlock.base.text import quoted
from oarlock.cases import case as cases
from oarlock.cases.case import Case, load_case
from oarlock.cases.motion import RULE, Motion
from oarlock.experiments.outcome import Results
from oarlock.experiments.session import run
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.mjcf import Copied, copy_model
from oarlock.mechanics.names import Equality, coordinates, element_name, equalities
from oarlock.mechanics.reactions import verdict
from oarlock.render.template import render
from oarlock.scaffold.survey import AS_IT_STANDS, Survey, longest, nice_above, survey

ROUNDING = 1e-8
"""rad or m. Where the calibration differs by more, it is no longer rounding but what a chaotic motion makes of it."""

COMPARABLE = 1e-3
"""Relative differences beyond it are no bound: two solutions of one linear system that have no digits in common."""

HEADROOM = 10.0
"""Bounds stand at least at so many times what was measured: another machine rounds in another way."""


@dataclass(frozen=True)
class Bound:
    """A gate, from what was measured."""

    figure: str
    where: dict[str, str]
    measured: float
    floor: float
    why: str

    @property
    def max(self) -> float:
        """``HEADROOM`` times what was measured, rounded up, and never below the floor."""
        return max(self.floor, nice_above(HEADROOM * self.measured)) if self.measured > 0 else self.floor

    @property
    def cause(self) -> str:
        """What the bound rests on, in words."""
        return f"{self.why}: {self.measured:.1e} measured when the case was written"


@dataclass
class Scaffold:
    """A new case: what was found and what was done, for the templates and for a summary."""

    name: str
    source: str
    title: str
    copied: Copied
    found: Survey
    ignored: str | None = None
    bounds: list[Bound] = field(default_factory=list)

    @property
    def equalities(self) -> list[Equality]:
        """Those that have rows at the start."""
        return [equality for equality in equalities(self.found.model) if equality.name in self.found.start.unique]

    @property
    def reactions(self) -> str:
        """Whose reactions the rigid model determines."""
        return verdict(self.found.start.unique)

    @property
    def redundancy(self) -> int:
        """Rows beyond the rank, those that are zero among them."""
        return self.found.start.rows - self.found.start.rank

    @property
    def closed_by(self) -> str:
        """``2 connects and 1 weld``."""
        kinds = [equality.kind.name for equality in self.equalities]
        counts = {kind: kinds.count(kind) for kind in kinds}
        return few([f"{count} {kind}{'s' if count > 1 else ''}" for kind, count in counts.items()])

    @property
    def coordinates(self) -> list[str]:
        """Joints in the order of qpos."""
        return list(dict.fromkeys(entry["name"].partition("[")[0] for entry in coordinates(self.found.model)))

    @property
    def example(self) -> str:
        """A joint to show how a start is written: a hinge or slide, where there is one."""
        numbered = {entry["name"].partition("[")[0] for entry in coordinates(self.found.model) if "[" in entry["name"]}
        return next((joint for joint in self.coordinates if joint not in numbered), self.coordinates[0])

    @property
    def actuators(self) -> list[str]:
        """Names of the actuators."""
        model = self.found.model
        return [element_name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, index) for index in range(model.nu)]

    @property
    def tags(self) -> list[str]:
        """What can be told from the numbers alone."""
        model = self.found.model
        tags = ["full rank" if self.reactions == "unique" else "redundant"]
        tags += ["floating"] if (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any() else []
        return tags + (["driven"] if self.found.controls else [])

    @property
    def moved(self) -> str:
        """What closing did to the start."""
        start = self.found.start
        if start.moved <= AS_IT_STANDS:
            return "closed as it stands"
        return f"closed by moving coordinates by up to {start.moved:.3g} rad or m"

    def lines(self) -> list[str]:
        """A short summary."""
        found, start = self.found, self.found.start
        open_ones = [quoted(name) for name, unique in start.unique.items() if not unique]
        whose = ", the model's own" if found.own_timestep else ""
        said = [
            f"{self.name}: {self.closed_by}; {found.model.nv} velocities, {start.rows} rows of rank {start.rank} "
            f"({self.redundancy} redundant or zero), {start.dof} dof",
            f"reactions {self.reactions}" + (f": {few(open_ones)} not determined" if open_ones else ""),
            f"start: {found.origin}, {self.moved}; {found.driven}; integrator {found.integrator}",
            f"timestep {found.timestep_s:g} s{whose}: {found.timestep_reason}",
        ]
        if self.copied.names:
            said.append(f"named in the copy: {few(self.copied.names)}")
        if self.ignored:
            said.append(f"without contacts, limits and friction (run.ignore_inequalities): {self.ignored}")
        return said + found.notes


def models_folder() -> Path | None:
    """The models of the checkout that oarlock runs from; None where it was installed."""
    return cases.MODELS.resolve() if cases.MODELS.is_symlink() else None


def new_model(
    name: str,
    source: Path,
    to: Path | None = None,
    progress: Progress | None = None,
    *,
    outside: bool = False,
    asked: Motion = RULE,
) -> tuple[Path, Scaffold]:
    """Writes the folder of a new case.

    Args:
        name: name of the model and of its folder.
        source: an MJCF file.
        to: the folder that gets the new one; if None the models of the checkout, or the working folder.
        progress: listens to the runs that the bounds are measured with.
        outside: whether files that the model names outside its folder are copied as well.
        asked: where it starts and what drives it, in place of what ``stepping.beginning`` says.

    Returns:
        The new folder, and what was found.

    Raises:
        InputError: a name that no folder can have, a folder that holds something, a model that MuJoCo refuses or that
            cannot be closed.
    """
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise InputError(f"name '{name}', expected letters, digits, '_' and '-' only: it names a folder")
    if source.suffix.lower() != ".xml":
        raise InputError(f"'{source}', expected an MJCF file whose name ends in .xml")
    target = (to or models_folder() or Path()) / name
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise InputError(f"'{target}' is there already, expected a new name or an empty folder")
    if asked.log is not None:
        raise InputError(f"'{asked.log}' is a log, expected laws of time (--control): a case holds no log")
    progress = progress or Progress()
    try:
        target = target.resolve() if target.is_symlink() else target
        target.parent.mkdir(parents=True, exist_ok=True)
        if left := sweep_up([target.parent]):
            progress.note(left)
        with scratch_folder(f".{name}", target.parent) as temporary:
            folder = temporary / name
            folder.mkdir()
            with mujoco_ends_in_a_line(source):
                scaffold = _write(name, source, folder, _picture(name, target.parent), progress, outside, asked)
            if target.exists():
                target.rmdir()
            os.replace(folder, target)
    except OSError as error:
        raise InputError(f"cannot write '{target}': {error.strerror or error}") from None
    return target, scaffold


def _picture(name: str, parent: Path) -> str:
    """Where the report draws the mechanism, seen from the new folder."""
    if parent == models_folder():
        return f"../../reports/{name}/figures/mechanism.svg"
    return f"../results/{name}/report/figures/mechanism.svg"


def _write(
    name: str, source: Path, folder: Path, picture: str, progress: Progress, outside: bool, asked: Motion
) -> Scaffold:
    copied = copy_model(source, folder, outside=outside)
    model = folder / "model.xml"
    title = mujoco.MjSpec.from_file(str(model)).modelname
    if title in ("", "MuJoCo Model"):
        title = name.replace("_", " ").replace("-", " ").capitalize()

    def attempt(ignored: str | None) -> Scaffold:
        found = survey(name, model, ignoring=ignored is not None, asked=asked)
        scaffold = Scaffold(name, source.name, title, copied, found, ignored)
        _measure(scaffold, folder, progress)
        return scaffold

    try:
        scaffold = attempt(None)
    except RefusedError as refusal:
        scaffold = attempt(one_line(refusal).partition(", expected")[0])
    text = render("model.md.j2", case=scaffold, found=scaffold.found, picture=picture)
    write_text(folder / "README.md", text)
    return scaffold


def _measure(scaffold: Scaffold, folder: Path, progress: Progress) -> None:
    """Runs the case and sets bounds; a motion whose rounding errors grow is cut where they no longer are small."""
    found = scaffold.found
    results = _run(scaffold, folder, progress)
    chaotic = _end_of_rounding(results)
    if chaotic is not None and longest(found.timestep_s, round(chaotic / found.timestep_s)) < found.duration_s:
        found.duration_s = longest(found.timestep_s, max(10, round(chaotic / found.timestep_s)))
        found.notes.append(
            f"rounding errors pass {ROUNDING:g} at t = {chaotic:.3g} s: the case ends before, at {found.duration_s:g} s"
        )
        results = _run(scaffold, folder, progress)
    scaffold.bounds, unbounded = _bounds(results)
    found.notes += unbounded
    for row in results.rows:
        if row["status"] == "diverged":
            found.notes.append(f"run {row['run']} diverged: {row['message']}")
    if results.still:
        found.notes.append("nothing moves: give [start] a velocity or [drive] a law")
    _write_case(scaffold, folder)


def _run(scaffold: Scaffold, folder: Path, progress: Progress) -> Results:
    _write_case(scaffold, folder)
    return run(folder, progress=progress)


def _write_case(scaffold: Scaffold, folder: Path) -> Case:
    text = render("case.toml.j2", case=scaffold, found=scaffold.found)
    write_text(folder / "case.toml", text)
    return load_case(folder)


def _end_of_rounding(results: Results) -> float | None:
    """When the calibration's difference passes ``ROUNDING``, in s."""
    times = []
    for row, steps in zip(results.rows, results.tables, strict=True):
        if row["mode"] == "calibration":
            late = steps.filter(pl.col("trajectory_diff") > ROUNDING).select("time_s").head(1)
            times += late.collect()["time_s"].to_list()
    return min(times, default=None)


def _bounds(results: Results) -> tuple[list[Bound], list[str]]:
    """Gates on what must hold: stepping, export, how well the exact run keeps loops and energy; and what has none."""
    lockstep = {"mode": "lockstep", "form": "matched", "solver": "pinv"}
    free = {"mode": "free", "form": "hard", "solver": "pinv"}
    wanted = [
        ("trajectory_diff_max", {"mode": "calibration"}, 1e-11, "MuJoCo's own force through our stepping is MuJoCo"),
        ("qacc_rel_diff_max", lockstep, 1e-9, "the same linear system, solved elsewhere"),
        ("qfrc_constraint_rel_diff_max", lockstep, 1e-9, "as for the accelerations"),
        ("drift_pos_max", free, 1e-11, "rounding: every step ends in a projection"),
        ("energy_drift_rel", free, 1e-11, "the integrator's own error, for nothing drives or damps it"),
    ]
    bounds, unbounded = [], []
    for figure, where, floor, why in wanted:
        rows = [row for row in results.rows if all(row[key] == value for key, value in where.items())]
        values = [row[figure] for row in rows if row["status"] != "diverged"]
        if not values or len(values) != len(rows) or None in values:
            continue
        if figure.endswith("_rel_diff_max") and max(values) > COMPARABLE:
            unbounded.append(
                f"no bound on {figure}, of which {max(values):.1e} was measured: where nothing accelerates it compares "
                "rounding with rounding"
            )
            continue
        bounds.append(Bound(figure, where, max(values), floor, why))
    return bounds, unbounded
