"""The drawing is true: bodies are where MuJoCo has them, links end at joints, anchors that are apart look apart."""

import dataclasses

import mujoco
import numpy as np
import pytest
from mechanisms import write_model
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page import motion as motions
from oarlock.diagnosis.page.motion import Skeleton, motion, still
from oarlock.experiments.sketch import sketch
from oarlock.mechanics.names import equalities
from tolerances import SAME_POINT

HEAD = """<mujoco><option timestep="0.001"/><default><joint axis="0 0 1" damping="0.01"/>
  <geom type="capsule" size="0.01" contype="0" conaffinity="0" density="800"/></default><worldbody>"""

SLIDER_CRANK = f"""{HEAD}
  <body name="crank" pos="0 0 0.1"><joint name="crank"/><geom fromto="0 0 0 0 0.1 0"/>
    <body name="rod" pos="0 0.1 0"><joint name="rod"/><geom fromto="0 0 0 0.3 -0.1 0"/>
      <site name="small_end" pos="0.3 -0.1 0"/></body></body>
  <body name="piston" pos="0.28 0 0.1"><joint name="piston" type="slide" axis="1 0 0" pos="0.01 0 0"/>
    <geom fromto="-0.02 0 0 0.06 0 0"/><site name="pin" pos="0.02 0 0"/></body></worldbody>
  <equality><connect name="pin" site1="small_end" site2="pin"/></equality>
  <actuator><motor name="m" joint="crank"/></actuator></mujoco>"""


def platform():
    """A plate on two slides and a hinge, held by three arms of two links: a planar robot."""
    arms, seams, sites = "", "", ""
    for number in range(3):
        turn = 2 * np.pi * number / 3
        radius = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        base, elbow, corner = (radius @ np.array(at) for at in ((0.5, 0.0), (-0.05, 0.2), (0.12, 0.0)))
        reach = corner - base - elbow
        arms += f"""<body name="upper{number}" pos="{base[0]} {base[1]} 0"><joint name="a{number}"/>
          <geom fromto="0 0 0 {elbow[0]} {elbow[1]} 0"/><body name="lower{number}" pos="{elbow[0]} {elbow[1]} 0">
          <joint name="b{number}"/><geom fromto="0 0 0 {reach[0]} {reach[1]} 0"/>
          <site name="end{number}" pos="{reach[0]} {reach[1]} 0"/></body></body>"""
        sites += f'<site name="corner{number}" pos="{corner[0]} {corner[1]} 0"/>'
        seams += f'<connect name="leg{number}" site1="end{number}" site2="corner{number}"/>'
    return f"""{HEAD}{arms}<body name="plate"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/><joint name="turn"/><geom type="cylinder" size="0.12 0.005"/>{sites}
      </body></worldbody><equality>{seams}</equality>
      <actuator><motor name="m" joint="a0" gear="0.2"/></actuator></mujoco>"""


APART = f"""{HEAD}
  <body name="crank" pos="0 0 0.5"><joint name="crank" axis="0 1 0"/><geom fromto="0 0 0 0.1 0 0"/>
    <body name="upper" pos="0.1 0 0"><joint name="upper" axis="0 1 0"/><geom fromto="0 0 0 0.2 0 0.1"/></body></body>
  <body name="swing" pos="0.35 0 0.4"><joint name="swing" axis="0 1 0"/><geom fromto="0 0 0 0.05 0 0.1"/></body>
  </worldbody><equality><connect name="knuckle" body1="upper" body2="swing" anchor="0.2 0 0.1"/></equality></mujoco>"""
TIP = np.array([0.05, 0, 0.1])


def examined(folder, xml):
    exam = begin(str(write_model(folder, xml)), CheckOptions(budget=0.0, duration=0.05))
    for part in examine(exam):
        if part == "run":
            break
    return exam


