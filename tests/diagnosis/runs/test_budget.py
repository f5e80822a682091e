"""What a search may cost: counted work decides, the clock only cuts short, and the finding says which of them did."""

import itertools
import random
import time

import mujoco
import numpy as np
import pytest
from gallery import piece
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page.document import document
from oarlock.diagnosis.page.page import html_fragment
from oarlock.diagnosis.runs.budget import LEAST_LIMIT_S, PATIENCE, Budget, CutShortError, charge
from oarlock.diagnosis.runs.recipe import Recipe, recipe
from oarlock.diagnosis.runs.trials import TICKS, Setting, Start, run_trial
from oarlock.diagnosis.verdict.verdicts import judge
from places import FIXTURES

CHECK = FIXTURES / "check"

MIMIC = """<mujoco><option timestep="0.0002"/><worldbody>
  <body name="a"><joint name="a" axis="0 1 0" damping="0.01"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.24" size="0.01" mass="0.4" contype="0" conaffinity="0"/></body>
  <body name="b" pos="0.4 0 0"><joint name="b" axis="0 1 0" damping="0.01"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.17" size="0.01" mass="0.9" contype="0" conaffinity="0"/></body>
  </worldbody><equality><joint name="mimic" joint1="a" joint2="b" polycoef="0 1.4 0 0 0"/></equality></mujoco>"""
"""It hangs at rest and holds as authored; from a disturbed start it opens, and stiffer settings hold it."""

