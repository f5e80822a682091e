"""Logs of states: what a program's own run went through, with the controls that it was given.

An NPZ file has arrays ``time`` (rows), ``qpos`` (rows, nq) and ``qvel`` (rows, nv), and where there are any ``act``
(rows, na) and ``ctrl`` (rows, nu); a CSV file has a column for each number, ``qpos0``, ``qpos1``, …. Where there is one
number a row, as of a single actuator, the array may be (rows), and the column have no number. A row is the start of a
step: the state before ``mj_step`` and the controls that this step is given.
"""

from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose
from oarlock.base.series import TIME, pop_time, read_series
from oarlock.mechanics.controls import Laws, actuators

ENDINGS = (".csv", ".npz")
"""Of the files that a log of states may be in."""

EVEN = 1e-6
"""Part of a timestep by which rows may be off an even spacing: a log written in six digits."""

MULTIPLE = 1e-3
"""Part of a timestep by which the distance of rows may be off a multiple of it, in a log of every so manieth step."""

_CTRL = "ctrl"

_FEWEST = 2
"""Rows of a log."""


class StateLog:
    """A log of states at the timestep of a model.

    Attributes:
        path: where it was read.
        start_s: time of the first row, s.
        qpos: positions, (rows, nq); qvel: velocities, (rows, nv); act: activations, (rows, na).
        ctrl: controls, (rows, nu), zero where the log has none.
        laws: the same as laws of time, from the first row on.

    Args:
        path: a file whose name ends in ``.csv`` or ``.npz``.
        model: whose states they are.

    Raises:
        InputError: it cannot be read, lacks a column or has one too many, rows are not a timestep of the model apart,
            or a quaternion is not one.
    """

    def __init__(self, path: Path, model: mujoco.MjModel):
        if path.suffix.lower() not in ENDINGS:
            raise InputError(f"'{path}', expected a log of states FILE.csv or FILE.npz")
        self.path = path
        columns = read_series(path, tables=True)
        self._time = pop_time(path, columns, "qpos and qvel")
        if len(self._time) < _FEWEST:
            raise InputError(
                f"{path}: {len(self._time)} row, expected {_FEWEST} at least: a state alone shows no motion"
            )
        self.start_s = float(self._time[0])
        sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na, _CTRL: model.nu}
        found = _tables(path, columns, sizes)
        for name in ("qpos", "qvel"):
            if name not in found:
                raise InputError(f"{path}: no '{name}', expected {sizes[name]} numbers a row")
        empty = {name: np.zeros((len(self._time), size)) for name, size in sizes.items()}
        self.qpos, self.qvel, self.act, self.ctrl = (found.get(name, empty[name]) for name in sizes)
        self._require_even(float(model.opt.timestep))
        self._require_units(model)
        self.laws = Laws({}, held=True)
        if _CTRL in found:
            since = self._time - self._time[0]
            read = {
                name: TimeLaw.sampled(name, since, self.ctrl[:, index].copy())
                for index, name in enumerate(actuators(model))
            }
            self.laws = Laws(dict.fromkeys(read, str(self)), logs=read, held=True)

    @property
    def uncontrolled(self) -> int:
        """How many actuators the model has, where the log has no controls of them."""
        return 0 if self.laws else self.ctrl.shape[1]

    @property
    def driven(self) -> str:
        """By what it is, in words."""
        if self.laws:
            return "the controls of the log"
        return f"no controls: the log has no '{_CTRL}'" if self.uncontrolled else "no controls"

    def __len__(self) -> int:
        return len(self._time)

    def __str__(self) -> str:
        first, last = float(self._time[0]), float(self._time[-1])
        return f"states '{self.path}' ({len(self)} rows from {first:g} to {last:g} s)"

    def _require_even(self, timestep: float) -> None:
        apart = np.diff(self._time)
        rounding = np.abs(self._time[1:])
        spacing = np.spacing(rounding.astype(np.float32)) if _single(self._time) else np.spacing(rounding)
        late = np.flatnonzero(np.abs(apart - timestep) > EVEN * timestep + spacing)
        if len(late):
            row = int(late[0])
            said = f"{self.path}: rows {row + 1} and {row + 2} are {apart[row]:.9g} s apart, expected a row every "
            parts = float(np.median(apart)) / timestep
            every = round(parts)
            if every > 1 and abs(parts - every) <= MULTIPLE:
                said += f"{timestep:g} s: the log has every {_ordinal(every)} step of the model, and needs each"
            else:
                said += f"{timestep:g} s, the timestep of the model (--timestep)"
            raise InputError(said)

    def _require_units(self, model: mujoco.MjModel) -> None:
        for joint in range(model.njnt):
            kind, address = int(model.jnt_type[joint]), int(model.jnt_qposadr[joint])
            if kind in (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)):
                first = address + (3 if kind == int(mujoco.mjtJoint.mjJNT_FREE) else 0)
                norms = np.linalg.norm(self.qpos[:, first : first + 4], axis=1)
                bad = np.flatnonzero(np.abs(norms - 1.0) > 1e-3)
                if len(bad):
                    row = int(bad[0])
                    raise InputError(
                        f"{self.path}: qpos {first} to {first + 3}, row {row + 1}: a quaternion of norm "
                        f"{norms[row]:.4g}, expected 1"
                    )


def _single(values: np.ndarray) -> bool:
    """Whether numbers were written in single precision: as such numbers, or in the digits that tell them apart."""
    single = values.astype(np.float32)
    return np.array_equal(single, values) or np.array_equal([float(str(one)) for one in single], values)


def _ordinal(number: int) -> str:
    last = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if number % 100 in (11, 12, 13) else last}"


def _tables(path: Path, columns: dict[str, np.ndarray], sizes: dict[str, int]) -> dict[str, np.ndarray]:
    """The arrays that are there, (rows, size), from whole ones or from a column a number."""
    found: dict[str, np.ndarray] = {}
    numbered = {f"{name}{index}": (name, index) for name, size in sizes.items() for index in range(size)}
    parts: dict[str, dict[int, np.ndarray]] = {}
    for column, values in columns.items():
        if column in sizes:
            table = values if values.ndim == 2 else values[:, None]
            if table.shape[1] != sizes[column]:
                some = f"{table.shape[1]} number{'' if table.shape[1] == 1 else 's'}"
                raise InputError(f"{path}: '{column}' has {some} a row, expected {sizes[column]}")
            found[column] = table
        else:
            name, index = numbered[choose(f"column in {path}", column, [TIME, *numbered])]
            parts.setdefault(name, {})[index] = values
    for name, given in parts.items():
        if name in found:
            raise InputError(f"{path}: columns '{name}' and '{name}{min(given)}', expected one of the two")
        lacking = [f"{name}{index}" for index in range(sizes[name]) if index not in given]
        if lacking:
            raise InputError(f"{path}: no column '{lacking[0]}', expected {sizes[name]} of '{name}'")
        found[name] = np.stack([given[index] for index in range(sizes[name])], axis=1)
    return found
