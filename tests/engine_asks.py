"""Questions for programs of engines, as folders, and the exact accelerations to compare their answers with."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import oarlock
import polars as pl
from oarlock.cases.case_file import Baumgarte
from oarlock.diagnosis.loops.states import start_of
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import REFERENCE
from oarlock.stepping.state import State

RANK_CUT = 1e-13
"""Of exact answers at sampled states, which are closed to rounding: what is redundant there is 1e-16 or less of the
largest eigenvalue, and near a singular pose a true one can be less than a cut that suits open loops, 1e-10."""

PROGRAMS = Path(str(oarlock.__file__)).parent / "engines" / "programs"

_NAMED = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "equality": mujoco.mjtObj.mjOBJ_EQUALITY,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
}
_COUNTS = {"body": "nbody", "joint": "njnt", "geom": "ngeom", "site": "nsite"}
_COUNTS |= {"equality": "neq", "tendon": "ntendon", "actuator": "nu"}


def program(name: str) -> ModuleType:
    """A program, or a part that they share, as a module; its engine is not loaded."""
    if str(PROGRAMS) not in sys.path:
        sys.path.append(str(PROGRAMS))
    spec = importlib.util.spec_from_file_location(f"program_{name.replace('/', '_')}", PROGRAMS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there for annotations
    spec.loader.exec_module(module)
    return module


def arrays_of(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Every numeric array and size of a model, its options, and names of its elements."""
    found: dict[str, np.ndarray] = {}
    for owner, prefix in ((model, ""), (model.opt, "opt_"), (model.stat, "stat_")):
        for name in dir(owner):
            value = None if name.startswith("_") else getattr(owner, name)
            if isinstance(value, np.ndarray | int | float):
                found[prefix + name] = np.asarray(value)
    for sort, kind in _NAMED.items():
        count = getattr(model, _COUNTS[sort])
        found[f"{sort}_names"] = np.array(
            [mujoco.mj_id2name(model, kind, one) or "" for one in range(count)], dtype=str
        )
    return found


def states_of(model: mujoco.MjModel, rows: list[tuple[Any, ...]]) -> tuple[pl.DataFrame, list[np.ndarray]]:
    """States from (time, qpos, qvel, ctrl), with MuJoCo's forces at each, and the exact accelerations of each."""
    data = mujoco.MjData(model)
    question = Question(State(model, data, Baumgarte(beta=0.0, k=0.0)), "hard")
    solver = oarlock.make_solver(REFERENCE, rank_cut=RANK_CUT)
    written, exact = [], []
    for time, qpos, qvel, ctrl in rows:
        data.time, data.qpos[:], data.qvel[:], data.ctrl[:] = time, qpos, qvel, ctrl
        mujoco.mj_forward(model, data)
        force = data.qfrc_actuator + data.qfrc_passive + data.qfrc_applied
        row = {"time": time, "qpos": qpos, "qvel": qvel, "act": data.act, "ctrl": ctrl, "qfrc_applied": force}
        row = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in row.items()}
        written.append(row | {"ncon": int(data.ncon)})
        question.state.read()
        question.ask()
        exact.append(question.answer(solver).qacc.copy())
    lists = {name: pl.List(pl.Float64) for name in ("qpos", "qvel", "act", "ctrl", "qfrc_applied")}
    return pl.DataFrame(written, schema={"time": pl.Float64, **lists, "ncon": pl.Int64}), exact


def write_ask(folder: Path, model: mujoco.MjModel, states: pl.DataFrame, question: str, **document: Any) -> Path:
    """A folder ASK for a program."""
    folder.mkdir(parents=True, exist_ok=True)
    asked = {"format": 1, "model": "made up", "question": question, "timestep": model.opt.timestep, **document}
    (folder / "ask.json").write_text(json.dumps(asked), encoding="utf-8")
    np.savez(folder / "model.npz", allow_pickle=False, **arrays_of(model))
    states.write_parquet(folder / "states.parquet")
    return folder


def ask(python: str, name: str, folder: Path, answer: Path) -> tuple[int, dict[str, Any], pl.DataFrame | None, str]:
    """Runs a program; returns its status, what it says, its rows, and what it wrote to standard error."""
    done = subprocess.run(
        [python, str(PROGRAMS / f"{name}.py"), str(folder), str(answer)],
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    said = answer / "answer.json"
    rows = answer / "answer.parquet"
    document = json.loads(said.read_text(encoding="utf-8")) if said.is_file() else {}
    return done.returncode, document, pl.read_parquet(rows) if rows.is_file() else None, done.stderr


def closed_states(name: str, count: int, seed: int = 0) -> tuple[mujoco.MjModel, list[tuple[Any, ...]]]:
    """A model of the gallery, or a file, and states of it that are closed, with random controls."""
    _, model, _ = start_of(name, None)
    drawn = oarlock.sample(name, count, seed)
    random = np.random.default_rng(seed)
    return model, [(0.0, q, v, random.normal(size=model.nu)) for q, v in zip(drawn.qpos, drawn.qvel, strict=True)]
