"""Mechanisms in free flight: the forces of their loops are internal, whichever multipliers a solver chose."""

import mujoco
import numpy as np
import pytest
from mechanisms import setup_of
from oarlock import load_case
from oarlock.stepping.question import SolvedForce
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.state import State
from oarlock.stepping.walkers import ForcedWalker
from tolerances import MOMENTUM_DRIFT, OPEN_LOOP_TORQUE


def momenta(model, data):
    """Momentum (kg m/s) and angular momentum about the centre of mass (kg m²/s) of everything, (6)."""
    mujoco.mj_subtreeVel(model, data)
    mass = float(model.body_subtreemass[0])
    return np.concatenate((mass * data.subtree_linvel[0], data.subtree_angmom[0]))


def along(setup, case, form, solver):
    """The momenta at every step of a free run."""
    data = setup.data()
    state = State(setup.model, data, case.file.baumgarte)
    spec = SolverSpec.parse(solver).with_defaults(rank_cut=case.file.rank_cut)
    walker = ForcedWalker(setup.model, data, setup.drive, SolvedForce(state, form, spec.make()))
    found = []
    for _ in range(setup.steps):
        walker.look()
        found.append(momenta(setup.model, data))
        walker.step()
    return np.array(found)


@pytest.mark.parametrize("solver", ["pinv", "sr1"])
@pytest.mark.parametrize("model", ["ring", "floating_four_bar"])
def test_momenta_are_conserved(model, solver):
    case = load_case(model)
    path = along(setup_of(case, duration_s=0.3), case, "hard", solver)
    assert np.linalg.norm(path[0, 3:]) > 0.1
    assert np.abs(path - path[0]).max() <= MOMENTUM_DRIFT


@pytest.mark.parametrize("model", ["ring", "floating_four_bar"])
def test_a_soft_loop_makes_angular_momentum(model):
    """Its two forces are opposite, but they act at points that stand apart: no smaller step helps."""
    case = load_case(model)
    path = along(setup_of(case, duration_s=0.3), case, "matched", "pinv")
    change = np.abs(path - path[0]).max(axis=0)
    assert change[:3].max() <= MOMENTUM_DRIFT
    assert change[3:].max() > OPEN_LOOP_TORQUE
