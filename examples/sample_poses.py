"""Consistent states of a mechanism, spread over all that it reaches, and how near each is to a singular pose.

Run: python examples/sample_poses.py MODEL.xml 200
"""

import sys

import numpy as np
import oarlock

samples = oarlock.sample(sys.argv[1], int(sys.argv[2]), seed=0)
print(samples.branches)
print(samples.coverage)
print("positions", samples.qpos.shape, "largest", np.abs(samples.qpos).max().round(3))
