"""What a run does besides drifting: each finding beside plain MuJoCo, and beside the same model without its cause."""

import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from oarlock.diagnosis import examination
from oarlock.diagnosis.options import usual_target
from oarlock.diagnosis.runs.exact import record_exact
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.mechanics.load import collected_warnings
from places import FIXTURES
from tolerances import CLOSED, SAME_RUN

CHECK = FIXTURES / "check"

LIMIT = 1e-6
"""rad. A limit is found by steps down to 1e-9, and its angle is as the square root of what a loop closes to."""

ROUNDED = 0.5e-3
"""Relative. Figures of a line have four digits."""


def findings(file: Path | str, **options) -> dict[str, Finding]:
    return {one.code: one for one in oarlock.check(file, **options).verdict}


def plain(
    file: Path | str, change=None, key: int | None = 0, duration_s: float = 2.0
) -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """A run of MuJoCo alone: the model, coordinates and deviations of its first equality's rows at every step."""
    model = mujoco.MjModel.from_xml_path(str(file))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if change is not None:
        change(model)
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    poses, rows = [], []
    with collected_warnings():
        for _ in range(round(duration_s / model.opt.timestep)):
            poses.append(data.qpos.copy())
            mujoco.mj_step(model, data)
            rows.append(data.efc_pos[: data.ne][data.efc_id[: data.ne] == 0].copy())
    return model, np.array(poses), np.array(rows)


def written(tmp_path: Path, name: str, *changes: tuple[str, str]) -> Path:
    """A fixture with some of its text changed."""
    text = (CHECK / name).read_text()
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    file = tmp_path / name
    file.write_text(text)
    return file


# Dead points.


def test_a_motor_tears_a_linkage_at_its_dead_point():
    """Where coupler and follower lie in a line, by the law of cosines."""
    found = findings(CHECK / "torn_linkage.xml", budget=0)
    one = found["U4"]
    assert (one.severity, one.element, one.figures["joint"]) == ("error", "joined", "input")
    reach = math.hypot(0.35, 0.1) + math.hypot(0.2, 0.3)
    angle = math.acos((0.2**2 + 0.55**2 - reach**2) / (2 * 0.2 * 0.55))
    assert one.figures["limit"] == pytest.approx(math.pi / 2 - angle, abs=LIMIT)
    _, poses, rows = plain(CHECK / "torn_linkage.xml")
    assert one.figures["furthest"] == pytest.approx(float(poses[:, 0].min()), rel=SAME_RUN)
    assert one.figures["torn"] == pytest.approx(float(np.linalg.norm(rows, axis=1).max()), rel=SAME_RUN)
    assert not found.keys() & {"D1", "D3", "D4", "E1"}  # what is torn drifts for no other reason


def test_it_is_named_first():
    assert oarlock.check(CHECK / "torn_linkage.xml", budget=0).verdict[0].code == "U4"


def test_a_weak_motor_turns_back_with_it(tmp_path):
    file = written(tmp_path, "torn_linkage.xml", ('gear="160"', 'gear="0.5"'))
    assert "U4" not in findings(file, budget=0)
    _, poses, _ = plain(file)
    assert poses[:, 0].min() > -1.3


# Branches.


def _side(file: Path, pose: np.ndarray) -> float:
    """On which side of a line coupler and rocker of a four-bar are: the sign of the sine between them."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.qpos[:] = pose
    mujoco.mj_forward(model, data)
    joint, pin = data.xanchor[1], data.xpos[2] + data.xmat[2].reshape(3, 3) @ model.eq_data[0, :3]
    coupler, rocker = pin - joint, pin - data.xanchor[2]
    return float(np.sign(np.cross(coupler, rocker)[1]))


def test_a_soft_loop_steps_over_to_another_branch():
    """The exact four-bar never has coupler and rocker in a line; MuJoCo's goes through one."""
    file = CHECK / "dead_point.xml"
    checked = oarlock.check(file, budget=0)
    one = next(one for one in checked.verdict if one.code == "U5")
    exact = checked.examination.exact
    assert exact is not None
    assert len({_side(file, pose) for pose in exact.qpos[::40]}) == 1
    _, poses, _ = plain(file, key=None)
    place = round(one.figures["time_s"] / 0.001)
    assert {_side(file, pose) for pose in poses[place - 60 : place - 20 : 10]} == {_side(file, exact.qpos[0])}
    assert {_side(file, pose) for pose in poses[place + 20 : place + 100 : 10]} == {-_side(file, exact.qpos[0])}


