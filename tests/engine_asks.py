"""Questions for programs of engines, and the exact accelerations to compare their answers with."""

import importlib.util
import io
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import setup_of
from oarlock.cases.case import Case, load_case
from oarlock.cases.case_file import Baumgarte
from oarlock.cases.truth import load_truth
from oarlock.diagnosis.loops.states import start_of
from oarlock.engines import environments, running
from oarlock.engines.answers import Answer, read
from oarlock.engines.asking import States, arrays_of, ask, states_of, write
from oarlock.engines.registry import PROGRAMS, parse_engine
from oarlock.mechanics.controls import actuators, written_out
from oarlock.mechanics.prepare import set_integrator
from oarlock.stepping.question import Question
from oarlock.stepping.solvers import REFERENCE
from oarlock.stepping.state import State

INTERPRETERS = "OARLOCK_TEST_ENGINES"
"""Variable with engines and their interpreters, such as ``pinocchio=/opt/pin/bin/python``, parted by blanks."""

RANK_CUT = 1e-13
"""Of exact answers at sampled states, which are closed to rounding: what is redundant there is 1e-16 or less of the
largest eigenvalue, and near a singular pose a true one can be less than a cut that suits open loops, 1e-10."""


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


def compiled(model: mujoco.MjModel) -> Any:
    """A model as programs read it."""
    with np.load(io.BytesIO(arrays_of(model)), allow_pickle=False) as arrays:
        return program("shared/compiled").Compiled({name: arrays[name] for name in arrays.files})


def refused(folder: Path, name: str, model: mujoco.MjModel, states: States, **asked: Any) -> list[str]:
    """What a program cannot express, without its engine."""
    files = {"ask.json": ask("made up", model, asked.pop("question", "forward"), **asked)}
    files |= {"model.npz": arrays_of(model), "states.parquet": states.table()}
    answer = program("shared/exchange").Answer(name)
    program(name).answered(program("shared/family").Ask(str(write(folder, files))), answer)
    return [one["element"] for one in answer.missing]


NEAR = 1e-3
"""How near to a singular pose states are at least, of what is usual: nearer by, an answer has the fewer digits."""


class Engine:
    """A program in its environment; the test is skipped where there is none."""

    def __init__(self, name: str):
        given = {one.partition("=")[0]: one for one in os.environ.get(INTERPRETERS, "").split()}
        engine = parse_engine(given.get(name, name))
        found = environments.find(engine)
        if found is None:
            pytest.skip(f"no environment for {name}: name one in {INTERPRETERS}, or {environments.how_to(engine)}")
        self.program, self.environment = engine.program, found

    def answer(self, folder: Path, model: mujoco.MjModel, states: States, question: str, **asked: Any) -> Answer:
        """The answer to one question about states of a model."""
        document = ask("made up", model, question, **asked)
        files = {"ask.json": document, "model.npz": arrays_of(model), "states.parquet": states.table()}
        steps, every = asked.get("steps", 1), asked.get("every", 1)
        count = steps // every if question == "run" else len(states)
        written = running.run(self.program, self.environment, [write(folder, files)])
        return read(written.files[0], model.nq, model.nv, count, written.status)


def exact_of(model: mujoco.MjModel, states: States) -> np.ndarray:
    """The accelerations (n, nv) of states with rigid equalities, J a = −J̇v."""
    data = mujoco.MjData(model)
    question = Question(State(model, data, Baumgarte(beta=0.0, k=0.0)), "hard")
    solver = oarlock.make_solver(REFERENCE, rank_cut=RANK_CUT)
    found = []
    for qpos, qvel, ctrl in zip(states.qpos, states.qvel, states.ctrl, strict=True):
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
        mujoco.mj_forward(model, data)
        question.state.read()
        question.ask()
        found.append(question.answer(solver).qacc.copy())
    return np.array(found)


def closed_states(name: str, count: int, seed: int = 0) -> tuple[mujoco.MjModel, States]:
    """A model of the gallery, or a file, and states of it that are closed, with random controls, none near a singular
    pose.
    """
    _, model, _ = start_of(name, None)
    drawn = oarlock.sample(name, count, seed)
    far = drawn.singular > NEAR
    controls = np.random.default_rng(seed).normal(size=(count, model.nu))
    return model, states_of(model, drawn.qpos[far], drawn.qvel[far], controls[far])


def driven_start(name: str, duration_s: float, timestep_s: float) -> tuple[Case, mujoco.MjModel, States]:
    """A case of the gallery, its model, and the states of a run: its start, and its controls twice a step from then."""
    case = load_case(name)
    setup = setup_of(case, "rk4", timestep_s, duration_s)
    model = setup.model
    model.opt.timestep = timestep_s
    set_integrator(model, "rk4")
    laws = written_out(case.file.drive)
    parsed = laws.parsed()
    times = np.arange(round(2.0 * duration_s / timestep_s) + 1) * 0.5 * timestep_s
    times = times[:1] if laws.constant else times
    count = len(times)
    ctrl = [[parsed[name].at(time) if name in parsed else 0.0 for name in actuators(model)] for time in times]
    qpos, qvel = (np.tile(value, (count, 1)) for value in (setup.start.qpos, setup.start.qvel))
    controls = np.array(ctrl, dtype=float).reshape(count, model.nu)
    return case, model, States(times, qpos, qvel, np.zeros((count, 0)), controls, np.zeros((count, model.nv)))


def truth_error(case: Case, model: mujoco.MjModel, answer: Answer) -> float:
    """The largest distance of a run from the outside truth of its case, m or rad."""
    truth, asked = load_truth(case), case.file.truth
    assert truth is not None
    assert asked is not None
    if asked.joint:
        seen = answer.qpos[:, [model.jnt_qposadr[model.joint(asked.joint).id]]]
    else:
        data, places = mujoco.MjData(model), []
        for qpos in answer.qpos:
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            places.append(data.site(asked.site).xpos.copy())
        seen = np.array(places)
    return float(np.abs(seen - truth.position(answer.time)).max())
