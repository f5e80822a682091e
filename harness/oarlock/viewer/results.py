"""A folder of results as what a page shows: the motions that its tables have, with nothing run anew."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl

from oarlock.base.errors import InputError, few
from oarlock.cases.case import Case
from oarlock.cases.equality_kinds import KNOWN
from oarlock.diagnosis.loops.loops import Loops, find_loops
from oarlock.experiments.opening import open_case
from oarlock.mechanics.controls import drive
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.prepare import load_mechanism
from oarlock.poses.layout import Layout, RowColumns
from oarlock.stepping.beginning import beginning_of_case
from oarlock.stepping.solvers import MUJOCO
from oarlock.tables.folder import SUMMARY, ResultFolder, believing
from oarlock.tables.provenance import inputs
from oarlock.viewer.film import FRAMES
from oarlock.viewer.show import Footage, Show, filmed

OWN = (("free", None), ("lockstep", "matched"), ("calibration", None))
"""Modes and forms of the runs that MuJoCo walks, the one that tells most of it first."""


@dataclass(frozen=True)
class _Track:
    """Some steps of a run, as ``viewer.film.Track`` has them; ``steps`` are their numbers in the run."""

    layout: Layout
    time: np.ndarray
    qpos: np.ndarray
    position: np.ndarray
    force: np.ndarray
    present: np.ndarray


def of_results(folder: Path, model: str | Path | None = None) -> Show:
    """What a page shows of a folder of results.

    Args:
        folder: as ``oarlock run --out`` or a case of ``oarlock suite --out`` leaves it.
        model: the model of its runs, where that is no longer where it was: as of ``load_case``.

    Raises:
        InputError: the folder or its model is missing, damaged, or not what belongs together; MuJoCo's motion is not
            among the runs; or mocap bodies went where the folder does not tell.
    """
    kept = ResultFolder(folder)
    with believing(folder):
        told, summary = kept.read_json("case.json"), kept.read_json(SUMMARY)
        provenance, rows = summary["provenance"], summary["runs"]
        case = _case(folder, told, provenance, model)
        own = _own(folder, rows, case.file.run.integrator)
        exact, missing = _exact(rows, own)
        return filmed(_footage(kept, case, provenance, own, exact, missing))


def _case(folder: Path, told: dict[str, Any], provenance: dict[str, Any], model: str | Path | None) -> Case:
    """The case of the runs, once its model was found to be the one that they had."""
    place = model or told.get("model_file") or told["name"]
    try:
        case = open_case(place)
    except InputError as error:
        raise InputError(f"the model of '{folder}': {error} (--model)") from None
    case = case.at(told["parameters"]) if told["parameters"] else case
    now = inputs(case)
    if now["model_sha256"] != provenance["model_sha256"]:
        raise InputError(
            f"'{case.model_path}' is not the model that the runs of '{folder}' had (checksum), expected that one "
            "(--model), or to be run again"
        )
    return case


def _own(folder: Path, rows: list[dict[str, Any]], integrator: str) -> dict[str, Any]:
    """The row of the run that is MuJoCo's own motion."""
    found = [
        (row["integrator"] != integrator, row["settings"] != "default", OWN.index((row["mode"], row["form"])), row)
        for row in rows
        if row["walker"] == MUJOCO and (row["mode"], row["form"]) in OWN and row["steps_done"]
    ]
    if not found:
        names = few([row["run"] for row in rows]) or "none"
        raise InputError(
            f"'{folder}' has no run that MuJoCo walks, expected one among its runs: a free one, a matched "
            f"lockstep or a calibration ({names})"
        )
    return min(found, key=lambda one: one[:3])[3]


def _exact(rows: list[dict[str, Any]], own: dict[str, Any]) -> tuple[dict[str, Any] | None, str]:
    """The row of the exact run beside MuJoCo's, or why there is none."""
    same = ("integrator", "timestep_s")
    found = [row for row in rows if (row["mode"], row["form"]) == ("free", "hard")]
    found = [row for row in found if all(row[name] == own[name] for name in same)]
    done = [row for row in found if row["status"] == "done"]
    if done:
        return min(done, key=lambda row: row["settings"] != "default"), ""
    if found:
        return None, f"run {found[0]['run']} {found[0]['status']}: {found[0]['message']}"
    return None, "the folder has no free run in the hard form beside it"


