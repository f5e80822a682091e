"""The answer in one sentence, and the order of findings by what they cost."""

from dataclasses import replace

import pytest
from diagnosis.verdict.test_verdicts import as_it_is, of, only
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.verdict.answer import answer
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
