"""The same mechanisms with limits, friction loss and contacts of all kinds: is every step of theirs proved?"""

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import polars as pl
from oarlock.cases.case import Case
from oarlock.cases.case_file import Baumgarte, CaseFile, Form
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.prepare import prepare
from oarlock.stepping.native_path import NativePath
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.solvers import SolverSpec

from random_mechanisms.generator import TIMESTEP_S, Mechanism

STEPS = 50
CONDIMS = (1, 3, 4, 6)


@dataclass(frozen=True)
class Proof:
    """What a free run among limits, friction loss and contacts came to.

    Attributes:
        seed: of the mechanism.
        steps: how many were taken.
        ended: why it ended early; empty if it did not.
        rows: most rows of limits, friction loss and contacts; active: most that pushed.
        unproved: steps whose answers are not proved.
        blocked: most limits and contacts that pushed against loops alone.
        newton: mean Newton iterations a solve; worst: of the solve that took most.
        gradient: largest relative gradient left beyond rounding.
        drift: largest deviation of an equality row, m or rad.
    """

    seed: int
    steps: int
    ended: str
    rows: int
    active: int
    unproved: int
    blocked: int
    newton: float
    worst: int
    gradient: float
    drift: float


def pushed(mechanism: Mechanism) -> mujoco.MjModel:
    """The model with what pushes drawn at random: by the mechanism's number, always the same."""
    rng = np.random.default_rng([mechanism.seed, 17])
    spec = mujoco.MjSpec.from_string(mechanism.xml)
    spec.option.cone = int(rng.integers(2))
    spec.option.impratio = float(rng.choice([1.0, 10.0]))
    model = spec.compile()
    for joint in spec.joints:
        if joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            continue
        if rng.random() < 0.5:
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            # Some begin at or beyond an end.
            ends = [-float(rng.uniform(-1e-4, 0.02)), float(rng.uniform(0.01, 1.0))]
            joint.range = np.sort(rng.choice([-1.0, 1.0]) * np.array(ends))
            joint.solref_limit[:] = [float(rng.uniform(2.5, 30.0)) * TIMESTEP_S, 1.0]
        if rng.random() < 0.4:
            joint.frictionloss = float(10.0 ** rng.uniform(-4, 1))
    for tendon in spec.tendons:
        tendon.frictionloss = float(10.0 ** rng.uniform(-3, 0)) if rng.random() < 0.5 else 0.0
    if rng.random() < 0.7:
        _touch(spec, model, rng)
    return spec.compile()


def _touch(spec: mujoco.MjSpec, model: mujoco.MjModel, rng: np.random.Generator) -> None:
    """Gives bodies geoms, near and in one another and a floor."""
    reach = float(model.stat.extent)
    kinds = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CAPSULE)
    for body in spec.bodies[1:]:
        if rng.random() < 0.7:
            geom = body.add_geom()
            geom.type = kinds[rng.integers(len(kinds))]
            geom.size[:] = reach * rng.uniform(0.02, 0.2, 3)
            geom.pos[:] = reach * rng.uniform(-0.1, 0.1, 3)
            _rub(geom, rng)
    floor = spec.worldbody.add_geom()
    floor.type = mujoco.mjtGeom.mjGEOM_PLANE
    floor.size[:] = [10.0 * reach, 10.0 * reach, 1.0]
    floor.pos[:] = [0.0, 0.0, float(model.stat.center[2]) - reach * float(rng.uniform(0.0, 0.6))]
    _rub(floor, rng)


def _rub(geom: mujoco.MjsGeom, rng: np.random.Generator) -> None:
    geom.condim = int(rng.choice(CONDIMS))
    geom.friction[:] = [float(rng.uniform(0.1, 1.5)), 0.01, 0.001]
    geom.solref[:] = [float(rng.uniform(2.5, 30.0)) * TIMESTEP_S, 1.0]


def prove(mechanism: Mechanism, form: Form) -> Proof:
    """Walks freely in a form for ``STEPS`` steps, and counts what is not proved."""
    model = prepare(pushed(mechanism), integrator="implicitfast", timestep_s=TIMESTEP_S)
    drive = Drive(model, Case("random", Path(), CaseFile(title="random")))
    prepared = Prepared(model, drive, model.qpos0.copy(), mechanism.qvel.copy(), STEPS)
    (table,), ending = NativePath(prepared, Baumgarte()).free(
        SolverSpec("auto"), form, TRACKED if form == "hard" else None
    )
    steps = table.frame()
    figures = ("inequalities", "active", "blocked", "newton_worst", "optimality", "drift_pos")
    rows, active, blocked, worst, gradient, drift = (value or 0 for value in steps.select(pl.col(figures).max()).row(0))
    return Proof(
        seed=mechanism.seed,
        steps=len(steps),
        ended="" if ending is None else ending.reason,
        rows=rows,
        active=active,
        unproved=int((steps["unconverged"] > 0).sum()),
        blocked=blocked,
        newton=float(steps["newton"].fill_null(0).to_numpy().sum()) / max(1, len(steps)),
        worst=worst,
        gradient=float(gradient),
        drift=float(drift),
    )