def _footage(
    kept: ResultFolder,
    case: Case,
    provenance: dict[str, Any],
    own: dict[str, Any],
    exact: dict[str, Any] | None,
    missing: str,
) -> Footage:
    model = load_mechanism(case, integrator=own["integrator"], timestep_s=own["timestep_s"])
    driven = _driven(kept.path, case, model, provenance)
    layout = Layout.of(model)
    if not layout.rows:
        raise InputError(f"'{kept.path}': no row of an equality to show, expected {KNOWN} equalities")
    reader = _Reader(kept, model, layout, driven)
    steps = reader.chosen(own["run"])
    run = reader.read(own["run"], steps)
    beside = reader.read(exact["run"], steps) if exact else None
    notes = [f"MuJoCo's motion is that of run {own['run']}."]
    if own["mode"] == "lockstep":
        notes.append(f"Forces along MuJoCo's motion are those that {own['solver']} finds for MuJoCo's own softness.")
    elif np.isnan(run.force).all():
        notes.append(f"Run {own['run']} keeps no forces.")
    if exact:
        notes.append(f"The exact motion is that of run {exact['run']}, with forces of least norm.")
    else:
        notes.append(f"MuJoCo's motion alone: there is no exact solution: {missing}.")
    lost = own["status"] == "diverged"
    if lost:
        notes.append(f"MuJoCo's run ends early: {own['message']}.")
    told = f"{own['steps']} steps of {own['timestep_s']:g} s, integrator {own['integrator']}"
    return Footage(
        title=case.name,
        head=f"Results of '{case.name}': {told}; {provenance.get('motion', 'start and drive of the case')}.",
        model=model,
        driven=driven,
        run=run,
        exact=beside,
        finished=not lost,
        loops=_loops(model, beside or run),
        notes=notes,
        steps=own["steps_done"],
    )


def _driven(folder: Path, case: Case, model: mujoco.MjModel, provenance: dict[str, Any]) -> Drive:
    """What moves mocap bodies and switches equalities: the case's, or what a rule gives a file.

    Raises:
        InputError: there are mocap bodies, and the runs had other laws.
    """
    begins = beginning_of_case(model, case)
    motion = provenance.get("motion")
    if motion is None or (case.bare and motion.startswith(str(begins))):
        return drive(model, begins.laws)
    if model.nmocap:
        raise InputError(
            f"'{folder}': the runs went {motion}, and results keep no poses of mocap bodies, expected the case's own "
            "start and drive"
        )
    return drive(model, {})


def _loops(model: mujoco.MjModel, run: _Track) -> Loops | None:
    data = mujoco.MjData(model)
    data.qpos[:] = run.qpos[0]
    try:
        return find_loops(model, data)
    except InputError:
        return None


class _Reader:
    """Reads steps of runs, and puts their rows where a layout has them."""

    def __init__(self, kept: ResultFolder, model: mujoco.MjModel, layout: Layout, driven: Drive):
        self._kept, self._model, self._layout, self._driven = kept, model, layout, driven

    def chosen(self, run: str) -> np.ndarray:
        """Numbers of the steps to read of a run: equally spaced, and the one that drifts most."""
        with self._kept.scanning(run) as table:
            every = table.select("step", "drift_pos").collect()
        spaced = np.linspace(0, len(every) - 1, min(FRAMES, len(every))).astype(int)
        drift = np.nan_to_num(every["drift_pos"].fill_null(0.0).to_numpy())
        return every["step"].to_numpy()[np.unique([*spaced, int(drift.argmax())])]

    def read(self, run: str, steps: np.ndarray) -> _Track:
        """Some steps of a run: those that it has."""
        columns = ("time_s", "qpos", "multipliers")
        with self._kept.scanning(run) as table:
            rows = table.filter(pl.col("step").is_in(steps.tolist())).sort("step").select(columns).collect()
        shape = (len(rows), self._layout.rows)
        track = _Track(
            self._layout,
            rows["time_s"].to_numpy(),
            np.array(rows["qpos"].to_list(), dtype=float).reshape(len(rows), self._model.nq),
            np.zeros(shape),
            np.full(shape, np.nan),
            np.zeros(shape, dtype=bool),
        )
        data, places = mujoco.MjData(self._model), RowColumns(self._layout)
        for at, (time, force) in enumerate(zip(rows["time_s"], rows["multipliers"], strict=True)):
            data.qpos[:], data.time = track.qpos[at], time
            self._driven.apply(data)
            mujoco.mj_fwdPosition(self._model, data)
            columns_here, mine = places.of(data), places.rows(data)
            track.position[at, columns_here] = data.efc_pos[: data.ne][mine]
            track.present[at, columns_here] = True
            if force is not None and len(force) == track.force[at, columns_here].size:
                track.force[at, columns_here] = force.to_numpy()
        return track
