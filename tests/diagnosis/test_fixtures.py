"""The models in fixtures/check, in the manner of files that others write: each is what it is there for."""

from collections import Counter
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from oarlock.base.errors import InputError
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.load import collected_warnings, load_model
from oarlock.mechanics.names import equalities
from oarlock.mechanics.prepare import prepare
from oarlock.mechanics.rows import closing_jacobian
from places import FIXTURES
from tolerances import CLOSED, FINITE_DIFFERENCE

CHECKED = FIXTURES / "check"

RANK_GAP = 1e-9
"""Relative singular value of J at poses closed to rounding: the redundant ones are below 1e-16, the others above 0.01
(measured)."""

SHORT = 0.1
"""m. What the lengths of unreachable.xml lack: 1.3 − 0.3 − 0.5 − 0.4."""


@dataclass(frozen=True)
class Facts:
    """What a model is at its start: velocities, equalities, rows, their rank, and how far it is open in m or rad."""

    nv: int
    neq: int
    rows: int
    rank: int
    gap: float = CLOSED


MODELS = {
    "gripper_2f/gripper_2f.xml": Facts(6, 3, 7, 5),
    "gripper_2f/scene.xml": Facts(12, 3, 7, 5),
    "biped_leg/leg.xml": Facts(19, 2, 6, 6),
    "biped_leg/scene.xml": Facts(19, 2, 6, 6),
    "thirty_equalities.xml": Facts(67, 30, 74, 64),
    "unreachable.xml": Facts(3, 1, 3, 2, gap=0.25),
    "diverges.xml": Facts(3, 1, 3, 2),
    "dead_point.xml": Facts(3, 1, 3, 2),
    "damped_gripper.xml": Facts(6, 3, 7, 5),
    "all_redundant.xml": Facts(4, 5, 11, 3),
    "contacts.xml": Facts(3, 1, 3, 2),
    "script_names.xml": Facts(4, 2, 4, 3),
    "ships_refsafe.xml": Facts(4, 2, 4, 3),
    "locked_cranks.xml": Facts(4, 2, 6, 3, gap=0.011),
    "short_arm.xml": Facts(2, 1, 3, 1, gap=0.81),
    "tilted_hinge.xml": Facts(3, 1, 3, 3),
    "torn_linkage.xml": Facts(3, 1, 3, 2),
    "fast_crank.xml": Facts(3, 1, 3, 2),
    "carried_tray.xml": Facts(6, 1, 6, 6, gap=0.0301),
    "starved_rods.xml": Facts(15, 3, 9, 9),
    "two_walls.xml": Facts(8, 3, 7, 6, gap=0.051),
    "pin_collision.xml": Facts(3, 1, 3, 2),
    "mimic_ring.xml": Facts(3, 3, 3, 3),
    "welded_pin.xml": Facts(3, 1, 6, 3),
    "drawn_apart.xml": Facts(3, 1, 3, 2, gap=0.14),
    "stiff_servo.xml": Facts(3, 1, 3, 2),
    "stiff_damping.xml": Facts(2, 1, 1, 1),
    "wrong_units.xml": Facts(2, 1, 1, 1, gap=30.0),
    "short_range.xml": Facts(2, 1, 1, 1),
    "ringing.xml": Facts(3, 3, 6, 2),
    "turned_weld.xml": Facts(4, 1, 6, 3, gap=0.93),
    "wrong_sign.xml": Facts(3, 2, 4, 3),
    "degrees.xml": Facts(2, 1, 1, 1, gap=25.0),
}
LASTING = [name for name in MODELS if name not in ("diverges.xml", "stiff_servo.xml", "stiff_damping.xml")]


def load(name: str) -> mujoco.MjModel:
    """As its author runs it, but that a NaN stays one."""
    model = load_model(CHECKED / name)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def start(model: mujoco.MjModel, key: int | None = None) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    mujoco.mj_forward(model, data)
    return data


def closing_rank(name: str, without: int | None = None) -> int:
    """Rank of the rows at the start, perhaps without those of one equality."""
    model = prepare(load(name), integrator="euler")
    data = mujoco.MjData(model)
    if without is not None:
        data.eq_active[without] = 0
    mujoco.mj_forward(model, data)
    values = np.linalg.svd(closing_jacobian(model, data), compute_uv=False)
    return int((values > RANK_GAP * values[0]).sum())


