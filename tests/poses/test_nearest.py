"""The nearest closed pose, against an outside search: plain MuJoCo, a penalty, many random starts."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.optimize
from gallery import at_start
from oarlock import InputError, model_names
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.mechanics.load import load_model
from oarlock.poses.nearest import driven_joints, joints_called, nearest, outside_ranges
from places import FIXTURES
from tolerances import CLOSED

POSES, STARTS = 20, 50
NEAR = 1.05
"""By so much the correction may be longer than the best of the outside search."""

OPEN = 1e-4
"""rad, rows over their lengths. What the penalty leaves open at most, where it counts as closed."""

DISTURBED = 0.5
"""rad, and m on slides."""

CLOSING = ["damped_gripper", "dead_point", "thirty_equalities", "locked_cranks", "contacts", "tilted_hinge"]


class Outside:
    """The same question in plain MuJoCo: ½‖x‖² + ½ w ‖r‖² inside of bounds, w rising."""

    def __init__(self, model, given, arm, held=()):
        self.model, self.given = model, given
        self.model.opt.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_LIMIT
            | mujoco.mjtDisableBit.mjDSBL_CONTACT
            | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        )
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(model)
        kinds = model.jnt_type[model.dof_jntid]
        self.unit = np.where(kinds == mujoco.mjtJoint.mjJNT_SLIDE, arm, 1.0)
        self.turns = []
        self.bounds = np.tile([-np.inf, np.inf], (model.nv, 1))
        for joint in range(model.njnt):
            dof, at = model.jnt_dofadr[joint], model.jnt_qposadr[joint]
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                self.unit[dof : dof + 3] = arm
                self.turns.append(slice(dof + 3, dof + 6))
            elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
                self.turns.append(slice(dof, dof + 3))
            elif model.jnt_limited[joint]:
                self.bounds[dof] = (model.jnt_range[joint] - given[at]) / self.unit[dof]
            if joint in held:
                self.bounds[dof] = 0.0
        self.size = 1.0
        lengths = np.linalg.norm(self.rows(np.zeros(model.nv))[1], axis=1)
        self.size = np.maximum(lengths, 1e-2 * lengths.max(initial=0.0))

    def rows(self, x):
        pose = self.given.copy()
        mujoco.mj_integratePos(self.model, pose, x * self.unit, 1.0)
        self.data.qpos[:] = pose
        mujoco.mj_fwdPosition(self.model, self.data)
        count = self.data.ne
        jacobian = self.data.efc_J[: count * self.model.nv].reshape(count, self.model.nv) * self.unit
        for turn in self.turns:  # ∫ exp(−s[x]) ds: what a change of the rotation vector turns by
            a, b, c = x[turn]
            cross, term, whole = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]), np.eye(3), np.zeros((3, 3))
            for order in range(1, 30):
                whole, term = whole + term, term @ -cross / (order + 1)
            jacobian[:, turn] = jacobian[:, turn] @ whole
        jacobian, rest = [jacobian], [self.data.efc_pos[:count]]
        for tendon in np.flatnonzero(self.model.tendon_limited):  # beyond its range it counts as a row
            least, most = self.model.tendon_range[tendon]
            start, many = self.model.ten_J_rowadr[tendon], self.model.ten_J_rownnz[tendon]
            row = np.zeros((1, self.model.nv))
            row[0, self.model.ten_J_colind[start : start + many]] = self.data.ten_J[start : start + many]
            beyond = max(self.data.ten_length[tendon] - most, 0.0) - max(least - self.data.ten_length[tendon], 0.0)
            rest.append([beyond])
            jacobian.append(row * self.unit * (beyond != 0.0))
        jacobian, rest = np.vstack(jacobian), np.concatenate(rest)
        if np.ndim(self.size):
            return rest / self.size, jacobian / self.size[:, None]
        return rest, jacobian

    def search(self, begin):
        x = np.clip(begin, *self.bounds.T)
        for weight in (1e1, 1e3, 1e5, 1e7):

            def cost(x, weight=weight):
                rest, jacobian = self.rows(x)
                return 0.5 * (x @ x + weight * rest @ rest), x + weight * jacobian.T @ rest

            x = scipy.optimize.minimize(
                cost,
                x,
                jac=True,
                method="L-BFGS-B",
                bounds=self.bounds,
                options={"maxiter": 200, "maxcor": 30, "ftol": 1e-12, "gtol": 1e-6},
            ).x
        rest, _ = self.rows(x)
        return float(np.linalg.norm(x)) if np.abs(rest).max(initial=0.0) <= OPEN else np.inf

    def best(self, count, seed=1):
        rng = np.random.default_rng(seed)
        starts = [np.zeros(self.model.nv), *rng.normal(size=(count - 1, self.model.nv))]
        spread = [0.0, *rng.uniform(0.1, 1.5, count - 1)]
        return min(self.search(far * start) for far, start in zip(spread, starts, strict=True))


def disturbed(model, qpos, seed):
    pose = qpos.copy()
    mujoco.mj_integratePos(model, pose, np.random.default_rng(seed).uniform(-DISTURBED, DISTURBED, model.nv), 1.0)
    return pose


def model_at(name):
    """A model by its name in the gallery or among the fixtures, and a pose to disturb."""
    if name in model_names():
        _, model, start, _ = at_start(name)
        return model, start.qpos
    model = load_model(Path(FIXTURES / "check" / f"{name}.xml"))
    return model, model.key_qpos[0] if model.nkey else model.qpos0


def compare(name, poses, starts):
    """Ratios to the outside search; every pose is closed and inside, as plain MuJoCo sees it."""
    model, base = model_at(name)
    ratios = []
    for seed in range(poses):
        given = disturbed(model, base, seed)
        found = nearest(model, given)
        assert found is not None, (name, seed)
        data = mujoco.MjData(model)
        data.qpos[:] = found.qpos
        mujoco.mj_fwdPosition(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() <= CLOSED
        for joint in np.flatnonzero(model.jnt_limited):
            if model.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                least, most = model.jnt_range[joint]
                assert least <= found.qpos[model.jnt_qposadr[joint]] <= most, (name, seed, joint)
        best = Outside(load_again(name), given, found.arm).best(starts)
        ratios.append(found.norm / best)
    return ratios


def load_again(name):
    return model_at(name)[0]


QUICK = ["four_bar", "cable_finger", "gripping_gripper", "floating_four_bar"]


@pytest.mark.parametrize("name", QUICK)
def test_no_start_of_others_is_nearer(name):
    assert max(compare(name, 3, 6)) <= NEAR


@pytest.mark.slow
@pytest.mark.parametrize("name", [*model_names(), *CLOSING])
def test_no_start_of_many_others_is_nearer(name):
    ratios = compare(name, POSES, STARTS)
    print(f"{name:22s} {max(ratios):.4f}")
    assert max(ratios) <= NEAR


# What is to stay.

LEG = """<mujoco><compiler angle="degree"/><default><geom type="capsule" size="0.01" mass="{mass}"/>
  <joint axis="0 1 0"/></default>
  <worldbody><body name="link" pos="0 0 1"><joint name="hip"/><geom fromto="0 0 0 0 0 -0.3"/>
    <body pos="0 0 -0.3"><joint name="knee" range="-150 -20"/><geom fromto="0 0 0 0.08 0 -0.3"/>
      <site name="heel" pos="0.08 0 -0.3"/></body>
    <body name="horn" pos="0.06 0 0"><joint name="horn" range="-40 50"/><geom fromto="0 0 0 0.05 0 0" mass="0.01"/>
      <body pos="0.05 0 0"><joint name="rod"/><geom fromto="0 0 0 0 0 -0.4" mass="0.01"/>
        <site name="end" pos="0 0 -0.42"/></body></body></body></worldbody>
  <equality><connect name="ankle" site1="heel" site2="end"/></equality>
  <actuator><position joint="horn" kp="40"/></actuator></mujoco>"""
GIVEN = np.array([0.2, -1.2, 0.3, 0.1])


def leg(mass=0.5):
    return mujoco.MjModel.from_xml_string(LEG.format(mass=mass))


def test_light_links_are_not_flung():
    """The same pose whatever the links weigh."""
    found = [nearest(leg(mass), GIVEN) for mass in (0.05, 50.0)]
    np.testing.assert_allclose(found[0].qpos, found[1].qpos, atol=CLOSED)
    best = Outside(leg(), GIVEN, found[0].arm).best(20)
    assert found[0].norm == pytest.approx(best, rel=1e-5)
    assert found[0].qpos[0] == GIVEN[0]  # the hip carries the loop and has no part in it


def test_a_joint_that_is_held_stays_bit_for_bit():
    model = leg()
    free, held = nearest(model, GIVEN), nearest(model, GIVEN, held=joints_called(model, ("horn",)))
    assert held.qpos[2] == GIVEN[2] != free.qpos[2]
    assert held.held == ("horn",)
    assert free.norm < held.norm == pytest.approx(Outside(leg(), GIVEN, held.arm, held=(2,)).best(10), rel=1e-5)
    assert driven_joints(model) == (2,)


def test_what_cannot_be_held_or_is_none():
    model = leg()
    assert nearest(model, GIVEN, held=joints_called(model, ("knee", "horn", "rod"))) is None
    with pytest.raises(InputError, match="unknown joint to hold 'toe', expected one of: hip, knee, horn, rod"):
        joints_called(model, ("toe",))


def test_ranges_are_kept_and_named():
    model = leg()
    given = np.array([0.0, -2.9, 0.6, 0.0])
    assert [(one.limit, one.by) for one in outside_ranges(model, given)] == [
        ("limit of joint 'knee'", pytest.approx(2.9 - np.radians(150))),
    ]
    found = nearest(model, given)
    assert outside_ranges(model, found.qpos) == ()
    free = nearest(model, given, limits=False)
    assert free.norm < found.norm
    assert outside_ranges(model, free.qpos)


def test_a_closed_group_stays_beside_an_open_one():
    """Two coupled slides that share nothing with the leg: of them no bit changes."""
    slides = "".join(
        f'<body name="s{n}" pos="1 0 0"><joint name="s{n}" type="slide"/><geom type="sphere" size="0.1"/></body>'
        for n in (1, 2)
    )
    xml = LEG.format(mass=0.5).replace("</worldbody>", f"{slides}</worldbody>")
    xml = xml.replace("<equality>", '<equality><joint joint1="s1" joint2="s2" polycoef="0 0.3 0 0 0"/>')
    model = mujoco.MjModel.from_xml_string(xml)
    place = 0.1 + 1e-9  # not quite a float's multiple
    found = nearest(model, np.array([*GIVEN, 0.3 * place, place]), tolerance=1e-6)
    assert found.qpos[4:].tolist() == [0.3 * place, place]
    np.testing.assert_allclose(found.qpos[:4], nearest(leg(), GIVEN).qpos, atol=CLOSED)


# As ``check`` asks it.


def test_driven_joints_are_held_where_the_rest_can_close():
    model = leg()
    pose = nearest_closed(model, GIVEN, hold=None)
    assert (pose.held, pose.released) == (("horn",), ())
    assert pose.qpos[2] == GIVEN[2]
    assert pose.norm_free == pytest.approx(nearest(model, GIVEN).norm)
    assert pose.norm_free < pose.norm == pytest.approx(nearest(model, GIVEN, held=(2,)).norm)
    free = nearest_closed(model, GIVEN)
    assert (free.held, free.norm_free) == ((), free.norm)


def test_driven_joints_are_let_go_where_nothing_closes_else():
    drives = "".join(f'<motor joint="{name}"/>' for name in ("knee", "rod"))
    model = mujoco.MjModel.from_xml_string(LEG.format(mass=0.5).replace("<actuator>", f"<actuator>{drives}"))
    pose = nearest_closed(model, GIVEN, hold=None)
    assert pose.closed
    assert (pose.held, set(pose.released)) == ((), {"knee", "rod", "horn"})
    with pytest.raises(InputError, match="no pose closes the loops with 'knee', 'rod' and 'horn' held"):
        nearest_closed(model, GIVEN, hold=("knee", "rod", "horn"))


def test_a_closed_start_beyond_a_range_stays_and_is_named():
    model = leg()
    closed = nearest(model, np.array([0.0, -2.9, 0.6, 0.0]), limits=False).qpos
    pose = nearest_closed(model, closed, hold=None)
    np.testing.assert_array_equal(pose.qpos, closed)
    assert pose.status == "consistent"
    assert [one.limit for one in pose.rested] == [one.limit for one in outside_ranges(model, closed)] != []
    assert pose.outside == pose.rested


def test_limits_that_cannot_be_kept_are_named():
    """The ankle closes only with a knee that bends further than it may."""
    model = mujoco.MjModel.from_xml_string(LEG.format(mass=0.5).replace('"-150 -20"', '"-150 -149"'))
    pose = nearest_closed(model, GIVEN)
    assert pose.closed
    assert nearest(model, GIVEN) is None
    assert [one.limit for one in pose.outside] == ["limit of joint 'knee'"]
    assert pose.norm == pytest.approx(nearest(model, GIVEN, limits=False).norm)


ROPED = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="a"><joint name="a" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/><site name="tip" pos="0.6 0 0"/>
    <body name="ball" pos="0.6 0 0"><joint name="ball" type="ball" range="0 0.5"/><geom size="0.1"/></body>
  </body>
  <body name="b" pos="2 0 0"><joint name="b" axis="0 1 0"/><geom size="0.1" pos="0.1 0 0"/></body>
  <body name="hand" mocap="true" pos="0 0 1"><site name="hook"/></body></worldbody>
  <tendon><fixed name="sum" limited="true" range="-0.2 0.3"><joint joint="a" coef="1"/>
    <joint joint="b" coef="1"/></fixed>
    <spatial name="rope" limited="true" range="0 1.5"><site site="hook"/><site site="tip"/></spatial></tendon>
  <equality><joint joint1="a" joint2="b"/></equality></mujoco>"""


