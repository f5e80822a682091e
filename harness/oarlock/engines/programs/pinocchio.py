# /// script
# requires-python = ">=3.10"
# dependencies = ["pin>=4.1,<5", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "Pinocchio"
# package = "pin"
# several = true
# questions = ["forward", "step", "run"]
# equalities = ["connect", "weld", "joint", "tendon"]
# settings = ["method", "mu", "accuracy", "iterations", "rank_cut"]
# closed = true
# ///
"""Pinocchio answers: exact accelerations of a mechanism that is built from a compiled model's arrays.

Connects and welds are constraint models of Pinocchio, solved by its own
``constraintDynamics`` or ``lcaba``. Where a joint or tendon equality is beside them, which Pinocchio has no models for,
the whole is solved by the minimum-norm pseudo-inverse of Pinocchio's M, bias and Jacobians and rows of our own. No
method stabilises: J a = −J̇v.

Settings: ``method`` (``constraintDynamics``, ``lcaba``, ``kkt``; by default the first, or ``kkt`` where there are
other rows), ``mu``, ``accuracy`` and ``iterations`` of the proximal methods, ``rank_cut`` of the pseudo-inverse.
"""

# pyright: reportMissingImports=false

import time
from importlib import import_module
from typing import Any

import numpy as np
from shared.compiled import BALL, FREE, SLIDE, Compiled, matrix, moved, unit
from shared.exchange import Answer, NotExpressible, answer_all, tell
from shared.family import Ask
from shared.forces import Controls, Laws
from shared.rows import Body, Coupled, Rows, joined, stretched

METHODS = ("constraintDynamics", "lcaba", "kkt")

MU, ACCURACY = {"constraintDynamics": 1e-8, "lcaba": 1e-6}, {"constraintDynamics": 1e-14, "lcaba": 1e-10}
"""Of the proximal methods: their softness, and where they stop. The articulated-body method loses 1e-16/μ of its
digits."""

ITERATIONS = 50
"""At most; where rows are redundant they go so far, without loss of digits."""

COUPLED = 1e-14
"""Cosine of the angle between two rows that are not coupled but for rounding."""

RANK_CUT = 1e-10
"""Relative to the largest eigenvalue of A = J M⁻¹ Jᵀ, where smaller ones count as none."""

REPEATS = 5
"""Times that all states are gone through to be timed; the least counts."""


# Coordinates: MuJoCo's quaternions are w x y z, Pinocchio's x y z w. The velocity of a free joint is in world axes with
# MuJoCo, of Pinocchio in the axes of the body: v' = S v with S = diag(Rᵀ, 1), and Ṡ v = −ω × v' in its first part.


class Coordinates:
    """Goes from MuJoCo's coordinates to Pinocchio's and back, at one state.

    Args:
        compiled: the model.
        qpos: positions (nq).
        qvel: velocities (nv).
    """

    def __init__(self, compiled: Compiled, qpos: np.ndarray, qvel: np.ndarray):
        self.q = qpos.copy()
        self._frames: list[tuple[int, np.ndarray]] = []
        for joint, kind in enumerate(compiled.jnt_type.tolist()):
            at, dof = int(compiled.jnt_qposadr[joint]), int(compiled.jnt_dofadr[joint])
            if kind in (FREE, BALL):
                first = at + 3 if kind == FREE else at
                quat = unit(qpos[first : first + 4])
                self.q[first : first + 4] = quat[[1, 2, 3, 0]]
                if kind == FREE:
                    self._frames.append((dof, matrix(quat)))
            else:
                self.q[at] -= compiled.qpos0[at]
        self.v = self.into(qvel)
        self.drift = np.zeros(len(qvel))
        """Ṡ v (nv): Pinocchio's accelerations where MuJoCo's are 0."""
        for dof, _ in self._frames:
            self.drift[dof : dof + 3] = -np.cross(self.v[dof + 3 : dof + 6], self.v[dof : dof + 3])

    def into(self, vector: np.ndarray) -> np.ndarray:
        """S x of velocities, or of forces (nv, …), which turn likewise."""
        found = vector.copy()
        for dof, turn in self._frames:
            found[dof : dof + 3] = turn.T @ vector[dof : dof + 3]
        return found

    def back(self, vector: np.ndarray) -> np.ndarray:
        """Sᵀ x of velocities or forces (nv, …)."""
        found = vector.copy()
        for dof, turn in self._frames:
            found[dof : dof + 3] = turn @ vector[dof : dof + 3]
        return found

    def accelerations_back(self, a: np.ndarray) -> np.ndarray:
        """MuJoCo's accelerations (nv) from Pinocchio's."""
        return self.back(a - self.drift)


