"""Models with their own start and drive, ready for ``oarlock.check``, and its examinations."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mechanisms import setup_of
from oarlock.cases.case import Case, load_case
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.options import CheckOptions
from oarlock.mechanics.controls import written_out
from oarlock.mechanics.load import load_model
from oarlock.mechanics.prepare import set_integrator
from oarlock.stepping.start import ConsistentStart, consistent_start


@dataclass(frozen=True)
class Piece:
    """A model as its author configured it, but for integrator and timestep; its start; its controls."""

    model: mujoco.MjModel
    qpos: np.ndarray
    qvel: np.ndarray
    laws: dict[str, str]


@cache
def _start(name: str) -> tuple[np.ndarray, np.ndarray]:
    start = setup_of(load_case(name), "euler").start
    return start.qpos, start.qvel


def piece(name: str, integrator: Any = "euler", timestep_s: float = 1e-3) -> Piece:
    """One of the gallery, by the name of its folder."""
    case = load_case(name)
    model = load_model(case.model_path, case.parameters)
    set_integrator(model, integrator)
    model.opt.timestep = timestep_s
    return Piece(model, *_start(name), written_out(case.file.drive))


def at_start(name: str) -> tuple[Case, mujoco.MjModel, ConsistentStart, mujoco.MjData]:
    """A case of the gallery, its model with a dense Jacobian, its consistent start, and a data there."""
    case = load_case(name)
    model = load_model(case.model_path, case.parameters)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    start = consistent_start(model, case)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    return case, model, start, data


def looked_at(file: Path | str, wish: CheckOptions, **options: Any) -> Any:
    """All parts of an examination, of a model whose options of MuJoCo were changed by name first."""
    found = begin(str(file), wish)
    for option, value in options.items():
        setattr(found.model.opt, option, value)
    for _ in examine(found):
        pass
    return found
