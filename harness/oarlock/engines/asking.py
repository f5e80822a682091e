"""What an engine is asked: a folder with the model, as a text and as arrays, and states.

``model.xml`` is self-contained; ``model.npz`` has every array of the compiled model by MuJoCo's name for those who are
fed from arrays; ``states.parquet`` has a row a state; ``ask.json`` says what is to be done.
"""

import io
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl

from oarlock.base.scratch import scratch_folder
from oarlock.cases.case import Case
from oarlock.mechanics.load import build_spec, load_model
from oarlock.mechanics.mjcf import copy_model
from oarlock.mechanics.names import element_name
from oarlock.mechanics.prepare import integrator_of

FORMAT = 1

Files = dict[str, bytes]
"""Name within a folder → contents."""

_NAMED = {"body": "nbody", "joint": "njnt", "geom": "ngeom", "site": "nsite", "tendon": "ntendon", "actuator": "nu"}
_NAMED |= {"equality": "neq"}
"""Kind of an element → how many there are."""


@dataclass(frozen=True)
class States:
    """States of a model.

    Attributes:
        time: (n), s; qpos: positions (n, nq); qvel: velocities (n, nv); act: activations (n, na); ctrl: controls
            (n, nu); applied: generalised forces (n, nv) of actuators, springs, dampers and whatever else is applied.
    """

    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    ctrl: np.ndarray
    applied: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, chosen: Any) -> "States":
        return States(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    def table(self) -> bytes:
        """As Parquet."""
        columns = {"time": pl.Series(self.time, dtype=pl.Float64)}
        lists = {"qpos": self.qpos, "qvel": self.qvel, "act": self.act, "ctrl": self.ctrl}
        for name, values in {**lists, "qfrc_applied": self.applied}.items():
            columns[name] = pl.Series(values.tolist(), dtype=pl.List(pl.Float64))
        buffer = io.BytesIO()
        pl.DataFrame(columns).write_parquet(buffer)
        return buffer.getvalue()

    @classmethod
    def read(cls, content: bytes) -> "States":
        """Reads what ``table`` made."""
        frame = pl.read_parquet(io.BytesIO(content))
        count = len(frame)

        def matrix(name: str) -> np.ndarray:
            return np.array(frame[name].to_list(), dtype=float).reshape(count, -1)

        moving = (matrix(name) for name in ("qpos", "qvel", "act", "ctrl", "qfrc_applied"))
        return cls(frame["time"].to_numpy().astype(float), *moving)


def states_of(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray, act: np.ndarray | None = None
) -> States:
    """States at time 0, with the forces that act besides the constraints.

    Args:
        model: the model.
        qpos: positions (n, nq).
        qvel: velocities (n, nv).
        ctrl: controls (n, nu).
        act: activations (n, na); zero if left out.
    """
    act = np.zeros((len(qpos), model.na)) if act is None else act
    data, applied = mujoco.MjData(model), np.zeros((len(qpos), model.nv))
    for row in range(len(qpos)):
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:], data.ctrl[:], data.act[:] = qpos[row], qvel[row], ctrl[row], act[row]
        mujoco.mj_forward(model, data)
        applied[row] = data.qfrc_actuator + data.qfrc_passive + data.qfrc_applied
    return States(np.zeros(len(qpos)), qpos, qvel, act, ctrl, applied)


def text_of(case: Case) -> Files:
    """The model of a case as a self-contained MJCF with its assets.

    Of a model that is code, MuJoCo's writer makes the text, which rounds numbers to six digits: whoever compiles it
    takes the numbers of the arrays (see ``ask``, setting ``arrays``).

    Raises:
        InputError: the model cannot be copied.
    """
    with scratch_folder() as folder:
        if case.model_path.suffix == ".py":
            spec = build_spec(case.model_path, case.parameters)
            spec.compile()
            (folder / "model.xml").write_text(spec.to_xml(), encoding="utf-8")
        else:
            copy_model(case.model_path, folder, outside=True)
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def compiled(case: Case, text: Files) -> mujoco.MjModel:
    """The model that engines are asked about: that of the text, or of the code."""
    if case.model_path.suffix == ".py":
        return load_model(case.model_path, case.parameters)
    with scratch_folder() as folder:
        return load_model(write(folder, text) / "model.xml")


def arrays_of(model: mujoco.MjModel) -> bytes:
    """Every numeric array and size of a compiled model by MuJoCo's name, and names of elements, as NPZ."""
    arrays = dict(_arrays(model, ""))
    arrays |= {f"opt_{name}": value for name, value in _arrays(model.opt, "")}
    arrays |= {f"stat_{name}": value for name, value in _arrays(model.stat, "")}
    for kind, size in _NAMED.items():
        sort = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        names = [element_name(model, sort, index) for index in range(int(getattr(model, size)))]
        arrays[f"{kind}_names"] = np.array(names, dtype=np.str_)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _arrays(holder: Any, prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    for name in dir(holder):
        if name.startswith("_") or name in ("names", "names_map", "paths", "text_data"):
            continue
        value = getattr(holder, name)
        if isinstance(value, np.ndarray | int | float) and not isinstance(value, bool):
            array = np.asarray(value)
            if array.dtype.kind in "biuf":
                yield prefix + name, array


ACCURATE: dict[str, float] = {"tolerance": 1e-15, "ls_tolerance": 1e-10, "iterations": 200}
"""Of the questions of single states: how far an engine's own iteration goes is no part of what is compared."""


def ask(
    name: str,
    model: mujoco.MjModel,
    question: str,
    *,
    precision: str = "float64",
    steps: int = 1,
    every: int = 1,
    settings: dict[str, Any] | None = None,
) -> bytes:
    """The document of a question, with the step and the integrator of the model.

    Args:
        name: of the model.
        model: as it is to be walked.
        question: ``forward``, ``step`` or ``run``.
        precision: of the answer.
        steps: of a run.
        every: of a run: so many steps lie between two that are recorded.
        settings: the engine's own.
    """
    document: dict[str, Any] = {
        "format": FORMAT,
        "model": name,
        "question": question,
        "timestep": float(model.opt.timestep),
        "integrator": integrator_of(model).name,
        "precision": precision,
        "settings": settings or {},
    }
    if question == "run":
        document |= {"steps": steps, "every": every}
    return json.dumps(document, indent=1).encode()


def write(folder: Path, files: Files) -> Path:
    """Writes the files of a question into a folder, which it makes."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder
