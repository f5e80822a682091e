"""Causes are found by taking them out, of programs that are made up with one thing changed."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from fake_engines import engine
from mechanisms import four_bar
from oarlock.conformance.causes import Cause, candidates, is_single, tell, tell_reader
from oarlock.conformance.laws import EXACT, MUJOCO, Law, Laws, apart
from oarlock.conformance.precision import allowance
from oarlock.engines import asking, environments, running
from oarlock.engines.answers import Answer, read
from tolerances import HAND_SOLVED, SAME_LAW

BLOCK = """
<body pos="2 0 0.0499"><freejoint/><geom type="box" size="0.05 0.05 0.05" contype="1" conaffinity="1" mass="1"/></body>
<body pos="2 0 -1"><geom type="box" size="1 1 1" contype="1" conaffinity="1" mass="1"/></body>
"""
"""A block that slides on a table beside the four-bar: its friction differs from cone to cone."""

WHEEL = """<body name="wheel" pos="0 1 0"><joint name="wheel"/><geom fromto="0 0 0 0.2 0 0"/></body>"""

MODELS = {
    "redundant": four_bar(),
    "two loops": four_bar(
        rest='<equality><joint name="gear" joint1="wheel" joint2="crank" polycoef="0 2 0.2 0 0"/></equality>'
    ).replace("</worldbody>", f"{WHEEL}</worldbody>"),
    "sliding": four_bar(body="").replace("</worldbody>", f"{BLOCK}</worldbody>"),
}
STATES = 8


def states_of(model):
    """Closed at the model's own pose, where these have their loops closed, and moving as the rows admit or at rest."""
    rng = np.random.default_rng(1)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    J = np.zeros((data.nefc, model.nv))
    J[:] = data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)
    free = np.linalg.svd(J[: data.ne])[2][np.linalg.matrix_rank(J[: data.ne], tol=1e-9) :]
    qvel = rng.normal(size=(STATES, len(free))) @ free * np.linspace(3.0, 0.0, STATES)[:, None]
    return asking.states_of(model, np.tile(model.qpos0, (STATES, 1)), qvel, np.zeros((STATES, model.nu)))


@pytest.fixture(scope="module")
def laws():
    made = {}
    for name, text in MODELS.items():
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        made[name] = Laws(model, states_of(model))
    return made


def answered(folder, name, laws: Laws, text: str) -> Answer:
    """What a made-up engine answers to the states."""
    model, states = laws.model, laws.states
    files = {
        "model.xml": text.replace("<option", '<option jacobian="dense"', 1).encode(),
        "model.npz": asking.arrays_of(model),
        "states.parquet": states.table(),
        "ask.json": asking.ask("made up", model, "forward", settings=asking.ACCURATE),
    }
    chosen = engine(folder, name)
    written = running.run(chosen.program, environments.find(chosen), [asking.write(folder / "ask", files)])
    return read(written.files[0], model.nq, model.nv, len(states), written.status)


@pytest.mark.parametrize(
    ("name", "model", "cause", "text"),
    [
        ("true", "redundant", "agrees", "as MuJoCo"),
        ("true", "two loops", "agrees", "as MuJoCo"),
        ("true", "sliding", "agrees", "as MuJoCo"),
        ("without_jdotv", "redundant", "jdotv", "no J̇v"),
        ("without_jdotv", "two loops", "jdotv", "no J̇v"),
        ("single", "redundant", "agrees+float32", "as MuJoCo, within float32"),
        ("single_without_jdotv", "redundant", "jdotv+float32", "no J̇v, within float32"),
        ("drops_a_row", "two loops", "rows", "without 'pin'"),
        ("exact", "redundant", "exact", "exact rows, no softness"),
        ("other_cone", "sliding", "cone", "elliptic friction cone"),
        ("lighter", "redundant", "mass", "other mass of 'crank'"),
        ("other_weights", "redundant", "compiled", "body_invweight0 compiled otherwise"),
        ("remembers", "redundant", "jdotv+history", "no J̇v; asked once more: as MuJoCo"),
        ("wrong", "redundant", "unexplained", "unexplained: "),
        ("wrong", "two loops", "unexplained", "unexplained: "),
    ],
)
def test_a_cause_is_found(tmp_path, laws, name, model, cause, text):
    found = tell(laws[model], answered(tmp_path, name, laws[model], MODELS[model]))
    assert found.name == cause, found
    assert found.text.startswith(text)


