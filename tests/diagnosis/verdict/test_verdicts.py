"""What ``oarlock check`` says of models that others wrote: each fixture gets the findings that it is there for."""

import math
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from gallery import looked_at
from mechanisms import GROUPED, four_bar, write_model
from oarlock import InputError
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.loops.gaps import Opening
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.verdict.blame import in_words, merged
from oarlock.diagnosis.verdict.findings import Finding, found
from oarlock.diagnosis.verdict.verdicts import judge
from places import FIXTURES

CHECK = FIXTURES / "check"

TARGET = 1e-6
"""m or rad: so small that what a model is there for is named, however small it is."""

LESS = 10.0
"""Times less a drift must be without the cause that was named: 1e2 and more, mostly."""


def examined(file: Path | str, wish: CheckOptions | None = None, **options) -> Any:
    """Without a search for settings unless it is wished for."""
    return looked_at(file, wish or CheckOptions(duration=1.0, budget=0), **options)


@cache
def as_it_is(name: str) -> tuple[Any, list[Finding]]:
    """A fixture with one target for all that reach it; grippers, whose keyframe leaves them at rest, are driven."""
    target = None if name == "thirty_equalities.xml" else TARGET  # runs that reach it do not fit into the budget
    wish = CheckOptions(target=target, controls="random" if name.startswith("gripper_2f") else None)
    exam = examined(CHECK / name, wish)
    return exam, judge(exam)


def codes(findings: list[Finding]) -> set[str]:
    return {one.code for one in findings}


def of(findings: list[Finding], code: str) -> list[Finding]:
    return [one for one in findings if one.code == code]


def only(findings: list[Finding], code: str) -> Finding:
    (one,) = of(findings, code)
    return one


LINTED = {"A1", "A2", "A3", "C4", "L8", "L9", "L10", "L11", "L12", "L13", "S5", "S6", "S7", "T6"}
"""Codes of findings that need no run."""

# The whole table.

FOUND = {
    "all_redundant.xml": {"S1", "L2", "T1", "U1", "L3", "L4"},
    "biped_leg/leg.xml": {"T1"},
    "biped_leg/scene.xml": {"R2", "D1", "T1"},
    "contacts.xml": {"R2", "U3", "D1", "E1", "T1", "L3"},
    "damped_gripper.xml": {"D4", "T1", "L3"},
    "carried_tray.xml": {"S1", "S3", "S4", "D1", "D5", "T1"},
    "dead_point.xml": {"D1", "E1", "U2", "U5", "T1", "L3"},
    "diverges.xml": {"T2", "R1", "T1", "L3"},
    "gripper_2f/gripper_2f.xml": {"R2", "D1", "D2", "D4", "T1", "L3"},
    "gripper_2f/scene.xml": {"R2", "D1", "T1", "L3"},
    "locked_cranks.xml": {"S3", "S1", "S4", "D1", "T1", "L3"},
    "script_names.xml": {"D1", "D3", "E1", "T1", "L3"},
    "ships_refsafe.xml": {"T4", "D3", "D1", "E1", "T1", "L3"},
    "short_arm.xml": {"S2", "L3"},
    "thirty_equalities.xml": {"S3", "D1", "D2", "D5", "V2", "T1", "L3", "L6"},
    "fast_crank.xml": {"D8", "D3", "E1", "T1", "L3"},
    "starved_rods.xml": {"D6", "T1", "A1"},
    "torn_linkage.xml": {"U4", "D8", "T1", "L3"},
    "tilted_hinge.xml": {"S3", "D1", "D5", "T1"},
    "degrees.xml": {"A2", "S1", "R2", "U3"},
    "turned_weld.xml": {"S7", "S2", "L3"},
    "wrong_sign.xml": {"L9", "L3"},
    "drawn_apart.xml": {"S5", "S4", "L3"},
    "mimic_ring.xml": {"L9"},
    "pin_collision.xml": {"C4", "C1", "D1", "R2", "U3", "L3"},
    "ringing.xml": {"L11", "L12", "T6", "L2", "D1", "U1", "L3", "L4", "T1", "D4"},
    "stiff_servo.xml": {"A1", "R1", "L3", "T1"},
    "stiff_damping.xml": {"A4", "R1", "T1"},
    "short_range.xml": {"C5", "D1", "D5", "R2"},
    "two_walls.xml": {"S2"},
    "welded_pin.xml": {"L10", "L3"},
    "wrong_units.xml": {"A2", "S1", "R2"},
    "unreachable.xml": {"S2", "L3"},
}


