"""Which models conserve the energy that MuJoCo counts: what the rule says, and what free runs show."""

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, only, write_model
from oarlock import run
from oarlock.mechanics.energy import Energy
from tolerances import ENERGY_DRIFT

CORD = '<tendon><fixed {}><joint joint="crank" coef="1"/></fixed></tendon>'


@pytest.mark.parametrize(
    ("options", "conserved"),
    [
        ({}, True),
        ({"joint": 'stiffness="5"'}, True),
        ({"joint": 'stiffness="5 8 3"'}, True),
        ({"rest": CORD.format('stiffness="4 1 3" springlength="0.1 0.2"')}, True),
        ({"joint": 'stiffness="5" springyield="0.1"'}, False),
        ({"rest": CORD.format('damping="0.1"')}, False),
        ({"body": '<body gravcomp="1"><geom type="sphere" size="0.05" mass="0.2"/></body>'}, False),
        ({"joint": 'damping="0.1"'}, False),
        ({"rest": '<actuator><motor joint="crank"/></actuator>'}, False),
        ({"rest": '<option density="1"/>'}, False),
    ],
)
def test_energy_is_conserved_where_mujoco_counts_all_of_it(tmp_path, options, conserved):
    path = write_model(tmp_path, four_bar(**options), 'title = "swing"\nstart.qpos.crank = 1.0')
    assert Energy(mujoco.MjModel.from_xml_path(str(path.parent / "model.xml"))).conserved is conserved
    row = only(run(path, mode="free", form="hard", solver="pinv", duration=1.0).rows, mode="free")
    if conserved:
        assert row["energy_drift_rel"] <= ENERGY_DRIFT
    else:
        assert row["energy_drift_rel"] is None
    assert row["status"] == "done"


def test_a_run_that_gains_energy_is_no_longer_done(tmp_path):
    """Steps of 20 ms of a crank that turns with 12 rad/s: each leads a quarter of a radian on."""
    path = write_model(tmp_path, four_bar(), 'title = "fast"\nstart.qvel.crank = 12.0')
    row = only(run(path, mode="free", form="hard", solver="pinv", timestep=0.02, duration=2.0).rows, mode="free")
    assert row["status"] == "drifted"
    assert row["message"].startswith("its energy, which nothing drives or damps, changes by ")
    assert row["message"].endswith(" of the largest kinetic energy, expected at most 0.001")


def test_a_mechanism_at_rest_has_not_drifted(tmp_path):
    """Hanging straight down nothing moves but by rounding, which is many times the kinetic energy."""
    xml = """<mujoco><worldbody>
      <body name="a"><joint axis="0 1 0"/><geom size="0.05" pos="0 0 -0.3"/></body>
      <body name="b"><joint axis="0 1 0"/><geom size="0.05" pos="0.1 0 -0.3"/><site name="b"/></body></worldbody>
      <default><geom contype="0" conaffinity="0"/></default>
      <equality><connect body1="a" body2="b" anchor="0 0 -0.3"/></equality></mujoco>"""
    results = run(write_model(tmp_path, xml, 'title = "rest"'), mode="free", form="hard", solver="pinv", duration=0.2)
    assert only(results.rows, mode="free")["status"] == "done"
    assert np.isfinite(only(results.rows, mode="free")["drift_pos_max"])
