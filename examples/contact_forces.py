"""What goes through the loops of a gripper that holds a box: MuJoCo's forces beside those of exact loops.

Run: python examples/contact_forces.py MODEL.xml
"""

import sys

import mujoco
import numpy as np
import oarlock

model = mujoco.MjModel.from_xml_path(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
data.ctrl[:] = model.actuator_ctrlrange[:, 1]  # shut
while data.time < 1.0:
    mujoco.mj_step(model, data)
print(f"t = {data.time:.3f} s, {data.ncon} contacts")

for one in oarlock.reactions(model, data):
    loads = (load.along if load.force is None else load.force for load in (one.given, one.exact))
    given, exact = (np.linalg.norm(np.asarray(load)) for load in loads)
    print(f"{one.equality:4} {' – '.join(one.ends):45} {one.verdict:13}", end="")
    print(f" MuJoCo {given:8.4f}  exact {exact:8.4f}", *one.beside)