@pytest.mark.parametrize("name", FOUND)
def test_findings(name):
    exam, findings = as_it_is(name)
    expected = FOUND[name] - (set() if mujoco.__version__ == "4.0.0" else {"V2"})
    assert codes(findings) == expected
    assert [one.severity for one in findings] == sorted(
        (one.severity for one in findings), key=["error", "warning", "note"].index
    )
    for one in findings:
        assert "\n" not in str(one)
        assert one.file == exam.file
        assert not one.line.endswith(".")
        assert "nan" not in one.line.split()


# What is seen without a run.


def test_a_collision_is_measured_by_taking_it_away():
    """The drift beside it is that of plain MuJoCo with the pair excluded in the file, to the last digit printed."""
    exam, findings = as_it_is("pin_collision.xml")
    one = only(findings, "C4")
    (pair,) = exam.collisions
    assert (pair.body1, pair.body2, pair.equality) == ("coupler", "slider", "wrist")
    text = (CHECK / "pin_collision.xml").read_text(encoding="utf-8")
    exclude = '<contact><exclude body1="coupler" body2="slider"/></contact>'
    for drift, given in ((pair.drift, text), (pair.drift_without, text.replace("</mujoco>", f"{exclude}</mujoco>"))):
        model = mujoco.MjModel.from_xml_string(given)
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        largest = 0.0
        for _ in range(exam.steps):
            mujoco.mj_step(model, data)
            largest = max(largest, float(np.linalg.norm(data.efc_pos[:3])))
        assert drift == pytest.approx(largest, rel=1e-9)
    assert f"opens by {pair.drift:.3g} m, by {pair.drift_without:.3g} m without the contact between them" in one.line
    assert one.figures["drift_without"] == pair.drift_without


def test_joined_bodies_that_touch_only_later_are_named_where_that_opens_them(tmp_path):
    """A bar that hangs from two pins swings against the plate that one of them is on."""
    text = (CHECK / "pin_collision.xml").read_text(encoding="utf-8")
    later = text.replace(
        '<geom type="box" size="0.03 0.02 0.02"/>', '<geom type="box" size="0.02 0.02 0.02" pos="-0.1 -0.06 0"/>'
    )
    file = tmp_path / "later.xml"
    file.write_text(later, encoding="utf-8")
    exam = examined(file, CheckOptions(budget=0))
    (pair,) = exam.collisions
    assert pair.depth == 0.0
    assert pair.drift_without < 0.5 * pair.drift
    assert "collide in the run" in only(judge(exam), "C4").line
    early = examined(file, CheckOptions(budget=0, duration=0.05))
    assert early.collisions == ()


@pytest.mark.parametrize("name", ["mimic_ring.xml", "welded_pin.xml", "wrong_sign.xml"])
def test_what_stiffness_does_not_cure_is_not_called_soft(name):
    _, findings = as_it_is(name)
    assert findings[0].severity == "error"
    assert not {"D1", "S3"} & codes(findings)


def test_a_wrong_number_comes_before_what_comes_of_it():
    """Degrees before the start that they open, a turned weld before the loop that does not close."""
    assert [one.code for one in as_it_is("degrees.xml")[1]][:2] == ["A2", "S1"]
    assert [one.code for one in as_it_is("turned_weld.xml")[1]][:2] == ["S7", "S2"]


@pytest.mark.parametrize("name", [name for name in FOUND if "/" not in name])
def test_a_check_says_what_a_lint_says(name):
    def seen(findings):
        return {(one.code, one.element) for one in findings if one.code in LINTED}

    lint = judge(examined(CHECK / name, CheckOptions(lint=True)))
    assert seen(lint) == seen(as_it_is(name)[1])
    every = codes(as_it_is(name)[1])
    assert {one.code for one in lint} <= every | {"T2"} | ({"S1"} if "S2" in every else set())


# Loops.


def test_a_model_whose_equalities_are_all_switched_off(tmp_path):
    text = (CHECK / "contacts.xml").read_text()
    assert "<connect " in text
    for number, (switched, by) in enumerate(
        [
            (text.replace("<connect ", '<connect active="false" '), 'active="false"'),
            *(
                (text.replace("<option ", f"<option>{flag}</option><option "), flag)
                for flag in ('<flag equality="disable"/>', '<flag constraint="disable"/>')
            ),
        ]
    ):
        file = tmp_path / f"off_{number}.xml"
        file.write_text(switched)
        exam = examined(file)
        findings = judge(exam)
        assert only(findings, "L1").severity == "error"
        assert only(findings, "L1").line.startswith(f"the only equality, 'ground pin', is switched off by {by}: ")
        assert only(findings, "L6").element == "ground pin"
        assert only(findings, "L6").line.startswith(f"is switched off by {by}: ")
        assert "no active equality" in exam.missing["run"] or "switched off" in exam.missing["run"]
        assert only(judge(exam, fail_above=1e-3), "D7").line.startswith("there is no run to measure")


