"""Consistent starts: found, left alone, or refused with the name of what is in the way."""

import boat_paper as paper
import mujoco
import numpy as np
import pytest
from mechanisms import boat_with, case_of, four_bar, write_model
from oarlock import InputError, load_case
from oarlock.cases.point import DISTURBANCE
from oarlock.mechanics.inequalities import row_name
from oarlock.mechanics.load import load_model
from oarlock.mechanics.prepare import load_mechanism
from oarlock.mechanics.rows import jacobian
from oarlock.stepping.start import consistent_start
from tolerances import CLOSED, START_UNCHANGED


def started(case):
    """The start of a case, and MuJoCo's own view of it."""
    model = load_mechanism(case, integrator="rk4")
    start = consistent_start(model, case)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    mujoco.mj_forward(model, data)
    return start, data


def four_bar_case(tmp_path, start=None, **changes):
    return case_of(write_model(tmp_path, four_bar(**changes)), start=start or {})


def test_consistent_start_is_left_alone():
    case = load_case("boat")
    start, data = started(case)
    assert start.moved <= START_UNCHANGED
    assert np.abs(start.qpos - list(case.file.start.qpos.values())).max() <= START_UNCHANGED
    assert not start.qvel.any()
    assert np.abs(data.efc_pos).max() <= CLOSED
    assert (start.rows, start.rank, start.dof) == (6, 4, 1)


@pytest.mark.parametrize("seed", range(10))
def test_disturbed_start_is_closed(seed):
    rng = np.random.default_rng(seed)
    joints = list(load_case("boat").file.start.qpos)
    qpos = {joint: paper.START[index] + rng.uniform(-0.3, 0.3) for index, joint in enumerate(joints)}
    qvel = {joint: rng.normal() for joint in joints}
    start, data = started(boat_with(start={"qpos": qpos, "qvel": qvel}))
    assert start.moved > 0.01
    assert np.abs(data.efc_pos).max() <= CLOSED
    assert np.abs(data.efc_vel).max() <= CLOSED
    assert np.abs(start.qvel).max() > 1e-3  # not closed by standing still
    assert (start.rank, start.dof) == (4, 1)


def test_projected_velocity_is_the_nearest_in_kinetic_energy():
    """v − v₀ is M-orthogonal to every velocity that the constraints admit."""
    start, data = started(boat_with(start={**load_case("boat").file.start.model_dump(), "qvel": {"crank": 1.0}}))
    model = load_mechanism(load_case("boat"), integrator="rk4")
    mass = np.zeros((5, 5))
    mujoco.mj_fullM(model, data, mass)
    rows = jacobian(model, data)
    admissible = np.linalg.svd(rows)[2][4:]
    assert np.abs(rows @ admissible.T).max() <= CLOSED
    assert np.abs(admissible @ mass @ (start.qvel - [1, 0, 0, 0, 0])).max() <= 10 * CLOSED  # masses of 13 kg m²


def test_consistent_velocity_is_left_alone():
    qpos = load_case("boat").file.start.qpos
    start, data = started(boat_with(start={"qpos": qpos, "qvel": {"crank": 1.0}}))
    assert np.abs(data.efc_vel).max() <= CLOSED
    qvel = dict(zip(qpos, start.qvel.tolist(), strict=True))
    again, _ = started(boat_with(start={"qpos": qpos, "qvel": qvel}))
    np.testing.assert_array_equal(again.qvel, start.qvel)


KEY = '<keyframe><key name="{}" qpos="0.1 0.2 0.3" qvel="1 0 0"/></keyframe>'


def test_keyframe_is_the_start(tmp_path):
    """Under its own name only, entries of [start] on top, and closed like any other start."""
    path = write_model(tmp_path, four_bar(rest=KEY.format("start")))
    start, data = started(case_of(path))
    asked, _ = started(case_of(path, start={"qpos": dict(zip(JOINTS, [0.1, 0.2, 0.3], strict=True)), "qvel": MOVING}))
    np.testing.assert_array_equal(start.qpos, asked.qpos)
    np.testing.assert_array_equal(start.qvel, asked.qvel)
    assert np.abs(data.efc_vel).max() <= CLOSED
    assert start.moved > 0.01
    still, _ = started(case_of(path, start={"qvel": {"crank": 0.0}}))
    assert not still.qvel.any()
    other, _ = started(case_of(write_model(tmp_path, four_bar(rest=KEY.format("home")))))
    assert not other.qpos.any()


def test_unclosable_loop_is_named_with_its_gap(tmp_path):
    """The tips are 0.85 m and 0.54 m from pivots that are 5 m apart: at least 3.6 m stay open."""
    with pytest.raises(InputError, match=r"equality 'pin' stays open by 3\.6\d") as raised:
        started(four_bar_case(tmp_path, pivot="5 0 0"))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("kind", ["qpos", "qvel"])
def test_unknown_joint_lists_the_joints(tmp_path, kind):
    with pytest.raises(InputError, match=rf"joint in \[start\] {kind} .*'crnk'.* crank, coupler, rocker"):
        started(four_bar_case(tmp_path, start={kind: {"crnk": 0.1}}))


@pytest.mark.parametrize(("value", "count"), [([0.1, 0.2], 2), ([], 0)])
def test_wrong_size_names_both_sizes(tmp_path, value, count):
    with pytest.raises(InputError, match=rf"joint 'crank' .* has {count} numbers, expected 1"):
        started(four_bar_case(tmp_path, start={"qpos": {"crank": value}}))


