"""Which reactions are unique: from mechanisms whose answer is known, and from the definition itself."""

import mujoco
import numpy as np
import pytest
from mechanisms import case_of, four_bar, write_model
from oarlock import load_case, make_solver
from oarlock.mechanics.prepare import load_mechanism
from oarlock.mechanics.reactions import VANISHES, unique_reactions, verdict
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping.start import consistent_start
from tolerances import ARBITRARY_REACTION, DETERMINED_REACTION

AGAIN = '<equality><connect name="again" site1="tip1" site2="tip2"/></equality>'
ASIDE = """<worldbody><body name="swing" pos="0 1 0"><joint name="swing" axis="1 0 0"/><geom fromto="0 0 0 0 0 0.3"/>
  <body name="bob" pos="0 0 0.3"><joint name="bob" axis="1 0 0"/><geom fromto="0 0 0 0 0.2 0"/>
  <site name="bob" pos="0 0.2 0"/></body></body><site name="peg" pos="0 1.2 0.3"/></worldbody>
  <equality><connect name="hook" site1="bob" site2="peg"/></equality>"""


def started(case):
    model = load_mechanism(case, integrator="rk4")
    return model, consistent_start(model, case)


@pytest.mark.parametrize(
    ("rest", "expected", "together"),
    [
        ("", {"pin": True}, "unique"),  # its third row is zero: no reaction, no ambiguity
        (AGAIN, {"pin": False, "again": False}, "not unique"),
        (AGAIN + ASIDE, {"pin": False, "again": False, "hook": True}, "partly unique"),
    ],
)
def test_four_bars(tmp_path, rest, expected, together):
    _, start = started(case_of(write_model(tmp_path, four_bar(rest=rest))))
    assert start.unique == expected
    assert verdict(start.unique) == together


def test_no_reaction_of_the_boat_is_unique():
    _, start = started(load_case("boat"))
    assert start.unique == {"pin2": False, "pin3": False}


def test_equalities_that_are_off_have_no_reaction(tmp_path):
    off = AGAIN.replace('name="again"', 'name="again" active="false"')
    _, start = started(case_of(write_model(tmp_path, four_bar(rest=off))))
    assert start.unique == {"pin": True}


@pytest.mark.parametrize("name", ["boat", "andrews_squeezer", "n_four_bar", "n_four_bar:connects=2", "made-up"])
def test_unique_is_what_every_solution_agrees_on(name, tmp_path):
    """Two solutions of A λ = b, least in two different norms, agree on the unique multipliers and on no others."""
    made_up = name == "made-up"
    case = case_of(write_model(tmp_path, four_bar(rest=AGAIN + ASIDE))) if made_up else load_case(name)
    model, start = started(case)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start.qpos, start.qvel
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    jacobian = closing_jacobian(model, data)
    A = np.asarray(jacobian @ np.linalg.solve(mass, jacobian.T), dtype=float)
    b = A @ np.random.default_rng(0).normal(size=data.ne)
    weights = np.random.default_rng(1).uniform(0.5, 2.0, size=data.ne)
    plain, _ = make_solver("pinv").solve(A, b)
    scaled, _ = make_solver("pinv").solve(A * np.outer(weights, weights), weights * b)
    apart = np.abs(plain - weights * scaled) / np.abs(plain).max()
    for index in range(model.neq):
        rows = data.efc_id[: data.ne] == index
        if start.unique[model.equality(index).name]:
            assert apart[rows].max() <= DETERMINED_REACTION
        else:
            assert apart[rows].max() >= ARBITRARY_REACTION


def test_the_decision_is_not_close(tmp_path):
    """On every model the parts are either far above or far below the bound."""
    model, start = started(case_of(write_model(tmp_path, four_bar(rest=AGAIN + ASIDE))))
    data = mujoco.MjData(model)
    data.qpos[:] = start.qpos
    mujoco.mj_fwdPosition(model, data)
    for bound in (VANISHES / 1000, VANISHES * 1000):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("oarlock.mechanics.reactions.VANISHES", bound)
            assert unique_reactions(model, data, start.rank) == start.unique