def second(model: mujoco.MjModel, data: mujoco.MjData):
    """Steps through a second, giving the data after each step."""
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        yield data


def test_no_model_is_forgotten():
    parts = {"gripper_2f/defaults.xml", "biped_leg/common.xml"}
    found = {path.relative_to(CHECKED).as_posix() for path in CHECKED.rglob("*.xml")}
    assert found == {*MODELS, *parts, "none.xml"}


@pytest.mark.parametrize("name", MODELS)
def test_is_what_it_says(name):
    facts = MODELS[name]
    model = load(name)
    data = start(model)
    assert (model.nv, model.neq, data.ne, closing_rank(name)) == (facts.nv, facts.neq, facts.rows, facts.rank)
    assert np.abs(data.efc_pos[: data.ne]).max() <= facts.gap


@pytest.mark.parametrize("name", LASTING)
def test_simulates_a_second_from_every_start(name):
    model = load(name)
    for key in (None, *range(model.nkey)):
        data = start(model, key)
        assert np.abs(data.efc_pos[: data.ne]).max() <= MODELS[name].gap
        for _ in second(model, data):
            assert np.isfinite(data.qpos).all()
        assert [int(warning.number) for warning in data.warning] == [0] * len(data.warning)


def limited(model: mujoco.MjModel) -> set[str]:
    return {model.joint(index).name for index in np.flatnonzero(model.jnt_limited)}


# One by one.


def test_gripper_has_limits_and_is_driven_by_one_tendon():
    model = load("gripper_2f/gripper_2f.xml")
    assert limited(model) == {model.joint(index).name for index in range(model.njnt)}
    kinds = [equality.kind.name for equality in equalities(model)]
    assert kinds == ["connect", "connect", "joint"]
    assert model.nu == 1
    assert model.actuator_trntype[0] == mujoco.mjtTrn.mjTRN_TENDON


def test_fingers_of_the_gripper_meet():
    model = load("gripper_2f/gripper_2f.xml")
    data = start(model, key=1)
    assert data.ncon == 0
    for _ in second(model, data):
        pass
    pads = {model.geom("left_pad").id, model.geom("right_pad").id}
    assert pads in [set(contact.geom.tolist()) for contact in data.contact]


def test_gripper_in_its_scene_holds_the_box():
    model = load("gripper_2f/scene.xml")
    data = start(model, key=1)
    for _ in second(model, data):
        pass
    held = {int(model.geom_bodyid[geom]) for contact in data.contact for geom in contact.geom}
    assert {model.body(name).id for name in ("box", "left_coupler", "right_coupler")} <= held


@pytest.mark.parametrize("quadratic", [0.05, 0.0])
def test_joint_equality_of_the_gripper_bends(quadratic):
    """With a quadratic term J̇v = −2·c·ẋ², which MuJoCo leaves out; without it there is none."""
    model = prepare(load("gripper_2f/gripper_2f.xml"), integrator="euler")
    mimic = equalities(model)[2].index
    assert model.eq_data[mimic, 2] == 0.05
    model.eq_data[mimic, 2] = quadratic
    data = mujoco.MjData(model)
    data.qvel[:] = 3.0
    mujoco.mj_forward(model, data)
    found = np.empty(data.ne)
    Curvature(model, data).write(data, found)
    (row,) = np.flatnonzero(data.efc_id[: data.ne] == mimic)
    assert found[row] == pytest.approx(-2 * quadratic * 3.0**2, rel=FINITE_DIFFERENCE)


def test_leg_floats_and_its_rods_spin():
    """Of its 13 freedoms 6 are the base's, 5 are moved by actuators, and each rod turns about itself."""
    name = "biped_leg/leg.xml"
    model = prepare(load(name), integrator="euler")
    assert Counter(mujoco.mjtJoint(kind).name for kind in model.jnt_type) == {
        "mjJNT_FREE": 1,
        "mjJNT_BALL": 2,
        "mjJNT_HINGE": 7,
    }
    assert model.nv - closing_rank(name) == 6 + model.nu + 2
    data = start(model)
    for rod in ("rod_left_ball", "rod_right_ball"):
        spin = np.zeros(model.nv)
        spin[model.joint(rod).dofadr[0] + 2] = 1.0  # the rods lie along their own z
        assert np.abs(closing_jacobian(model, data) @ spin).max() <= CLOSED
    hinges = {model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] == mujoco.mjtJoint.mjJNT_HINGE}
    assert limited(model) == hinges