@pytest.mark.parametrize("lift", [0.0, 0.7])
def test_ranges_of_tendons_and_balls_are_named_too(lift):
    """By lengths that plain MuJoCo has, and the angle of a quaternion; the mocap body stands where the data has it."""
    model = mujoco.MjModel.from_xml_string(ROPED)
    data = mujoco.MjData(model)
    data.mocap_pos[0, 2] += lift
    ball = 0.8
    data.qpos[:] = [0.25, np.cos(ball / 2), np.sin(ball / 2), 0, 0, 0.25]
    mujoco.mj_forward(model, data)
    beyond = {"limit of joint 'ball'": ball - 0.5, "limit of tendon 'sum'": data.ten_length[0] - 0.3}
    if data.ten_length[1] > 1.5:
        beyond["limit of tendon 'rope'"] = data.ten_length[1] - 1.5
    assert len(beyond) == (3 if lift else 2)
    found = nearest_closed(model, data.qpos, data=data).outside
    assert {one.limit: one.by for one in found} == pytest.approx(beyond, abs=CLOSED)
    assert [one.by for one in found] == sorted((one.by for one in found), reverse=True)
    assert outside_ranges(model, np.array([0.1, 1, 0, 0, 0, 0.1])) == ()


def test_the_command_holds_joints(oarlock_here, tmp_path):
    path = tmp_path / "leg.xml"
    key = f'<keyframe><key qpos="{" ".join(map(str, GIVEN))}" ctrl="0.3"/></keyframe>'
    path.write_text(LEG.format(mass=0.5).replace("</mujoco>", f"{key}</mujoco>"), encoding="utf-8")
    common = ("check", path, "--budget", "0", "--duration", "0.05")
    for asked, moves, words in (
        ((), "horn", "with 'horn' held; with nothing held"),
        (("--hold", "none"), None, "It is the nearest inside of all ranges"),
        (("--hold", "knee"), "knee", "with 'knee' held"),
    ):
        said = oarlock_here(*common, *asked, "--write-keyframe", "closed.xml")
        assert said.returncode == 0
        assert words in " ".join(said.stdout.split())
        written = load_model(tmp_path / "closed.xml")
        pose = dict(zip(("hip", "knee", "horn", "rod"), written.key_qpos[-1], strict=True))
        still = [name for name, value in zip(pose, GIVEN, strict=True) if pose[name] == value]
        assert still == ["hip"] if moves is None else moves in still
    said = oarlock_here(*common, "--hold", "toe")
    assert said.returncode == 2
    assert "unknown joint to hold 'toe'" in said.stderr


def test_one_start_gives_the_same_bits_again():
    model, base = model_at("five_bar")
    given = disturbed(model, base, 3)
    np.testing.assert_array_equal(nearest(model, given).qpos, nearest(model, given).qpos)


@pytest.mark.parametrize("far", [1e9, 1e160, 1e300])
def test_a_start_out_of_this_world_ends_without_a_word(far):
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body><joint type="slide" axis="1 0 0"/>
      <geom type="sphere" size="0.1"/><site name="a"/></body><site name="b" pos="1 0 0"/></worldbody>
      <equality><connect site1="a" site2="b"/></equality></mujoco>""")
    found = nearest(model, np.array([far]))
    assert found is None or found.qpos[0] == pytest.approx(1.0)
