"""Contacts, limits and friction loss: taken as MuJoCo has them, or ignored on request and then said to be."""

import json

import mujoco
import pytest
from mechanisms import case_of, four_bar, frames_of, setup_of, write_model
from oarlock import InputError, run
from oarlock.mechanics.inequalities import ignore_inequalities, may_act
from oarlock.report.case_report import write_report
from tolerances import CALIBRATION_SWINGING, CLOSED, FREE_PARITY

HAND = '<geom name="hand" type="sphere" size="0.1" contype="1" conaffinity="1"/>'
REST = """<worldbody><site name="peg" pos="0 0 2"/>
    <geom name="wall" type="sphere" size="0.1" pos="0 0 0.3" contype="1" conaffinity="1"/></worldbody>
  <tendon><spatial name="cord" range="0 1" frictionloss="1"><site site="tip1"/><site site="peg"/></spatial></tendon>"""
EVERYTHING = {"rocker": 'range="0.1 1" frictionloss="0.1"', "body": HAND, "rest": REST}
SHORT = {"mode": "free", "solver": ["pinv", "mujoco"], "duration": 0.2}


def test_everything_at_once_runs(tmp_path):
    """Friction of a joint and of a tendon, limits of both, and a contact, all at the start."""
    path = write_model(tmp_path, four_bar(**EVERYTHING))
    rows = run(path, **SHORT).rows
    assert [row["status"] for row in rows] == ["done"] * len(rows)
    exact = next(row for row in rows if row["form"] == "hard")
    assert exact["drift_pos_max"] < CLOSED
    assert min(exact["limit_force_max"], exact["friction_force_max"], exact["contact_force_max"]) > 0


@pytest.mark.filterwarnings("ignore:.*flex 'cloth' is not rigid")
def test_contacts_that_are_no_rows_are_refused(tmp_path):
    """The flag ipc solves contacts of flexes in another way."""
    flex = """<option integrator="discrete"><flag ipc="enable"/></option><worldbody>
      <flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" pos="0 0 5" radius="0.01"/></worldbody>"""
    path = write_model(tmp_path, four_bar(rest=flex))
    with pytest.raises(InputError, match="the flag ipc is enabled and the model has a flex"):
        setup_of(case_of(path))


@pytest.mark.parametrize(
    ("changes", "acts"),
    [
        ({}, False),
        ({"rocker": 'range="0.1 1"'}, True),
        ({"rocker": 'frictionloss="0.1"'}, True),
        ({"body": HAND}, True),
    ],
)
def test_what_may_act(changes, acts):
    model = mujoco.MjModel.from_xml_string(four_bar(**changes))
    assert may_act(model) is acts
    ignore_inequalities(model)
    assert not may_act(model)


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
    assert oarlock_here(*arguments).returncode == 0
    ignored = oarlock_here(*arguments, "--ignore-inequalities")
    assert ignored.returncode == 0
    assert "oarlock: inequalities ignored: limits of joints rocker" in ignored.stderr
