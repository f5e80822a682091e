"""J̇v of every kind of equality: against differences of MuJoCo's Jacobian along the motion, and against its own aref."""

import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE, four_bar, relative
from oarlock import InputError
from oarlock.mechanics.curvature import Curvature
from oarlock.mechanics.engine_version import lacks_curvature
from oarlock.mechanics.names import equalities
from oarlock.mechanics.rows import jacobian
from tolerances import FINITE_DIFFERENCE, FINITE_DIFFERENCE_STEP, REFERENCE_CURVATURE

SEEDS = range(8)
SPHERE, CYLINDER = '"sphere" size="0.3"', '"cylinder" size="0.3 1"'


def model_of(xml):
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return model


@pytest.fixture(scope="module")
def tangle():
    return model_of(TANGLE)


def tangled(model, seed):
    """A random state."""
    rng = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(0, 1, model.nv), 1.0)
    data.qvel[:] = rng.normal(0, 2, model.nv)
    return data


def curvature(model, data, law=None):
    """J̇v of the state, and the equality of every row."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    out = np.full(data.ne, np.nan)
    (law or Curvature(model, data)).write(data, out)
    return out, np.array(data.efc_id[: data.ne])


def difference(model, data):
    """d/dt (J v) along the motion at constant v, by five-point differences."""

    def rate(step):
        moved = mujoco.MjData(model)
        moved.eq_active[:], moved.qpos[:] = data.eq_active, data.qpos
        mujoco.mj_integratePos(model, moved.qpos, data.qvel, step)
        mujoco.mj_fwdPosition(model, moved)
        return jacobian(model, moved) @ data.qvel

    step = FINITE_DIFFERENCE_STEP
    return (8 * (rate(step) - rate(-step)) - (rate(2 * step) - rate(-2 * step))) / (12 * step)


@pytest.mark.parametrize("seed", SEEDS)
def test_curvature_is_the_derivative_of_the_jacobian(tangle, seed):
    data = tangled(tangle, seed)
    found, owners = curvature(tangle, data)
    expected = difference(tangle, data)
    for equality in equalities(tangle):
        rows = owners == equality.index
        assert rows.sum() == equality.rows
        if equality.name in ("angle", "mix"):
            assert found[rows] == 0 == expected[rows]
        else:
            assert relative(found[rows], expected[rows]) <= FINITE_DIFFERENCE, equality.name


@pytest.mark.parametrize("seed", SEEDS)
def test_curvature_of_our_own_is_mujocos(tangle, seed, monkeypatch):
    """Of connects and welds too, as versions of MuJoCo need it that leave it out of their aref."""
    data = tangled(tangle, seed)
    monkeypatch.setattr("oarlock.mechanics.curvature.lacks_curvature", lambda kind: kind.known)
    found, owners = curvature(tangle, data)
    expected = difference(tangle, data)
    joined = np.isin(owners, [equality.index for equality in equalities(tangle) if equality.kind.joins_points])
    assert joined.sum() > 9
    assert relative(found[joined], expected[joined]) <= FINITE_DIFFERENCE
    if not any(lacks_curvature(equality.kind) for equality in equalities(tangle) if equality.kind.joins_points):
        monkeypatch.undo()
        assert relative(found[joined], curvature(tangle, data)[0][joined]) <= REFERENCE_CURVATURE


@pytest.mark.parametrize("seed", SEEDS)
def test_mujoco_leaves_it_out_for_joints_and_tendons(tangle, seed):
    """Which is why these have formulas of our own."""
    data = tangled(tangle, seed)
    found, owners = curvature(tangle, data)
    stiffness, damping, impedance, _ = data.efc_KBIP.T
    theirs = -damping * data.efc_vel - stiffness * impedance * data.efc_pos - data.efc_aref
    for equality in equalities(tangle):
        rows = owners == equality.index
        if equality.kind.name in ("joint", "tendon") and equality.name not in ("angle", "mix"):
            assert abs(theirs[rows][0]) <= REFERENCE_CURVATURE * abs(found[rows][0]), equality.name


@pytest.mark.parametrize("name", [equality.name for equality in equalities(model_of(TANGLE))])
def test_curvature_follows_equalities_that_are_switched(tangle, name):
    data = tangled(tangle, 7)
    law = Curvature(tangle, data)
    whole, owners = curvature(tangle, data, law)
    index = next(equality.index for equality in equalities(tangle) if equality.name == name)
    data.eq_active[index] = 0
    np.testing.assert_array_equal(curvature(tangle, data, law)[0], whole[owners != index])
    off_at_first = Curvature(tangle, data)
    data.eq_active[index] = 1
    np.testing.assert_array_equal(curvature(tangle, data, off_at_first)[0], whole)


def test_curvature_knows_rows_that_mujoco_drops():
    """A tendon between two sites of the world has a zero row: MuJoCo leaves it out."""
    rest = """<worldbody><site name="p" pos="1 0 0"/><site name="q" pos="2 0 0"/></worldbody>
      <tendon><spatial name="still"><site site="p"/><site site="q"/></spatial></tendon>
      <equality><tendon name="nothing" tendon1="still"/><joint name="gear" joint1="crank" joint2="rocker"
       polycoef="0 1 2 0 0"/></equality>"""
    model = model_of(four_bar(rest=rest))
    data = tangled(model, 3)
    found, owners = curvature(model, data)
    assert model.equality("nothing").id not in owners
    assert len(found) == 4
    assert relative(found, difference(model, data)) <= FINITE_DIFFERENCE


# Tendons over geoms.


def over(geom, side="", inside=False, between=""):
    """Two free bodies, a third with a geom, and a tendon from the first over the geom to the second."""
    place = "0.1 0 0" if inside else "0.1 0.5 0"
    return f"""
