"""What holds a loop: stability predicted, settings in closed form that reach their target, a tuned copy of the file."""

import copy
import dataclasses
import math
import re
import shutil

import mujoco
import numpy as np
import pytest
from gallery import Piece, piece
from mechanisms import TANGLE, four_bar, write_model
from oarlock import InputError
from oarlock.diagnosis.edit.tuned import write_tuned
from oarlock.diagnosis.runs import trials
from oarlock.diagnosis.runs.recipe import Recipe, critical, deadbeat, recipe
from oarlock.diagnosis.runs.stability import RowSettings, growth, impedance, stability
from oarlock.diagnosis.runs.trials import Made, Setting, Start, disturbed, run_trial
from oarlock.diagnosis.runs.walking import own_copy, walk
from oarlock.mechanics import controls
from oarlock.mechanics.load import collected_warnings, load_model
from oarlock.mechanics.mjcf import differences
from oarlock.poses.layout import Layout
from strange import FILES
from tolerances import CLOSED, SAME_SETTINGS


def start_of(one: Piece) -> Start:
    return Start(one.qpos, one.qvel)


def recipe_of(name: str, target: float, integrator: str = "euler", duration_s: float = 1.0, **options) -> Recipe:
    one = piece(name, integrator)
    return recipe(one.model, start_of(one), one.laws, target, duration_s, **options)


# Settings as MuJoCo takes them.


@pytest.mark.parametrize("refsafe", [True, False])
def test_stiffness_damping_and_impedance_are_mujocos(refsafe):
    """On every kind of row, for positive, negative and mixed solrefs, and solimps out of range."""
    model = mujoco.MjModel.from_xml_string(TANGLE)
    if not refsafe:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    data, layout = mujoco.MjData(model), Layout.of(model)
    random = np.random.default_rng(4)
    changed = 0
    for trial in range(60):
        model.opt.timestep = 10 ** random.uniform(-4, -2)
        low, high = 10 ** random.uniform(-4, 0), 10 ** random.uniform(-1, 0.5)
        solref = [(low, high), (-1e6 * low, -1e3 * high), (-low, high)][trial % 3]
        middle, power = random.uniform(-0.1, 1.1), random.uniform(0.5, 4)
        solimp = np.array([*random.uniform(-0.1, 1.1, 2), [0.0, 0.01, 2.0][trial % 2], middle, power])
        model.eq_solref[:], model.eq_solimp[:] = solref, solimp
        with collected_warnings():
            mujoco.mj_forward(model, data)
        settings = RowSettings.of(np.array(solref), solimp, model.opt.timestep, refsafe)
        changed += settings.changed
        stiffness, damping, d, _ = data.efc_KBIP[: data.ne].T
        assert stiffness == pytest.approx(settings.stiffness, rel=SAME_SETTINGS)
        assert damping == pytest.approx(settings.damping, rel=SAME_SETTINGS)
        for place in range(len(layout.equalities)):
            rows = layout.of_equality(place)
            expected = settings.impedance(float(np.linalg.norm(data.efc_pos[rows])))
            assert d[rows] == pytest.approx(float(expected), rel=SAME_SETTINGS)
    assert (changed > 20) == refsafe  # mixed ones are replaced always, short ones only then


def test_impedance_rises_from_one_bound_to_the_other():
    solimp = (0.2, 0.9, 0.01, 0.5, 2.0)
    assert impedance(solimp, np.array([0.0, 0.005, -0.01, 1.0])) == pytest.approx([0.2, 0.55, 0.9, 0.9])


# Stability.


def test_limits_are_those_of_the_formulas():
    h = 1e-3
    for damper in (0.1, 0.5, 1.0, 1.9):
        limit = (4.0 - 2.0 * damper) / h**2
        assert growth(0.999 * limit, damper / h, h, "euler") < 1.0 < growth(1.001 * limit, damper / h, h, "implicit")
    assert growth(0.0, 2.001 / h, h, "euler") > 1.0
    assert growth(7.9 / h**2, 0.0, h, "rk4") < 1.0 < growth(8.1 / h**2, 0.0, h, "rk4")  # √8 on the imaginary axis
    assert growth(1e-9, 2.78 / h, h, "rk4") <= 1.0 < growth(1e-9, 2.79 / h, h, "rk4")  # 2.785 on the real one
    assert growth(1.0 / h**2, 1.0 / h, h, "euler") == pytest.approx(0.0, abs=1e-7)  # deadbeat


