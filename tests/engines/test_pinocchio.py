"""Pinocchio's program: what it refuses without Pinocchio, and its answers beside ours where it is there."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import polars as pl
import pytest
from engine_asks import Engine, closed_states, compiled, driven_start, exact_of, program, refused, truth_error
from mechanisms import TANGLE, four_bar, write_model
from oarlock.engines import running
from oarlock.engines.asking import arrays_of, ask, states_of, write

AGREEMENT = 1e-7
"""Relative. What is asked of every model; 1e-11 at most is measured."""

OPEN = 1e-9
"""Relative. The same rows of a state that is far from closed, once more: 1e-12 (measured)."""

REFUSED = {
    "cable_loop": "tendon 'over_the_drum'",
    "friction_latch": "joint 'right_bolt'",
    "gripping_gripper": "joint 'right_crank'",
    "scissor_lift": "contacts",
    "standing_leg": "contacts",
}
"""Model of the gallery → the first of what Pinocchio has no words for."""


@pytest.mark.parametrize("name", REFUSED)
def test_what_it_has_no_words_for_is_named(name: str, tmp_path: Path):
    model, states = closed_states(name, 2)
    assert refused(tmp_path, "pinocchio", model, states)[0] == REFUSED[name]


def test_a_limit_is_refused_where_it_acts(tmp_path: Path):
    path = write_model(tmp_path, four_bar(rocker='range="-1 1"'))
    model = mujoco.MjModel.from_xml_path(str(path))
    states = states_of(model, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.1]]), np.zeros((2, 3)), np.zeros((2, 0)))
    assert refused(tmp_path / "a", "pinocchio", model, states) == ["joint 'rocker'"]
    assert refused(tmp_path / "b", "pinocchio", model, states, precision="float32")[-1] == "precision 'float32'"


@pytest.mark.parametrize(
    ("change", "element"),
    [
        (
            {"body": '<body><joint name="soft" type="ball" stiffness="1"/><geom type="sphere" size="0.1"/></body>'},
            "joint 'soft'",
        ),
        ({"joint": 'damping="1 0.5"'}, "joint 'crank'"),
        ({"rest": '<option viscosity="0.1"/>'}, "option"),
        ({"rest": '<actuator><muscle name="m" joint="crank" lengthrange="-1 1"/></actuator>'}, "actuator 'm'"),
        ({"body": '<body name="light" gravcomp="1"><geom type="sphere" size="0.1"/></body>'}, "body 'light'"),
    ],
)
def test_forces_that_a_run_lacks_are_named(change: dict[str, str], element: str, tmp_path: Path):
    model = mujoco.MjModel.from_xml_string(four_bar(**change))
    states = states_of(model, model.qpos0[None], np.zeros((1, model.nv)), np.zeros((1, model.nu)))
    assert refused(tmp_path, "pinocchio", model, states, question="run")[0] == element


def test_forces_of_a_run_are_those_of_mujoco():
    actuator = """<actuator>
      <position joint="crank" kp="3" kv="0.2" gear="2" ctrlrange="-0.4 0.4" forcerange="-1 1"/>
      <motor joint="rocker" gear="-3"/><damper joint="coupler" kv="2" ctrlrange="0 2"/>
    </actuator>"""
    xml = four_bar(joint='damping="0.3" stiffness="2" springref="0.4"', rocker='ref="0.2"', rest=actuator)
    model = mujoco.MjModel.from_xml_string(xml)
    random = np.random.default_rng(0)
    qpos, qvel, ctrl = (random.normal(size=(20, 3)) for _ in range(3))
    states = states_of(model, qpos, qvel, np.abs(ctrl))
    forces = program("shared/forces")
    for row in range(20):
        columns = {"time": states.time[row:], "ctrl": states.ctrl[row:]}
        laws = forces.Laws(compiled(model), forces.Controls(columns))
        assert list(laws.foreign()) == []
        assert laws(qpos[row], qvel[row], 0.0) == pytest.approx(states.applied[row], rel=1e-12, abs=1e-12)


def test_controls_go_straight_from_row_to_row_as_long_as_time_goes_on():
    controls = program("shared/forces").Controls(
        {"time": np.array([0.0, 1.0, 2.0, 0.0]), "ctrl": np.array([[0.0], [2.0], [0.0], [9.0]])}
    )
    assert [controls(time)[0] for time in (-1.0, 0.5, 1.0, 1.5, 5.0)] == [0.0, 1.0, 2.0, 1.0, 0.0]


# With Pinocchio.


@pytest.fixture(scope="module")
def pinocchio() -> Engine:
    return Engine("pinocchio")


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(oarlock.model_names()) - set(REFUSED)))
def test_closed_states_accelerate_as_ours(name: str, pinocchio: Engine, tmp_path: Path):
    model, states = closed_states(name, 20)
    answer = pinocchio.answer(tmp_path, model, states, "forward")
    expected = exact_of(model, states)
    apart = np.linalg.norm(answer.qacc - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert apart.max() <= AGREEMENT, f"state {apart.argmax()}"
    assert answer.facts["total_mass"] == pytest.approx(model.body_mass.sum())


@pytest.mark.slow
def test_constraint_forces_are_what_accelerations_ask_for(pinocchio: Engine, tmp_path: Path):
    model, states = closed_states("welded_frame", 10)
    answer = pinocchio.answer(tmp_path, model, states, "forward")
    data = mujoco.MjData(model)
    for row in range(len(states)):
        data.qpos[:], data.qvel[:], data.qacc[:] = states.qpos[row], states.qvel[row], answer.qacc[row]
        mujoco.mj_inverse(model, data)
        needed = np.zeros(model.nv)
        mujoco.mj_rne(model, data, 1, needed)
        assert answer.qfrc_constraint[row] == pytest.approx(needed - states.applied[row], rel=1e-8, abs=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("index", range(14))
def test_every_form_of_an_equality_is_answered_far_from_closed(index: int, pinocchio: Engine, tmp_path: Path):
    armed = TANGLE.replace("<default>", '<default><joint armature="0.3"/>')
    armed = armed.replace("<freejoint name", '<joint type="free" armature="0.2" name')
    armed = armed.replace('<spatial name="line"', '<spatial name="line" armature="0.4"')
    model = mujoco.MjModel.from_xml_string(armed)
    assert (model.dof_armature > 0).all()
    assert (model.tendon_armature > 0).any()
    model.eq_active0[:] = 0
    model.eq_active0[index] = 1
    random, poses = np.random.default_rng(index), []
    for _ in range(5):
        qpos = model.qpos0.copy()
        mujoco.mj_integratePos(model, qpos, random.normal(size=model.nv), 1.0)
        poses.append(qpos)
    states = states_of(model, np.array(poses), random.normal(size=(5, model.nv)), np.zeros((5, 0)))
    answer = pinocchio.answer(tmp_path, model, states, "forward", settings={"method": "kkt"})
    expected = exact_of(model, states)
    apart = np.linalg.norm(answer.qacc - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert apart.max() <= OPEN


@pytest.mark.slow
@pytest.mark.parametrize("method", ["constraintDynamics", "lcaba"])
def test_its_own_methods_take_armature_and_free_joints(method: str, pinocchio: Engine, tmp_path: Path):
    model, states = closed_states("floating_four_bar", 10)
    model.dof_armature[:] = np.where(np.arange(model.nv) < 3, 0.7, 0.2)
    answer = pinocchio.answer(tmp_path, model, states, "forward", settings={"method": method, "mu": 1e-8})
    expected = exact_of(model, states)
    assert answer.facts["method"] == method
    apart = np.linalg.norm(answer.qacc - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert apart.max() <= (AGREEMENT if method == "constraintDynamics" else 1e-4)  # its μ shows as 1e-6


@pytest.mark.slow
def test_a_step_is_semi_implicit_euler(pinocchio: Engine, tmp_path: Path):
    model, states = closed_states("floating_four_bar", 5)
    answer = pinocchio.answer(tmp_path, model, states, "step")
    for row in range(len(states)):
        qpos, qvel = states.qpos[row].copy(), states.qvel[row] + model.opt.timestep * answer.qacc[row]
        mujoco.mj_integratePos(model, qpos, qvel, model.opt.timestep)
        assert answer.qvel[row] == pytest.approx(qvel, abs=1e-12)
        assert answer.qpos[row] == pytest.approx(qpos, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["boat", "bricard"])
def test_a_free_run_is_of_order_four(name: str, pinocchio: Engine, tmp_path: Path):
    errors = []
    for step in (4e-3, 2e-3):
        case, model, states = driven_start(name, 1.0, step)
        asked = {"steps": round(1.0 / step), "every": round(0.02 / step)}
        answer = pinocchio.answer(tmp_path / str(step), model, states, "run", **asked)
        assert answer.loop_error is not None
        assert answer.loop_error.max() < 1e-8
        errors.append(truth_error(case, model, answer))
    assert 10.0 < errors[0] / errors[1] < 25.0  # 2⁴, as far as a maximum over times has it
    assert errors[1] < 1e-7


@pytest.mark.slow
def test_a_call_is_timed(pinocchio: Engine, tmp_path: Path):
    model, states = closed_states("four_bar", 5)
    files = {"ask.json": ask("made up", model, "time"), "model.npz": arrays_of(model), "states.parquet": states.table()}
    written = running.run(pinocchio.program, pinocchio.environment, [write(tmp_path, files)])
    (tmp_path / "answer.parquet").write_bytes(written.files[0]["answer.parquet"])
    assert pl.read_parquet(tmp_path / "answer.parquet")["microseconds"].is_between(0.1, 1e4).all()