def chains(compiled: Compiled) -> np.ndarray:
    """Which degrees of freedom are on one chain, (nv, nv)."""
    found = np.eye(int(compiled.nv), dtype=bool)
    for dof, parent in enumerate(compiled.dof_parentid.tolist()):
        if parent >= 0:
            found[dof] |= found[parent]  # parents come first
    return found | found.T


class Mechanism:
    """The model as Pinocchio has it: a tree of joints, and where each of MuJoCo's bodies is in it.

    Args:
        pin: the package.
        compiled: the model.
    """

    def __init__(self, pin: Any, compiled: Compiled):
        self.pin, self.compiled = pin, compiled
        self.model = pin.Model()
        self.model.gravity.linear = compiled.gravity
        self.joints, self.places = [0], [pin.SE3.Identity()]
        for body in range(1, int(compiled.nbody)):
            self._add(body)
        self.frames = [
            self.model.addFrame(pin.Frame(f"body{body}", joint, place, pin.FrameType.OP_FRAME))
            for body, (joint, place) in enumerate(zip(self.joints, self.places, strict=True))
        ]
        self.armature = np.array(compiled.dof_armature, dtype=float)
        self._chains = chains(compiled)
        self._pulled = [int(at) for at in np.flatnonzero(compiled.get("tendon_armature"))]
        self.data = self.model.createData()

    def _add(self, body: int) -> None:
        pin, compiled = self.pin, self.compiled
        parent = int(compiled.body_parentid[body])
        joint = self.joints[parent]
        place = self.places[parent] * self._place(compiled.body_pos[body], compiled.body_quat[body])
        for index in compiled.joints(body):
            kind, anchor = int(compiled.jnt_type[index]), np.asarray(compiled.jnt_pos[index], dtype=float)
            if kind == FREE:
                place, model = pin.SE3.Identity(), pin.JointModelFreeFlyer()
            elif kind == BALL:
                model = pin.JointModelSpherical()
            else:
                sort = pin.JointModelPrismaticUnaligned if kind == SLIDE else pin.JointModelRevoluteUnaligned
                model = sort(np.asarray(compiled.jnt_axis[index], dtype=float))
            at = place * pin.SE3(np.eye(3), anchor)
            joint = self.model.addJoint(joint, model, at, f"joint{index}")
            place = pin.SE3(np.eye(3), -anchor)
        self.joints.append(joint)
        self.places.append(place)
        turn = matrix(unit(compiled.body_iquat[body]))
        inertia = turn @ np.diag(compiled.body_inertia[body]) @ turn.T
        own = pin.Inertia(float(compiled.body_mass[body]), np.asarray(compiled.body_ipos[body], dtype=float), inertia)
        self.model.appendBodyToJoint(joint, own, place)

    def _place(self, place: np.ndarray, turn: np.ndarray) -> Any:
        return self.pin.SE3(matrix(unit(turn)), np.asarray(place, dtype=float))

    def constraints(self) -> Any:
        """The connects and welds that are on, as Pinocchio's constraint models. Those that move nothing have none."""
        pin = self.pin
        found = pin.StdVec_RigidConstraintModel()
        for joining in self.compiled.joinings():
            ends = [
                (self.joints[body], self.places[body] * self._place(place, turn))
                for body, place, turn in zip(joining.bodies, joining.places, joining.turns, strict=True)
            ]
            if ends[0][0] == ends[1][0]:
                continue
            kind = pin.ContactType.CONTACT_6D if joining.scale else pin.ContactType.CONTACT_3D
            (joint1, place1), (joint2, place2) = ends
            found.append(
                pin.RigidConstraintModel(kind, self.model, joint1, place1, joint2, place2, pin.ReferenceFrame.LOCAL)
            )
        return found

    def motion(self, at: Coordinates) -> Any:
        """How bodies move at a state, and accelerate where MuJoCo's accelerations are 0."""
        pin, model, data = self.pin, self.model, self.data
        pin.computeJointJacobians(model, data, at.q)
        pin.forwardKinematics(model, data, at.q, at.v, at.drift)
        known: dict[int, Body] = {}
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

        def look(body: int) -> Body:
            if body not in known:
                frame = self.frames[body]
                place = pin.updateFramePlacement(model, data, frame)
                x, y, z, w = pin.Quaternion(place.rotation).coeffs()
                velocity = pin.getFrameVelocity(model, data, frame, axes)
                bend = pin.getFrameClassicalAcceleration(model, data, frame, axes)
                jacobian = at.back(pin.getFrameJacobian(model, data, frame, axes).T).T
                known[body] = Body(
                    place.translation.copy(),
                    np.array([w, x, y, z]),
                    velocity.linear,
                    velocity.angular,
                    bend.linear,
                    bend.angular,
                    jacobian,
                )
            return known[body]

        return look

    def dynamics(self, at: Coordinates, qpos: np.ndarray, qvel: np.ndarray, motion: Any) -> tuple[Any, Any]:
        """M (nv, nv) and the bias (nv) in MuJoCo's coordinates, with the armature of joints and tendons."""
        pin, model, data = self.pin, self.model, self.data
        inertia = pin.crba(model, data, at.q)
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        bias = at.back(pin.nonLinearEffects(model, data, at.q, at.v) + inertia @ at.drift)
        inertia = at.back(at.back(inertia).T) + np.diag(self.armature)
        for tendon in self._pulled:
            armature = float(self.compiled.tendon_armature[tendon])
            _, gradient, bend = stretched(self.compiled, tendon, qpos, qvel, motion)
            # MuJoCo's M has entries along chains only: what a tendon couples between branches is left out of it.
            inertia += armature * np.outer(gradient, gradient) * self._chains
            bias += armature * bend * gradient
        return inertia, bias


