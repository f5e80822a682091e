# /// script
# requires-python = ">=3.10"
# dependencies = ["exudyn>=1.9,<2", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "Exudyn, maximal coordinates"
# package = "exudyn"
# several = true
# questions = ["forward", "run"]
# equalities = ["connect", "weld"]
# settings = ["spectral_radius", "relative_tolerance", "absolute_tolerance", "index"]
# closed = true
# ///
"""Exudyn answers: maximal coordinates and the generalised-α method, another formulation and another integrator.

Every body is a rigid body of its own with Euler parameters about its centre of mass;
joints and equalities are constraints between bodies. ``run`` is the question for it. ``forward`` gives the consistent
accelerations that a run begins with. A joint or tendon equality couples coordinates that maximal coordinates lack.

Settings: ``spectral_radius`` of the method, ``index`` of the constraints (2 or 3), tolerances of Newton's method
``relative_tolerance`` and ``absolute_tolerance``.
"""

# pyright: reportMissingImports=false

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np
from shared.compiled import BALL, FREE, HINGE, JOINT, SLIDE, TENDON, Compiled, Joining, matrix, product
from shared.exchange import Answer, NotExpressible, answer_all, tell
from shared.family import Ask
from shared.forces import Controls, Laws
from shared.links import Link, Moving, Pose, Tree, quaternion

SPECTRAL_RADIUS = 0.9

INDICES = (2, 3)
"""Of the constraints that are solved, velocities first: where rows repeat one another and their positions drift apart,
Newton's method no longer ends at index 2, and the run is made again at index 3."""

RELATIVE, ABSOLUTE = 1e-8, 1e-10
"""Tolerances of Newton's method: where rows repeat one another, what is left of their multipliers stops it below."""

QUIET_STEP = 1e-9
"""s. Length of the step behind the initial accelerations, which is not looked at."""


def along_z(axis: np.ndarray) -> np.ndarray:
    """A rotation matrix (3, 3) whose third column is an axis."""
    away = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(away, axis)
    first = first / np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


Law = Callable[[float, float, float], float]
"""Force along a joint at a position, velocity and time."""


