"""Values printed by others: held at exactly their step, in free runs, and refused where there is no such step."""

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, only, setup_of, write_model
from oarlock import InputError, load_case, run
from oarlock.stepping.published import componentwise
from tolerances import SAME_ACCELERATION

DURATION, STEP = 0.02, 0.002
HEAD = f"""
title = "x"
[run]
duration_s = {DURATION}
[[experiments]]
mode = "free"
solvers = ["mujoco", "pinv"]
[[experiments]]
mode = "lockstep"
"""


def case_with(tmp_path, *published):
    toml = HEAD + "".join(f"[[published]]\nsource = 's'\n{one}\n" for one in published)
    write_model(tmp_path / "bar", four_bar(joint='damping="0"'), toml)
    return tmp_path / "bar"


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """The exact run of the four-bar without published values: steps, and the place of its site at every step."""
    folder = case_with(tmp_path_factory.mktemp("plain"))
    steps = run(folder, mode="free", form="hard", solver="pinv", duration=DURATION + STEP).steps
    steps = steps.filter(steps["mode"] == "free")
    model = setup_of(load_case(folder)).model
    data = mujoco.MjData(model)
    tips = []
    for qpos in steps["qpos"]:
        data.qpos[:] = qpos.to_list()
        mujoco.mj_kinematics(model, data)
        tips.append(data.site("tip1").xpos.copy())
    return steps, np.array(tips)


@pytest.mark.parametrize("step", [0, 5, 10])  # 10: the very end, for which the run takes one step more
def test_errors_are_those_of_the_step(tmp_path, walked, step):
    steps, tips = walked
    time = step * STEP
    qpos, forces = steps["qpos"][step].to_list(), steps["multipliers"][step].to_list()
    values = (
        f"time_s = {time}\njoint = 'rocker'\nposition = {qpos[2] + 1e-3!r}",
        f"time_s = {time}\nsite = 'tip1'\nposition = {(tips[step] + [0, 2e-3, 0]).tolist()!r}",
        f"time_s = {time}\nequality = 'pin'\nmultipliers = {[forces[0] / 1.01, *forces[1:]]!r}",
    )
    results = run(case_with(tmp_path, *values))
    exact = only(results.rows, mode="free", solver="pinv")
    assert exact["steps"] == (11 if step == 10 else 10)
    assert exact["published_position_error_max"] == pytest.approx(2e-3, rel=SAME_ACCELERATION)  # the worse of the two
    assert exact["published_multiplier_error_rel_max"] == pytest.approx(0.01, rel=1e-6)
    assert exact["published_velocity_error_rel_max"] is None
    assert only(results.rows, mode="free", solver="mujoco")["published_position_error_max"] is not None
    assert only(results.rows, mode="lockstep", form="hard")["published_position_error_max"] is None


def test_velocity_is_relative(tmp_path, walked):
    setup = setup_of(load_case(case_with(tmp_path, "time_s = 0.01\njoint = 'crank'\nvelocity = -2.0")))
    data = setup.data()
    mujoco.mj_forward(setup.model, data)
    data.qvel[0] = -2.1
    assert setup.published.errors(5, data) == pytest.approx({"published_velocity_error_rel": 0.05})
    assert setup.published.errors(4, data) == {}


def test_what_is_not_finite_is_no_small_error(tmp_path):
    two = [f"time_s = 0.01\njoint = '{joint}'\nposition = 0.0" for joint in ("crank", "coupler", "rocker")]
    setup = setup_of(load_case(case_with(tmp_path, *two)))
    data = setup.data()
    data.qpos[1] = np.nan
    assert np.isnan(setup.published.errors(5, data)["published_position_error"])


@pytest.mark.parametrize(
    ("value", "printed", "error"),
    [
        ([1.1, 2.0], [1.0, 2.0], 0.1),
        ([1.0, 2.2], [1.0, 2.0], 0.1),
        ([0.2, 2.0], [0.0, 2.0], 0.1),  # a printed 0: relative to the largest
        ([0.2, 0.1], [0.0, 0.0], 0.2),  # nothing but 0: absolute
        ([-1.0, 1.0], [1.0, 1.0], 2.0),
    ],
)
def test_components_are_relative_each(value, printed, error):
    assert componentwise(np.array(value), np.array(printed)) == pytest.approx(error)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("time_s = 0.003\njoint = 'crank'\nposition = 0.0", r"time_s = 0\.003 is no multiple of the timestep 0\.002 s"),
        ("time_s = 0.0020001\njoint = 'crank'\nposition = 0.0", r"is no multiple of the timestep"),
        ("time_s = 0.002\njoint = 'crnk'\nposition = 0.0", r"joint in \[\[published\]\] .*'crnk'.* crank, coupler"),
        ("time_s = 0.002\nsite = 'tip'\nposition = [0, 0, 0]", r"site in \[\[published\]\] .*'tip'.* tip1"),
        ("time_s = 0.002\nequality = 'pn'\nmultipliers = [0]", r"equality in \[\[published\]\] .*'pn'.* pin"),
        ("time_s = 0.002\nequality = 'pin'\nmultipliers = [0, 1]", r"2 multipliers of 'pin', expected 3, one a row"),
    ],
)
def test_mistaken_values_are_named(tmp_path, value, message):
    with pytest.raises(InputError, match=message):
        run(case_with(tmp_path, value))


def test_another_timestep_leaves_values_out_that_it_does_not_meet(tmp_path):
    """What is no mistake of the case must not keep a user from trying a timestep."""
    values = [f"time_s = {time}\njoint = 'crank'\nposition = 0.0" for time in (0.002, 0.006)]
    row = only(run(case_with(tmp_path, *values), timestep=0.003).rows, mode="free", solver="pinv")
    assert row["published_position_error_max"] > 0
    none = only(run(case_with(tmp_path, values[0]), timestep=0.003).rows, mode="free", solver="pinv")
    assert none["published_position_error_max"] is None


def test_energy_of_exact_free_runs_can_be_bounded(tmp_path):
    gate = "[[gates]]\nfigure = 'energy_drift_rel'\nwhere = {solver = 'pinv', mode = 'free'}\nmax = 1e-5\ncause = 'c'\n"
    for damping, held in (("0", True), ("0.01", False)):  # no energy is kept with dampers: not measured, not held
        write_model(tmp_path / "bar", four_bar(joint=f'damping="{damping}"'), HEAD + gate)
        verdicts = run(tmp_path / "bar").verdicts
        assert [(verdict.value is not None, verdict.held) for verdict in verdicts] == [(held, held)]
