"""Rows, coordinates and links that programs compute from a compiled model's arrays, beside MuJoCo's own."""

from typing import Any

import mujoco
import numpy as np
import pytest
from engine_asks import compiled, program
from mechanisms import TANGLE
from oarlock.mechanics.curvature import Curvature

ROUNDING = 1e-11
"""Relative to the largest entry: the same formulas in another order, with velocities of a few rad/s squared."""

DIFFERENCED = 1e-7
"""Of a central difference with a step of 1e-5: 1e-10 of it, and rounding, 1e-16, over the step."""


def moved(model: mujoco.MjModel, seed: int) -> mujoco.MjData:
    """A state with random positions and velocities."""
    random, data = np.random.default_rng(seed), mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, random.normal(size=model.nv), 1.0)
    data.qvel[:] = random.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    return data


def tangle(xml: str = TANGLE) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return model


def motion_of(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    """How bodies move, from MuJoCo's own Jacobians and their rates."""
    kind = program("shared/rows").Body

    def look(body: int) -> Any:
        jacobian, rates = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        place = data.xpos[body].copy()
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], place, body)
        mujoco.mj_jacDot(model, data, rates[:3], rates[3:], place, body)
        velocity, bend = jacobian @ data.qvel, rates @ data.qvel
        return kind(place, data.xquat[body].copy(), velocity[:3], velocity[3:], bend[:3], bend[3:], jacobian)

    return look


def close(value: np.ndarray, expected: np.ndarray, tolerance: float = ROUNDING) -> None:
    assert np.shape(value) == np.shape(expected)
    assert np.abs(value - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_those_of_mujoco(seed: int):
    model = tangle()
    data = moved(model, seed)
    rows, own = program("shared/rows"), compiled(model)
    motion = motion_of(model, data)
    found = rows.Coupled(own).rows(data.qpos, data.qvel, motion)
    found |= {joining.index: rows.joined(joining, motion) for joining in own.joinings()}
    assert sorted(found) == list(range(model.neq))
    curvature = np.empty(data.ne)
    Curvature(model, data).write(data, curvature)
    jacobian = data.efc_J.reshape(data.nefc, model.nv)
    for index, row in found.items():
        mine = np.flatnonzero(data.efc_id[: data.ne] == index)
        assert len(mine) in (1, 3, 6)
        close(row.jacobian, jacobian[mine])
        close(row.curvature, curvature[mine])
        close(row.deviation, data.efc_pos[mine])
    assert own.rows() == data.ne


def test_an_equality_that_is_off_has_no_rows():
    model = tangle()
    model.eq_active0[2:] = 0
    assert compiled(model).active() == [0, 1]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    assert compiled(model).active() == []


def test_poses_go_on_as_those_of_mujoco():
    model = tangle()
    data, random = moved(model, 1), np.random.default_rng(5)
    for scale in (1e-9, 1.0, 4.0):
        qvel, expected = scale * random.normal(size=model.nv), data.qpos.copy()
        mujoco.mj_integratePos(model, expected, qvel, 0.7)
        close(program("shared/compiled").moved(compiled(model), data.qpos, qvel, 0.7), expected)


# Pinocchio's coordinates.


def test_velocities_of_free_joints_turn_with_the_body():
    model = tangle()
    data, coordinates = moved(model, 2), program("pinocchio").Coordinates
    own = compiled(model)
    at = coordinates(own, data.qpos, data.qvel)
    assert np.array_equal(at.back(at.into(data.qvel)), at.back(at.v))
    close(at.back(at.v), data.qvel)
    # Work is the same in both.
    force = np.random.default_rng(0).normal(size=model.nv)
    assert at.into(force) @ at.v == pytest.approx(force @ data.qvel, rel=ROUNDING)
    # With accelerations of 0 the velocities stay in world axes, and those of Pinocchio change by the turning alone.
    step, ends = 1e-5, []
    for time in (-step, step):
        qpos = data.qpos.copy()
        mujoco.mj_integratePos(model, qpos, data.qvel, time)
        ends.append(coordinates(own, qpos, data.qvel).v)
    close(at.drift, (ends[1] - ends[0]) / (2.0 * step), DIFFERENCED)
    assert np.abs(at.drift).max() > 0.1
    close(at.accelerations_back(at.drift), np.zeros(model.nv))


def test_quaternions_and_references_are_those_of_the_other_convention():
    model = tangle(TANGLE.replace('name="slide" type="slide"', 'name="slide" type="slide" ref="0.3"'))
    data = moved(model, 3)
    at = program("pinocchio").Coordinates(compiled(model), data.qpos, data.qvel)
    ball, free = (int(model.joint(name).qposadr[0]) for name in ("ball", "free"))
    assert np.allclose(at.q[ball : ball + 4], data.qpos[[ball + 1, ball + 2, ball + 3, ball]])
    assert np.allclose(at.q[free + 3 : free + 7], data.qpos[[free + 4, free + 5, free + 6, free + 3]])
    slide = int(model.joint("slide").qposadr[0])
    assert at.q[slide] == pytest.approx(data.qpos[slide] - 0.3)


# Links of maximal coordinates.


def links_of(model: mujoco.MjModel, data: mujoco.MjData, tree: Any) -> list[Any]:
    """How the links of a tree move, by MuJoCo; of bodies with several joints only the last link is a body."""
    kinds = program("shared/links")
    mujoco.mj_rnePostConstraint(model, data)
    found = []
    for link in tree.links:
        body, rates = int(model.jnt_bodyid[link.joint]), np.zeros((2, 6))
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, rates[0], 0)
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, rates[1], 0)
        pose = kinds.Pose(data.xpos[body].copy(), data.xmat[body].reshape(3, 3).copy())
        acceleration = rates[1, 3:] + model.opt.gravity
        found.append(kinds.Moving(pose, rates[0, 3:], rates[0, :3], acceleration, rates[1, :3]))
    return found