def skeleton_of(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    return model, Skeleton(model, tuple(equalities(model)))


def poses_of(model, count=5):
    """Poses along a run, far from the model's own."""
    data, found = mujoco.MjData(model), []
    data.ctrl[:] = 0.5
    for _ in range(count):
        mujoco.mj_step(model, data, 150)
        found.append(data.qpos.copy())
    return np.array(found)


def lines_of(bone, name):
    return next(lines for body, lines in bone.bodies if body == name)


@pytest.mark.parametrize(("xml", "least"), [(SLIDER_CRANK, 0.01), (platform(), 0.01)])
def test_all_of_a_body_moves_with_it(xml, least):
    """Every line of a body is as long, and as far from its centre, at every pose as at the first."""
    model, bone = skeleton_of(xml)
    poses = poses_of(model)
    points, data = bone.read(poses), mujoco.MjData(model)
    moved = 0.0
    for name, lines in bone.bodies:
        body = model.body(name).id
        seen = []
        for at, pose in enumerate(poses):
            data.qpos[:] = pose
            mujoco.mj_kinematics(model, data)
            own = [points[at, end] for line in lines for end in line]
            seen.append([data.xmat[body].reshape(3, 3).T @ (point - data.xpos[body]) for point in own])
            moved = max(moved, float(np.abs(data.xpos[body] - model.body_pos[body]).max()))
        gap = np.ptp(np.array(seen), axis=0).max()
        assert gap <= SAME_POINT, name
    assert moved > least


def test_a_plate_on_slides_is_where_it_is():
    model, bone = skeleton_of(platform())
    poses = poses_of(model)
    points, data = bone.read(poses), mujoco.MjData(model)
    lines = lines_of(bone, "plate")
    (hub,) = {first for first, _ in lines}
    assert hub not in bone.grounded
    assert len(bone.grounded) == 3  # the arms' shoulders
    for at, pose in enumerate(poses):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(points[at, hub], data.body("plate").xpos, atol=SAME_POINT)
        ends = [points[at, end] for _, end in lines]
        sites = [data.site(f"corner{number}").xpos for number in range(3)]
        np.testing.assert_allclose(ends, sites, atol=SAME_POINT)
        # From the first rail's beginning along x, then along y, to the plate.
        (a, b), (c, d) = bone.rails
        np.testing.assert_allclose(
            points[at, [a, b, c, d]], [[0, 0, 0], [pose[6], 0, 0], [pose[6], 0, 0], [*pose[6:8], 0]]
        )
    assert np.linalg.norm(poses[:, 6:8], axis=1).max() > 0.02


def test_a_piston_is_on_its_rail():
    model, bone = skeleton_of(SLIDER_CRANK)
    poses = poses_of(model)
    points, data = bone.read(poses), mujoco.MjData(model)
    (hub, end), ((begin, slid),) = lines_of(bone, "piston")[0], bone.rails
    for at, pose in enumerate(poses):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(points[at, hub], data.body("piston").xpos + np.array([0.01, 0, 0]), atol=SAME_POINT)
        np.testing.assert_allclose(points[at, end], data.site("pin").xpos, atol=SAME_POINT)
        np.testing.assert_allclose(points[at, slid], points[at, hub], atol=SAME_POINT)
    assert np.ptp(points[:, begin], axis=0).max() <= SAME_POINT  # the rail stands
    assert np.ptp(points[:, hub, 0]) > 0.01


def test_an_anchor_in_the_air_is_no_end_of_a_link():
    model, bone = skeleton_of(APART)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    points = bone.read(model.qpos0[None])[0]
    ((_, end),) = lines_of(bone, "swing")
    ((tip, anchor),) = bone.air
    assert tip == end
    assert anchor == bone.loops[0][1]
    drawn = data.body("swing").xpos + TIP
    assert np.linalg.norm(points[tip] - drawn) <= 0.01 * np.sqrt(3)  # the capsule's round end, in its box
    gap = np.linalg.norm(drawn - (data.body("upper").xpos + np.array([0.2, 0, 0.1])))
    assert np.linalg.norm(points[tip] - points[anchor]) == pytest.approx(gap, abs=0.02)
    assert gap > 0.05
    # Drawn so that they meet, nothing is in the air.
    x, _, z = np.array([0.3, 0, 0.6]) - [0.35, 0, 0.4]
    assert skeleton_of(APART.replace("0 0 0 0.05 0 0.1", f"0 0 0 {x} 0 {z}"))[1].air == []


def test_the_gap_is_on_the_page(tmp_path):
    moving = motion(examined(tmp_path, APART))
    assert "in the air" in moving.caption
    frame = moving.sides["MuJoCo"][moving.worst]
    ((tip, anchor),) = moving.document()["air"]
    assert np.linalg.norm(frame[tip] - frame[anchor]) > 50  # of 1000 across
    x, y = frame[tip]
    assert f"M{x - 11} {y - 11}l22 22" in still(moving)


def test_the_sketch_of_a_case_is_true_too():
    model = mujoco.MjModel.from_xml_string(platform())
    poses = poses_of(model)
    drawn = sketch(model, poses[-1], poses)
    plate = next(body for body in drawn["bodies"] if body["name"] == "plate")
    data = mujoco.MjData(model)
    data.qpos[:] = poses[-1]
    mujoco.mj_kinematics(model, data)
    assert not plate["grounded"]
    np.testing.assert_allclose(plate["hub"], data.body("plate").xpos, atol=SAME_POINT)
    np.testing.assert_allclose(plate["points"][:3], [data.site(f"corner{n}").xpos for n in range(3)], atol=SAME_POINT)
    model = mujoco.MjModel.from_xml_string(APART)
    drawn = sketch(model, model.qpos0, model.qpos0[None])
    swing = next(body for body in drawn["bodies"] if body["name"] == "swing")
    far = [np.linalg.norm(np.array(point) - drawn["anchors"][1]) for point in swing["points"]]
    assert min(far) > 0.05


PIXEL = 1.5
"""Units of the drawing: two whole numbers are compared with a third."""


def test_geoms_are_drawn_where_their_bodies_are(tmp_path):
    """The rod of a slider crank: its capsule lies along the line from its joint to its end."""
    exam = examined(tmp_path, SLIDER_CRANK)
    moving = motion(exam)
    bone = moving.skeleton
    at = [name for name, _ in bone.bodies].index("rod")
    ((hub, end),) = bone.bodies[at][1]
    found = moving.solids["exact"]
    assert len(found) == len(moving.sides["exact"])
    for frame, parts in zip(moving.sides["exact"], found, strict=True):
        middles = [points.min(axis=0) + np.ptp(points, axis=0) / 2 for _, _, points in parts]
        wanted = 0.5 * (frame[hub] + frame[end])
        assert min(np.linalg.norm(middle - wanted) for middle in middles) < PIXEL
        length = np.linalg.norm(frame[hub] - frame[end])
        longest = max(np.linalg.norm(points[:, None] - points[None], axis=2).max() for _, _, points in parts)
        assert longest > length
    assert still(moving).count("<path") > still(dataclasses.replace(moving, solids={})).count("<path")


def test_too_many_geoms_are_left_out(tmp_path, monkeypatch):
    exam = examined(tmp_path, SLIDER_CRANK)
    monkeypatch.setattr(motions, "NUMBERS", 2_000)
    moving = motion(exam)
    assert moving.solids == {}
    assert all(side["solids"] == [] for side in moving.document()["sides"])
    assert "<svg" in still(moving)