PARALLELOGRAM = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="a"/><geom fromto="0 0 0 0 0 0.3"/>
      <body name="bar" pos="0 0 0.3"><joint name="b"/><geom fromto="0 0 0 0.7 0 0"/></body></body>
    <body name="other" pos="0.7 0 0"><joint name="c"/><geom fromto="0 0 0 0 0 0.3"/></body>
  </worldbody>
  <equality><connect name="pin" body1="bar" body2="other" anchor="0.7 0 0"/></equality>
  <keyframe><key qvel="2.5 -2.5 2.5"/></keyframe>
</mujoco>
"""


def test_going_straight_through_a_flat_parallelogram_is_the_same_branch(tmp_path):
    """MuJoCo's motion and the exact one are both reversed there, and stay parallelograms."""
    file = tmp_path / "parallelogram.xml"
    file.write_text(PARALLELOGRAM)
    checked = oarlock.check(file, budget=0)
    codes = {one.code for one in checked.verdict}
    assert "L5" in codes
    assert next(one for one in checked.verdict if one.code == "L5").line.startswith("rank 2 falls to 1 at t = ")
    assert "U5" not in codes
    exact = checked.examination.exact
    assert exact is not None
    for poses in (plain(file)[1], exact.qpos):
        assert np.abs(poses[:, 0] - poses[:, 2]).max() < 0.01


def test_a_run_that_diverges_is_on_no_branch(tmp_path):
    """Direct stiffness and damping that the timestep does not bear: where it was last is beyond any branch."""
    text = SPUN.replace("GEAR", "2").replace('timestep="0.001"', 'timestep="0.005"')
    file = tmp_path / "stiff.xml"
    file.write_text(text.replace("<connect ", '<connect solref="-100000 -1000" '))
    checked = oarlock.check(file, budget=0)
    codes = {one.code for one in checked.verdict}
    assert checked.examination.branch is not None
    assert "R1" in codes
    assert "U5" not in codes


def test_a_joint_without_a_name_is_called_by_its_body_once(tmp_path):
    text = (
        SPUN.replace("GEAR", "8")
        .replace('<joint name="wrist"/>', "<joint/>")
        .replace('name="rocker"/><geom', "/><geom")
    )
    text = text.replace('<motor name="weak" joint="rocker" gear="0.01"/>', "").replace("0.5 -0.5 0.5", "0.5 0.5")
    file = tmp_path / "nameless.xml"
    file.write_text(text)
    assert findings(file, budget=0)["D8"].line.startswith("joint of 'r")


# Steps that are too long.


def test_a_fast_crank_turns_too_far_within_a_step(tmp_path):
    found = findings(CHECK / "fast_crank.xml", budget=0)
    assert found["D8"].figures["bound"] == pytest.approx(0.1)
    assert found["D8"].figures["per_step"] > 0.22
    assert found["D3"].figures["part"] > 0.5
    assert "D8" not in findings(CHECK / "fast_crank.xml", budget=0, integrator="rk4")
    slow = written(tmp_path, "fast_crank.xml", ("110 -110 36.666666666666664", "11 -11 3.6666666666666665"))
    assert "D8" not in findings(slow, budget=0)


