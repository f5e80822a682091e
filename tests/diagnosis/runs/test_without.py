"""Causes that are taken away: a solver that stops early, and what is no evidence for any."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from oarlock.mechanics.load import collected_warnings
from tolerances import SAME_RUN

DECKS = 4
"""Parallelograms one upon another."""


def tower(solver: str) -> str:
    """Parallelograms that carry one another and a load, driven at the lowest rod."""
    body = '<body name="load" pos="0.15 0 0.02"><geom type="sphere" size="0.03" mass="4"/></body>'
    pins = ""
    for deck in reversed(range(DECKS)):
        base = "0 0 1" if deck == 0 else "0 0 0.02"
        beside = "0.25 0 1" if deck == 0 else "0.25 0 0.02"
        body = f"""
        <body pos="{base}"><joint name="in{deck}"/><geom fromto="0 0 0 0.04 0 0.12"/>
          <body name="deck{deck}" pos="0.04 0 0.12"><joint name="top{deck}"/>
            <geom type="box" size="0.12 0.05 0.005" pos="0.12 0 0" mass="0.2"/>{body}</body></body>
        <body name="side{deck}" pos="{beside}"><joint name="out{deck}"/><geom fromto="0 0 0 0.04 0 0.12"/></body>"""
        pins = f'<connect name="pin{deck}" body1="deck{deck}" body2="side{deck}" anchor="0.25 0 0"/>{pins}'
    return f"""
    <mujoco>
      <option timestep="0.002" {solver}/>
      <default><geom type="capsule" size="0.01" density="1000" contype="0" conaffinity="0"/>
        <joint axis="0 1 0" damping="0.4"/><equality solref="0.01 1"/></default>
      <worldbody>{body}</worldbody>
      <equality>{pins}</equality>
      <actuator><position name="servo" joint="in0" kp="250" kv="3"/></actuator>
      <keyframe><key ctrl="0.2"/></keyframe>
    </mujoco>"""


def opened(file: Path, change=None) -> np.ndarray:
    """Largest distance at each pin in a run of plain MuJoCo at each step, (steps, pins)."""
    model = mujoco.MjModel.from_xml_path(str(file))
    if change is not None:
        change(model)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    found = []
    with collected_warnings():
        for _ in range(1000):
            mujoco.mj_forward(model, data)
            found.append(np.linalg.norm(data.efc_pos[: data.ne].reshape(-1, 3), axis=1))
            mujoco.mj_step(model, data)
    return np.array(found)


def enough(model: mujoco.MjModel) -> None:
    model.opt.solver, model.opt.iterations = mujoco.mjtSolver.mjSOL_NEWTON, 100
    model.opt.ls_iterations, model.opt.tolerance = 50, 1e-10


def test_a_starved_solver_leads_and_nothing_else_is_blamed(tmp_path):
    file = tmp_path / "tower.xml"
    file.write_text(tower('solver="CG" iterations="5" ls_iterations="5"'))
    given, fed = opened(file), opened(file, enough)
    step, pin = np.unravel_index(int(given.argmax()), given.shape)
    part = 1 - fed[max(0, step - 20) : step + 21, pin].max() / given[step, pin]  # 2 % of 1000 steps
    assert part > 0.5
    checked = oarlock.check(file, budget=0)
    findings = [one for one in checked.verdict if one.severity != "note"]
    assert findings[0].code == "D6"
    assert findings[0].element == f"pin{pin}"
    assert findings[0].figures["part"] == pytest.approx(part, rel=SAME_RUN)
    assert not {one.code for one in findings} & {"D1", "D3", "D4", "U5"}
    said = next(one.line for one in findings if one.element == f"pin{pin}")
    assert "of it is what the solver left (with Newton, 100 iterations, tolerance 1e-10" in said


def test_a_run_that_a_starved_solver_blows_up_is_its_fault(tmp_path):
    file = tmp_path / "tower.xml"
    file.write_text(tower('solver="CG" iterations="4" ls_iterations="4"'))
    one, *_ = oarlock.check(file, budget=0).verdict
    assert (one.code, one.severity) == ("D6", "error")
    assert one.figures["drift"] == pytest.approx(opened(file, enough).max(), rel=SAME_RUN)


def test_a_solver_that_arrives_is_not_run_again(tmp_path):
    file = tmp_path / "tower.xml"
    file.write_text(tower('solver="CG" iterations="100"'))
    exam = oarlock.check(file, budget=0).examination
    assert "solver" not in {one.cause for one in exam.without}


THICK = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0"/>
  <default><geom type="capsule" size="0.01" contype="0" conaffinity="0"/><joint axis="0 1 0"/></default>
  <worldbody>
    <body><joint name="crank"/><geom fromto="0 0 0 0 0 0.1" mass="0.3"/>
      <body name="rod" pos="0 0 0.1"><joint/><geom fromto="0 0 0 0.3 0 0" mass="0.2"/></body></body>
    <body name="arm" pos="0.3 0 0"><joint damping="DAMPING"/><geom fromto="0 0 0 0 0 0.1" mass="0.2"/></body>
  </worldbody>
  <equality><connect name="pin" body1="rod" body2="arm" anchor="0.3 0 0"
    solref="0.008 0.5" solimp="0.9999 0.9999 0.001 0.5 2"/></equality>
  <actuator><motor joint="crank"/></actuator>
  <keyframe><key ctrl="20"/></keyframe>
</mujoco>"""
"""An arm with thick damping."""


def explicit(model: mujoco.MjModel) -> None:
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP


def test_the_share_of_implicit_damping_is_what_explicit_damping_leaves(tmp_path):
    file = tmp_path / "thick.xml"
    file.write_text(THICK.replace("DAMPING", "0.4"))
    given, left = opened(file)[:, 0], opened(file, explicit)[:, 0]
    worst = int(given.argmax())
    part = 1 - left[max(0, worst - 20) : worst + 21].max() / given[worst]  # 2 % of 1000 steps
    one = next(one for one in oarlock.check(file, budget=0).verdict if one.code == "D4")
    assert 0.5 < part == pytest.approx(one.figures["part"], rel=SAME_RUN)


def test_no_share_is_said_of_it_where_an_explicit_run_diverges(tmp_path):
    """Such a step is unstable whatever the loop does, which says nothing of the loop."""
    file = tmp_path / "thick.xml"
    file.write_text(THICK.replace("DAMPING", "2"))
    checked = oarlock.check(file, budget=0)
    measured = {one.cause: one for one in checked.examination.without}
    assert not measured["implicit"].left
    one = next(one for one in checked.verdict if one.code == "D4")
    assert "%" not in one.line
    assert one.line.endswith("how much of it is not known: without it the run diverges)")
    assert one.figures["part"] is None
