"""Steps with equality rows and inequality rows at random, and a gripper that grips a box."""

from dataclasses import dataclass

import numpy as np
from oarlock.base import core
from scipy.linalg import cho_solve, solve_triangular


@dataclass(frozen=True)
class Rows:
    """Inequality rows as ``core.Inequalities`` takes them: J (m, nv), aref, D and friction loss (m), and groups."""

    jacobian: np.ndarray
    aref: np.ndarray
    stiffness: np.ndarray
    loss: np.ndarray
    dims: list[int]
    mu: np.ndarray
    friction: np.ndarray


@dataclass(frozen=True)
class Step:
    """M (nv, nv), f (nv), equality rows J (n, nv) with aref (n) and R (n) or None, and inequality rows."""

    mass: np.ndarray
    force: np.ndarray
    equalities: np.ndarray
    wanted: np.ndarray
    softness: np.ndarray | None
    rows: Rows


@dataclass(frozen=True)
class Whole:
    """The whole answer: accelerations (nv), multipliers (n), forces of inequality rows (m), and what is said of it."""

    acceleration: np.ndarray
    multipliers: np.ndarray
    forces: np.ndarray
    report: core.InequalityReport
    certificate: core.Certificate


def random_step(seed: int, *, hard: bool, softest: float = -1.0, stiffest: float = 3.0) -> Step:
    """Up to six velocities, up to four equality rows that agree, some of which say the same, and any groups."""
    rng = np.random.default_rng(seed)
    nv = int(rng.integers(1, 7))
    factor = np.tril(rng.uniform(-0.5, 0.5, (nv, nv)), -1) + np.eye(nv)
    factor *= 10 ** rng.uniform(-1, 1, (nv, 1))

    def row() -> np.ndarray:
        found = np.zeros(nv)
        found[rng.integers(nv, size=4)] = rng.uniform(-1, 1, 4)
        return found

    equalities = [row()]
    for _ in range(rng.integers(4)):
        equalities.append(row() if rng.random() < 0.6 else rng.uniform(-1, 1) * equalities[0])
    groups: list[tuple[int, np.ndarray, float, float]] = []
    jacobian, stiffness, loss = [], [], []
    for _ in range(rng.integers(1, 5)):
        dim = int(rng.choice([0, 1, 1, 2, 3, 4, 6]))
        friction, first, most = (
            rng.uniform(0.05, 1.5, 5),
            10 ** rng.uniform(softest, stiffest),
            10 ** rng.uniform(-2, 2),
        )
        mu = friction[0] * rng.uniform(0.3, 1.0)
        groups.append((dim, friction, mu, most))
        for index in range(max(dim, 1)):
            jacobian.append(row())
            stiffness.append(first if index == 0 else first * (friction[index - 1] / mu) ** 2)
            loss.append(most)
    matrix = np.array(equalities)
    rows = Rows(
        jacobian=np.array(jacobian),
        aref=rng.uniform(-20, 20, len(jacobian)),
        stiffness=np.array(stiffness),
        loss=np.array(loss),
        dims=[dim for dim, *_ in groups],
        mu=np.array([mu for _, _, mu, _ in groups]),
        friction=np.array([friction for _, friction, *_ in groups]),
    )
    return Step(
        mass=factor @ factor.T,
        force=rng.uniform(-10, 10, nv),
        equalities=matrix,
        wanted=matrix @ rng.uniform(-10, 10, nv),
        softness=None if hard else 10 ** rng.uniform(-6, 0, len(matrix)),
        rows=rows,
    )


def answer(step: Step, solver: str = "auto") -> Whole:
    """The whole answer of a step, by a solver of the registry for the equality rows."""
    system, inequalities = core.ConstrainedSystem(), core.Inequalities()
    factor = np.linalg.cholesky(step.mass)

    def whiten(matrix: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(solve_triangular(factor, matrix.T, lower=True).T)

    def move(force: np.ndarray) -> np.ndarray:
        return cho_solve((factor, True), force)

    start = move(step.force)
    system.assemble_factored(whiten(step.equalities), step.equalities, start, step.wanted, step.softness)
    rows = step.rows
    report = inequalities.solve(
        system,
        whiten(rows.jacobian),
        rows.jacobian,
        rows.aref,
        rows.stiffness,
        rows.loss,
        rows.dims,
        rows.mu,
        rows.friction,
    )
    pushed = start + move(inequalities.generalised_force)
    system.renew(pushed, step.wanted)
    multipliers, _ = core.make_solver(solver).solve_system(system)
    acceleration = pushed + move(system.force(multipliers))
    forces = inequalities.forces
    certificate = inequalities.certify(acceleration, forces)
    return Whole(acceleration, multipliers, forces, report, certificate)


def gripper(*, cone: str, condim: int, impratio: float = 1.0) -> str:
    """MJCF of a planar gripper: two fingers, a four-bar each that a connect closes, coupled by a joint equality.

    Between them is a free box on a floor; every hinge has limits and friction loss. MuJoCo solves to rounding.
    """
    contact = f'condim="{condim}" friction="0.7 0.01 0.002"'
    hinge = 'type="hinge" axis="0 1 0" range="-1.5 1.5" damping="0.0005"'

    def finger(side: int, name: str) -> str:
        return f"""
    <body name="crank{name}" pos="{side * 0.03} 0 0.15">
      <joint name="crank{name}" type="hinge" axis="0 1 0" range="-1.2 1.2" damping="0.002" frictionloss="0.002"/>
      <geom type="capsule" fromto="0 0 0 {side * 0.03} 0 -0.03" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
      <body pos="{side * 0.03} 0 -0.03">
        <joint name="coupler{name}" {hinge} frictionloss="0.001"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.085" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
        <geom type="box" pos="{-side * 0.006} 0 -0.085" size="0.004 0.01 0.02" mass="0.01" {contact}/>
        <site name="tip{name}" pos="{-side * 0.02} 0 0"/>
      </body>
    </body>
    <body pos="{side * 0.01} 0 0.15">
      <joint name="rocker{name}" {hinge} frictionloss="0.001"/>
      <geom type="capsule" fromto="0 0 0 {side * 0.03} 0 -0.03" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
      <site name="end{name}" pos="{side * 0.03} 0 -0.03"/>
    </body>"""

    return f"""
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.001" cone="{cone}" impratio="{impratio}" tolerance="0" iterations="200" ls_iterations="200"
          ls_tolerance="1e-10" jacobian="dense"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1" {contact}/>{finger(1, "R")}{finger(-1, "L")}
    <body pos="0 0 0.0195"><freejoint/><geom type="box" size="0.022 0.018 0.02" mass="0.05" {contact}/></body>
  </worldbody>
  <equality>
    <connect site1="tipR" site2="endR"/><connect site1="tipL" site2="endL"/>
    <joint joint1="crankL" joint2="crankR" polycoef="0 -1 0 0 0"/>
  </equality>
  <actuator><motor joint="crankR"/></actuator>
</mujoco>"""
