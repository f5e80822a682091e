"""``oarlock check`` on the gallery: the findings of each model, the figures of the drift, and what holds the loops."""

from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from gallery import looked_at, piece
from oarlock import model_names
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.options import BUDGET_S, CheckOptions
from oarlock.diagnosis.runs.budget import charge
from oarlock.diagnosis.runs.recipe import STIFF_SOLIMP, deadbeat
from oarlock.diagnosis.runs.recording import record
from oarlock.diagnosis.runs.row_law import HOLDS
from oarlock.diagnosis.runs.trials import Setting, Start, run_trial
from oarlock.diagnosis.runs.versions import without_curvature
from oarlock.diagnosis.verdict.findings import Finding
from oarlock.diagnosis.verdict.verdicts import judge
from places import FIXTURES

DURATION_S = {"andrews_squeezer": 0.03}
"""Of a run; 1 s unless it is here: mechanisms of centimetres are fast."""

PEAK = 0.06
"""Relative. The largest drift of a figure that has two digits."""

LAGS = 0.15
"""Relative. Two time constants of 4 ms behind a J̇v that changes within 0.1 s (0.10 measured at most)."""

FLAT_S, FLAT = 0.7143555293, 1e-3
"""s. When the four-bars of n_four_bar first lie flat, by their own scalar equation; and how well it is met."""


def examined(name: str, duration_s: float | None = None, target: float = 1e-6, **changes) -> Any:
    """An examination with another integrator, timestep or budget, or options of MuJoCo changed by name."""
    asked = {key: changes.pop(key) for key in ("integrator", "timestep", "budget") if key in changes}
    return looked_at(
        name, CheckOptions(duration=duration_s or DURATION_S.get(name, 1.0), target=target, **asked), **changes
    )


@cache
def as_it_is(name: str) -> tuple[Any, list[Finding]]:
    found = examined(name)
    return found, judge(found)


def only(findings: list[Finding], code: str) -> Finding:
    (found,) = [one for one in findings if one.code == code]
    return found


# What is found, model by model.

FOUND = {
    "andrews_squeezer": {"D1", "T1", "L3"},
    "bennett": {"D1", "L2", "T1", "U1", "L4"},
    "boat": {"D1", "E1", "T1", "U1", "L4"},
    "bricard": {"D1", "T1", "U1", "L4", "L7"},
    "cable_finger": {"D1", "T1", "R2"},
    "cable_loop": {"D1", "T1"},
    "delta": {"D1", "E1", "L2", "T1", "U1", "L4"},
    "five_bar": {"D1", "T1", "L3"},
    "floating_four_bar": {"D1", "L2", "T1", "U1", "L3", "L4"},
    "four_bar": {"D1", "E1", "T1", "L3"},
    "friction_latch": {"D1", "T1", "L3", "R2", "U3"},
    "gear_train": {"D2", "D1", "L2", "T1", "U1"},
    "gripper": {"D1", "T1", "L3"},
    "gripping_gripper": {"D1", "T1", "L3", "R2", "U3"},
    "jansen_leg": {"D1", "T1", "L3"},
    "n_crank": {"D1", "E1", "T1", "U1", "L3", "L4"},
    "n_four_bar": {"D1", "T1", "L5", "L3"},
    "net": {"D1", "T1", "U1", "L3", "L4", "L7"},
    "ring": {"D1", "T1"},
    "sarrus": {"D1", "T1", "U1", "L4"},
    "scissor_lift": {"D1", "D5", "T1", "L3", "R2"},
    "spatial_slider_crank": {"D1", "E1", "T1"},
    "standing_leg": {"D1", "D5", "T1", "R2"},
    "stewart": {"D1", "E1", "T1"},
    "stopped_four_bar": {"D1", "T1", "L3", "R2"},
    "tensegrity": {"D2", "T1"},
    "triple_crank": {"D1", "E1", "T1", "U1", "L3", "L4"},
    "welded_frame": {"D1", "D5", "T1", "U1"},
}


@pytest.mark.parametrize("name", model_names())
def test_findings(name):
    found, findings = as_it_is(name)
    assert {one.code for one in findings} == FOUND[name]
    assert not found.missing
    assert found.attribution.defect < HOLDS
    assert all(one.severity != "error" for one in findings)
    assert all("\n" not in str(one) and str(one).startswith(name) for one in findings)
    assert found.recipe.reached
    size = found.recording.layout.rows + found.model.nv
    assert sum(charge(one.taken, one.taken * one.setting.evaluations, size) for one in found.recipe.trials) < BUDGET_S
    assert len({(one.code, one.element) for one in findings}) == len(findings)