SPUN = """
<mujoco>
  <option timestep="0.001" gravity="0 0 0"/>
  <default><joint axis="0 1 0" damping="0.02"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="crank"/><geom fromto="0 0 0 0 0 0.1"/>
      <body name="rod" pos="0 0 0.1"><joint name="wrist"/><geom fromto="0 0 0 0.4 0 0.1"/></body></body>
    <body name="rocker" pos="0.4 0 0"><joint name="rocker"/><geom fromto="0 0 0 0 0 0.2"/></body>
    <body pos="0 1 0"><joint name="other"/><geom fromto="0 0 0 0 0 9" mass="9"/></body>
  </worldbody>
  <equality><connect name="pin" body1="rod" body2="rocker" anchor="0.4 0 0.1"/></equality>
  <actuator>
    <motor name="weak" joint="rocker" gear="0.01"/>
    <motor name="spin" joint="crank" gear="GEAR"/>
    <motor name="elsewhere" joint="other" gear="500"/>
  </actuator>
  <keyframe><key ctrl="0.5 -0.5 0.5"/></keyframe>
</mujoco>
"""


def test_what_spins_a_loop_is_named_with_its_torque(tmp_path):
    file = tmp_path / "spun.xml"
    file.write_text(SPUN.replace("GEAR", "8"))
    one = findings(file, budget=0)["D8"]
    assert one.line.endswith("; motor 'spin' gives up to 4 N m")
    assert one.figures["force"] == pytest.approx(4.0)
    file.write_text(SPUN.replace("GEAR", "0.08"))
    assert "D8" not in findings(file, budget=0)


@pytest.mark.parametrize("lost", ["open", "not known"])
def test_a_lost_exact_run_tells_nothing_of_a_motion(tmp_path, monkeypatch, lost):
    """MuJoCo's run turns slowly; an exact one that left its constraints, or its own estimate, turns fast."""
    file = tmp_path / "spun.xml"
    file.write_text(SPUN.replace("GEAR", "0.08"))

    def record_lost(*given, **options):
        run = record_exact(*given, **options)
        after = run.time > run.time[-1] / 2
        wild = run.qpos + np.where(after, np.arange(len(run.time)), 0.0)[:, None]
        if lost == "open":
            return replace(run, qpos=wild, drift=run.drift + np.where(after, 0.1, 0.0)[:, None])
        return replace(run, qpos=wild, error=np.where(after, np.inf, run.error))

    trusted = oarlock.check(file, budget=0)
    assert trusted.examination.exact is not None
    monkeypatch.setattr(examination, "record_exact", record_lost)
    checked = oarlock.check(file, budget=0, target=1e-9)
    _, poses, _ = plain(file)
    most = float(np.abs(np.diff(poses, axis=0)).max() / 0.001)
    assert checked.examination.pace.rate == pytest.approx(most, rel=SAME_RUN)
    assert "D8" not in {one.code for one in checked.verdict}
    assert checked.examination.exact is None
    assert not checked.examination.determined
    said = {"open": "it stands open by 0.1 m or rad", "not known": "a walk at half the timestep goes elsewhere"}
    assert said[lost] in checked.examination.missing["exact"]


def test_the_share_of_time_stepping_is_what_a_quarter_of_the_timestep_leaves():
    found = findings(CHECK / "fast_crank.xml", budget=0)

    def finer(model):
        model.opt.timestep /= 4

    whole, quarter = (np.linalg.norm(plain(CHECK / "fast_crank.xml", change)[2], axis=1) for change in (None, finer))
    worst = int(whole.argmax())
    left = quarter[::4][max(0, worst - 20) : worst + 21].max()  # 2 % of 1000 steps
    assert found["D3"].figures["part"] == pytest.approx(1 - left / whole[worst], abs=1e-9)


# What lasts.