def test_what_is_unexplained_says_what_is_left(tmp_path, laws):
    found = tell(laws["redundant"], answered(tmp_path, "wrong", laws["redundant"], MODELS["redundant"]))
    assert found.left is not None
    assert found.allowed is not None
    assert found.left == pytest.approx(0.01, rel=0.5)
    assert found.allowed < found.left


@pytest.mark.parametrize("model", MODELS)
def test_the_law_of_mujoco_is_mujocos(laws, model):
    own = laws[model].installed()
    assert apart(own.qacc, laws[model].solve(MUJOCO)).max() < SAME_LAW


def test_exact_rows_do_not_accelerate(laws):
    """J q̈ + J̇v = 0, J̇v by differences of J along the motion."""
    one = laws["redundant"]
    solved, model = one.solve(EXACT), one.model
    data, step = mujoco.MjData(model), 1e-6
    for number in range(len(one.states)):
        rates = []
        for way in (-0.5, 0.5):
            one.place(data, number)
            qvel = data.qvel.copy() + way * step * solved.qacc[number]
            mujoco.mj_integratePos(model, data.qpos, data.qvel, way * step)
            mujoco.mj_fwdPosition(model, data)
            rates.append(data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv) @ qvel)
        assert np.abs(rates[1] - rates[0]).max() / step < HAND_SOLVED * max(1.0, np.abs(solved.qacc[number]).max())


def test_a_difference_of_every_size_beyond_the_allowance_counts(laws):
    """The rule for float32 lets nothing through that is a little more than what it allows."""
    one = laws["redundant"]
    base = one.solve(MUJOCO)
    allowed = allowance(one, base, True)
    assert (allowed > 0).all()
    assert allowed.max() < 0.1
    values = (base.qacc * (1.0 + 20.0 * allowed)).astype(np.float32).astype(float)
    answer = Answer("made up", {}, "float32", [], [], {}, one.states.time, values, values, one.states.qpos, values)
    assert is_single(answer)
    assert tell(one, answer).name == "unexplained"
    within = (base.qacc * (1.0 + 0.1 * allowed)).astype(np.float32).astype(float)
    assert tell(one, replace(answer, qacc=within)).name == "agrees+float32"


def test_double_precision_is_held_to_more(laws):
    one = laws["redundant"]
    base = one.solve(MUJOCO)
    values = base.qacc * (1.0 + 1e-4)
    answer = Answer("made up", {}, "float32", [], [], {}, one.states.time, values, values, one.states.qpos, values)
    assert not is_single(answer)  # whatever it says
    assert tell(one, answer).name == "unexplained"
    nearly = tell(one, replace(answer, qacc=base.qacc * (1.0 + 3e-6)))
    assert nearly.name == "agrees+residue"
    assert "but for" in nearly.text


def test_the_laws_that_are_tried_begin_with_no_change(laws):
    answer = Answer("made up", {}, "float64", [], [], {})
    tried = list(candidates(laws["two loops"], answer))
    assert tried[0] == MUJOCO
    assert len(tried) == len(set(tried)) > 8


