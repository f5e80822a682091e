"""Exports a model for a reader, and has the reader say what it makes of it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few, one_line
from oarlock.base.files import write_text
from oarlock.base.scratch import scratch_folder
from oarlock.engines import environments, running
from oarlock.engines.answers import Answer, read
from oarlock.engines.asking import arrays_of, ask, states_of, write
from oarlock.engines.registry import parse_engine
from oarlock.experiments.opening import open_case
from oarlock.export.readers import Reader, reader_of
from oarlock.export.writer import TOGETHER, Export, Writer
from oarlock.mechanics.load import collected_warnings, load_model
from oarlock.stepping.prepared import PreparedCase

HEAVY = 1e-5
"""Relative. Masses that differ by more are others: Newton has them in single precision."""

PLACED = 1e-5
"""m. Bodies further apart, in the pose that is written, were placed elsewhere."""


@dataclass
class Exported:
    """A model as it was exported.

    Attributes:
        model: how it was called.
        reader: who is to read it.
        export: what was written, and what it lacks.
        read: what its reader made of it, in sentences; empty if its engine is not there.
        differences: those of them that say that something is other than it was written.
    """

    model: str
    reader: Reader
    export: Export
    read: list[str] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)

    def lines(self) -> list[str]:
        """What it has and what it lacks, a line each."""
        export, title = self.export, self.reader.title
        has = f"has {few(export.equalities, most=12)}" if export.equalities else "has no equality"
        said = [f"{self.model} for {title}: {has}"]
        said += [f"left out: {one}" for one in export.left]
        if export.split:
            said.append(f"free joint as three slides and a ball, under one root: {few(export.split)}")
        if export.shifted or export.turned:
            count = len(export.shifted) + len(export.turned)
            said.append(f"counted from the pose that is written: {count} of the positions, named in --json")
        if not self.read:
            said.append(
                f"not read back: {title} is not there; oarlock conform MODEL --install --engine {self.reader.program}"
            )
        return said + self.read

    def document(self) -> dict[str, Any]:
        """As ``oarlock export --json``."""
        return {
            "model": self.model,
            "for": self.reader.name,
            "equalities": self.export.equalities,
            "left_out": [{"element": one.element, "why": one.why} for one in self.export.left],
            "free_joints_split": self.export.split,
            "zeros": {str(at): zero for at, zero in self.export.shifted.items()},
            "quaternions_from": {str(at): turn.tolist() for at, turn in self.export.turned.items()},
            "read_back": self.read,
            "differences": self.differences,
        }


def export(asked: str, reader: str, out: Path | None = None, engine: str = "") -> Exported:
    """Writes a model for a reader, and has it read where the engine is there.

    Args:
        asked: what ``load_case`` takes.
        reader: name of the reader.
        out: file for the MJCF; if None it is not written.
        engine: how the engine is asked for, as for ``oarlock conform``; by default by the reader's name.

    Raises:
        InputError: there is no such reader or model, it cannot be closed, or the file cannot be written.
    """
    chosen = reader_of(reader)
    model, reference = closed_model(asked)
    written = Writer(model, chosen, reference).write()
    exported = Exported(asked, chosen, written)
    if out is not None:
        if out.suffix.lower() != ".xml":
            raise InputError(f"'{out}', expected a file whose name ends in .xml")
        write_text(out, written.text, named=True)
    _read_back(exported, engine or chosen.program)
    return exported


def closed_model(asked: str) -> tuple[mujoco.MjModel, np.ndarray]:
    """A model, and a pose (nq) that closes its equalities: its own where that does, else the start of its runs.

    Raises:
        InputError: there is no such model, or it cannot be closed.
    """
    case = open_case(asked)
    model = load_model(case.model_path, case.parameters)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    if np.abs(data.efc_pos[: data.ne]).max(initial=0.0) <= TOGETHER:
        return model, model.qpos0.copy()
    return model, PreparedCase(case, None, case.file.run.integrator, "default").start.qpos.copy()


def compile_export(written: Export) -> mujoco.MjModel:
    """The export as MuJoCo compiles it.

    Raises:
        InputError: it does not.
    """
    try:
        with collected_warnings():
            return mujoco.MjModel.from_xml_string(written.text)
    except ValueError as error:
        raise InputError(f"the export does not compile: {one_line(error)}") from None


def _read_back(exported: Exported, asked: str) -> None:
    engine = parse_engine(asked)
    environment = environments.find(engine)
    if environment is None:
        return
    model = compile_export(exported.export)
    with scratch_folder() as folder:
        states = states_of(model, model.qpos0[None], np.zeros((1, model.nv)), np.zeros((1, model.nu)))
        document = ask(exported.model, model, "forward")
        files = {"ask.json": document, "model.npz": arrays_of(model), "states.parquet": states.table()}
        files["model.xml"] = exported.export.text.encode()
        try:
            done = running.run(engine.program, environment, [write(folder, files)])
            answer = read(done.files[0], model.nq, model.nv, 1, done.status)
        except running.EngineError as error:
            exported.read.append(f"{exported.reader.title} does not read it: {one_line(error)}")
            exported.differences.append(exported.read[-1])
            return
    _compare(exported, model, answer)


def _compare(exported: Exported, model: mujoco.MjModel, answer: Answer) -> None:
    """Masses, places of bodies, velocities and rows, as far as the reader says them."""
    facts, rows = answer.facts, _rows(model)
    version = ", ".join(f"{name} {number}" for name, number in answer.versions.items())
    said = exported.read
    said.append(f"read by {version}")
    masses, places = facts.get("body_masses", {}), facts.get("body_places", {})
    heavier, elsewhere = [], []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body in range(1, model.nbody):
        name, mass = model.body(body).name, float(model.body_mass[body])
        if name in masses and abs(masses[name] - mass) > HEAVY * mass:
            heavier.append(f"body '{name}' weighs {masses[name]:.6g} kg, expected {mass:.6g}")
        if name in places and np.abs(np.asarray(places[name]) - data.xpos[body]).max() > PLACED:
            elsewhere.append(f"body '{name}' is at {_place(places[name])}, expected {_place(data.xpos[body])}")
    found = [*heavier, *elsewhere]
    total = float(model.body_mass.sum())
    if "total_mass" in facts and abs(facts["total_mass"] - total) > HEAVY * total:
        found.append(f"the whole weighs {facts['total_mass']:.6g} kg, expected {total:.6g}")
    for what, key, expected in (("velocities", "velocities", model.nv), ("equality rows", "rows", rows)):
        if key in facts and facts[key] != expected:
            found.append(f"{facts[key]} {what}, expected {expected}")
    exported.differences += found
    said += found
    if not found:
        compared = {"body_masses": "masses", "body_places": "places", "velocities": "velocities", "rows": "rows"}
        lacks = [one.element for one in exported.export.left if one.moves]
        but = f", without {few(lacks)}" if lacks else ""
        said.append(f"as written{but}: {', '.join(what for key, what in compared.items() if key in facts)}")


def _rows(model: mujoco.MjModel) -> int:
    sizes = {int(mujoco.mjtEq.mjEQ_CONNECT): 3, int(mujoco.mjtEq.mjEQ_WELD): 6}
    return sum(sizes.get(int(kind), 1) for kind in model.eq_type)


def _place(place: Any) -> str:
    return " ".join(f"{float(one):.6g}" for one in place)