class Solver:
    """Accelerations by one method.

    Args:
        mechanism: the model.
        settings: of the program.
    """

    def __init__(self, mechanism: Mechanism, settings: dict[str, Any]):
        self.mechanism, self.coupled = mechanism, Coupled(mechanism.compiled)
        others = len(self.coupled) > 0 or bool(mechanism.compiled.get("tendon_armature").any())
        self.method = settings.get("method", METHODS[2] if others else METHODS[0])
        if self.method not in METHODS:
            raise SystemExit(f"method '{self.method}', expected one of: {', '.join(METHODS)}")
        if others and self.method != METHODS[2]:
            raise SystemExit(f"method '{self.method}' has no rows of joints and tendons, expected {METHODS[2]}")
        self._cut = float(settings.get("rank_cut", RANK_CUT))
        pin, model = mechanism.pin, mechanism.model
        self._models = mechanism.constraints()
        self._datas = pin.StdVec_RigidConstraintData()
        for one in self._models:
            self._datas.append(one.createData())
        self._mu = float(settings.get("mu", MU.get(self.method, 0.0)))
        self._accuracy = float(settings.get("accuracy", ACCURACY.get(self.method, 0.0)))
        self._iterations = int(settings.get("iterations", ITERATIONS))
        self._armed = model.copy()
        self._armed.armature = mechanism.armature
        self._armed_data = self._armed.createData()
        if self.method == "lcaba":
            pin.computeJointMinimalOrdering(self._armed, self._armed_data, self._models)
        else:
            pin.initConstraintDynamics(self._armed, self._armed_data, self._models, self._datas)
        self.iterations, self.ranks = 0, set[int]()

    def __call__(self, qpos: np.ndarray, qvel: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations and the constraints' forces (nv, nv), from all other generalised forces (nv)."""
        at = Coordinates(self.mechanism.compiled, qpos, qvel)
        motion = self.mechanism.motion(at)
        inertia, bias = self.mechanism.dynamics(at, qpos, qvel, motion)
        if self.method == METHODS[2]:
            return self._by_rows(inertia, force - bias, qpos, qvel, motion)
        call = self.prepared(at, force)
        a = at.accelerations_back(call())
        return a, inertia @ a + bias - force

    def prepared(self, at: Coordinates, force: np.ndarray) -> Any:
        """The call of Pinocchio's own method at a state."""
        pin = self.mechanism.pin
        # The armature of a free joint acts along its coordinates: theirs are other ones here.
        tau = at.into(force) + self.mechanism.armature * at.drift
        settings = pin.ProximalSettings(self._accuracy, self._accuracy, self._mu, self._iterations)
        arguments = (self._armed, self._armed_data, at.q, at.v, tau, self._models, self._datas, settings)
        solve = pin.lcaba if self.method == "lcaba" else pin.constraintDynamics

        def call() -> np.ndarray:
            found = solve(*arguments).copy()
            self.iterations = max(self.iterations, int(settings.iter))
            return found

        return call

    def rows(self, qpos: np.ndarray, qvel: np.ndarray, motion: Any) -> Rows:
        """All rows, in the order of the equalities."""
        found = self.coupled.rows(qpos, qvel, motion)
        found |= {joining.index: joined(joining, motion) for joining in self.mechanism.compiled.joinings()}
        parts = [found[index] for index in sorted(found)]
        empty = Rows(np.zeros((0, len(qvel))), np.zeros(0), np.zeros(0))
        return Rows(*(np.concatenate(part) for part in zip(empty, *parts, strict=True)))

    def _by_rows(self, inertia: Any, force: Any, qpos: Any, qvel: Any, motion: Any) -> tuple[np.ndarray, np.ndarray]:
        rows = self.rows(qpos, qvel, motion)
        half = np.linalg.inv(np.linalg.cholesky(inertia))
        free = half.T @ (half @ force)
        white = rows.jacobian @ half.T
        asked = -rows.curvature - rows.jacobian @ free
        change, rank = np.zeros(len(free)), 0
        for block in _blocks(white):
            # The pseudo-inverse of A = X Xᵀ by the singular values of X keeps twice the digits. Loops that nothing
            # couples are cut each by its own largest one: a screw of 12 566 rad/m is no measure for a four-bar.
            u, values, vt = np.linalg.svd(white[block], full_matrices=False)
            kept = values**2 > self._cut * max(values.max(initial=0.0) ** 2, np.finfo(float).tiny)
            rank += int(kept.sum())
            change += vt[kept].T @ ((u[:, kept].T @ asked[block]) / values[kept])
        self.ranks.add(rank)
        a = free + half.T @ change
        return a, inertia @ (a - free)


def _blocks(white: np.ndarray) -> list[np.ndarray]:
    """Numbers of the rows that A = X Xᵀ couples, of whitened rows X (n, nv)."""
    coupled = np.abs(white @ white.T)
    sizes = np.sqrt(np.diag(coupled))
    near = coupled > COUPLED * np.outer(sizes, sizes)
    left, found = set(range(len(white))), []
    while left:
        block, waiting = set[int](), [min(left)]
        while waiting:
            row = waiting.pop()
            if row in block:
                continue
            block.add(row)
            waiting += [int(other) for other in np.flatnonzero(near[row]) if other not in block]
        left -= block
        found.append(np.array(sorted(block)))
    return found


def _forward(ask: Ask, answer: Answer, solver: Solver, timestep: float | None) -> None:
    states = ask.states
    for index in range(len(ask)):
        qpos, qvel = states["qpos"][index], states["qvel"][index]
        a, force = solver(qpos, qvel, states["qfrc_applied"][index])
        if timestep is not None:
            qvel = qvel + timestep * a
            qpos = moved(solver.mechanism.compiled, qpos, qvel, timestep)
        answer.add(time=states["time"][index], qacc=a, qfrc_constraint=force, qpos=qpos, qvel=qvel)
        tell(index + 1, len(ask))


def _run(ask: Ask, answer: Answer, solver: Solver, laws: Laws) -> None:
    """Free motion: Runge–Kutta of order 4 where that is asked for, else semi-implicit Euler; nothing is projected."""
    compiled, h = solver.mechanism.compiled, float(ask.document["timestep"])
    steps, every = int(ask.document["steps"]), int(ask.document.get("every", 1))
    qpos, qvel = ask.states["qpos"][0], ask.states["qvel"][0]
    t0 = float(ask.states["time"][0])
    runge = ask.document.get("integrator") == "rk4"
    widest = 0.0
    for step in range(steps + 1):
        t = t0 + step * h
        for element, why in compiled.limits(qpos[None]):
            raise NotExpressible(element, f"{why} at t = {t:g} s")
        a, force = solver(qpos, qvel, laws(qpos, qvel, t))
        if step:
            motion = solver.mechanism.motion(Coordinates(compiled, qpos, qvel))
            widest = max(widest, float(np.abs(solver.rows(qpos, qvel, motion).deviation).max(initial=0.0)))
        if step and (step % every == 0 or step == steps):
            answer.add(time=t, qacc=a, qfrc_constraint=force, qpos=qpos, qvel=qvel, loop_error=widest)
            widest = 0.0
            tell(step, steps)
        if not runge:
            qvel = qvel + h * a
            qpos = moved(compiled, qpos, qvel, h)
            continue
        rates, changes = [qvel], [a]
        for part in (0.5, 0.5, 1.0):
            v = qvel + part * h * changes[-1]
            q = moved(compiled, qpos, rates[-1], part * h)
            rates.append(v)
            changes.append(solver(q, v, laws(q, v, t + part * h))[0])
        weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
        qpos = moved(compiled, qpos, weights @ np.array(rates), h)
        qvel = qvel + h * (weights @ np.array(changes))


def _time(ask: Ask, answer: Answer, solver: Solver) -> None:
    """Microseconds of one call of Pinocchio's method from Python, states and forces already in its coordinates."""
    compiled, states = solver.mechanism.compiled, ask.states
    calls = [
        solver.prepared(Coordinates(compiled, qpos, qvel), force)
        for qpos, qvel, force in zip(states["qpos"], states["qvel"], states["qfrc_applied"], strict=True)
    ]
    spans = np.full(len(calls), np.inf)
    for _ in range(int(ask.settings.get("repeats", REPEATS))):
        for index, call in enumerate(calls):
            start = time.perf_counter_ns()
            call()
            spans[index] = min(spans[index], (time.perf_counter_ns() - start) * 1e-3)
    for index, span in enumerate(spans):
        answer.add(time=states["time"][index], microseconds=span)
    answer.facts |= {"microseconds_median": float(np.median(spans)), "microseconds_least": float(spans.min())}


def answered(ask: Ask, answer: Answer) -> None:
    """Answers one question."""
    compiled = Compiled(ask.model)
    coupled = Coupled(compiled)
    laws = Laws(compiled, Controls(ask.states)) if ask.question == "run" else None
    states = {name: column[:1] for name, column in ask.states.items()} if laws else ask.states
    foreign = [*compiled.foreign(states), *(laws.foreign() if laws else ())]
    around = "it runs around geoms: its length has no Jacobian here"
    foreign += [(compiled.called("tendon", tendon), around) for tendon in coupled.wrapped()]
    if ask.question not in ("forward", "step", "run", "time"):
        foreign.append((f"question '{ask.question}'", "expected forward, step, run or time"))
    if ask.document.get("precision", "float64") != "float64":
        foreign.append((f"precision '{ask.document['precision']}'", "Pinocchio's Python package has float64 only"))
    answer.missing = [{"element": element, "why": why} for element, why in foreign]
    if answer.missing:
        return

    pin = import_module("pinocchio")
    answer.versions = {"pin": pin.__version__, "numpy": np.__version__}
    mechanism = Mechanism(pin, compiled)
    solver = Solver(mechanism, ask.settings)
    answer.expressed = compiled.expressed()
    answer.facts = compiled.facts() | {
        "total_mass": float(sum(inertia.mass for inertia in mechanism.model.inertias)),
        "jdotv": True,
        "method": solver.method,
        "stabilisation": None,
        "forces": "of actuators, springs and dampers as given" if laws is None else "by their laws",
    }
    if ask.question == "time":
        _time(ask, answer, solver)
    elif laws is not None:
        answer.facts["integrator"] = "rk4" if ask.document.get("integrator") == "rk4" else "semi-implicit Euler"
        _run(ask, answer, solver, laws)
    else:
        step = ask.question == "step"
        if step:
            answer.facts["integrator"] = "semi-implicit Euler"
        _forward(ask, answer, solver, float(ask.document["timestep"]) if step else None)
    if solver.method == METHODS[2]:
        answer.facts["ranks"] = sorted(solver.ranks)
    else:
        answer.facts["iterations"] = solver.iterations


if __name__ == "__main__":
    answer_all(answered, "pinocchio")
