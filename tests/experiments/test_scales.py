"""Mechanisms whose constraints differ in size by 1e10 and more: each keeps its rank, and exact runs stay closed."""

import warnings

import numpy as np
import oarlock
import pytest
from mechanisms import four_bar, only, write_model

CLOSED = 1e-8
"""m or rad. What an exact run may leave open: a projected one leaves rounding times coefficients of 1e5."""

SECONDS = 0.5

SCREW = """<worldbody>
  <body name="screw" pos="3 0 0"><joint name="screw" axis="0 0 1"/><geom type="sphere" size=".01" mass=".01"/></body>
  <body name="nut" pos="3 0 1">
    <joint name="nut" type="slide" axis="0 0 1"/><geom type="sphere" size=".02" mass=".05"/>
  </body>
</worldbody>
<equality><joint joint1="screw" joint2="nut" polycoef="0 12566.37 0 0 0"/></equality>"""

GEAR = """<worldbody>
  <body name="fast" pos="3 0 0"><joint name="fast" axis="0 0 1"/><geom type="sphere" size=".01" mass=".001"/></body>
  <body name="slow" pos="3 0 1"><joint name="slow"/><geom type="sphere" size=".1" mass="3" pos=".2 0 0"/></body>
</worldbody>
<equality><joint joint1="fast" joint2="slow" polycoef="0 1e5 0 0 0"/></equality>"""

SERVO = """<worldbody>
  <body name="rotor" pos="3 0 0">
    <joint name="rotor" axis="0 0 1" armature="{inertia}"/><geom type="sphere" size=".002" mass="1e-5"/>
  </body>
</worldbody>
<equality><joint joint1="rotor" joint2="crank" polycoef="0 {ratio} 0 0 0"/></equality>"""

SMALL = """<worldbody>
  <body name="a" pos="4 0 0"><joint name="a"/><geom fromto="0 0 0 0 0 .01" size=".001" mass="1e-4"/>
    <body name="b" pos="0 0 .01"><joint name="b"/><geom fromto="0 0 0 .02 0 .005" size=".001" mass="1e-4"/>
      <site name="b" pos=".02 0 .005"/></body></body>
  <body name="c" pos="4.025 0 0"><joint name="c"/><geom fromto="0 0 0 -.005 0 .015" size=".001" mass="1e-4"/>
    <site name="c" pos="-.005 0 .015"/></body>
</worldbody>
<equality><connect name="small" site1="b" site2="c"/></equality>"""

HEAVY = '<geom type="sphere" size=".05" mass="1000" pos=".2 0 .1"/>'

MODELS = {
    "a lead screw": ({"rest": SCREW}, 3),
    "a gear of 1e5": ({"rest": GEAR}, 3),
    "a servo behind a gear of 200": ({"rest": SERVO.format(inertia=1e-7, ratio=200)}, 3),
    "a servo behind a gear of 1e5": ({"rest": SERVO.format(inertia=1e-9, ratio=1e5)}, 3),
    "a ton, and a lead screw": ({"body": HEAVY, "rest": SCREW}, 3),
    "a ton, and a loop of grams": ({"body": HEAVY, "rest": SMALL}, 4),
    "a ton, a screw and a servo": ({"body": HEAVY, "rest": SCREW + SERVO.format(inertia=1e-8, ratio=1e4)}, 4),
}
"""What is beside a four-bar, or in it → parts of the model, and its rank."""


@pytest.mark.parametrize("name", MODELS)
def test_exact_runs_keep_rank_and_loops(tmp_path, name):
    parts, rank = MODELS[name]
    model = write_model(tmp_path, four_bar(**parts))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = oarlock.run(
            model, solver=["auto", "pinv"], form="hard", mode="free", duration=SECONDS, integrator="rk4"
        )
    for solver in ("auto", "pinv"):
        row = only(found.rows, mode="free", solver=solver)
        assert (row["status"], row["rank_min"], row["rank_max"]) == ("done", rank, rank)
        assert row["drift_pos_max"] <= CLOSED
        assert row["unconverged"] == 0
        assert row["rank_rises"] == 0
        assert np.isfinite(row["error_estimate_max"])


@pytest.mark.parametrize("name", MODELS)
def test_ranks_are_right_along_the_way_of_mujoco(tmp_path, name):
    parts, rank = MODELS[name]
    model = write_model(tmp_path, four_bar(**parts))
    found = oarlock.run(model, solver=["auto", "svd"], form="hard", mode="lockstep", duration=SECONDS)
    for row in found.rows:
        if row["mode"] == "lockstep":
            assert (row["status"], row["rank_min"], row["rank_max"]) == ("done", rank, rank)