def test_rods_move_the_ankle():
    """Both cranks alike: pitch. Apart: roll."""
    model = load("biped_leg/leg.xml")
    data = start(model, key=1)
    for _ in second(model, data):
        pass
    assert abs(data.joint("ankle_pitch").qpos[0]) > 0.05
    assert abs(data.joint("ankle_roll").qpos[0]) > 0.05


def test_leg_in_its_scene_comes_down_on_the_floor():
    model = load("biped_leg/scene.xml")
    data = start(model, key=0)
    assert any(data.ncon for _ in second(model, data))


def test_thirty_are_of_every_kind():
    model = load("thirty_equalities.xml")
    found = equalities(model)
    assert Counter(equality.kind.name for equality in found) == {"connect": 11, "joint": 10, "weld": 5, "tendon": 4}
    assert {equality.kind.name for equality in found if equality.sites} == {"connect", "weld"}
    assert sum(not model.equality(index).name for index in range(model.neq)) == 3
    assert [found[i].name for i in np.flatnonzero(model.eq_active0 == 0)] == ["parking_hook"]
    assert mujoco.mj_isSparse(model)
    quadratic = [e.name for e in found if e.kind.name in ("joint", "tendon") and model.eq_data[e.index, 2] != 0]
    assert quadratic == ["mesh_34", "mesh_78", "pull_1"]


def test_unreachable_is_short_by_a_tenth():
    model = load("unreachable.xml")
    bars = [
        np.linalg.norm(model.body("coupler").pos),
        np.linalg.norm(model.site("coupler_tip").pos),
        np.linalg.norm(model.site("rocker_tip").pos),
    ]
    assert model.body("rocker").pos[0] - sum(bars) == pytest.approx(SHORT, abs=CLOSED)


def test_none_has_no_equality():
    with pytest.raises(InputError, match=r"none\.xml: no <equality> element"):
        load("none.xml")
    assert mujoco.MjModel.from_xml_path(str(CHECKED / "none.xml")).nv == 2


def test_diverges():
    """h²K + 2hB = 1 + 4 ≥ 4."""
    model = load("diverges.xml")
    data = start(model)
    step = model.opt.timestep
    stiffness, damping = data.efc_KBIP[0, :2]
    assert step**2 * stiffness + 2 * step * damping > 4
    with collected_warnings() as said:
        assert not all(np.isfinite(data.qpos).all() for _ in second(model, data))
    assert "unstable" in said[0]


def test_any_single_equality_can_go():
    name = "all_redundant.xml"
    assert [closing_rank(name, without=index) for index in range(5)] == [closing_rank(name)] * 5


def test_contact_happens_and_not_at_once():
    model = load("contacts.xml")
    data = start(model)
    times = [data.time for _ in second(model, data) if data.ncon]
    assert data.ncon > 0
    assert 0.1 < times[0] < 0.9


def test_names_hold_markup():
    model = load("script_names.xml")
    names = model.names.decode()
    for hostile in ("<script>alert(1)</script>", "<img src=x onerror=alert(2)>", "{{ joint }}", "]]>-->", "[bold red]"):
        assert hostile in names
    assert equalities(model)[0].name == "<script>alert(1)</script>"


def test_refsafe_changes_the_pin_and_not_the_gear():
    """K as MuJoCo computes it is that of a time constant of 4 ms instead of 1 ms."""
    model = load("ships_refsafe.xml")
    data = start(model)
    pin, gear = (model.eq_solref[i, 0] for i in range(2))
    assert pin < 2 * model.opt.timestep < gear
    used = 2 * model.opt.timestep
    widest = model.eq_solimp[0, 1]
    assert data.efc_KBIP[0, 0] == pytest.approx(1 / (widest * used) ** 2, rel=FINITE_DIFFERENCE)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    written = start(model)
    assert written.efc_KBIP[0, 0] == pytest.approx(16 * data.efc_KBIP[0, 0], rel=FINITE_DIFFERENCE)
    assert written.efc_KBIP[3, 0] == data.efc_KBIP[3, 0]