def test_none_is_refused_with_its_file():
    with pytest.raises(InputError, match=r"none\.xml: no <equality> element"):
        begin(str(CHECK / "none.xml"), CheckOptions())


def test_all_redundant_says_it_once():
    exam, findings = as_it_is("all_redundant.xml")
    assert only(findings, "L2").line.startswith("any one of the 5 equalities could be left out")
    assert only(findings, "L4").figures["pairs"] == 5
    assert [one.element for one in of(findings, "U1")] == ["bearing left", "gear"]
    assert of(findings, "U1")[0].figures["also"] == ["bearing middle", "bearing right"]
    assert exam.recipe.reached


def test_a_redundant_equality_is_named_once(tmp_path):
    """A crank and rocker with a joint equality beside its pin, and a hinge made of two connects elsewhere."""
    file = tmp_path / "twice.xml"
    text = (CHECK / "contacts.xml").read_text()
    name = 'name="ground pin"'
    start = text.index("<connect ")
    pin = text[start : text.index("/>", start) + 2]
    assert name in pin
    body = '<body name="{0}" pos="0 9 {1}"><joint name="{0}"/><geom type="sphere" size="0.1"/></body>'
    arm = body.format("a", 1) + body.format("b", 2)
    extra = '<joint name="gear" joint1="a" joint2="b"/>'
    file.write_text(
        text.replace(pin, pin + pin.replace(name, 'name="again"') + extra).replace("</worldbody>", arm + "</worldbody>")
    )
    findings = judge(examined(file))
    assert "L2" not in codes(findings)
    assert (only(findings, "L7").element, only(findings, "L7").figures["also"]) == ("ground pin", ["again"])
    assert only(findings, "L4").figures["pairs"] == 2


# The start.


@pytest.mark.parametrize(
    ("name", "line"),
    [
        (
            "unreachable.xml",
            "is short by 0.1000 m; its points lie 0.100 m along x of the world apart where they come nearest",
        ),
        (
            "short_arm.xml",
            "is short by 0.1000 m; its points lie (x 0.060 m, z 0.080 m) apart where they come nearest",
        ),
        ("two_walls.xml", "cannot hold together with 'right': short by 0.1000 m"),
    ],
)
def test_what_cannot_close_is_an_error_and_no_softness_is_blamed(name, line):
    exam, findings = as_it_is(name)
    assert only(findings, "S2").line == line
    assert only(findings, "S2").severity == "error"
    assert exam.missing["remedy"] == "there is no closed start to try settings from"
    assert exam.recording.end.how == "finished"


def test_a_tilted_hinge_locks():
    one = only(as_it_is("tilted_hinge.xml")[1], "S3")
    assert one.severity == "error"
    assert "the axis of 'rocker' is tilted by 0.0349 rad" in one.line


@pytest.mark.parametrize(("tilt", "doubtful"), [(0.0, False), (3e-9, False), (2e-5, True), (1e-4, True)])
def test_a_rank_that_hangs_on_a_small_tilt_is_doubtful(tmp_path, tilt, doubtful):
    tilted = four_bar(rocker=f'axis="0 1 {tilt}"')
    doubts = of(judge(examined(write_model(tmp_path, tilted))), "L8")
    assert bool(doubts) == doubtful
    if doubtful:
        assert doubts[0].element == "pin"
        assert f"the axis of 'rocker' is tilted by {tilt:.3g} rad" in doubts[0].line


def test_cranks_lock_that_are_a_little_off():
    _, findings = as_it_is("locked_cranks.xml")
    assert only(findings, "S3").severity == "error"
    assert only(findings, "S1").line == (
        "stands open by 0.01000 m at the start; the nearest closed pose moves 'crank1' by 0.025 rad"
    )
    assert only(findings, "T1").line.endswith("what is locked (S3) then stands still")


def test_locks_that_are_meant_are_notes():
    _, findings = as_it_is("thirty_equalities.xml")
    assert {one.element: one.severity for one in of(findings, "S3")} == {"hatch_lock": "note", "lid_bolt": "note"}
    assert "stands still" not in only(findings, "T1").line


def arm(tmp_path, offset: str) -> Path:
    file = tmp_path / "arm.xml"
    file.write_text(f"""<mujoco><option timestep="0.001"/><worldbody>
      <body name="a"><joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 1 0 0" size="0.01"/>
        <body name="b" pos="1 0 0"><joint name="b" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 1" size="0.01"/></body>
      </body></worldbody>
      <equality><connect name="slot" body1="b" body2="world" anchor="0 0 1"/></equality>
      <keyframe><key qpos="{offset} 0"/></keyframe></mujoco>""")
    return file


