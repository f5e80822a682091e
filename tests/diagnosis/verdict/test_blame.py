"""What is said of why a loop gives way, beside plain MuJoCo with other settings."""

from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest

SHELF = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body name="shelf" pos="0 0 1"><joint name="hinge" axis="0 1 0" damping="0.5"/>
    <geom type="box" pos="0.2 0 0" size="0.2 0.1 0.01" mass="4"/></body>
  <body name="stay" pos="0 0 0.7"><joint name="foot" axis="0 1 0" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0.3" size="0.01" mass="0.3"/></body></worldbody>
  <equality><connect name="prop" body1="shelf" body2="stay" anchor="0.3 0 0" solimp="{solimp}"/></equality></mujoco>"""


def opened(solimp: str) -> float:
    model = mujoco.MjModel.from_xml_string(SHELF.format(solimp=solimp))
    data, worst = mujoco.MjData(model), 0.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.linalg.norm(data.efc_pos[:3])))
    return worst


def softness(solimp: str, folder: Path) -> str:
    file = folder / "shelf.xml"
    file.write_text(SHELF.format(solimp=solimp))
    (one,) = [one for one in oarlock.check(file, budget=0).verdict if one.code == "D1"]
    return one.line


@pytest.mark.parametrize("solimp", ["0 0.95 0.02", "0.2 0.9 0.05"])
def test_a_solimp_that_begins_low_is_told_where_a_loop_gives_way(tmp_path, solimp):
    low, high, width = solimp.split()
    assert opened(f"{high} {high} {width}") < 0.5 * opened(solimp)
    told = f"its solimp begins at {low} and comes to {high} only where it is open by {width} m"
    assert softness(solimp, tmp_path).endswith(told)


@pytest.mark.parametrize("solimp", ["0.9 0.95 0.001", "0.6 0.95 0.02"])
def test_others_are_not(tmp_path, solimp):
    assert "solimp" not in softness(solimp, tmp_path)