class System:
    """A model in Exudyn at one start.

    Args:
        exudyn: the package; items: its module of items.
        tree: the links.
        moving: how they move at the start.
        qpos: the same, positions (nq).
        laws: number of a hinge or slide → the force along it.
        pushes: constant forces of free and ball joints: number of a link → force and torque (3, 3), world axes.
    """

    def __init__(
        self,
        exudyn: Any,
        items: Any,
        tree: Tree,
        moving: list[Moving],
        qpos: np.ndarray,
        laws: dict[int, Law],
        pushes: dict[int, tuple[np.ndarray, np.ndarray]],
    ):
        self._exudyn, self._items, self._tree = exudyn, items, tree
        self.container = exudyn.SystemContainer()
        self.system = self.container.AddSystem()
        self._ground = self.system.AddObject(items.ObjectGround())
        self._bodies = [self._body(link, moving[link]) for link in range(len(tree.links))]
        for number, link in enumerate(tree.links):
            self._joint(number, link)
            if link.joint in laws:
                self._force(number, link, laws[link.joint], float(qpos[tree.compiled.jnt_qposadr[link.joint]]))
        for number, (force, torque) in pushes.items():
            marker = self._marker(number, np.zeros(3))
            self.system.AddLoad(items.Force(markerNumber=marker, loadVector=force.tolist()))
            self.system.AddLoad(items.Torque(markerNumber=marker, loadVector=torque.tolist()))
        for joining in tree.compiled.joinings():
            self._join(joining)
        self.system.Assemble()

    def _body(self, link: int, moving: Moving) -> int:
        items, gravity = self._items, self._tree.compiled.gravity
        mass, centre, inertia = self._tree.inertia[link]
        at = moving.at(centre)
        turn = quaternion(at.pose.turn)
        # ṗ = ½ p ∘ (0, Rᵀω) of the Euler parameters.
        rate = 0.5 * product(turn, np.concatenate([[0.0], at.pose.turn.T @ at.spin]))
        node = self.system.AddNode(
            items.NodeRigidBodyEP(referenceCoordinates=[*at.pose.place, *turn], initialVelocities=[*at.velocity, *rate])
        )
        moments = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]
        body = self.system.AddObject(items.ObjectRigidBody(nodeNumber=node, physicsMass=mass, physicsInertia=moments))
        if mass:
            marker = self.system.AddMarker(items.MarkerBodyMass(bodyNumber=body))
            self.system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=gravity.tolist()))
        return body

    def _marker(self, link: int, place: np.ndarray) -> int:
        if link < 0:
            return self.system.AddMarker(
                self._items.MarkerBodyRigid(bodyNumber=self._ground, localPosition=place.tolist())
            )
        own = place - self._tree.inertia[link][1]
        return self.system.AddMarker(
            self._items.MarkerBodyRigid(bodyNumber=self._bodies[link], localPosition=own.tolist())
        )

    def _ends(self, number: int, link: Link, turn: np.ndarray) -> dict[str, Any]:
        """The two frames of a joint, turned within."""
        return {
            "markerNumbers": [self._marker(link.parent, link.seat.place), self._marker(number, link.anchor)],
            "rotationMarker0": link.seat.turn @ turn,
            "rotationMarker1": turn,
        }

    def _joint(self, number: int, link: Link) -> None:
        held = {HINGE: [1, 1, 1, 1, 1, 0], SLIDE: [1, 1, 0, 1, 1, 1], BALL: [1, 1, 1, 0, 0, 0]}
        if link.kind == FREE:
            return
        turn = np.eye(3) if link.kind == BALL else along_z(link.axis)
        ends = self._ends(number, link, turn)
        self.system.AddObject(self._items.GenericJoint(constrainedAxes=held[link.kind], **ends))

    def _force(self, number: int, link: Link, law: Law, start: float) -> None:
        zero = float(self._tree.compiled.qpos0[self._tree.compiled.jnt_qposadr[link.joint]])

        def force(_system: Any, time: float, _item: int, position: float, velocity: float, *_: Any) -> float:
            return -law(position + zero, velocity, time)

        if link.kind == HINGE:
            # It counts turns, from where it starts.
            count = self.system.AddNode(
                self._items.NodeGenericData(numberOfDataCoordinates=1, initialCoordinates=[start - zero])
            )
            ends = self._ends(number, link, along_z(link.axis))
            spring = self._items.TorsionalSpringDamper(nodeNumber=count, springTorqueUserFunction=force, **ends)
        else:
            ends = self._ends(number, link, np.eye(3))
            axis = (ends.pop("rotationMarker0") @ link.axis).tolist()
            ends.pop("rotationMarker1")
            spring = self._items.LinearSpringDamper(axisMarker0=axis, springForceUserFunction=force, **ends)
        self.system.AddObject(spring)

    def _join(self, joining: Joining) -> None:
        tree, markers, turns = self._tree, [], []
        for body, place, turn in zip(joining.bodies, joining.places, joining.turns, strict=True):
            pose = tree.place[body].then(Pose(np.asarray(place, dtype=float), matrix(turn)))
            markers.append(self._marker(tree.owner[body], pose.place))
            turns.append(pose.turn)
        if tree.owner[joining.bodies[0]] == tree.owner[joining.bodies[1]]:
            return
        held = [1, 1, 1, 1, 1, 1] if joining.scale else [1, 1, 1, 0, 0, 0]
        self.system.AddObject(
            self._items.GenericJoint(
                markerNumbers=markers, constrainedAxes=held, rotationMarker0=turns[0], rotationMarker1=turns[1]
            )
        )

    def simulation(self, settings: dict[str, Any], timestep: float, steps: int, index: int, singular: bool) -> Any:
        """Settings of a solution; with ``singular`` one that bears rows that repeat one another, which costs more."""
        chosen = self._exudyn.SimulationSettings()
        method = chosen.timeIntegration
        method.numberOfSteps, method.endTime = steps, steps * timestep
        method.verboseMode = 0
        method.generalizedAlpha.spectralRadius = float(settings.get("spectral_radius", SPECTRAL_RADIUS))
        method.generalizedAlpha.useIndex2Constraints = index == INDICES[0]
        method.generalizedAlpha.useNewmark = index == INDICES[0]
        method.newton.relativeTolerance = float(settings.get("relative_tolerance", RELATIVE))
        method.newton.absoluteTolerance = float(settings.get("absolute_tolerance", ABSOLUTE))
        method.adaptiveStep = False
        kinds = self._exudyn.LinearSolverType
        chosen.linearSolverType = kinds.EigenDense if singular else kinds.EigenSparse
        chosen.linearSolverSettings.ignoreSingularJacobian = singular
        chosen.solutionSettings.writeSolutionToFile = False
        chosen.solutionSettings.solutionInformation = ""
        return chosen

    def moving(self) -> list[Moving]:
        """How links move now."""
        kinds = self._exudyn.OutputVariableType

        def read(body: int, kind: Any) -> np.ndarray:
            return np.array(self.system.GetObjectOutputBody(body, kind, [0.0, 0.0, 0.0]), dtype=float)

        found = []
        for link, body in enumerate(self._bodies):
            centre = Moving(
                Pose(read(body, kinds.Position), read(body, kinds.RotationMatrix).reshape(3, 3)),
                read(body, kinds.Velocity),
                read(body, kinds.AngularVelocity),
                read(body, kinds.Acceleration),
                read(body, kinds.AngularAcceleration),
            )
            found.append(centre.at(-self._tree.inertia[link][1]))
        return found