# Figures.


def test_boat_drifts_by_softness_and_is_held_at_the_same_timestep():
    """In its first two seconds; in twelve the same settings leave 1.2e-6 m under Euler."""
    found = examined("boat", 2.0, integrator="euler")
    findings = judge(found)
    worst = found.attribution.worst
    assert max(one.metres for one in found.drifts if one.level == "position") == pytest.approx(2.1e-4, rel=PEAK)
    assert worst.shares["compliance"] == pytest.approx(1.006, abs=0.01)
    assert worst.time_s == pytest.approx(0.066, abs=0.01)
    assert only(findings, "D1").line.endswith("100 % of it is softness; for the same reason also 'pin3'")
    assert "D5" not in {one.code for one in findings}  # the row that drifts is stiffer than asked for
    (same,) = [one for one in found.recipe.trials if one.setting == deadbeat(1e-3, "euler") and one.start == "own"]
    assert same.drift < 1e-6
    assert "its own start alone is held with 0.001 s" in only(findings, "T1").line


def test_boat_by_a_solver_that_stops_early():
    found = examined("boat", integrator="euler", solver=mujoco.mjtSolver.mjSOL_PGS, iterations=2, budget=0)
    one = only(judge(found), "D6")
    assert one.figures["drift_m"] > 1e-3
    assert one.figures["share_solver"] > 0.9
    patient = examined("boat", integrator="euler", solver=mujoco.mjtSolver.mjSOL_PGS, iterations=200, budget=0)
    assert {"D1", "D6"} & {one.code for one in judge(patient)} == {"D1"}


def test_fast_four_bar_by_time_stepping_and_without_curvature():
    """2.1e-3 m and 3.7e-2 m without J̇v on check.md's four-bar, here of another size."""
    found = examined("four_bar", 2.0, integrator="euler")
    findings = judge(found)
    one = only(findings, "D3")
    assert one.figures["drift_m"] == pytest.approx(1.9e-3, rel=PEAK)
    assert one.figures["share_stepping"] > 1.0 > one.figures["part"] > 0.5
    assert "rk4 in place of euler" in only(findings, "T1").line
    assert np.abs(without_curvature(found.recording)).max() > 10 * one.figures["drift_m"]
    assert "V1" not in {one.code for one in findings}  # it is told on the page
    half = examined("four_bar", 2.0, integrator="euler", timestep=5e-4, budget=0)
    stepping = [exam.attribution.worst.parts["stepping"] for exam in (found, half)]
    assert abs(stepping[1]) < 0.6 * abs(stepping[0])


def test_four_bar_under_implicitfast_has_no_damping_to_blame():
    codes = {one.code for one in judge(examined("four_bar", integrator="implicitfast", budget=0))}
    assert "D3" in codes
    assert "D4" not in codes


def test_gear_train_by_missing_curvature():
    found = examined("gear_train", integrator="euler", timestep=1e-3, budget=0)
    one = only(judge(found), "D2")
    assert one.element == "direct_mesh"
    assert one.figures["also"] == ["first_mesh"]
    assert one.figures["share_curvature"] > 0.9
    assert one.figures["drift_rad"] == pytest.approx(0.0112, rel=PEAK)


def test_welded_frame_by_an_inertia_that_is_judged_wrongly():
    """365 times on check.md's frame; this one's rotation rows are 8 times too soft."""
    found = examined("welded_frame", integrator="euler", timestep=1e-3)
    findings = judge(found)
    assert only(findings, "D1").figures["share_compliance"] == pytest.approx(1.0, abs=0.01)
    ratio = only(findings, "D5").figures["ratio"]
    assert 7.5 < ratio < 8.9
    # The remedy of the finding: with the true diagonal the loop drifts less.
    found.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
    start = Start(found.pose.qpos, found.pose.qvel)
    exact = run_trial(found.model, Setting.authored(found.model), start, found.laws, 1.0, "diagexact")
    assert exact.drift < 0.5 * found.recipe.authored.drift