@pytest.mark.parametrize(
    ("facts", "cause", "text"),
    [
        (
            {"total_mass": 1e-9, "body_masses": {"crank": 0.0}, "rows": 0},
            "reader+mass+rows",
            "on import: mass 1e-09 kg",
        ),
        ({"rows": 1}, "reader+rows", "on import: 1 of 3 equality rows kept"),
        ({}, "reader", "its reader tells nothing"),
    ],
)
def test_what_a_reader_lost(laws, facts, cause, text):
    found = tell_reader(laws["redundant"], Answer("made up", {}, "float64", [], [], facts), 3)
    assert isinstance(found, Cause)
    assert found.name == cause
    assert found.text.startswith(text)


def test_a_reader_that_keeps_all(laws):
    one = laws["redundant"]
    facts = {"total_mass": float(one.model.body_mass.sum()), "rows": 3}
    assert (
        tell_reader(one, Answer("made up", {}, "float64", [], [], facts), 3).text == "its reader keeps masses and rows"
    )


def test_masses_that_changed_bodies_are_lost_masses(laws):
    """Their sum says nothing of it, nor does the number of rows of the names of equalities."""
    one = laws["two loops"]
    masses = one.masses()
    first, second, *_ = masses
    swapped = {**masses, first: masses[second] * 2.0, second: masses[first] - masses[second]}
    facts = {"total_mass": sum(masses.values()), "body_masses": swapped, "rows": 4}
    found = tell_reader(one, Answer("made up", {}, "float64", [], [], facts), 4)
    assert found.name == "reader+mass"
    renamed = {"total_mass": sum(masses.values()), "body_masses": masses, "rows": 4, "equalities": ["pin", "other"]}
    found = tell_reader(one, Answer("made up", {}, "float64", [], [], renamed), 4)
    assert found.name == "reader+rows"
    assert "'gear'" in found.text


ROTOR = """<body name="rotor" pos="0 2 0"><joint name="rotor" axis="0 1 0"/>
  <inertial pos="0 0 0" mass="0.001" diaginertia="1e-9 1e-9 1e-9"/></body>"""


def test_a_mechanism_is_measured_by_itself():
    """A rotor of a milligram beside a four-bar, under a torque: accelerations of 1e6, and the loop without its pin."""
    text = four_bar(rest='<actuator><motor name="m" joint="rotor" gear="0.001"/></actuator>')
    model = mujoco.MjModel.from_xml_string(text.replace("</worldbody>", f"{ROTOR}</worldbody>"))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    states = states_of(model)
    one = Laws(model, replace(states, ctrl=np.ones_like(states.ctrl)))
    assert [len(block) for block in one.blocks] == [3, 1]
    solved = one.solve(MUJOCO)
    assert np.abs(solved.qacc[:, 3]).min() > 1e5
    left_out = one.solve(Law(without=("pin",)))
    found = tell(one, Answer("made up", {}, "float64", [], [], {}, states.time, left_out.qacc, left_out.force))
    assert found.name == "rows"
    assert apart(left_out.qacc, solved)[:, 0].max() > 0.1
    assert apart(left_out.qacc, solved)[:, 1].max() < SAME_LAW


def test_of_laws_that_a_precision_does_not_tell_apart_the_one_that_leaves_far_less(laws):
    """Velocities so small that J̇v is within what float32 loses, and answers that are J̇v's to the last digit."""
    whole = laws["redundant"]
    one = Laws(whole.model, replace(whole.states, qvel=0.01 * whole.states.qvel))
    without = one.solve(Law(curvature=False))
    sizes = allowance(one, one.solve(MUJOCO), True)
    assert (apart(without.qacc, one.solve(MUJOCO)) <= sizes).all()
    values = without.qacc.astype(np.float32).astype(float)
    found = tell(one, Answer("made up", {}, "float32", [], [], {}, one.states.time, values, without.force))
    assert found.name == "jdotv+float32"
    between = (0.5 * (without.qacc + one.solve(MUJOCO).qacc)).astype(np.float32).astype(float)
    found = tell(one, Answer("made up", {}, "float32", [], [], {}, one.states.time, between, without.force))
    assert "which does not tell it from no J̇v" in found.text