class Program:
    """Answers questions on one model."""

    def __init__(self, ask: Ask, compiled: Compiled):
        self._ask, self._exudyn = ask, import_module("exudyn")
        self._items = import_module("exudyn.itemInterface")
        self._exudyn.SetWriteToConsole(False)
        self._tree = Tree(compiled)

    @property
    def version(self) -> str:
        """Of the engine."""
        return str(self._exudyn.__version__)

    @property
    def mass(self) -> float:
        """Of all bodies, those of the ground among them, kg."""
        tree = self._tree
        still = [float(tree.compiled.body_mass[body]) for body, owner in enumerate(tree.owner) if owner < 0]
        return sum(mass for mass, _, _ in tree.inertia) + sum(still)

    def _system(self, qpos: np.ndarray, qvel: np.ndarray, laws: dict[int, Law], pushes: Any) -> System:
        return System(self._exudyn, self._items, self._tree, self._tree.moving(qpos, qvel), qpos, laws, pushes)

    def forward(self, answer: Answer) -> None:
        """The accelerations that a run begins with."""
        states = self._ask.states
        for row in range(len(self._ask)):
            qpos, qvel, force = (states[name][row] for name in ("qpos", "qvel", "qfrc_applied"))
            laws, pushes = self._given(qpos, force)
            system = self._system(qpos, qvel, laws, pushes)
            solver = self._exudyn.MainSolverImplicitSecondOrder()
            solver.InitializeSolver(
                system.system, system.simulation(self._ask.settings, QUIET_STEP, 1, INDICES[0], singular=True)
            )
            moving = system.moving()
            _, _, qacc = self._tree.coordinates(moving, qpos)
            held = self._tree.forces(moving) - force
            answer.add(time=states["time"][row], qacc=qacc, qfrc_constraint=held, qpos=qpos, qvel=qvel)
            tell(row + 1, len(self._ask))

    def _given(self, qpos: np.ndarray, force: np.ndarray) -> tuple[dict[int, Law], dict[int, Any]]:
        """Forces that do not change: of hinges and slides as laws, of free and ball joints on their links."""
        laws: dict[int, Law] = {}
        pushes: dict[int, Any] = {}
        moving = self._tree.moving(qpos, np.zeros(len(force)))
        for number, link in enumerate(self._tree.links):
            dof = int(self._tree.compiled.jnt_dofadr[link.joint])
            if link.kind in (HINGE, SLIDE):
                if force[dof]:
                    laws[link.joint] = lambda *_, value=float(force[dof]): value
            else:
                first = dof + 3 if link.kind == FREE else dof
                torque = moving[number].pose.turn @ force[first : first + 3]
                push = force[dof : dof + 3].copy() if link.kind == FREE else np.zeros(3)
                if link.kind == BALL and torque.any() and link.parent >= 0:
                    back = pushes.setdefault(link.parent, (np.zeros(3), np.zeros(3)))
                    pushes[link.parent] = back[0], back[1] - torque
                mine = pushes.setdefault(number, (np.zeros(3), np.zeros(3)))
                pushes[number] = mine[0] + push, mine[1] + torque
        return laws, {link: push for link, push in pushes.items() if np.any(push)}

    def run(self, answer: Answer, laws: Laws) -> None:
        """A free run from the first state."""
        ask, tree = self._ask, self._tree
        timestep = float(ask.document["timestep"])
        steps, every = int(ask.document["steps"]), int(ask.document.get("every", 1))
        start, qvel, t0 = ask.states["qpos"][0], ask.states["qvel"][0], float(ask.states["time"][0])

        def law(joint: int) -> Law:
            return lambda position, velocity, time: laws.of_joint(joint, position, velocity, t0 + time)

        joinings = tree.compiled.joinings()

        def attempt(index: int, singular: bool) -> None:
            system = self._system(start, qvel, {joint: law(joint) for joint in laws.acts()}, {})
            seen: dict[str, Any] = {"widest": 0.0, "qpos": start, "stop": None}
            answer.rows.clear()

            def look(_system: Any, time: float) -> bool:
                step = round(time / timestep)
                moving = system.moving()
                seen["widest"] = max([seen["widest"], *(tree.deviation(moving, one) for one in joinings)])
                qpos, velocities, qacc = tree.coordinates(moving, seen["qpos"])
                seen["qpos"] = qpos
                for element, why in tree.compiled.limits(qpos[None]):
                    seen["stop"] = NotExpressible(element, f"{why} at t = {t0 + time:g} s")
                    return False
                if step and (step % every == 0 or step == steps):
                    held = tree.forces(moving) - laws(qpos, velocities, t0 + time)
                    moved = {"qacc": qacc, "qfrc_constraint": held, "qpos": qpos, "qvel": velocities}
                    answer.add(time=t0 + time, **moved, loop_error=seen["widest"])
                    seen["widest"] = 0.0
                    tell(step, steps)
                return True

            system.system.SetPostStepUserFunction(look)
            chosen = system.simulation(ask.settings, timestep, steps, index, singular)
            self._exudyn.SolveDynamic(system.system, chosen)
            if seen["stop"] is not None:
                raise seen["stop"]

        indices = [int(ask.settings["index"])] if "index" in ask.settings else INDICES
        attempts = [(index, singular) for index in indices for singular in (False, True)]
        while True:
            index, singular = attempts.pop(0)
            try:
                attempt(index, singular)
                break
            except self._exudyn.SolverError:
                if not attempts:
                    raise
        answer.facts |= {"integrator": f"generalised-α, index {index}", "singular": singular}


