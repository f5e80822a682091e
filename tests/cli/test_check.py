"""``oarlock check``: what it prints, writes and exits with; and ``oarlock.check``."""

import json
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import polars as pl
import pytest
from oarlock.diagnosis.examination import PARTS
from oarlock.diagnosis.options import usual_target
from places import FIXTURES, REPOSITORY
from suites import Heard

CHECKED = FIXTURES / "check"
GRIPPER = CHECKED / "gripper_2f" / "gripper_2f.xml"
DRIVEN = ("--controls", "random")
"""Its keyframe has no control."""
HEADINGS = ["Findings", "1  The loops", "2  The start", "3  Drift", "4  Why", "5  What would hold it", "6  Forces"]


def test_a_file_is_told_in_order(oarlock_here):
    said = oarlock_here("check", GRIPPER, *DRIVEN)
    assert (said.returncode, said.stderr) == (0, "")
    places = [said.stdout.index(f"\n{heading}\n") for heading in HEADINGS]
    assert places == sorted(places)
    answer, run, *_ = said.stdout.splitlines()
    assert " opens by " in answer
    assert "The run: " in run
    for text in ("mimic", "planar", "keyframe 'open': consistent", "missing J̇v", '<option timestep="', "T1 recipe"):
        assert text in said.stdout


def test_the_front_page_shows_what_is_printed(oarlock_here):
    front = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    shown = [
        " ".join(line.split())
        for line in front.splitlines()
        if line.startswith(("connect of ", "mimic ", "note    D2"))
    ]
    said = [
        " ".join(line.split()) for line in oarlock_here("check", GRIPPER, *DRIVEN, "--budget", "0").stdout.splitlines()
    ]
    assert len(shown) == 4
    assert [line for line in shown if line not in said] == []


def test_json_is_all_there_is_on_standard_output(oarlock_here):
    said = oarlock_here("check", GRIPPER, *DRIVEN, "--json", "-")
    document = json.loads(said.stdout)
    loops = document["loops"]
    assert (loops["rows"], loops["rank"], loops["redundancy"], loops["dof"]) == (7, 5, 2, 1)
    assert [one["name"] for one in loops["equalities"]] == [
        f"connect of '{side}_follower' and '{side}_coupler'" for side in ("right", "left")
    ] + ["mimic"]
    mimic = next(one for one in document["why"]["equalities"] if one["name"] == "mimic")
    assert sum(mimic["shares"].values()) == pytest.approx(1.0)
    *parts, together = document["why"]["accelerations"]
    assert {one["cause"] for one in parts} == set(mimic["shares"])
    assert together["cause"] == "together"
    # The whole is no longer than its parts one after another.
    assert 0 < together["rms"] <= sum(one["rms"] for one in parts)
    assert mimic["shares"]["curvature"] > 0.5
    assert document["recipe"]["outcome"] == "reached"
    assert document["recipe"]["chosen"]["drift"] <= document["target"]
    assert {one["code"] for one in document["findings"]} >= {"D1", "D2", "L3", "R2", "T1"}
    assert document["provenance"]["mujoco"] == mujoco.__version__


def test_fail_above_is_a_gate(oarlock_here):
    for bound, status in (("1e-9", 1), ("1e-2", 0)):
        said = oarlock_here("check", GRIPPER, "--fail-above", bound, "--budget", "0", "--json", "out.json")
        codes = [one["code"] for one in json.loads(Path("out.json").read_text(encoding="utf-8"))["findings"]]
        assert (said.returncode, "D7" in codes) == (status, status == 1)
        assert (f"expected at most {float(bound):g}" in said.stderr) == (status == 1)


def test_tuned_copy_holds_what_it_promises(oarlock_here):
    said = oarlock_here("check", CHECKED / "contacts.xml", "--ignore-inequalities", "--write-tuned", "tuned.xml")
    assert said.returncode == 0, said.stderr
    bound = (
        f"{3**0.5 * usual_target(0.7):g}"  # the loop is 0.7 m wide; of each of three rows, and this is their distance
    )
    said = oarlock_here("check", "tuned.xml", "--ignore-inequalities", "--fail-above", bound, "--budget", "0")
    assert said.returncode == 0, said.stderr


def test_keyframe_is_the_closed_start(oarlock_here):
    source = CHECKED / "locked_cranks.xml"
    assert oarlock_here("check", source, "--budget", "0", "--write-keyframe", "closed.xml").returncode == 0
    model = mujoco.MjModel.from_xml_path("closed.xml")
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.nkey - 1)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() <= 1e-9


def test_controls_can_be_chosen(oarlock_here):
    leg = CHECKED / "biped_leg" / "leg.xml"
    model = mujoco.MjModel.from_xml_path(str(leg))
    name = model.actuator(0).name
    common = ("check", leg, "--budget", "0", "--duration", "0.1", "--json", "-")
    held = json.loads(oarlock_here(*common, "--control", f"{name}=0.1").stdout)
    kept = dict(zip((model.actuator(index).name for index in range(model.nu)), model.key_ctrl[0].tolist(), strict=True))
    assert held["laws"] == {**{key: repr(value) for key, value in kept.items() if value}, name: "0.1"}
    moving = json.loads(oarlock_here(*common, "--control", f"{name}=0.1*sin(t)", "--keyframe", "none").stdout)
    assert (moving["laws"], moving["begins"]) == ({name: "0.1*sin(t)"}, "the model's own pose, at rest")
    first, second = (
        json.loads(oarlock_here(*common, "--controls", "random", "--seed", seed).stdout) for seed in (1, 2)
    )
    assert first["laws"] != second["laws"]
    assert first["duration_s"] == pytest.approx(0.1)


