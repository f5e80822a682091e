"""Contacts, limits and friction: refused by name all at once, or ignored on request and then said to be."""

import json

import mujoco
import pytest
from mechanisms import case_of, four_bar, frames_of, setup_of, write_model
from oarlock import InputError, run
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.report.case_report import write_report
from tolerances import CALIBRATION_SWINGING, FREE_PARITY

HAND = '<geom name="hand" type="sphere" size="0.1" contype="1" conaffinity="1"/>'
REST = """<worldbody><site name="peg" pos="0 0 2"/>
    <geom name="wall" type="sphere" size="0.1" pos="0 0 0.3" contype="1" conaffinity="1"/></worldbody>
  <tendon><spatial name="cord" range="0 1" frictionloss="1"><site site="tip1"/><site site="peg"/></spatial></tendon>"""
EVERYTHING = {"rocker": 'range="0.1 1" frictionloss="0.1"', "body": HAND, "rest": REST}
SHORT = {"mode": "free", "solver": ["pinv", "mujoco"], "duration": 0.2}


def test_all_active_ones_are_named(tmp_path):
    path = write_model(tmp_path, four_bar(**EVERYTHING))
    with pytest.raises(InputError) as raised:
        setup_of(case_of(path))
    text = str(raised.value)
    assert text.startswith(
        "friction of joint 'rocker', friction of tendon 'cord', limit of joint 'rocker', limit of tendon 'cord' "
        "and 1 more are active at t = 0 s"  # the contact is the fifth
    )
    assert "or run with --ignore-inequalities" in text
    assert "\n" not in text


def test_ignored_model_runs_as_one_that_has_none(tmp_path):
    path = write_model(tmp_path / "with", four_bar(**EVERYTHING))
    bare = write_model(tmp_path / "without", four_bar(body=HAND.replace('"1"', '"0"')))
    found = run(path, ignore_inequalities=True, **SHORT)
    expected = run(bare, **SHORT)
    assert [row["run"] for row in found.rows] == [row["run"] for row in expected.rows]
    for ours, theirs in zip(frames_of(found), frames_of(expected), strict=True):
        for qpos1, qpos2 in zip(ours["qpos"], theirs["qpos"], strict=True):
            assert (qpos1 - qpos2).abs().max() <= FREE_PARITY
    (calibration,) = [row for row in found.rows if row["mode"] == "calibration"]
    assert calibration["trajectory_diff_max"] <= CALIBRATION_SWINGING
    assert all(row["energy_drift_rel"] is not None for row in found.rows if row["mode"] == "free")
    assert "inequalities_ignored" not in expected.provenance


def test_what_was_ignored_is_said(tmp_path):
    path = write_model(tmp_path, four_bar(**EVERYTHING))
    results = run(path, ignore_inequalities=True, out=tmp_path / "out", **SHORT)
    said = results.provenance["inequalities_ignored"]
    assert said == (
        "contacts; limits of joints rocker; limits of tendons cord; friction of joints rocker; friction of tendons cord"
    )
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["provenance"]["inequalities_ignored"] == said
    page = (write_report(tmp_path / "out", tmp_path / "report") / "README.md").read_text()
    assert f"**Inequalities ignored:** {said}." in page


def test_models_without_any_say_so():
    model = mujoco.MjModel.from_xml_string(four_bar())
    assert ignore_inequalities(model) == "none in the model"


def test_command(oarlock_here, tmp_path):
    write_model(tmp_path, four_bar(rocker='range="0.1 1"'))
    arguments = ("run", "model.xml", "--mode", "free", "--duration", "0.02", "--solver", "pinv")
    refused = oarlock_here(*arguments)
    assert refused.returncode == 2
    assert "limit of joint 'rocker' is active" in refused.stderr
    ignored = oarlock_here(*arguments, "--ignore-inequalities")
    assert ignored.returncode == 0
    assert "oarlock: inequalities ignored: limits of joints rocker" in ignored.stderr