def foreign(compiled: Compiled) -> Iterator[tuple[str, str]]:
    """Yields what maximal coordinates have no words for, each with why."""
    for index in compiled.active():
        if compiled.eq_type[index] in (JOINT, TENDON):
            yield compiled.called("equality", index), "it couples joint coordinates, which maximal coordinates lack"
    for joint in dict.fromkeys(compiled.dof_jntid[np.flatnonzero(compiled.dof_armature)].tolist()):
        yield compiled.called("joint", joint), "armature, an inertia of a joint coordinate"
    for tendon in np.flatnonzero(compiled.get("tendon_armature")).tolist():
        yield compiled.called("tendon", tendon), "armature, an inertia of a length"


def answered(ask: Ask, answer: Answer) -> None:
    """Answers one question."""
    compiled = Compiled(ask.model)
    laws = Laws(compiled, Controls(ask.states)) if ask.question == "run" else None
    states = {name: column[:1] for name, column in ask.states.items()} if laws else ask.states
    missing = [*compiled.foreign(states), *foreign(compiled), *(laws.foreign() if laws else ())]
    if ask.question not in ("forward", "run"):
        missing.append((f"question '{ask.question}'", "a step of another integrator is not MuJoCo's, expected a run"))
    if ask.document.get("precision", "float64") != "float64":
        missing.append((f"precision '{ask.document['precision']}'", "Exudyn has float64 only"))
    answer.missing = [{"element": element, "why": why} for element, why in missing]
    if answer.missing:
        return
    program = Program(ask, compiled)
    answer.versions = {"exudyn": program.version, "numpy": np.__version__}
    answer.expressed = compiled.expressed()
    answer.facts = compiled.facts() | {
        "total_mass": program.mass,
        "jdotv": True,
        "stabilisation": None,
        "formulation": "maximal coordinates, Euler parameters",
    }
    if laws is None:
        program.forward(answer)
    else:
        program.run(answer, laws)


if __name__ == "__main__":
    answer_all(answered, "exudyn")
