"""Begins an examination: loads a model, and decides how it is to move."""

from dataclasses import replace
from pathlib import Path

import mujoco

from oarlock.base.errors import InputError, choose
from oarlock.cases.case import load_case
from oarlock.cases.integrators import RUNNING
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.options import CheckOptions
from oarlock.mechanics import controls
from oarlock.mechanics.controller import commanded
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.mechanics.limits import require_timestep
from oarlock.mechanics.load import load_model
from oarlock.mechanics.prepare import load_mechanism, set_integrator
from oarlock.mechanics.state_log import StateLog
from oarlock.stepping.beginning import Beginning, beginning_of_case, beginning_of_file
from oarlock.stepping.logged import beginning_of_log
from oarlock.stepping.start import consistent_start

DURATION_S = 2.0
"""Of the run, unless it is asked for or a case says otherwise."""

MAX_STEPS = 20_000
"""Steps of the run at most: a longer one is cut unless its duration was asked for."""

MOST_STEPS = 1_000_000
"""Steps that may be asked for: all of a run is held in memory, some kilobytes a step."""


def begin(model_or_file: str, options: CheckOptions) -> Examination:
    """Loads a file, or the model of a case by its name, and decides how it is to move.

    Raises:
        InputError: no such file, malformed MJCF, no equality, an unknown keyframe or actuator, a number out of range.
    """
    path = Path(model_or_file)
    found = _of_file(path, options) if path.is_file() else _of_case(model_or_file, options)
    model = found.model
    if options.integrator:
        set_integrator(model, choose("integrator", options.integrator, RUNNING))
    model.opt.timestep = options.timestep or model.opt.timestep
    found.steps = _steps(model, options, found.own_s)
    if options.ignore_inequalities:
        found.ignored = ignore_inequalities(found.model)
    if options.states is not None:
        log = found.states = StateLog(Path(options.states), model)
        begins = beginning_of_log(log)
        found.qpos, found.qvel, found.act = begins.qpos, begins.qvel, begins.act
        found.begins, found.laws, found.driven = begins.begins, begins.laws, begins.driven
        if options.duration and found.steps > len(log):
            most = len(log) * model.opt.timestep
            raise InputError(f"duration = {options.duration:g} s, expected at most {most:g} s: the {log} end")
        found.steps = found.steps if options.duration else len(log)
    elif options.motion.controller is not None:
        start = (found.qpos, found.qvel, found.act)
        found.laws, found.driven = commanded(model, start, options.motion.controller, found.steps)
    controls.drive(model, found.laws).apply(mujoco.MjData(model))  # a law without a value at the start is a mistake
    return found


def _of_file(path: Path, options: CheckOptions) -> Examination:
    model = load_model(path)
    return _begun(str(path), path, model, beginning_of_file(model, options.motion), options)


def _of_case(name: str, options: CheckOptions) -> Examination:
    case = load_case(name)
    run = case.file.run
    model = load_mechanism(case, integrator=run.integrator)
    begins = beginning_of_case(model, case, options.motion)
    start = consistent_start(model, case, begins=begins)
    begins = replace(begins, qpos=start.qpos, qvel=start.qvel)
    ignoring = run.ignore_inequalities and not options.ignore_inequalities
    ignored = ignore_inequalities(model) if ignoring else ""
    return _begun(name, case.model_path, model, begins, options, run.duration_s, ignored)


def _begun(
    file: str,
    path: Path,
    model: mujoco.MjModel,
    begins: Beginning,
    options: CheckOptions,
    own_s: float | None = None,
    ignored: str = "",
) -> Examination:
    return Examination(
        file,
        path,
        model,
        begins.qpos,
        begins.qvel,
        begins.begins,
        begins.laws,
        begins.driven,
        own_s,
        options,
        act=begins.act,
        ignored=ignored,
    )


def _steps(model: mujoco.MjModel, options: CheckOptions, own_s: float | None) -> int:
    timestep_s = float(model.opt.timestep)
    require_timestep(timestep_s)
    asked = (options.duration or own_s or DURATION_S) / timestep_s
    if options.duration and asked > MOST_STEPS:
        raise InputError(
            f"{options.duration:g} s at a timestep of {timestep_s:g} s are {asked:.3g} steps, "
            f"expected at most {MOST_STEPS:,}"
        )
    steps = max(1, round(asked))
    return steps if options.duration else min(steps, MAX_STEPS)