@pytest.mark.parametrize(("offset", "severity"), [("5e-7", None), ("5e-6", "note"), ("0.01", "warning")])
def test_six_digits_are_no_mistake(tmp_path, offset, severity):
    exam = examined(arm(tmp_path, offset))
    assert [one.severity for one in of(judge(exam), "S1")] == ([severity] if severity else [])


def test_an_opening_leaves_out_what_is_rounding():
    assert str(Opening("seam", 0.2, 1e-17)) == "0.2000 m"
    assert str(Opening("seam", 0.0, 0.0126)) == "0.01260 rad"
    assert Opening("seam", 0.2, 0.1).told("/s") == "0.2000 m/s and 0.1000 rad/s"


# Settings.


def test_a_run_that_diverges_is_blamed_on_its_settings():
    exam, findings = as_it_is("diverges.xml")
    assert only(findings, "T2").severity == "error"
    assert (
        only(findings, "T2").line
        == "a step multiplies its deviation by 1.62: h²K + 2hB = 5 under euler, stable below 4"
    )
    assert only(findings, "R1").figures["time_s"] == exam.recording.end.time_s
    assert "in place of a run that diverges" in only(findings, "T1").line
    above = of(judge(exam, fail_above=1e-3), "D7")
    assert above[-1].line.startswith("the run diverges")


def test_of_what_is_beyond_a_bound_the_worst_is_named_first():
    """The same that the answer names."""
    exam = examined(CHECK / "gripper_2f" / "scene.xml")
    above = [finding for finding in of(judge(exam, fail_above=1e-9), "D7") if "drift" in finding.figures]
    drifts = [finding.figures["drift"] for finding in above]
    assert len(drifts) == 3
    assert drifts == sorted(drifts, reverse=True)


def test_a_solref_that_is_silently_changed():
    _, findings = as_it_is("ships_refsafe.xml")
    assert only(findings, "T4").line == "solref 0.001 1 is taken as 0.004 1, for it is below 2 h = 0.004 s"


def test_mixed_signs_of_a_solref_are_named(tmp_path):
    text = (CHECK / "contacts.xml").read_text().replace("<connect ", '<connect solref="-1000 1" ')
    file = tmp_path / "mixed.xml"
    file.write_text(text)
    assert "is taken as 0.02 1, for its signs are mixed" in only(judge(examined(file)), "T4").line


# Drift.


def test_implicit_damping_opens_a_gripper():
    """And nothing else does: with explicit damping at the same stiffness it is closed."""
    exam, findings = as_it_is("damped_gripper.xml")
    assert only(findings, "D4").figures["share_stepping"] > 0.9
    explicit = examined(
        CHECK / "damped_gripper.xml",
        CheckOptions(budget=0),
        integrator=int(mujoco.mjtIntegrator.mjINT_EULER),
        disableflags=int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP),
    )
    assert "D4" not in codes(judge(explicit))
    for before, after in zip(exam.drifts, explicit.drifts, strict=True):
        if before.level == "position" and before.largest > 1e-6:
            assert after.largest < before.largest / LESS


def test_two_finger_gripper():
    """Limits and contacts are named where they begin; the pins yield, the coupling bends."""
    exam, findings = as_it_is("gripper_2f/gripper_2f.xml")
    assert "contact between geom 'right_pad' and geom 'left_pad'" in only(findings, "R2").line
    assert exam.exact.end.how == "finished"
    assert only(findings, "D1").element == "connect of 'left_follower' and 'left_coupler'"
    assert only(findings, "D4").element == "connect of 'right_follower' and 'right_coupler'"  # elsewhere, and later
    assert only(findings, "D2").element == "mimic"
    assert {one.severity for one in findings if one.code[0] == "D"} == {"note"}  # 0.02 mm and 0.02 mrad
    assert exam.recipe.reached


def test_biped_leg_on_the_floor():
    exam, findings = as_it_is("biped_leg/scene.xml")
    one = only(findings, "D1")
    assert one.figures["also"] == ["rod_right_end"]
    assert one.figures["drift_m"] == pytest.approx(0.0403, rel=0.05)
    assert exam.exact.end.how == "finished"
    assert exam.recipe.reached


