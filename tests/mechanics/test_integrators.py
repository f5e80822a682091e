"""What the table of integrators says of MuJoCo's, held against MuJoCo; and where its names are asked for."""

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError, load_case
from oarlock.cases.integrators import INTEGRATORS, RUNNING, RUNNING_IN_WORDS
from oarlock.diagnosis.runs.stability import growth
from oarlock.mechanics.prepare import integrator_of, set_integrator
from oarlock.stepping.walkers import MujocoWalker

SOFT = """<mujoco><option timestep="{timestep}" integrator="{mjcf}"/><worldbody>
  <body><joint name="a" axis="0 1 0" damping="0.3"/><geom size="0.1" pos="0.3 0 0"/>
    <body pos="0.5 0 0"><joint name="b" axis="0 1 0" stiffness="5"/><geom size="0.1" pos="0.3 0 0.1"/></body></body>
  </worldbody></mujoco>"""

RATE = 0.1
"""Of a power of two: how far an order may seem off at these timesteps."""


def model_with(mjcf, timestep=0.01):
    return mujoco.MjModel.from_xml_string(SOFT.format(mjcf=mjcf, timestep=timestep))


def test_every_integrator_of_mujocos_is_in_the_table():
    assert sorted(one.mjt for one in INTEGRATORS.values()) == sorted(mujoco.mjtIntegrator.__members__)


@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=str)
def test_mjcf_and_number_are_mujocos(integrator):
    model = model_with(integrator.mjcf)
    assert model.opt.integrator == getattr(mujoco.mjtIntegrator, integrator.mjt)
    assert integrator_of(model) is integrator
    other = model_with("Euler")
    set_integrator(other, integrator.name)
    assert other.opt.integrator == model.opt.integrator


@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=str)
def test_a_walker_steps_as_mj_step(integrator):
    model = model_with(integrator.mjcf)
    ours, theirs = mujoco.MjData(model), mujoco.MjData(model)
    ours.qvel[:] = theirs.qvel[:] = 1.0, -2.0
    walker = MujocoWalker(model, ours)
    for _ in range(50):
        walker.look()
        walker.step()
        mujoco.mj_step(model, theirs)
    assert (ours.qpos.tobytes(), ours.qvel.tobytes()) == (theirs.qpos.tobytes(), theirs.qvel.tobytes())


@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=str)
def test_error_goes_with_the_order_and_the_force_is_asked_for_at_the_stages(integrator):
    def end(timestep):
        model = model_with(integrator.mjcf, timestep)
        data = mujoco.MjData(model)
        data.qvel[:] = 1.0, -2.0
        mujoco.mj_step(model, data, nstep=round(0.4 / timestep))
        return np.concatenate([data.qpos, data.qvel])

    finest = end(1e-4) if integrator.order > 1 else 2.0 * end(1e-5) - end(2e-5)
    coarse, fine = (np.linalg.norm(end(timestep) - finest) for timestep in (1e-3, 5e-4))
    assert np.log2(coarse / fine) == pytest.approx(integrator.order, abs=RATE)

    model, asked = model_with(integrator.mjcf), []
    data = mujoco.MjData(model)
    try:
        mujoco.set_mjcb_passive(lambda model, data: asked.append(data.time))
        mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_passive(None)
    assert len(asked) == integrator.stages


def test_the_growth_of_one_that_asks_at_its_stages_is_that_of_its_series():
    """With damping alone a step of ẏ = −B y makes Σ (−hB)ᵏ/k! of y."""
    rate, h = 30.0, 0.01
    series = sum((-rate * h) ** power / divisor for power, divisor in enumerate(INTEGRATORS["rk4"].divisors))
    assert series == pytest.approx(np.exp(-rate * h), abs=(rate * h) ** 5 / 120)
    assert growth(0.0, rate, h, "rk4") == pytest.approx(1.0)  # the position stays
    assert not INTEGRATORS["rk4"].holds_force
    assert INTEGRATORS["euler"].holds_force


def test_only_those_that_run_can_be_asked_for(tmp_path, oarlock_here):
    assert RUNNING == ("euler", "implicit", "implicitfast", "rk4")
    folder = write_model(tmp_path / "bar", four_bar(), "title = 'x'\n[run]\nintegrator = 'discrete'\n")
    with pytest.raises(InputError, match=r"run.integrator = 'discrete'.*'euler', 'implicit', 'implicitfast' or 'rk4'"):
        load_case(folder)
    assert RUNNING_IN_WORDS in " ".join(oarlock_here("run", "--help").stdout.split())
