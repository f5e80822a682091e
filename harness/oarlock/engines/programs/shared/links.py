"""The links of a compiled model, each a rigid body of its own with one joint, for engines of maximal coordinates.

From joint coordinates to the motion of links and back; what goes through the joints follows from how links move.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shared.compiled import BALL, FREE, HINGE, NO_TURN, Compiled, Joining, matrix, turned, unit


class Pose(NamedTuple):
    """A frame within another: place (3), and orientation as a matrix (3, 3)."""

    place: np.ndarray
    turn: np.ndarray

    def then(self, other: "Pose") -> "Pose":
        """A frame that is given within this one."""
        return Pose(self.place + self.turn @ other.place, self.turn @ other.turn)


STILL = Pose(np.zeros(3), np.eye(3))


class Moving(NamedTuple):
    """How a frame moves, world axes: pose, velocity, angular velocity, and accelerations likewise."""

    pose: Pose
    velocity: np.ndarray
    spin: np.ndarray
    acceleration: np.ndarray
    twist: np.ndarray

    def at(self, place: np.ndarray) -> "Moving":
        """The frame with its origin moved to a place (3) within it."""
        arm = self.pose.turn @ place
        velocity = self.velocity + np.cross(self.spin, arm)
        acceleration = self.acceleration + np.cross(self.twist, arm)
        acceleration = acceleration + np.cross(self.spin, np.cross(self.spin, arm))
        return Moving(Pose(self.pose.place + arm, self.pose.turn), velocity, self.spin, acceleration, self.twist)


GROUND = Moving(STILL, np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3))


@dataclass(frozen=True)
class Link:
    """A joint and the rigid body that it moves.

    A body with several joints is as many links, of which all but the last have no mass.

    Attributes:
        joint: number of the joint; kind: of it.
        parent: number of the link that it is on; −1 is the ground.
        seat: frame of the joint within the parent, at the position 0.
        anchor: where the joint is in the link's own frame.
        axis: of a hinge or slide, within both frames.
    """

    joint: int
    kind: int
    parent: int
    seat: Pose
    anchor: np.ndarray
    axis: np.ndarray


class Tree:
    """The links of a model, in the order of its joints.

    Attributes:
        links: the links.
        owner: of each body the link that it is part of; place: the body's frame within that.
        inertia: of each link mass (kg), centre of mass (3) and inertia about it (3, 3), in its own frame.
    """

    def __init__(self, compiled: Compiled):
        self.compiled = compiled
        self.links: list[Link] = []
        self.owner, self.place = [-1], [STILL]
        for body in range(1, int(compiled.nbody)):
            self._add(body)
        self.inertia = [self._inertia(link) for link in range(len(self.links))]

    def _add(self, body: int) -> None:
        compiled, parent = self.compiled, int(self.compiled.body_parentid[body])
        owner = self.owner[parent]
        place = self.place[parent].then(Pose(compiled.body_pos[body], matrix(unit(compiled.body_quat[body]))))
        joints = compiled.joints(body)
        for joint in joints:
            kind, anchor = int(compiled.jnt_type[joint]), np.asarray(compiled.jnt_pos[joint], dtype=float)
            seat = STILL if kind == FREE else place.then(Pose(anchor, np.eye(3)))
            last = joint == joints[-1]
            own = anchor if last else np.zeros(3)
            self.links.append(Link(joint, kind, owner, seat, own, np.asarray(compiled.jnt_axis[joint], dtype=float)))
            owner, place = len(self.links) - 1, STILL if last else Pose(-anchor, np.eye(3))
        self.owner.append(owner)
        self.place.append(place)

    def _inertia(self, link: int) -> tuple[float, np.ndarray, np.ndarray]:
        compiled = self.compiled
        parts = []
        for body in (body for body, owner in enumerate(self.owner) if owner == link):
            pose = self.place[body].then(Pose(compiled.body_ipos[body], matrix(unit(compiled.body_iquat[body]))))
            parts.append((float(compiled.body_mass[body]), pose, np.asarray(compiled.body_inertia[body], dtype=float)))
        mass = sum(part for part, _, _ in parts)
        if not mass:
            return 0.0, np.zeros(3), np.zeros((3, 3))
        centre = sum((part * pose.place for part, pose, _ in parts), np.zeros(3)) / mass
        whole = np.zeros((3, 3))
        for part, pose, moments in parts:
            arm = pose.place - centre
            whole += pose.turn @ np.diag(moments) @ pose.turn.T + part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return mass, centre, whole

    def moving(self, qpos: np.ndarray, qvel: np.ndarray) -> list[Moving]:
        """How links move at positions (nq) and velocities (nv); accelerations are left at 0."""
        found: list[Moving] = []
        for link in self.links:
            at, dof = int(self.compiled.jnt_qposadr[link.joint]), int(self.compiled.jnt_dofadr[link.joint])
            if link.kind == FREE:
                turn = matrix(unit(qpos[at + 3 : at + 7]))
                found.append(
                    Moving(
                        Pose(qpos[at : at + 3].copy(), turn),
                        qvel[dof : dof + 3].copy(),
                        turn @ qvel[dof + 3 : dof + 6],
                        np.zeros(3),
                        np.zeros(3),
                    )
                )
                continue
            base = (found[link.parent] if link.parent >= 0 else GROUND).at(link.seat.place)
            seat = base.pose.turn @ link.seat.turn
            place, velocity, spin, turn = base.pose.place, base.velocity, base.spin, seat
            if link.kind == BALL:
                turn = seat @ matrix(unit(qpos[at : at + 4]))
                spin = spin + turn @ qvel[dof : dof + 3]
            else:
                way, change = seat @ link.axis, float(qpos[at] - self.compiled.qpos0[at])
                if link.kind == HINGE:
                    turn = seat @ matrix(turned(NO_TURN, change * link.axis))
                    spin = spin + qvel[dof] * way
                else:
                    place = place + change * way
                    velocity = velocity + np.cross(base.spin, change * way) + qvel[dof] * way
            moved = Moving(Pose(place, turn), velocity, spin, np.zeros(3), np.zeros(3))
            found.append(moved.at(-link.anchor))
        return found

    def coordinates(self, moving: list[Moving], before: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (nq), velocities (nv) and accelerations (nv) from how links move.

        Args:
            moving: of every link.
            before: positions (nq) shortly before, from which hinges tell their whole turns.
        """
        compiled = self.compiled
        qpos, qvel, qacc = before.copy(), np.zeros(int(compiled.nv)), np.zeros(int(compiled.nv))
        for link, own in zip(self.links, moving, strict=True):
            at, dof = int(compiled.jnt_qposadr[link.joint]), int(compiled.jnt_dofadr[link.joint])
            turn = own.pose.turn
            if link.kind == FREE:
                qpos[at : at + 3], qpos[at + 3 : at + 7] = own.pose.place, quaternion(turn)
                qvel[dof : dof + 3], qvel[dof + 3 : dof + 6] = own.velocity, turn.T @ own.spin
                qacc[dof : dof + 3], qacc[dof + 3 : dof + 6] = own.acceleration, turn.T @ own.twist
                continue
            base = moving[link.parent] if link.parent >= 0 else GROUND
            seat = base.pose.turn @ link.seat.turn
            spin, twist = own.spin - base.spin, own.twist - base.twist
            if link.kind == BALL:
                qpos[at : at + 4] = quaternion(seat.T @ turn)
                qvel[dof : dof + 3] = turn.T @ spin
                qacc[dof : dof + 3] = turn.T @ (twist - np.cross(own.spin, spin))
                continue
            way = seat @ link.axis
            if link.kind == HINGE:
                relative = quaternion(seat.T @ turn)
                angle = 2.0 * np.arctan2(relative[1:] @ link.axis, relative[0]) + compiled.qpos0[at]
                qpos[at] = angle + 2.0 * np.pi * np.round((before[at] - angle) / (2.0 * np.pi))
                qvel[dof], qacc[dof] = way @ spin, way @ twist
            else:
                # Along with the parent, at the place where the joint is now.
                end = own.at(link.anchor)
                there = base.at(base.pose.turn.T @ (end.pose.place - base.pose.place))
                start = base.at(link.seat.place)
                qpos[at] = way @ (end.pose.place - start.pose.place) + compiled.qpos0[at]
                qvel[dof] = way @ (end.velocity - there.velocity)
                qacc[dof] = way @ (end.acceleration - there.acceleration)
        return qpos, qvel, qacc

    def forces(self, moving: list[Moving]) -> np.ndarray:
        """The generalised forces (nv) under which links move so, gravity not among them."""
        compiled, count = self.compiled, len(self.links)
        push, moment = np.zeros((count, 3)), np.zeros((count, 3))  # on the link and all beyond it, about its origin
        found = np.zeros(int(compiled.nv))
        for number in reversed(range(count)):
            link, own = self.links[number], moving[number]
            mass, centre, inertia = self.inertia[number]
            middle, turn = own.at(centre), own.pose.turn
            force = mass * (middle.acceleration - compiled.gravity)
            whole = turn @ inertia @ turn.T
            push[number] += force
            moment[number] += np.cross(turn @ centre, force) + whole @ own.twist
            moment[number] += np.cross(own.spin, whole @ own.spin)
            dof = int(compiled.jnt_dofadr[link.joint])
            here = moment[number] - np.cross(turn @ link.anchor, push[number])  # about the joint
            if link.kind == FREE:
                found[dof : dof + 3], found[dof + 3 : dof + 6] = push[number], turn.T @ moment[number]
            elif link.kind == BALL:
                found[dof : dof + 3] = turn.T @ here
            else:
                found[dof] = turn @ link.axis @ (here if link.kind == HINGE else push[number])
            if link.parent >= 0:
                arm = own.pose.place - moving[link.parent].pose.place
                push[link.parent] += push[number]
                moment[link.parent] += moment[number] + np.cross(arm, push[number])
        return found

    def deviation(self, moving: list[Moving], joining: Joining) -> float:
        """How far apart the points of a connect or weld are, m."""
        ends = []
        for body, place in zip(joining.bodies, joining.places, strict=True):
            own = moving[self.owner[body]].pose if self.owner[body] >= 0 else STILL
            ends.append(own.then(self.place[body]).then(Pose(place, np.eye(3))).place)
        return float(np.abs(ends[0] - ends[1]).max())


def quaternion(turn: np.ndarray) -> np.ndarray:
    """The unit quaternion (w x y z) of a rotation matrix (3, 3), with w ≥ 0 or the largest part positive."""
    square = np.array(
        [
            1.0 + turn[0, 0] + turn[1, 1] + turn[2, 2],
            1.0 + turn[0, 0] - turn[1, 1] - turn[2, 2],
            1.0 - turn[0, 0] + turn[1, 1] - turn[2, 2],
            1.0 - turn[0, 0] - turn[1, 1] + turn[2, 2],
        ]
    )
    spin = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    largest = int(square.argmax())
    found = np.empty(4)
    if largest == 0:
        found[0], found[1:] = square[0], spin
    else:
        one = largest - 1
        found[0] = spin[one]
        for other in range(3):
            found[1 + other] = square[largest] if other == one else turn[one, other] + turn[other, one]
    return unit(found)
