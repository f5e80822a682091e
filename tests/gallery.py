"""The gallery's models with their own start and drive, ready for ``oarlock.check``."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mechanisms import setup_of
from oarlock.cases import load_case
from oarlock.check.controls import written_out
from oarlock.mechanism import INTEGRATORS, load_model


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
    model.opt.integrator, model.opt.timestep = INTEGRATORS[integrator], timestep_s
    return Piece(model, *_start(name), written_out(case.file.drive))
