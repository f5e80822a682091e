"""What a new case says of its start, and of laws that are no actuators'."""

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock.cases.drive import Drive
from oarlock.cases.motion import Motion
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.scaffold.survey import survey
from tolerances import CLOSED, NEAREST_POSE

SWING = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="cart" mocap="true" pos="0 0 1"/>
    <body name="bob" pos="0 0 1"><freejoint name="bob"/>
      <inertial pos="0.1 0 0" mass="0.2" diaginertia="0.001 0.002 0.002"/></body>
  </worldbody>
  <equality><weld name="hold" body1="cart" body2="bob"/></equality>
</mujoco>"""


def test_laws_that_move_and_switch_have_tables_of_their_own(tmp_path):
    """The start is closed at the pose that the law begins with."""
    law = {"mocap:cart.x": "0.05 + 0.1*t", "mocap:cart.ry": "0.3 + t", "active:hold": "1"}
    path = write_model(tmp_path, SWING)
    found = survey("swing", path, ignoring=False, asked=Motion(control=law))
    expected = {"cart": {"x": law["mocap:cart.x"], "ry": law["mocap:cart.ry"]}}
    assert found.drive == Drive(mocap=expected, active={"hold": "1"})
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:], data.mocap_pos[0] = found.start.qpos, [0.05, 0.0, 1.0]
    mujoco.mju_axisAngle2Quat(data.mocap_quat[0], np.array([0.0, 1.0, 0.0]), 0.3)
    mujoco.mj_fwdPosition(model, data)
    assert np.abs(data.efc_pos).max() <= CLOSED
    assert found.written.qpos["bob"][0] == found.start.qpos[0]


@pytest.mark.parametrize("angles", [(0.632, 1.066, -1.532), (0.113, -0.314, -0.248), (1.225, -1.533, 0.251)])
def test_a_start_is_closed_where_check_closes_it(tmp_path, angles):
    """The driven crank stays, and the rocker keeps its range: steps in the metric of M would not see to that."""
    keyframe = " ".join(map(str, angles))
    driven = f'<actuator><motor joint="crank"/></actuator><keyframe><key name="start" qpos="{keyframe}"/></keyframe>'
    path = write_model(tmp_path, four_bar(rocker='limited="true" range="-0.6 0.25"', rest=driven))
    found = survey("bar", path, ignoring=False, asked=Motion(controls="constant"))
    pose = nearest_closed(mujoco.MjModel.from_xml_path(str(path)), np.array(angles), hold=None)
    assert found.start.qpos[0] == pytest.approx(angles[0], abs=CLOSED)
    assert found.start.qpos[2] <= 0.25 + CLOSED
    np.testing.assert_allclose(found.start.qpos, pose.qpos, atol=NEAREST_POSE)
    assert found.start.moved == pytest.approx(pose.moved, abs=NEAREST_POSE)
    assert found.written.qpos["rocker"] == found.start.qpos[2]
