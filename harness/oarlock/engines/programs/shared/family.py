"""What programs with a MuJoCo of their own share: files, model, facts. Needs pyarrow or polars."""

import json
import os
import pathlib
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

FORMAT = 1
NOT_EXPRESSIBLE = 3
"""Exit status of a program whose engine cannot express the question; ``answer.json`` says what of it."""

MOVING = ("qpos", "qvel", "act", "ctrl", "qfrc_applied")


class Ask:
    """What is asked.

    Attributes:
        folder: with ``model.xml``, ``model.npz``, ``states.parquet`` and ``ask.json``.
        document: contents of ``ask.json``.
        question: ``forward``, ``step`` or ``run``.
        states: name of a column → array (states, n); ``time`` (states).
    """

    def __init__(self, folder: str):
        self.folder = pathlib.Path(folder)
        self.document: dict[str, Any] = json.loads((self.folder / "ask.json").read_text(encoding="utf-8"))
        self.question: str = self.document["question"]
        self.precision: str = self.document.get("precision", "float64")
        self.settings: dict[str, Any] = self.document.get("settings", {})
        columns = read_table(self.folder / "states.parquet")
        self.states = {name: np.array(columns[name], dtype=float) for name in columns}
        count = len(self.states["time"])
        for name in MOVING:
            self.states.setdefault(name, np.zeros((count, 0)))
            self.states[name] = self.states[name].reshape(count, -1)

    def __len__(self) -> int:
        return len(self.states["time"])

    @property
    def model(self) -> dict[str, np.ndarray]:
        """The arrays of the compiled model, by MuJoCo's names."""
        with np.load(self.folder / "model.npz", allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


def read_table(path: pathlib.Path) -> dict[str, list]:
    """Reads the columns of a Parquet file as lists."""
    try:
        import pyarrow.parquet
    except ImportError:
        import polars

        return polars.read_parquet(path).to_dict(as_series=False)
    return pyarrow.parquet.read_table(path).to_pydict()


def write_table(path: pathlib.Path, columns: dict[str, Any]) -> None:
    """Writes columns, arrays (n) or (n, m), to a Parquet file of floats or lists of floats."""
    lists = {name: np.asarray(values, dtype=float).tolist() for name, values in columns.items()}
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        import polars

        kinds = {
            name: polars.Float64 if np.ndim(values) == 1 else polars.List(polars.Float64)
            for name, values in columns.items()
        }
        polars.DataFrame(lists, schema=kinds).write_parquet(path)
        return
    pyarrow.parquet.write_table(pyarrow.table(lists), path)


def questions() -> Iterator[tuple[Ask, pathlib.Path]]:
    """Yields what is asked and the folder for its answer, in the order of the arguments."""
    pairs = sys.argv[1:]
    for ask, answer in zip(pairs[::2], pairs[1::2]):  # noqa: B905 (strict is not known to Python 3.9)
        path = pathlib.Path(answer)
        path.mkdir(parents=True, exist_ok=True)
        yield Ask(ask), path


def write_answer(
    folder: pathlib.Path,
    document: dict[str, Any],
    columns: dict[str, Any] | None,
) -> None:
    """Writes an answer; without columns one that says what cannot be expressed."""
    if columns is not None:
        write_table(folder / "answer.parquet", columns)
    text = json.dumps({"format": FORMAT, **document}, default=_plain)
    (folder / "answer.json").write_text(text, encoding="utf-8")


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)


def progress(done: int, of: int) -> None:
    """Says how far the work is, so that nobody takes it for hung."""
    print(json.dumps({"done": done, "of": of}), flush=True)


def refuse(folder: pathlib.Path, document: dict[str, Any], elements: list[dict[str, str]]) -> None:
    """Writes that a question cannot be expressed; the program then ends with ``NOT_EXPRESSIBLE``."""
    write_answer(folder, {**document, "not_expressible": elements}, None)


