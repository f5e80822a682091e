"""The exact run beside a recorded one: where it ends, and what is left of one that diverged."""

import mujoco
import oarlock
import pytest
from mechanisms import four_bar
from oarlock.diagnosis.runs.exact import record_exact
from oarlock.stepping import native_path
from oarlock.tables.promise import ERROR_BOUND

AWAY = four_bar(joint='stiffness="-1e5"', rest='<keyframe><key name="off" qpos="1e-3 0 0"/></keyframe>')
"""Springs that push away from their rest, so that every engine is thrown about until its numbers overflow."""


@pytest.mark.parametrize("stepping", ["native", "python"])
def test_an_exact_run_that_overflows_diverged_at_its_time(monkeypatch, stepping):
    if stepping == "python":
        monkeypatch.setattr(native_path, "refusal", lambda: "not here")
    model = mujoco.MjModel.from_xml_string(AWAY)
    data = mujoco.MjData(model)
    data.qvel[:] = 1e-3, 0.0, 0.0
    run = record_exact(model, data.qpos, data.qvel, {}, 500)
    assert run.end.how == "diverged"
    assert 0 < run.end.time_s < 0.1
    assert len(run.time) == len(run.qpos) == round(run.end.time_s / run.timestep_s)


def test_nothing_is_computed_from_an_exact_run_that_diverged(tmp_path):
    path = tmp_path / "away.xml"
    path.write_text(AWAY)
    document = oarlock.check(path).document()
    assert document["exact"] is None
    assert document["missing"]["exact"].startswith("it diverged at t = 0.01")
    assert {one["exact_metres"] for one in document["drift"]} == {None}
    assert not {one["code"] for one in document["findings"]} & {"L5", "U2", "V1"}


def test_the_exact_solution_says_how_far_it_got_and_how_far_it_is_off(tmp_path):
    path = tmp_path / "bar.xml"
    path.write_text(four_bar(rest='<keyframe><key name="up" qvel="3 -3 0"/></keyframe>'))
    found = oarlock.check(path, budget=0, integrator="rk4")
    exact = found.document()["exact"]
    assert exact["end"] == {"how": "finished", "time_s": pytest.approx(1.998), "message": ""}
    assert 0 < exact["error"] < ERROR_BOUND
    assert exact["integrator"] == "rk4"
