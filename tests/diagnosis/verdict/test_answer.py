"""The answer in one sentence, and the order of findings by what they cost."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import oarlock
import pytest
from diagnosis.verdict.test_verdicts import as_it_is, of, only
from oarlock.base.numbers import figure
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.verdict.answer import answer
from oarlock.diagnosis.verdict.blame import remedy
from oarlock.diagnosis.verdict.cost import metres
from oarlock.diagnosis.verdict.findings import SEVERITIES, found, worst_first


def test_of_one_severity_the_dearest_comes_first():
    cheap, dear = (
        replace(found("D1", "m.xml", "x", element=name), cost=cost) for name, cost in (("a", 1e-4), ("b", 1e-2))
    )
    assert worst_first([cheap, found("S2", "m.xml", "x"), dear])[1:] == [dear, cheap]


def test_bodies_that_collide_are_the_answer_and_what_gives_way_costs_the_rest():
    exam, findings = as_it_is("pin_collision.xml")
    collision, softness = of(findings, "C4")[0], of(findings, "D1")
    assert findings[0] == collision
    assert "collide" in answer(exam, findings)
    assert "exclude the pair" in answer(exam, findings)
    figures = collision.figures
    assert collision.cost == pytest.approx(figures["drift"] - figures["drift_without"], rel=1e-12)
    (own,) = [one for one in softness if one.element == collision.element]  # what is left without the contact
    assert own.cost <= figures["drift_without"] * 1.01


def test_a_lock_costs_all_that_its_equalities_open_by():
    exam, findings = as_it_is("locked_cranks.xml")
    lock = of(findings, "S3")
    for one in lock:
        named = {one.element, *one.figures["also"]}
        drifts = [drift for drift in exam.drifts if drift.level == "position" and drift.equality in named]
        assert one.cost == max(metres(exam, drift.metres, drift.radians) for drift in drifts)
    assert lock


@pytest.mark.parametrize(
    "name", ["damped_gripper.xml", "contacts.xml", "tilted_hinge.xml", "diverges.xml", "unreachable.xml"]
)
def test_the_answer_is_one_line_about_the_worst_finding(name: str):
    exam, findings = as_it_is(name)
    said = answer(exam, findings)
    assert said
    assert "\n" not in said
    order = [(SEVERITIES.index(one.severity), -one.cost) for one in findings]
    assert order == sorted(order)
    if findings[0].severity == "error":
        assert findings[0].line in said


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("unreachable.xml", "'pin' is short by "),
        ("two_walls.xml", "'left' cannot hold together with 'right': short by "),
    ],
)
def test_the_answer_names_its_element_once(name, begins):
    assert answer(*as_it_is(name)).startswith(begins)


def test_a_model_that_holds_says_so():
    exam, findings = as_it_is("contacts.xml")
    exam = replace(exam, options=CheckOptions(target=1.0, duration=1.0, budget=0))
    worst = max(one.largest for one in exam.drifts if one.level == "position")
    assert worst < 1.0
    kept = [one for one in findings if one.severity == "note"]
    assert answer(exam, kept).startswith("Every loop holds the wanted 1 m or rad: ")


def test_an_angle_counts_by_the_size_of_the_loops():
    exam, _ = as_it_is("contacts.xml")
    assert metres(exam, 1e-3, 0.0) == 1e-3
    assert metres(exam, 1e-3, 0.5) == max(1e-3, 0.5 * exam.size)
    assert metres(exam, None, None) == 0.0


def test_what_makes_a_run_diverge_comes_before_what_is_seen_of_it():
    _, findings = as_it_is("diverges.xml")
    codes = [one.code for one in findings]
    assert codes.index("T2") < codes.index("R1")
    assert only(findings, "R1").cost == 0.0


TWISTED = """<mujoco><option timestep="0.001" gravity="0 0 0"/><default><geom contype="0" conaffinity="0"/></default>
  <worldbody><body name="hub"><joint name="hub" axis="0 0 1" stiffness="20" springref="40" damping="0.2"/>
    <geom type="box" size="0.1 0.02 0.02"/></body>
  <body name="sled" pos="0 0 0.1"><joint name="sled" type="slide" axis="1 0 0" stiffness="900" springref="{far}"/>
    <joint name="turn" axis="0 0 1"/><geom type="box" size="0.1 0.02 0.02"/></body></worldbody>
  <equality><weld name="stuck" body1="hub" body2="sled"/></equality></mujoco>"""


def test_maxima_of_different_times_are_told_with_their_own(tmp_path):
    """The distance and the angle of a weld are furthest at two moments, which plain MuJoCo shows."""
    text = TWISTED.format(far=0.3)
    (tmp_path / "model.xml").write_text(text)
    checked = oarlock.check(tmp_path / "model.xml", budget=0, duration=0.5)
    model = mujoco.MjModel.from_xml_string(text)
    data, found = mujoco.MjData(model), []
    for _ in range(500):
        mujoco.mj_forward(model, data)
        sine = float(np.linalg.norm(data.efc_pos[3:6]))
        found.append((data.time, float(np.linalg.norm(data.efc_pos[:3])), 2.0 * math.asin(sine)))
        mujoco.mj_step(model, data)
    times, metres, radians = np.array(found).T
    (one,) = (one for one in checked.examination.drifts if one.level == "position")
    assert (one.metres, one.metres_s) == pytest.approx((metres.max(), times[metres.argmax()]), rel=1e-9)
    assert (one.radians, one.radians_s) == pytest.approx((radians.max(), times[radians.argmax()]), rel=1e-9)
    assert abs(one.metres_s - one.radians_s) > 0.01
    for value, unit, time in ((one.metres, "m", one.metres_s), (one.radians, "rad", one.radians_s)):
        assert f"{figure(value, unit)} at t = {time:.4g} s" in checked.answer


HANGING = """<mujoco><option timestep="0.001"/><worldbody>
  <body name="a"><joint name="a" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.3"/></body>
  <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0"/><geom size="0.05" pos="0 0 -0.2"/></body>
  <body name="ball" pos="0 3 0"><freejoint/><geom size="0.1"/></body></worldbody>
  <equality><joint name="mimic" joint1="a" joint2="b"/></equality>{rest}</mujoco>"""


@pytest.mark.parametrize("moves", [False, True])
def test_loops_that_stand_still_hold_nothing(tmp_path, moves):
    """A ball falls beside them; with a velocity in a keyframe they move."""
    qvel = "0.5 0.5 0 0 0 0 0 0"
    rest = f'<keyframe><key qvel="{qvel}" qpos="0 0 0 3 0 1 0 0 0"/></keyframe>' if moves else ""
    (tmp_path / "model.xml").write_text(HANGING.format(rest=rest))
    checked = oarlock.check(tmp_path / "model.xml", duration=0.3, target=1.0)
    assert ("R4" in {one.code for one in checked.verdict}) != moves
    assert checked.answer.startswith("Every loop holds" if moves else "Nothing of its loops moves")


def test_what_was_not_tried_stands_beside_the_settings_and_not_in_them():
    exam, findings = as_it_is("damped_gripper.xml")
    recipe = replace(exam.recipe, untried="not tried from a disturbed start")
    exam = replace(exam, recipe=recipe)
    (one,) = remedy(exam)
    assert one.line.startswith(f"{recipe.reason}: no loop opens by more than ")
    assert one.line.endswith("; not tried from a disturbed start") or "; not tried from a disturbed start; " in one.line
    assert answer(exam, findings).endswith(", not tried from a disturbed start")