LINKS = """
<mujoco>
  <default><geom size="0.1" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body pos="0.1 0.2 0.3" euler="10 20 30"><geom mass="3"/>
      <body name="a" pos="0 0.1 0.3" euler="0 40 0">
        <joint name="skew" axis="1 2 3" pos="0.1 0 0" ref="20"/><geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0"/>
        <body pos="0.2 0 0.1" euler="70 0 20"><geom type="box" size="0.1 0.3 0.2" pos="0 0.2 0" euler="0 0 30"/>
          <body name="b" pos="0.3 0.1 0.4">
            <joint name="slide" type="slide" axis="2 -1 1" ref="0.3" pos="0 0.3 0"/><geom pos="0 0 0.2"/>
            <body name="c" pos="0.2 0 0" euler="0 0 50"><joint name="ball" type="ball" pos="0.1 0.1 0"/><geom/></body>
          </body>
        </body>
      </body>
    </body>
    <body name="d" pos="0.5 0.5 0.5">
      <freejoint name="free"/><geom type="box" size="0.1 0.2 0.3" pos="0.1 0.2 0" euler="10 20 30"/>
      <body name="e" pos="0.3 0 0"><joint name="wrist" axis="0 1 1"/><geom pos="0 0 0.3"/></body>
    </body>
  </worldbody>
</mujoco>"""
"""Every kind of joint, one a body, with anchors, references, and bodies without joints."""


@pytest.mark.parametrize("seed", range(3))
def test_links_move_as_bodies_of_mujoco(seed: int):
    model = tangle(LINKS)
    data = mujoco.MjData(model)
    drawn, random = moved(model, seed), np.random.default_rng(seed)
    data.qpos[:], data.qvel[:] = drawn.qpos, drawn.qvel
    data.qfrc_applied[:] = random.normal(size=model.nv)
    mujoco.mj_forward(model, data)
    tree = program("shared/links").Tree(compiled(model))
    assert len(tree.links) == model.njnt
    expected = links_of(model, data, tree)
    for own, other in zip(tree.moving(data.qpos, data.qvel), expected, strict=True):
        close(own.pose.place, other.pose.place)
        close(own.pose.turn, other.pose.turn)
        close(own.velocity, other.velocity)
        close(own.spin, other.spin)
    qpos, qvel, qacc = tree.coordinates(expected, data.qpos + 1e-3)
    close(tree.moving(qpos, qvel)[-1].pose.turn, expected[-1].pose.turn)
    close(qvel, data.qvel)
    close(qacc, data.qacc)
    close(tree.forces(expected), data.qfrc_applied + data.qfrc_passive)
    assert sum(mass for mass, _, _ in tree.inertia) == pytest.approx(model.body_subtreemass[0] - 3.0)


def test_hinges_count_whole_turns():
    model = tangle(LINKS)
    tree = program("shared/links").Tree(compiled(model))
    qpos = moved(model, 0).qpos.copy()
    skew = int(model.joint("skew").qposadr[0])
    qpos[skew] = 7.5 * np.pi
    found, _, _ = tree.coordinates(tree.moving(qpos, np.zeros(model.nv)), qpos - 0.1)
    close(found[skew], qpos[skew])


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 0, -1], [0.6, 0, 0.8], [1, 0, 0], [0, -1, 0]])
def test_frames_are_turned_onto_axes(axis: list[float]):
    turn = program("exudyn").along_z(np.array(axis, dtype=float))
    close(turn[:, 2], np.array(axis, dtype=float))
    close(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