def _angle(poses: np.ndarray) -> float:
    """Median angle of a free body to the world over the last quarter of a run."""
    last = poses[-len(poses) // 4 :, 3:7]
    return float(np.median(2 * np.arccos(np.minimum(1.0, np.abs(last[:, 0]) / np.linalg.norm(last, axis=1)))))


def test_a_load_tilts_what_a_mocap_body_carries_for_good():
    found = findings(CHECK / "carried_tray.xml", budget=0)
    one = found["S4"]
    assert one.element == "grip"
    assert 'torquescale="5"' in one.line

    def scaled(model):
        model.eq_data[0, 10] *= 5

    as_given, helped = (_angle(plain(CHECK / "carried_tray.xml", change, None)[1]) for change in (None, scaled))
    assert one.figures["left"] == pytest.approx(as_given, rel=1e-3)
    assert one.figures["after"] == pytest.approx(helped, rel=1e-3)
    assert found["S1"].severity == "warning"


LEVERS = """
<mujoco>
  <option timestep="0.002"/>
  <default>
    <joint axis="0 1 0" damping="0.05"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <body><joint name="hand" stiffness="40"/><geom fromto="0 0 0 0.2 0 0" mass="0.1"/></body>
    <body pos="0 0.2 0"><joint name="arm"/><geom fromto="0 0 0 0.3 0 0" mass="0.1"/>
      <geom type="sphere" size="0.03" pos="0.3 0 0" mass="3"/></body>
  </worldbody>
  <equality><joint name="gear" joint1="arm" joint2="hand"/></equality>
  <keyframe><key qpos="0 -0.3"/></keyframe>
</mujoco>
"""


def test_a_coupling_that_sags_is_no_matter_of_its_offset(tmp_path):
    """Two levers geared 1:1; the second carries a weight. An offset against that would be wrong with another weight."""
    file = tmp_path / "levers.xml"
    file.write_text(LEVERS)
    one = findings(file, budget=0)["S4"]
    poses = plain(file)[1]
    assert one.figures["left"] == pytest.approx(abs(float(np.median(poses[-250:, 1] - poses[-250:, 0]))), rel=1e-3)
    assert "polycoef" not in one.line


JAWS = """
<mujoco>
  <compiler autolimits="true"/>
  <option timestep="0.002"/>
  <default><joint type="slide" axis="1 0 0" damping="20"/>
    <geom size="0.02" mass="0.5" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="near" range="-0.1 0.1"/><geom/></body>
    <body pos="0 0.3 0"><joint name="far" range="-0.1 0.1"/><geom/></body>
  </worldbody>
  <equality><joint name="together" joint1="far" joint2="near" polycoef="0.6 0.5 0 0 0"/></equality>
  <actuator><position joint="near" kp="50" kv="5"/></actuator>
  <keyframe><key qpos="0.02 0.05" ctrl="0.02"/></keyframe>
</mujoco>
"""


def test_an_offset_that_opens_the_start_is_set_to_what_closes_it(tmp_path):
    """Their ranges hold the jaws off: the coupling is drawn 40 mm beside its leader, and 600 mm is written."""
    file = tmp_path / "jaws.xml"
    file.write_text(JAWS)
    found = findings(file, budget=0)
    one = found["S4"]
    wanted = [float(number) for number in one.figures["value"].split()]
    assert wanted == pytest.approx([0.04, 0.5, 0.0, 0.0, 0.0])

    def mended(model):
        model.eq_data[0, :5] = wanted

    rows = plain(file, mended)[2]
    assert abs(rows[0, 0]) < CLOSED
    assert one.figures["after"] == pytest.approx(abs(float(np.median(rows[-250:]))), abs=CLOSED)
    assert "C3" not in found
    assert found["S1"].severity == "note"
    assert next(iter(found)) == "S4"


def test_an_open_start_that_fades_is_only_that(tmp_path):
    file = written(tmp_path, "carried_tray.xml", ('timestep="0.002"', 'timestep="0.002" gravity="0 0 0"'))
    found = findings(file, budget=0)
    assert "S1" in found
    assert "S4" not in found


def test_settings_of_an_open_start_say_from_where_they_were_tried():
    assert "from the closed start" in findings(CHECK / "carried_tray.xml")["T1"].line


# Solvers.


def test_a_solver_with_too_few_iterations_is_named_and_fed():
    checked = oarlock.check(CHECK / "starved_rods.xml")
    one = next(one for one in checked.verdict if one.code == "D6")
    recipe = checked.examination.recipe
    assert recipe is not None
    assert recipe.reached
    assert "of it is what the solver left (with Newton, 100 iterations" in one.line
    assert recipe.starved is not None
    option = ET.fromstring(checked.mjcf.splitlines()[0])
    assert option.get("solver") == "Newton"
    assert int(option.get("iterations", 0)) == 100

    def set_(newton: bool):
        def change(model):
            recipe.chosen.setting.apply(model)
            if not newton:
                model.opt.solver, model.opt.iterations = mujoco.mjtSolver.mjSOL_CG, 6

        return change

    closed, open_ = (np.abs(plain(CHECK / "starved_rods.xml", set_(newton))[2]).max() for newton in (True, False))
    assert closed <= recipe.target < open_ or not np.isfinite(open_)


def test_a_solver_that_has_enough_is_left_alone(tmp_path):
    file = written(tmp_path, "starved_rods.xml", ('iterations="6" ls_iterations="6"', 'iterations="100"'))
    checked = oarlock.check(file)
    assert "D6" not in {one.code for one in checked.verdict}
    assert "solver" not in checked.mjcf


def test_a_run_that_blows_up_has_no_shares(tmp_path):
    """A servo that is too stiff for the timestep: what the loop does then has no cause among the rows."""
    file = written(
        tmp_path,
        "torn_linkage.xml",
        (
            '<motor name="push" joint="input" gear="160" ctrlrange="-1 1"/>',
            '<position name="push" joint="input" kp="1e6"/>',
        ),
    )
    checked = oarlock.check(file, budget=0)
    codes = {one.code for one in checked.verdict}
    assert "R1" in codes
    assert not codes & {"D1", "D3", "D4", "D8", "L5", "U4", "U5"}


# Flexes.

FLEX = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="a"><joint name="a" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.2" contype="0" conaffinity="0"/>
      <body name="b" pos="0 0 0.2"><joint name="b" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" size="0.01" fromto="0 0 0 0.5 0 0.1" contype="0" conaffinity="0"/>HANGS</body></body>
    <body name="c" pos="0.5 0 0"><joint name="c" axis="0 1 0" damping="0.1"/>
      <geom type="capsule" size="0.01" fromto="0 0 0 0 0 0.3" contype="0" conaffinity="0"/></body>
    STANDS
  </worldbody>
  <equality><connect name="corner" body1="b" body2="c" anchor="0.5 0 0.1"/></equality>
</mujoco>
"""

CLOTH = """
<flexcomp name="cloth" type="grid" count="4 3 1" spacing="0.05 0.05 0.05" pos="0.1 0.6 0.5" dim="2"
    radius="0.005" mass="0.1">
  <edge equality="true"/><contact contype="0" conaffinity="0" selfcollide="none"/><pin id="0 1"/>
</flexcomp>"""


def _with_cloth(tmp_path: Path, place: str) -> Path:
    text = FLEX.replace(place, CLOTH)
    for other in ("HANGS", "STANDS"):
        text = text.replace(other, "")
    file = tmp_path / f"{place.lower()}.xml"
    file.write_text(text)
    return file


def test_what_stands_beside_a_flex_is_examined(tmp_path):
    alone, beside = _with_cloth(tmp_path, "NOTHING"), _with_cloth(tmp_path, "STANDS")
    expected, found = (oarlock.check(file, budget=1) for file in (alone, beside))
    assert found.document()["flexes"] == ["cloth"]
    assert {one.code for one in found.verdict} == {one.code for one in expected.verdict}
    exact, alone_exact = found.examination.exact, expected.examination.exact
    assert exact is not None
    assert alone_exact is not None
    assert np.abs(exact.qpos[:, :3] - alone_exact.qpos).max() < CLOSED
    rows = np.array(plain(beside, key=None)[2])
    number = next(i for i in range(2) if mujoco.MjModel.from_xml_path(str(beside)).equality(i).name == "corner")
    assert number == 0
    assert found.examination.drifts[0].metres == pytest.approx(np.linalg.norm(rows, axis=1).max(), rel=SAME_RUN)


def test_a_flex_that_hangs_on_the_loop_leaves_no_exact_solution(tmp_path):
    checked = oarlock.check(_with_cloth(tmp_path, "HANGS"), budget=1)
    assert checked.examination.exact is None
    assert "the flex 'cloth' is left as MuJoCo has it" in checked.examination.missing["exact"]
    assert checked.examination.drifts[0].metres
    assert checked.examination.attribution is not None
    assert checked.examination.recipe is not None


# The target.


@pytest.mark.parametrize(("scale", "expected"), [(1.0, 5.5e-5), (0.1, 5.5e-6), (0.001, 1e-6), (100.0, 1e-3)])
def test_the_usual_target_grows_with_the_loops(scale, expected):
    assert usual_target(0.55 * scale) == pytest.approx(expected)


def test_a_target_of_ones_own_is_taken_as_it_is():
    assert oarlock.check(CHECK / "torn_linkage.xml", budget=0).document()["target"] == pytest.approx(5.5e-5)
    assert oarlock.check(CHECK / "torn_linkage.xml", budget=0, target=3e-7).document()["target"] == 3e-7


# What only looks as if it moved.

STEERING = """
<mujoco>
  <option timestep="0.001" gravity="0 0 0"/>
  <default><joint axis="0 0 1" damping="0.1"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body pos="0 0.4 0"><joint name="left"/><geom fromto="0 0 0 -0.15 -0.06 0"/>
      <body name="rod" pos="-0.15 -0.06 0"><joint name="rod"/><geom fromto="0 0 0 0 -0.68 0"/></body></body>
    <body name="right" pos="0 -0.4 0"><joint name="right"/><geom fromto="0 0 0 -0.15 0.06 0"/></body>
  </worldbody>
  <equality>
    <connect name="end" body1="rod" body2="right" anchor="0 -0.68 0"/>
    <joint name="alike" joint1="left" joint2="right"/>
  </equality>
  <actuator><position name="steer" joint="left" kp="60" kv="5"/></actuator>
  <keyframe><key ctrl="0.5"/></keyframe>
</mujoco>
"""


def test_what_is_locked_comes_to_no_dead_point(tmp_path):
    """A trapezium turns its two sides by other angles: a coupling by the ratio 1 admits its start alone."""
    file = tmp_path / "steering.xml"
    file.write_text(STEERING)
    found = findings(file, budget=0)
    assert not found.keys() & {"U4", "L7"}
    assert "it would move without 'end' or 'alike'" in found["S3"].line
    for name in ("end", "alike"):
        rest = "".join(line for line in STEERING.splitlines(True) if f'name="{name}"' not in line)
        free = tmp_path / f"{name}.xml"
        free.write_text(rest)
        assert abs(plain(free)[1][-1, 0]) > 0.4
        assert "S3" not in findings(free, budget=0)


DRUM = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="rotor" axis="0 0 1"/><inertial pos="0 0 0" mass="0.01" diaginertia="1e-6 1e-6 1e-6"/></body>
    <body pos="1 0 0"><joint name="drum" axis="0 0 1" damping="0.1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body>
  </worldbody>
  <equality><joint name="rope" joint1="rotor" joint2="drum" polycoef="0 5 0 0 0"/></equality>
  <actuator><position name="servo" joint="rotor" kp="0.5" kv="KV"/></actuator>
  <keyframe><key ctrl="0.3"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize(("kv", "lasts"), [("0.01", True), ("0.02", False)])
def test_a_servo_is_said_to_diverge_only_where_the_run_did(tmp_path, kv, lasts):
    """Alone the rotor bears neither; the drum holds it with the smaller one, and plain MuJoCo stays finite."""
    file = tmp_path / "drum.xml"
    file.write_text(DRUM.replace("KV", kv))
    poses = plain(file)[1]
    assert bool(np.isfinite(poses).all() and np.abs(poses).max() < 1.0) == lasts
    one = findings(file, budget=0)["A1"]
    assert one.severity == ("warning" if lasts else "error")
    assert ("the run diverges" in one.line) == (not lasts)
    assert ("stable with" in one.line) == (not lasts)
    unrun = findings(file, lint=True)["A1"]
    assert "the run diverges" not in unrun.line
    assert "unstable by itself" in unrun.line