def test_what_is_predicted_to_be_stable_is_and_the_rest_is_not():
    random = np.random.default_rng(7)
    wrong, seen = [], {True: 0, False: 0}
    for name in ("four_bar", "bricard", "gear_train"):
        for integrator in ("euler", "rk4", "implicitfast"):
            for _ in range(12):
                one = piece(name, integrator)
                h = one.model.opt.timestep
                one.model.eq_solref[:] = -(10 ** random.uniform(-1, 0.9)) / h**2, -(10 ** random.uniform(-1, 0.5)) / h
                one.model.eq_solimp[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
                predicted = stability(one.model)[0]
                if abs(predicted.growth - 1.0) < 0.02:
                    continue  # so near the limit a motion decides
                seen[predicted.stable] += 1
                if predicted.stable != _stays_closed(one):
                    wrong.append((name, integrator, predicted.number, predicted.growth))
    assert wrong == []
    assert min(seen.values()) > 20


def _stays_closed(one: Piece) -> bool:
    """Walks 300 steps, slowly, so that nothing but the rows themselves opens the loop."""
    own = own_copy(one.model)
    data = mujoco.MjData(own)
    data.qpos[:], data.qvel[:] = one.qpos, 0.01 * one.qvel
    opened = [np.abs(data.efc_pos[: data.ne]).max() for _ in walk(own, data, None, 300)]
    return len(opened) == 300 and max(opened) < 0.02


def test_a_solref_that_refsafe_changes_is_named_with_both_values():
    model = mujoco.MjModel.from_xml_string(four_bar())
    model.eq_solref[:] = 0.001, 1.0  # at a timestep of 2 ms
    found = stability(model)[0]
    assert (found.name, found.settings.changed, found.stable) == ("pin", True, True)
    assert (found.settings.given, found.settings.effective) == ((0.001, 1.0), (0.004, 1.0))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    found = stability(model)[0]
    assert (found.settings.changed, found.stable) == (False, False)
    model.eq_solref[:], model.opt.timestep = (-1e6, -2e3), 1e-3
    found = stability(model)[0]
    assert not found.stable
    assert found.number > 4.0


# Trials.


def test_a_trial_is_the_run_and_its_worst_moment():
    one = piece("boat")
    trial = run_trial(one.model, Setting.authored(one.model), start_of(one), one.laws, 2.0, "as authored")
    apart = _apart(one, 2.0)
    assert trial.drift == pytest.approx(max(apart), rel=SAME_SETTINGS)
    assert round(trial.time_s / trial.setting.timestep_s) == int(np.argmax(apart))
    assert trial.equality.name in ("pin2", "pin3")
    assert (trial.unit, trial.steps, trial.taken, trial.evaluations) == ("m", 2000, 2000, 2000)
    assert one.model.opt.timestep == 1e-3  # the user's is left alone


def _apart(one: Piece, seconds: float) -> list[float]:
    """The largest distance of the two sites of a connect at each step of plain MuJoCo, from their places."""
    model, data, found = one.model, mujoco.MjData(one.model), []
    data.qpos[:], data.qvel[:] = one.qpos, one.qvel
    drive = controls.drive(model, one.laws)
    drive.apply(data)
    with drive.installed():
        for _ in range(round(seconds / model.opt.timestep)):
            mujoco.mj_forward(model, data)
            sites = zip(data.site_xpos[model.eq_obj1id], data.site_xpos[model.eq_obj2id], strict=True)
            found.append(max(float(np.linalg.norm(first - second)) for first, second in sites))
            mujoco.mj_step(model, data)
    return found


def test_a_run_is_made_once_and_anew_where_anything_differs(monkeypatch):
    one, made, runs = piece("four_bar"), Made(), []
    monkeypatch.setattr(trials, "run_trial", lambda *given: runs.append(given) or run_trial(*given))
    setting, start = Setting.authored(one.model), start_of(one)
    first = made.run(one.model, setting, start, one.laws, 0.01, "first")
    again = made.run(copy.deepcopy(one.model), setting, start_of(one), dict(one.laws), 0.01, "again", 1e-3)
    assert len(runs) == 1
    assert again == dataclasses.replace(first, label="again", predicted=1e-3)
    other = copy.deepcopy(one.model)
    other.eq_solref[0] *= 2.0
    made.run(other, setting, start, one.laws, 0.01, "model")
    made.run(one.model, dataclasses.replace(setting, solref=(0.01, 1.0)), start, one.laws, 0.01, "setting")
    made.run(one.model, setting, dataclasses.replace(start, qvel=2.0 * start.qvel), one.laws, 0.01, "start")
    made.run(one.model, setting, start, one.laws, 0.02, "duration")
    assert len(runs) == 5


def test_disturbed_starts_are_closed_and_different():
    one = piece("stewart")
    starts = [disturbed(one.model, start_of(one), seed) for seed in (1, 1, 2)]
    data = mujoco.MjData(one.model)
    for start in starts:
        assert start is not None
        assert 0.01 < np.abs(start.qpos - one.qpos).max() < 0.5
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        mujoco.mj_forward(one.model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() <= 100 * CLOSED
        assert np.abs(data.efc_vel[: data.ne]).max() <= 100 * CLOSED
    first, again, other = (start.qpos for start in starts if start)
    assert (first == again).all()
    assert (first != other).any()


def test_the_settings_read_as_mjcf():
    text = critical(5e-4, "rk4").mjcf
    model = mujoco.MjModel.from_xml_string(four_bar().replace('<option timestep="0.002"/>', text))
    assert model.opt.timestep == 5e-4
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert model.eq_solref[0].tolist() == [0.002, 1.0]
    assert model.eq_solimp[0].tolist() == [0.9999, 0.9999, 0.001, 0.5, 2.0]


# The recipe.

STRAIGHT_GEAR = """<mujoco><worldbody>
  <body name="a"><joint name="a" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.24 0 0" size="0.01"/></body>
  <body name="b" pos="0.4 0 0"><joint name="b" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.17 0 0" size="0.01"/>
  </body></worldbody><equality><joint joint1="a" joint2="b" polycoef="0 1.4 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("target", [1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("name", ["boat", "four_bar", "welded_frame", "bricard", "gripper", "gear_train", "stewart"])
def test_targets_are_reached(name, target):
    found = recipe_of(name, target)
    assert found.outcome == "reached"
    assert found.authored.drift > target >= found.chosen.drift
    assert len(found.verified) == 2
    assert max(trial.drift for trial in found.verified) <= target
    one = piece(name)
    again = run_trial(one.model, found.chosen.setting, start_of(one), one.laws, 1.0, "again")
    assert again.drift == found.chosen.drift
    assert {trial.label for trial in found.verified} == {found.chosen.label}
    assert found.pareto[0].evaluations <= found.chosen.evaluations
    if found.chosen.setting.integrator == "euler":
        assert found.chosen.cost == pytest.approx(found.chosen.steps / found.authored.steps)
    drifts = [trial.drift for trial in found.pareto]
    assert drifts == sorted(drifts, reverse=True)


def test_boat_is_held_below_a_micrometre_at_the_same_timestep():
    found = recipe_of("boat", 1e-6, seeds=())
    assert found.chosen.setting == deadbeat(1e-3, "euler")
    assert found.chosen.drift < 1e-6 < 1.5e-4 < found.authored.drift
    assert 'solref="0.002 0.5" solimp="0.9999 0.9999 0.001 0.5 2"' in found.mjcf
    assert "not tried" not in found.reason


DAMPED = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody>
  <body><joint name="a" axis="0 1 0" damping="0.5"/><inertial pos="0 0 -0.1" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>
  </body><body><joint name="b" axis="0 1 0" damping="0.5"/>
  <inertial pos="0 0 -0.1" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/></body></worldbody>
  <equality><joint name="alike" joint1="a" joint2="b" solref="SOLREF"/></equality></mujoco>"""


def test_euler_is_tried_where_runge_kutta_does_not_bear_the_damping_of_joints():
    """h d/I is 9, beyond the 2.785 of the method; Euler takes that damping at the end of a step."""
    model = mujoco.MjModel.from_xml_string(DAMPED.replace("SOLREF", "0.02 1"))
    found = recipe(model, Start(np.zeros(2), np.array([0.5, 0.5])), {}, 1e-5, 1.0)
    assert not math.isfinite(found.authored.drift)
    assert found.reached
    assert found.chosen.setting.integrator == "euler"
    assert found.reason == "stiffer equalities and euler in place of rk4, at the same timestep"


DRIVEN = """<mujoco><option timestep="0.002" integrator="INTEGRATOR"/>
  <default><joint axis="0 1 0" damping="0.01"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank"><joint name="crank"/><geom fromto="0 0 0 0 0 0.1" mass="0.02"/>
      <body name="coupler" pos="0 0 0.1"><joint/><geom fromto="0 0 0 0.3 0 0.05" mass="0.03"/></body></body>
    <body name="rocker" pos="0.3 0 0"><joint/><geom fromto="0 0 0 0 0 0.15" mass="0.03"/></body>
  </worldbody>
  <equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0.05"/></equality>
  <actuator><velocity name="drive" joint="crank" kv="KV"/></actuator></mujoco>"""


def driven(kv: float, integrator: str = "Euler") -> Recipe:
    model = mujoco.MjModel.from_xml_string(DRIVEN.replace("KV", str(kv)).replace("INTEGRATOR", integrator))
    return recipe(model, Start(model.qpos0.copy(), np.zeros(3)), {"drive": "1"}, 1e-4, 0.5)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
@pytest.mark.parametrize(("kv", "saves"), [(1.0, 2.0), (2.0, 1.5)])
def test_implicitfast_is_taken_where_the_damping_of_an_actuator_costs_the_timestep(kv, saves, integrator):
    """h kv/I is beyond 2: Euler would need an eighth of the timestep, implicitfast takes kv at the end of a step."""
    found = driven(kv, integrator)
    assert not math.isfinite(found.authored.drift)
    assert found.reached
    assert found.chosen.setting.integrator == "implicitfast"
    assert f"implicitfast in place of {integrator.lower()}" in found.reason
    others = [one for one in found.trials if one.setting.integrator != "implicitfast" and one.drift <= found.target]
    assert all(one.evaluations >= saves * found.chosen.evaluations for one in others)


def test_implicitfast_is_not_taken_where_the_own_integrator_does():
    found = driven(0.1)
    assert found.chosen.setting.integrator == "euler"
    assert {one.setting.integrator for one in found.trials} <= {"euler", "rk4"}


def test_implicitfast_is_tried_and_left_where_it_does_not_help(monkeypatch):
    """A servo whose spring the timestep does not bear: that is taken at the start of a step under every integrator."""
    text = (
        DRIVEN.replace("INTEGRATOR", "Euler")
        .replace("<velocity", "<position")
        .replace('kv="KV"', 'kp="4000" kv="0.01"')
    )
    model = mujoco.MjModel.from_xml_string(text)
    found = recipe(model, Start(model.qpos0.copy(), np.zeros(3)), {"drive": "0.1"}, 1e-4, 0.2)
    tried = [one for one in found.trials if one.setting.integrator == "implicitfast"]
    assert tried
    assert all(one.drift > found.target or one.setting.timestep_s < 0.002 for one in tried)
    assert found.chosen.setting.integrator != "implicitfast"


def test_direct_numbers_that_are_too_stiff_are_not_called_stiffened():
    model = mujoco.MjModel.from_xml_string(DAMPED.replace("RK4", "Euler").replace("SOLREF", "-1e9 -1e5"))
    found = recipe(model, Start(np.zeros(2), np.array([0.5, 0.4])), {}, 1e-2, 1.0)
    assert not math.isfinite(found.authored.drift) or found.authored.drift > found.target
    assert 'in place of "-1e+09 -100000"' in found.reason
    assert "stiffer" not in found.reason


def test_fast_four_bar_goes_over_to_runge_kutta_where_euler_would_need_ten_times_the_steps():
    found = recipe_of("four_bar", 1e-6)
    assert found.chosen.setting.integrator == "rk4"
    assert found.chosen.setting.timestep_s == 1e-3
    assert found.chosen.cost == 4.0
    assert found.reason == "stiffer equalities and rk4 in place of euler, at the same timestep"
    assert found.chosen.energy_error < 1e-2 * found.authored.energy_error
    at_the_same_step = next(trial for trial in found.trials if trial.label == "deadbeat, euler")
    assert math.sqrt(at_the_same_step.drift / 0.7e-6) > 8.0


def test_runge_kutta_is_named_where_energy_asks_for_it():
    found = recipe_of("five_bar", 1e-5)
    assert found.chosen.setting.integrator == "euler"
    assert found.chosen.energy_error > 0.01 * found.chosen.kinetic_energy
    assert found.conserving is not None
    assert found.conserving.drift <= 1e-5
    assert found.conserving.energy_error <= 0.1 * found.chosen.energy_error


def test_what_holds_already_is_left_as_it_is():
    found = recipe_of("boat", 1e-2)
    assert (found.outcome, found.mjcf, found.chosen) == ("holds", "", found.authored)
    assert len(found.trials) == 3


def test_a_target_below_what_rounding_leaves_is_not_reached_and_says_why():
    found = recipe_of("triple_crank", 1e-17, duration_s=0.05, max_steps=5_000)
    assert found.outcome == "not-reached"
    assert "opens by" in found.reason
    assert "at most 5,000 are run" in found.reason
    assert found.chosen.drift < found.authored.drift


def test_an_open_start_is_told_from_wrong_settings():
    model = mujoco.MjModel.from_xml_string(four_bar())
    opened = model.qpos0 + np.array([0.0, 0.0, 1e-3])
    found = recipe(model, Start(opened, np.zeros(3)), {}, 1e-5, 0.2)
    assert (found.outcome, len(found.trials)) == ("not-reached", 1)
    assert "the start itself is open by 0.0005" in found.reason


def test_what_a_smaller_timestep_should_leave_is_said_before_it_is_tried():
    found = recipe_of("four_bar", 1e-8, duration_s=0.25)
    own = [trial for trial in found.trials if trial.start == found.authored.start]
    refined = [trial for trial in own if "smaller" in trial.label]
    assert refined
    assert all(trial.predicted is not None for trial in refined)


def test_missing_curvature_is_named_where_a_target_is_not_reached():
    found = recipe_of("gear_train", 1e-9, max_steps=5000)
    assert found.outcome == "not-reached"
    assert "MuJoCo leaves J̇v out on rows of a joint equality" in found.reason


def test_a_straight_gear_is_not_blamed_for_a_curvature():
    model = mujoco.MjModel.from_xml_string(STRAIGHT_GEAR)
    found = recipe(model, Start(model.qpos0.copy(), np.zeros(2)), {}, 1e-13, 0.1, max_steps=500)
    assert found.outcome == "not-reached"
    assert "at most 500 are run" in found.reason
    assert "J̇v" not in found.reason


def test_settings_that_diverge_are_found_out_and_replaced():
    model = mujoco.MjModel.from_xml_string(four_bar())
    model.opt.timestep, model.eq_solref[:] = 1e-3, (-1e6, -2e3)
    found = recipe(model, Start(model.qpos0.copy(), np.zeros(3)), {}, 1e-4, 0.5)
    assert found.authored.drift == math.inf
    assert found.authored.cost is None
    assert found.authored.taken < found.authored.steps
    assert found.chosen.cost == 1.0
    assert "of joint '" in found.authored.end.message
    assert found.outcome == "reached"
    assert found.chosen.setting == deadbeat(1e-3, "euler")


def test_a_target_that_is_no_length_is_refused():
    for target in (0.0, -1e-6, math.nan, math.inf):
        with pytest.raises(InputError, match=r"target = .*, expected a finite number > 0"):
            recipe_of("boat", target)


# The tuned copy.


@pytest.mark.parametrize("name", list(FILES))
def test_a_tuned_copy_is_the_same_model_but_for_its_settings(name, strange, tmp_path):
    source, out = strange / FILES[name], tmp_path / "elsewhere" / "tuned.xml"
    out.parent.mkdir()
    setting = deadbeat(4e-4, "euler")
    assert write_tuned(source, out, setting) == [out]
    tuned, wanted = load_model(out), load_model(source)
    assert len(differences(tuned, wanted)) >= 3
    setting.apply(wanted)
    assert differences(tuned, wanted) == []
    assert tuned.opt.timestep == 4e-4
    assert tuned.eq_solref[0].tolist() == [8e-4, 0.5]


def test_attached_models_with_equalities_of_their_own_are_tuned_too(tmp_path):
    write_model(tmp_path, four_bar())
    parent = """<mujoco><asset><model name="bars" file="model.xml"/></asset>
      <worldbody><frame><attach model="bars" prefix="a_"/></frame></worldbody></mujoco>"""
    source = tmp_path / "parent.xml"
    source.write_text(parent)
    (tmp_path / "out").mkdir()
    written = write_tuned(source, tmp_path / "out" / "tuned.xml", critical(1e-3, "rk4"))
    assert [path.name for path in written] == ["tuned-model.xml", "tuned.xml"]
    shutil.move(tmp_path / "model.xml", tmp_path / "away.xml")
    assert load_model(tmp_path / "out" / "tuned.xml").eq_solref[0].tolist() == [0.004, 1.0]


def test_a_tuned_copy_keeps_every_digit_and_comment(tmp_path):
    place = "0.12345678901234567"
    path = write_model(tmp_path, four_bar(body=f'<!-- mine --><site name="s" pos="{place} 0 0"/>'))
    out = tmp_path / "tuned.xml"
    write_tuned(path, out, deadbeat(1e-3, "euler"))
    assert place in out.read_text()
    assert "<!-- mine -->" in out.read_text()


def test_mistakes_with_a_tuned_copy_are_named(tmp_path):
    path = write_model(tmp_path, four_bar())
    with pytest.raises(InputError, match="is the model itself"):
        write_tuned(path, tmp_path / "." / "model.xml", deadbeat(1e-3, "euler"))
    with pytest.raises(InputError, match=re.escape("out.xml' cannot be written")):
        write_tuned(path, tmp_path / "no" / "out.xml", deadbeat(1e-3, "euler"))
    with pytest.raises(InputError, match="no model file"):
        write_tuned(tmp_path / "none.xml", tmp_path / "out.xml", deadbeat(1e-3, "euler"))


def test_disturbed_starts_close_to_the_digits_of_a_file():
    """Sites of seven digits do not meet to rounding in any pose: a disturbed start is as closed as the given one."""
    text = four_bar().replace("</mujoco>", '<equality><connect name="pin2" site1="a" site2="b"/></equality></mujoco>')
    text = text.replace('<site name="tip1"', '<site name="a" pos="0.5 0.02 0.2"/><site name="tip1"')
    text = text.replace('<site name="tip2"', '<site name="b" pos="-0.2000002 0.02 0.5"/><site name="tip2"')
    model = mujoco.MjModel.from_xml_string(text)
    given = Start(model.qpos0, np.zeros(model.nv))
    for seed in (1, 2):
        found = disturbed(model, given, seed)
        data = mujoco.MjData(model)
        data.qpos[:] = found.qpos
        mujoco.mj_forward(model, data)
        gap = float(np.abs(data.efc_pos[: data.ne]).max())
        assert 1e-8 < gap < 1e-6
        assert np.abs(found.qpos - model.qpos0).max() > 1e-3