DURATION_S, STEPS = 0.1, 500
LOOKS = -(-STEPS // TICKS)
"""At the clock, during a run."""


def hanging(budget_s: float, **options) -> Recipe:
    model = mujoco.MjModel.from_xml_string(MIMIC)
    start = Start(model.qpos0.copy(), np.zeros(2))
    return recipe(model, start, {}, 1e-6, DURATION_S, budget_s=budget_s, **options)


def told(file, wish) -> tuple:
    """The document without what is of the occasion, the text of the page, and the examination."""
    found = begin(str(file), wish)
    for _ in examine(found):
        pass
    findings = judge(found)
    whole = document(found, findings)
    del whole["provenance"]
    return whole, html_fragment(found, findings), found


def stop_at(monkeypatch, looks: int) -> None:
    """A clock that stands still for so many looks, the first one among them, and then is a day later."""
    count = itertools.count(1)
    monkeypatch.setattr(time, "process_time", lambda: 0.0 if next(count) <= looks else 86_400.0)


# Work.


def test_a_run_is_charged_by_what_is_counted():
    one = mujoco.MjModel.from_xml_string(MIMIC)
    start = Start(one.qpos0.copy(), np.zeros(2))
    euler, rk4 = (run_trial(one, Setting(2e-4, name), start, {}, 0.1, name) for name in ("euler", "rk4"))
    assert (euler.evaluations, rk4.evaluations) == (500, 2000)
    assert rk4.against(euler).cost == 4.0
    assert charge(euler.steps, euler.evaluations, 3) < charge(rk4.steps, rk4.evaluations, 3)
    budget = Budget(charge(1000, 1000, 3))
    assert budget.affords(1000, 1000, 3)
    budget.spend(500, 500, 3)
    assert budget.affords(500, 500, 3)
    assert not budget.affords(501, 501, 3)


@pytest.mark.parametrize(
    ("runs", "trials", "outcome", "said"),
    [
        (0.01, 1, "undecided", "'as authored' at 0.0002 s holds from the user's own start, and 0 of 2 disturbed"),
        (2.5, 2, "undecided", "from a disturbed one 'mimic' opens by"),
        (4.5, 4, "undecided", "'deadbeat, euler' at 0.0002 s holds from the user's own start, and 0 of 2 disturbed"),
        (5.5, 5, "undecided", "and 1 of 2 disturbed ones were tried"),
        (6.5, 6, "reached", "stiffer equalities at the same timestep"),
    ],
)
def test_what_is_not_paid_for_is_not_decided(runs, trials, outcome, said):
    """Neither 'holds' nor 'reached' is said of what was not tried from every disturbed start."""
    found = hanging(runs * charge(STEPS, STEPS, 3))
    assert (found.outcome, len(found.trials)) == (outcome, trials)
    assert said in found.reason
    assert found.reached == (outcome == "reached")
    assert ("cut short by the budget of" in found.reason) == (outcome == "undecided")


def test_one_budget_gives_one_answer_whatever_the_clock_says(monkeypatch):
    names = ("contacts.xml", "diverges.xml", "tilted_hinge.xml", "gripper_2f/gripper_2f.xml")
    wishes = (CheckOptions(duration=0.1, target=1e-6), CheckOptions(duration=0.1, budget=0.03, target=1e-9))
    asked = list(itertools.product(names, wishes))
    first = [told(CHECK / name, wish)[:2] for name, wish in asked]
    moody = random.Random(3)
    passed = itertools.accumulate(moody.choice([0.0, 1e-6, 2e-4]) for _ in itertools.count())
    monkeypatch.setattr(time, "process_time", lambda: next(passed))
    assert [told(CHECK / name, wish)[:2] for name, wish in asked] == first
    outcomes = [one["recipe"]["outcome"] for one, _ in first]
    assert set(outcomes) == {"reached", "undecided"}


# The clock.


def test_the_clock_stands_far_behind_the_budget(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "process_time", lambda: now[0])
    for seconds, limit_s in ((0.001, LEAST_LIMIT_S), (8.0, 8.0 * PATIENCE)):
        now[0] = 0.0
        budget = Budget(seconds)
        now[0] = limit_s
        budget.tick()
        now[0] = 1.001 * limit_s
        with pytest.raises(CutShortError, match=f"cut short after {limit_s:g} s of processor time"):
            budget.tick()


@pytest.mark.parametrize(
    ("looks", "trials"), [(1, 1), (2 + LOOKS // 2, 1), (3 + LOOKS, 2), (4 + 2 * LOOKS, 3), (5 + 5 * LOOKS, 5)]
)
def test_the_clock_cuts_short_between_steps_and_says_so(monkeypatch, looks, trials):
    """A run that was cut is no run: what is kept are whole ones, the same as without a clock."""
    whole = hanging(8.0)
    stop_at(monkeypatch, looks)
    found = hanging(8.0)
    assert found.outcome == "undecided"
    assert found.trials == whole.trials[:trials]
    assert found.reason.startswith("cut short after 80 s of processor time; '")
    assert not found.reached


def test_what_is_decided_stays_so_if_the_clock_ends_the_search_for_less_loss(monkeypatch):
    one = piece("five_bar")
    asked = one.model, Start(one.qpos, one.qvel), one.laws, 1e-5, 0.3
    whole = recipe(*asked)
    assert whole.conserving == whole.trials[-1]
    stop_at(monkeypatch, 3 + sum(1 + -(-one.steps // TICKS) for one in whole.trials[1:-1]))
    found = recipe(*asked)
    assert (found.outcome, found.chosen, found.trials) == (whole.outcome, whole.chosen, whole.trials[:-1])
    assert found.conserving is None
    assert found.reason == whole.reason
    assert found.untried == "cut short after 80 s of processor time, before a run that loses less was looked for"


# What is said.


def test_a_search_that_was_cut_short_is_a_finding_of_its_own(monkeypatch):
    wish = CheckOptions(duration=0.2, budget=0.001, target=1e-6)
    whole, page, found = told(CHECK / "contacts.xml", wish)
    (one,) = [one for one in judge(found) if one.code in ("T1", "T3", "T5")]
    assert (one.code, one.name, one.severity) == ("T5", "undecided", "note")
    assert one.line.startswith(f"not decided whether {found.target:g} can be held: cut short by the budget of 0.001 s")
    assert whole["recipe"]["outcome"] == "undecided"
    assert one.figures["cost"] == whole["recipe"]["trials"][0]["cost"] == 1.0
    assert "is not decided: cut short by the budget of 0.001 s" in page
    assert found.recipe.mjcf == ""


def test_a_run_that_diverged_has_no_cost():
    whole, page, found = told(CHECK / "diverges.xml", CheckOptions(duration=0.2))
    authored, *others = whole["recipe"]["trials"]
    assert (authored["end"], authored["cost"]) == ("diverged", None)
    assert all(one["cost"] == found.recipe.chosen.cost == 1.0 for one in others)
    assert page.count("<td>diverged: ") == page.count("<td>–</td><td>–</td></tr>") == 1