def test_thirty_equalities_are_told_by_groups():
    exam, findings = as_it_is("thirty_equalities.xml")
    assert len(findings) < 20
    named = [
        name for one in of(findings, "D1") + of(findings, "D2") for name in [one.element, *one.figures.get("also", [])]
    ]
    beyond = [one.equality for one in exam.drifts if one.level == "position" and one.largest > exam.target]
    assert sorted(named) == sorted(beyond)
    assert only(findings, "L6").element == "parking_hook"
    assert only(findings, "D2").element == "string"
    assert max(one.figures["ratio"] for one in of(findings, "D5")) > 200


def test_scale_is_that_of_the_row_that_drifts():
    """A row of the hopper's hinge is 1e6 times too soft, and holds nothing: it is not named."""
    findings = judge(examined(FIXTURES / "hopper.xml", CheckOptions(budget=0)))
    assert "D1" in codes(findings)
    assert "D5" not in codes(findings)


def test_contacts_do_not_keep_the_rest_from_an_answer():
    exam, findings = as_it_is("contacts.xml")
    assert only(findings, "R2").line.startswith(
        "in MuJoCo's run contact between geom 'table' and geom 'coupler' from t = 0.758 s, up to"
    )
    assert exam.exact.end.how == "finished"
    assert exam.exact.drift[:, 0].max() < 1e-12
    assert exam.recipe.reached
    ignored = examined(CHECK / "contacts.xml", CheckOptions(ignore_inequalities=True, budget=0))
    assert "contacts" in ignored.ignored
    assert "R2" not in codes(judge(ignored))
    assert ignored.exact.end.how == "finished"


def test_a_dead_point_is_told_with_its_time():
    exam, findings = as_it_is("dead_point.xml")
    one = only(findings, "U2")
    near = min((event for event in exam.history.events), key=lambda event: event.smallest)
    assert one.figures["smallest"] == near.smallest < 0.05
    assert f"t = {near.time_s:.4g} s" in one.line
    crank = exam.exact.qpos[round(near.time_s / exam.timestep_s), 0]
    assert abs(crank - math.pi / 3) < 0.02  # from 120° to where the crank points away from the rocker


def test_names_of_elements_do_not_break_lines(tmp_path):
    text = (CHECK / "contacts.xml").read_text().replace("ground pin", "two&#10;lines")
    file = tmp_path / "lines.xml"
    file.write_text(text)
    findings = judge(examined(file))
    assert any("two" in one.element for one in findings)
    assert all("\n" not in str(one) for one in findings)


# The user's own bound.


def test_fail_above():
    exam, findings = as_it_is("contacts.xml")
    assert judge(exam, fail_above=1.0) == findings
    one = judge(exam, fail_above=1e-4)[0]
    assert (one.code, one.severity, one.element) == ("D7", "error", "ground pin")
    assert "m at t = " in one.line
    assert one.line.endswith("expected at most 0.0001 (m, rad)")


# Words.


def test_lists_of_names():
    assert in_words(["a"]) == "'a'"
    assert in_words(["a", "b"]) == "'a' and 'b'"
    assert in_words(list("abcd")) == "'a', 'b', 'c' and 'd'"
    assert in_words(list("abcdef")) == "'a', 'b', 'c' and 3 more"


def test_the_same_is_said_once():
    findings = [found("L3", "m.xml", "its row y holds nothing", element=name) for name in "abc"]
    (one,) = merged([*findings])
    assert one.line == "its row y holds nothing; the same of 'b' and 'c'"
    assert (one.element, one.figures["also"]) == ("a", ["b", "c"])


def test_a_keyframe_places_mocap_bodies(tmp_path):
    file = tmp_path / "mocap.xml"
    file.write_text("""<mujoco><worldbody><body name="hand" mocap="true"/>
      <body name="a"><joint name="a" axis="0 1 0"/><geom size="0.1" pos="1 0 0"/></body></worldbody>
      <equality><connect name="held" body1="a" body2="hand" anchor="1 0 0"/></equality>
      <keyframe><key qpos="1.5707963267948966" mpos="-1 0 -1"/></keyframe></mujoco>""")
    exam = examined(file)
    assert exam.pose.openings[0].largest < 1e-12
    assert only(judge(exam), "S3").severity == "note"


def test_a_wrong_factor_is_named_where_there_is_one(tmp_path):
    """Of three loops two alone have a pattern that MuJoCo groups rightly."""
    first = '<connect body1="a" body2="d" anchor=".01 0 .05"/>'
    for name, text in (("wrong", GROUPED), ("right", GROUPED.replace(first, ""))):
        exam = examined(write_model(tmp_path / name, text), CheckOptions(duration=0.1, budget=0))
        assert ("V2" in codes(judge(exam))) == (name == "wrong" and mujoco.__version__ == "4.0.0")