<mujoco>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="left" pos="-1 0 0"><freejoint/><geom size="0.1"/><site name="l" pos="0.1 0.1 0.1"/></body>
    <body name="right" pos="1 0 0"><freejoint/><geom size="0.1"/><site name="r" pos="0.1 0 0"/></body>
    <body name="middle"><freejoint name="middle"/><geom name="drum" type={geom} pos="0.05 0 0" euler="10 20 30"/>
      <site name="side" pos="{place}"/></body>
  </worldbody>
  <tendon><spatial name="cord"><site site="l"/>{between}<geom geom="drum" {side}/><site site="r"/></spatial></tendon>
  <equality><tendon name="cord" tendon1="cord"/></equality>
</mujoco>"""


def swinging(model, seed):
    """A random state near the model's own."""
    rng = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(0, 0.15, model.nv), 1.0)
    data.qvel[:] = rng.normal(0, 1, model.nv)
    return data


@pytest.mark.parametrize("geom", [SPHERE, CYLINDER], ids=["sphere", "cylinder"])
@pytest.mark.parametrize("side", ["", 'sidesite="side"'], ids=["no side", "side"])
@pytest.mark.parametrize("between", ["", '<site site="r"/><pulley divisor="2"/><site site="l"/>'], ids=["", "pulley"])
def test_tendon_over_a_geom(geom, side, between):
    """The pulley's model comes past the geom twice, once without touching it."""
    model = model_of(over(geom, side, between=between))
    wrapped = 0
    turned_back = 0
    for seed in range(12):
        data = swinging(model, seed)
        found, _ = curvature(model, data)
        assert relative(found, difference(model, data)) <= FINITE_DIFFERENCE
        on_geom = np.flatnonzero(data.wrap_obj.ravel()[: data.ten_wrapnum[0]] >= 0)
        wrapped += len(on_geom) == 2
        if len(on_geom):
            turned_back += on_the_far_side(model, data, data.wrap_xpos.reshape(-1, 3)[on_geom[0]])
    assert wrapped >= (4 if side else 8)
    assert turned_back >= 1 if side else turned_back == 0


def on_the_far_side(model, data, touch):
    """Whether the path goes round the geom the other way than the straight line would: more than half a turn."""
    left, right, centre = data.site("l").xpos, data.site("r").xpos, data.geom("drum").xpos
    axis = data.geom("drum").xmat.reshape(3, 3)[:, 2]
    along = (right - left) / np.linalg.norm(right - left)
    foot = left + ((centre - left) @ along) * along - centre
    if model.geom("drum").type == mujoco.mjtGeom.mjGEOM_CYLINDER:
        across = np.cross(along, axis)
        return (foot @ across) * ((touch - centre) @ across) < 0
    return foot @ (touch - centre) < 0


@pytest.mark.parametrize("geom", [SPHERE, CYLINDER], ids=["sphere", "cylinder"])
def test_tendon_inside_a_geom_is_refused(geom):
    model = model_of(over(geom, 'sidesite="side"', inside=True))
    data = mujoco.MjData(model)
    data.joint("middle").qpos[1] = 1.0  # a ring that the cord runs through is pulled aside
    with pytest.raises(InputError, match=r"tendon 'cord' wraps inside geom 'drum', expected its side site outside"):
        curvature(model, data)


def test_tendon_without_length_is_refused():
    rest = """<tendon><spatial name="short"><site site="tip1"/><site site="tip2"/></spatial></tendon>
      <equality><tendon name="short" tendon1="short"/></equality>"""
    model = model_of(four_bar(rest=rest))
    with pytest.raises(InputError, match=r"tendon 'short' has a piece of length 0"):
        curvature(model, mujoco.MjData(model))


# What is not known.

CLOTH = """<mujoco>
  <worldbody>
    <flexcomp name="cloth" type="grid" count="3 3 1" spacing="0.1 0.1 0.1" mass="1" radius="0.01">
      <edge equality="true"/><contact selfcollide="none"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


def test_flex_is_refused_by_name():
    model = model_of(CLOTH)
    data = mujoco.MjData(model)
    (equality,) = equalities(model)
    assert (equality.kind.name, equality.kind.rows) == ("flex", None)
    with pytest.raises(InputError, match=rf"'{equality.name}' is a flex, expected connect, weld, joint or tendon"):
        Curvature(model, data)
    data.eq_active[0] = 0
    law = Curvature(model, data)
    data.eq_active[0] = 1
    with pytest.raises(InputError, match=r"is a flex"):
        curvature(model, data, law)