def test_another_integrator_and_timestep(oarlock_here):
    """Time stepping under Euler, nothing of it under Runge–Kutta at half the step, of a fast four-bar."""
    shares = {}
    for integrator, timestep in (("euler", 1e-3), ("rk4", 5e-4)):
        asked = ("--integrator", integrator, "--timestep", timestep, "--budget", "0", "--json", "-")
        document = json.loads(oarlock_here("check", "four_bar", *asked).stdout)
        assert document["timestep_s"] == timestep
        (pin,) = document["why"]["equalities"]
        shares[integrator] = pin["shares"]["stepping"]
    assert shares["euler"] > 0.9
    assert abs(shares["rk4"]) < 0.01


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["nothing.xml"], "nothing.xml"),
        ([CHECKED / "none.xml"], "no <equality> element"),
        ([GRIPPER, "--keyframe", "wide"], "expected one of: open, shut"),
        ([GRIPPER, "--controls", "wild"], "expected one of: keyframe, constant, random"),
        ([GRIPPER, "--control", "x"], "--control x, expected ACTUATOR=VALUE"),
        ([GRIPPER, "--control", "x=1"], "actuator"),
        ([GRIPPER, "--duration", "nan"], "duration = nan s, expected a finite number > 0"),
        ([GRIPPER, "--timestep", "0"], "timestep = 0 s, expected a finite number > 0"),
        ([GRIPPER, "--integrator", "heun"], "expected one of: euler, implicit, implicitfast, rk4"),
        ([GRIPPER, "--integrator", ""], "expected one of: euler, implicit, implicitfast, rk4"),
        ([GRIPPER, "--target", "0"], "target = 0, expected a finite number > 0"),
        ([GRIPPER, "--duration", "1e9"], "steps, expected at most 1,000,000"),
        ([GRIPPER, "--fail-above", "nan"], "fail_above = nan, expected a finite number ≥ 0"),
        ([GRIPPER, "--fix", GRIPPER], "is the model itself"),
        ([GRIPPER, "--fix", "no/out.xml"], "'no/out.xml' cannot be written: no folder"),
        (["n_four_bar", "--write-tuned", "out.xml"], "builds its model by a script"),
    ],
)
def test_a_mistake_is_one_line(oarlock_here, arguments, expected):
    said = oarlock_here("check", *arguments)
    assert said.returncode == 2
    assert expected in said.stderr
    assert len(said.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (["--budget", "0", "--write-keyframe", "out.xml"], "'out.xml' is not written: no pose near the start"),
        (["--write-tuned", "out.xml"], "'out.xml' is not written: there is no closed start"),
    ],
)
def test_a_copy_that_cannot_be_had_costs_nothing_else(oarlock_here, flags, expected):
    said = oarlock_here("check", CHECKED / "unreachable.xml", *flags, "--json", "out.json")
    assert said.returncode == 1
    assert expected in said.stderr
    assert json.loads(Path("out.json").read_text(encoding="utf-8"))["findings"]


def test_a_keyframe_takes_the_controls_of_its_start_along(oarlock_here):
    said = oarlock_here(
        "check", GRIPPER, "--budget", "0", "--duration", "0.01", "--keyframe", "shut", "--write-keyframe", "closed.xml"
    )
    assert said.returncode == 0, said.stderr
    model = mujoco.MjModel.from_xml_path("closed.xml")
    np.testing.assert_array_equal(model.key("closed").ctrl, model.key("shut").ctrl)
    assert model.key("shut").ctrl.any()


def test_from_python():
    heard = Heard()
    checked = oarlock.check(GRIPPER, budget=0, duration=0.2, progress=heard)
    assert (heard.ahead, heard.done, heard.names) == (len(PARTS), len(PARTS), list(PARTS))
    assert checked.findings.columns == ["severity", "code", "name", "element", "line"]
    assert set(checked.drift["level"]) == {"position", "velocity", "acceleration"}
    by_equality = checked.causes.group_by("equality").agg(pl.col("share").sum())
    np.testing.assert_allclose(by_equality["share"], 1.0)
    assert checked.trials.is_empty()
    assert checked.mjcf == ""
    assert "checked" in repr(checked)


# Without a run.


@pytest.mark.parametrize(("name", "status"), [("mimic_ring", 1), ("drawn_apart", 0), ("contacts", 0)])
def test_a_lint_is_a_gate_for_errors(oarlock_here, name, status):
    file = FIXTURES / "check" / f"{name}.xml"
    said = oarlock_here("check", "--lint", file)
    assert (said.returncode, said.stderr) == (status, "")
    assert "\nFindings\n" in said.stdout
    machine = oarlock_here("check", "--lint", file, "--json", "-")
    assert machine.returncode == status
    document = json.loads(machine.stdout)
    assert (document["drift"], document["recipe"], document["loops"]) == ([], None, None)
    assert all(one["code"] in said.stdout for one in document["findings"])
    assert bool(status) == any(one["severity"] == "error" for one in document["findings"])


@pytest.mark.parametrize("flag", ["--report", "--write-keyframe", "--write-tuned", "--fail-above"])
def test_a_lint_shows_no_run(oarlock_here, flag):
    said = oarlock_here("check", "--lint", GRIPPER, flag, "1")
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr == f"oarlock: {flag} with --lint, expected one of the two: it shows a run\n"


def test_a_lint_in_python(tmp_path):
    checked = oarlock.check(FIXTURES / "check" / "welded_pin.xml", lint=True)
    assert checked.findings["code"].to_list() == ["L10"]
    assert "L10 pin" in repr(checked)