def test_four_bars_lie_flat_when_their_equation_says():
    _, findings = as_it_is("n_four_bar")
    one = only(findings, "L5")
    assert float(one.figures["times_s"].split(", ")[0]) == pytest.approx(FLAT_S, abs=FLAT)
    assert "rank 4 falls to 2" in one.line


@pytest.mark.parametrize("name", ["bricard", "bennett", "sarrus", "triple_crank"])
def test_reactions_are_those_of_the_tables(name):
    """Bennett: none unique. Sarrus: the hinge's force is, as a sum, and a torque is not. Triple crank: along the cranks
    not. Bricard: one wrench of six is shared by all hinges."""
    found, findings = as_it_is(name)
    words = {one.element: one.line for one in findings if one.code == "U1"}
    if name == "triple_crank":
        assert words == {f"pin{k}": f"its force is not unique along z of crank{k}" for k in (2, 3)}
        return
    (whole,) = found.reactions.together
    free = {"bennett": (3, 2), "sarrus": (0, 1), "bricard": (1, 1)}[name]
    assert (whole.force.free, whole.torque.free) == free
    assert [r.mechanism for r in found.reactions.redundancy] == [{"bennett": 3, "sarrus": 1, "bricard": 1}[name]]


# What would hold them.

TARGETS = (1e-4, 1e-5, 1e-6)
FOUR = ("boat", "four_bar", "gear_train", "welded_frame")
WANTED = [(name, target) for name in FOUR for target in TARGETS] + [
    (name, TARGETS[np.random.default_rng(index).integers(3)])
    for index, name in enumerate(model_names())
    if name not in FOUR
]


@pytest.mark.parametrize(("name", "target"), WANTED)
def test_a_recipe_reaches_its_target_or_says_why_not(name, target):
    """Under Euler, MuJoCo's default, where it is harder; tried again here with another disturbance than its own."""
    found = examined(name, DURATION_S.get(name, 0.5), integrator="euler", target=target)
    recipe, findings = found.recipe, judge(found)
    if not recipe.reached:
        one = only(findings, "T3")
        assert one.figures["drift"] > target
        assert recipe.reason in one.line
        return
    start = Start(found.pose.qpos, found.pose.qvel)
    again = run_trial(found.model, recipe.chosen.setting, start, found.laws, found.duration_s, "again")
    assert again.drift <= target
    assert recipe.verified
    if found.withheld:  # a stop that fights the loop is what is the matter: no settings are offered beside it
        assert found.withheld in {one.code for one in findings if one.severity == "warning"}
        assert not [one for one in findings if one.code == "T1"]
    else:
        assert recipe.outcome == "holds" or only(findings, "T1").figures["drift"] <= target
    if recipe.outcome == "reached":
        assert recipe.chosen.setting.solimp == STIFF_SOLIMP


def test_a_target_that_cannot_be_reached_says_what_stands_in_the_way():
    found = examined("gear_train", 0.05, integrator="euler", target=1e-12)
    one = only(judge(found), "T3")
    assert one.element in {"first_mesh", "second_mesh", "direct_mesh"}
    assert one.figures["drift"] > 1e-12
    assert "MuJoCo leaves J̇v out on rows of a joint equality" in one.line


def test_a_disturbed_start_that_asks_for_more_is_told():
    file = FIXTURES / "check" / "biped_leg" / "leg.xml"
    found = begin(str(file), CheckOptions())
    for _ in examine(found):
        pass
    assert found.recipe
    assert found.recipe.authored.drift < 1e-8
    assert "m, from a disturbed start, energy error" in only(judge(found), "T1").line


@pytest.mark.parametrize("name", ["five_bar", "boat", "gripper"])
def test_older_versions_would_stand_off_by_their_curvature(name):
    """A motion that is slow against the spring: r = J̇v/(K d), but for a lag of two time constants of 4 ms."""
    one = piece(name)
    one.model.eq_solref[:], one.model.eq_solimp[:] = (0.004, 1.0), STIFF_SOLIMP
    recording = record(one.model, one.qpos, one.qvel, one.laws, 1000)
    found = without_curvature(recording)
    connects = np.array([recording.layout.equalities[owner].kind.name == "connect" for owner in recording.layout.owner])
    spring = np.where(recording.present, recording.stiffness * recording.impedance, 1.0)
    still = recording.curvature / spring
    assert np.abs(found - still)[50:, connects].max() < LAGS * np.abs(still).max()
    assert not found[:, ~connects].any()