def end(refused: bool) -> None:
    """Ends the program by what it could answer, without what engines do when they are taken down."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(NOT_EXPRESSIBLE if refused else 0)


# For engines that have a MuJoCo of their own.


INTEGRATORS = {"euler": "EULER", "rk4": "RK4", "implicit": "IMPLICIT", "implicitfast": "IMPLICITFAST"}


def compile_mujoco(mujoco: Any, ask: Ask) -> Any:
    """Compiles the model by the MuJoCo that is given, and sets what is asked: step, integrator, solver accuracy."""
    model = mujoco.MjModel.from_xml_path(str(ask.folder / "model.xml"))
    model.opt.timestep = ask.document["timestep"]
    model.opt.integrator = getattr(mujoco.mjtIntegrator, "mjINT_" + INTEGRATORS[ask.document["integrator"]])
    for name in ask.settings.get("disable", ()):
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, "mjDSBL_" + name.upper()))
    for name in ("tolerance", "ls_tolerance", "iterations", "ls_iterations"):
        if name in ask.settings and hasattr(model.opt, name):
            setattr(model.opt, name, ask.settings[name])
    if ask.settings.get("arrays"):  # a model without a text of its own: its numbers are those of the compiled one
        for name, value in ask.model.items():
            own = getattr(model, name, None)
            if isinstance(own, np.ndarray) and own.shape == value.shape and own.dtype.kind == "f":
                own[:] = value
    return model


COMPARED = ("body_", "dof_", "jnt_", "eq_", "geom_", "site_", "tendon_", "actuator_", "qpos")
"""Prefixes of arrays on which motion depends."""

COMPILED_APART = 1e-6
"""Relative difference of a compiled array that is none: what writers of texts round."""


def compiled_apart(model: Any, ask: Ask) -> dict[str, list[float]]:
    """Arrays of numbers that this compiler made otherwise than the one that the question comes from."""
    found = {}
    for name, value in ask.model.items():
        own = getattr(model, name, None) if name.startswith(COMPARED) else None
        if not isinstance(own, np.ndarray) or own.shape != value.shape or own.dtype.kind != "f" or not own.size:
            continue
        if np.abs(own - value).max() > COMPILED_APART * max(np.abs(value).max(), np.finfo(float).tiny):
            found[name] = own.ravel().tolist()
    return found


def place(mujoco: Any, model: Any, data: Any, ask: Ask, row: int) -> None:
    """Writes a state into a data."""
    mujoco.mj_resetData(model, data)
    data.time = ask.states["time"][row]
    data.qpos[:] = ask.states["qpos"][row]
    data.qvel[:] = ask.states["qvel"][row]
    data.act[:] = ask.states["act"][row]
    data.ctrl[:] = ask.states["ctrl"][row]


def model_facts(mujoco: Any, model: Any, ask: Ask) -> dict[str, Any]:
    """What a compiled model holds: masses by body, names of the equalities, friction cone."""

    def name(kind: str, index: int) -> str:
        return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, "mjOBJ_" + kind), index) or f"#{index}"

    return {
        "compiled_apart": compiled_apart(model, ask),
        "total_mass": float(model.body_mass.sum()),
        "body_masses": {name("BODY", index): float(model.body_mass[index]) for index in range(1, model.nbody)},
        "equalities": [name("EQUALITY", index) for index in range(model.neq)],
        "cone": "elliptic" if int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_ELLIPTIC) else "pyramidal",
    }


def any_jdotv(found: list[Any]) -> Any:
    """What some states say together: that there is a J̇v, if one of them shows it."""
    return True if True in found else False if False in found else "unknown"


def has_jdotv(aref: np.ndarray, laws: np.ndarray, rate: np.ndarray, gap: np.ndarray, precision: str) -> Any:
    """Whether reference accelerations (n) hold more than −B J v − K d r: that is −J̇v. ``unknown`` at rest.

    Args:
        aref: of the equality rows of connects and welds, (n).
        laws: stiffness K, damping B and impedance d of each, (n, 3 or more).
        rate: J v (n).
        gap: r (n).
        precision: of the engine.
    """
    if not len(aref) or not np.abs(rate).max(initial=0.0) < np.inf:
        return "unknown"
    parts = np.stack([aref, laws[:, 1] * rate, laws[:, 0] * laws[:, 2] * gap])
    left = np.abs(parts.sum(axis=0)).max()
    size = np.abs(parts).max()
    eps = np.finfo(np.float32 if precision == "float32" else np.float64).eps
    # What the terms themselves carry in this precision is no J̇v.
    noise = 1e3 * eps * max(size, float(np.abs(laws[:, 0] * laws[:, 2]).max()))
    return bool(left > noise) if size > 0.0 else "unknown"