def test_ball_joints_take_four_and_three_numbers(tmp_path):
    xml = """<mujoco><worldbody><body name="bob"><joint name="ball" type="ball"/><geom size="0.1" pos="0 0 1"/>
      </body></worldbody><equality><connect body1="bob" anchor="0 0 1"/></equality></mujoco>"""
    path = write_model(tmp_path, xml)
    half = np.sqrt(0.5)
    start, data = started(case_of(path, start={"qpos": {"ball": [half, 0, 0, half]}, "qvel": {"ball": [0, 0, 1]}}))
    assert np.abs(data.efc_pos).max() <= CLOSED
    assert start.dof == 1
    with pytest.raises(InputError, match=r"'ball' .* has 3 numbers, expected 4"):
        started(case_of(path, start={"qpos": {"ball": [1, 0, 0]}}))
    with pytest.raises(InputError, match=r"'ball' .* has 4 numbers, expected 3"):
        started(case_of(path, start={"qvel": {"ball": [1, 0, 0, 0]}}))


def test_all_equalities_off(tmp_path):
    path = write_model(tmp_path, four_bar().replace('name="pin"', 'name="pin" active="false"'))
    with pytest.raises(InputError, match=r"no active equality rows at the start .*pin"):
        started(case_of(path))


def test_disabled_equalities(tmp_path):
    path = write_model(tmp_path, four_bar(rest='<option><flag equality="disable"/></option>'))
    with pytest.raises(InputError, match=r"no active equality rows at the start"):
        started(case_of(path))


JOINTS, MOVING = ["crank", "coupler", "rocker"], {"crank": 1.0}
HAND = '<geom name="hand" type="sphere" size="0.1" contype="1" conaffinity="1"/>'
WALL = """<worldbody>
  <geom name="wall" type="sphere" size="0.1" pos="0 0 0.3" contype="1" conaffinity="1"/></worldbody>"""
CORD = """<tendon><spatial name="cord" {}><site site="tip1"/><site site="peg"/></spatial></tendon>
  <worldbody><site name="peg" pos="0 0 2"/></worldbody>"""


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"rocker": 'range="0.1 1"'}, "limit of joint 'rocker'"),
        ({"rocker": 'frictionloss="0.1"'}, "friction of joint 'rocker'"),
        ({"body": HAND, "rest": WALL}, "contact between geom 'wall' and geom 'hand'"),
        (
            {"body": HAND.replace('name="hand"', ""), "rest": WALL.replace('name="wall"', "")},
            "contact between the world and body 'coupler'",
        ),
        ({"rest": CORD.format('range="0 1"')}, "limit of tendon 'cord'"),
        ({"rest": CORD.format('frictionloss="1"')}, "friction of tendon 'cord'"),
    ],
)
def test_a_start_may_have_other_rows_which_have_names(tmp_path, changes, name):
    case = four_bar_case(tmp_path, **changes)
    start, data = started(case)
    assert (start.rows, start.rank) == (3, 2)
    model = load_model(case.model_path)
    assert data.nefc > data.ne
    assert {row_name(model, data, row) for row in range(data.ne, data.nefc)} == {name}


@pytest.mark.parametrize("seed", range(8))
def test_limits_are_never_taken_for_loops(tmp_path, seed):
    """A limit that becomes active while the loop is being closed is not counted as a row of the loop."""
    rng = np.random.default_rng(seed)
    low, high = rng.uniform(-0.2, -0.01), rng.uniform(0.01, 0.2)
    angles = {"crank": rng.uniform(-1, 1), "coupler": rng.uniform(-1, 1)}
    case = four_bar_case(tmp_path, start={"qpos": angles}, rocker=f'range="{low} {high}" margin="0.01"')
    start, data = started(case)
    assert (start.rows, start.rank, start.dof) == (3, 2, 1) == (data.ne, 2, 1)
    assert np.abs(data.efc_pos[: data.ne]).max() <= CLOSED


def test_drive_without_a_value_at_the_start():
    case = boat_with(drive={"ctrl": {"motor_angle": "sqrt(t - 1)"}})
    with pytest.raises(InputError, match=r"sqrt\(t - 1\).* at t = 0 s, expected a finite control"):
        started(case)


def test_unknown_actuator_lists_the_actuators():
    with pytest.raises(InputError, match=r"actuator in \[drive\] .*'motor'.* motor_angle, motor_speed"):
        started(boat_with(drive={"ctrl": {"motor": "1"}}))


# Disturbed by a seed.


def test_a_seed_disturbs_a_start_and_leaves_it_consistent():
    """Of a model with a free joint: a quaternion stays one."""
    case = load_case("floating_four_bar")
    model = load_mechanism(case, integrator="rk4")
    own = consistent_start(model, case)
    found = [consistent_start(model, case, seed) for seed in (0, 1, 1)]
    np.testing.assert_array_equal(found[1].qpos, found[2].qpos)
    np.testing.assert_array_equal(found[1].qvel, found[2].qvel)
    data = mujoco.MjData(model)
    (free,) = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    quaternion = slice(model.jnt_qposadr[free] + 3, model.jnt_qposadr[free] + 7)
    for start, other in ((found[0], own), (found[1], own), (found[0], found[1])):
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos).max() <= CLOSED
        assert np.abs(data.efc_vel).max() <= CLOSED
        assert abs(np.linalg.norm(start.qpos[quaternion]) - 1.0) <= CLOSED
        assert 1e-3 < np.abs(start.qpos - other.qpos).max() < 10 * DISTURBANCE
        assert 1e-3 < np.abs(start.qvel - other.qvel).max() < 10 * DISTURBANCE
