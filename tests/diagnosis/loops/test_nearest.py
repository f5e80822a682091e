"""The nearest closed pose, against an outside search: plain MuJoCo, a penalty, many random starts."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.optimize
from gallery import at_start
from mechanisms import four_bar
from oarlock import InputError, model_names
from oarlock.diagnosis.loops.nearest import Nearest, driven_joints, joints_called, nearest, outside_ranges
from oarlock.mechanics.load import load_model
from places import FIXTURES
from tolerances import CLOSED

POSES, STARTS = 20, 50
NEAR = 1.05
"""By so much the correction may be longer than the best of the outside search."""

OPEN = 1e-4
"""rad, rows over their lengths. What the penalty leaves open at most, where it counts as closed."""

DISTURBED = 0.5
"""rad, and m on slides."""

CLOSING = ["damped_gripper", "dead_point", "thirty_equalities", "locked_cranks", "contacts", "tilted_hinge"]


class Outside:
    """The same question in plain MuJoCo: ½‖x‖² + ½ w ‖r‖² inside of bounds, w rising."""

    def __init__(self, model, given, arm, held=()):
        self.model, self.given = model, given
        self.model.opt.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_LIMIT
            | mujoco.mjtDisableBit.mjDSBL_CONTACT
            | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        )
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(model)
        kinds = model.jnt_type[model.dof_jntid]
        self.unit = np.where(kinds == mujoco.mjtJoint.mjJNT_SLIDE, arm, 1.0)
        self.turns = []
        self.bounds = np.tile([-np.inf, np.inf], (model.nv, 1))
        for joint in range(model.njnt):
            dof, at = model.jnt_dofadr[joint], model.jnt_qposadr[joint]
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                self.unit[dof : dof + 3] = arm
                self.turns.append(slice(dof + 3, dof + 6))
            elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
                self.turns.append(slice(dof, dof + 3))
            elif model.jnt_limited[joint]:
                self.bounds[dof] = (model.jnt_range[joint] - given[at]) / self.unit[dof]
            if joint in held:
                self.bounds[dof] = 0.0
        self.size = 1.0
        lengths = np.linalg.norm(self.rows(np.zeros(model.nv))[1], axis=1)
        self.size = np.maximum(lengths, 1e-2 * lengths.max(initial=0.0))

    def rows(self, x):
        pose = self.given.copy()
        mujoco.mj_integratePos(self.model, pose, x * self.unit, 1.0)
        self.data.qpos[:] = pose
        mujoco.mj_fwdPosition(self.model, self.data)
        count = self.data.ne
        jacobian = self.data.efc_J[: count * self.model.nv].reshape(count, self.model.nv) * self.unit
        for turn in self.turns:  # ∫ exp(−s[x]) ds: what a change of the rotation vector turns by
            a, b, c = x[turn]
            cross, term, whole = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]), np.eye(3), np.zeros((3, 3))
            for order in range(1, 30):
                whole, term = whole + term, term @ -cross / (order + 1)
            jacobian[:, turn] = jacobian[:, turn] @ whole
        jacobian, rest = [jacobian], [self.data.efc_pos[:count]]
        for tendon in np.flatnonzero(self.model.tendon_limited):  # beyond its range it counts as a row
            least, most = self.model.tendon_range[tendon]
            start, many = self.model.ten_J_rowadr[tendon], self.model.ten_J_rownnz[tendon]
            row = np.zeros((1, self.model.nv))
            row[0, self.model.ten_J_colind[start : start + many]] = self.data.ten_J[start : start + many]
            beyond = max(self.data.ten_length[tendon] - most, 0.0) - max(least - self.data.ten_length[tendon], 0.0)
            rest.append([beyond])
            jacobian.append(row * self.unit * (beyond != 0.0))
        jacobian, rest = np.vstack(jacobian), np.concatenate(rest)
        if np.ndim(self.size):
            return rest / self.size, jacobian / self.size[:, None]
        return rest, jacobian

    def search(self, begin):
        x = np.clip(begin, *self.bounds.T)
        for weight in (1e1, 1e3, 1e5, 1e7):

            def cost(x, weight=weight):
                rest, jacobian = self.rows(x)
                return 0.5 * (x @ x + weight * rest @ rest), x + weight * jacobian.T @ rest

            x = scipy.optimize.minimize(cost, x, jac=True, method="L-BFGS-B", bounds=self.bounds,
                                        options={"maxiter": 500, "maxcor": 30, "ftol": 1e-15, "gtol": 1e-9}).x
        rest, _ = self.rows(x)
        return float(np.linalg.norm(x)) if np.abs(rest).max(initial=0.0) <= OPEN else np.inf

    def best(self, count, seed=1):
        rng = np.random.default_rng(seed)
        starts = [np.zeros(self.model.nv), *rng.normal(size=(count - 1, self.model.nv))]
        spread = [0.0, *rng.uniform(0.1, 1.5, count - 1)]
        return min(self.search(far * start) for far, start in zip(spread, starts, strict=True))


def disturbed(model, qpos, seed):
    pose = qpos.copy()
    mujoco.mj_integratePos(model, pose, np.random.default_rng(seed).uniform(-DISTURBED, DISTURBED, model.nv), 1.0)
    return pose


def model_at(name):
    """A model by its name in the gallery or among the fixtures, and a pose to disturb."""
    if name in model_names():
        _, model, start, _ = at_start(name)
        return model, start.qpos
    model = load_model(Path(FIXTURES / "check" / f"{name}.xml"))
    return model, model.key_qpos[0] if model.nkey else model.qpos0


def compare(name, poses, starts):
    """Ratios to the outside search; every pose is closed and inside, as plain MuJoCo sees it."""
    model, base = model_at(name)
    ratios = []
    for seed in range(poses):
        given = disturbed(model, base, seed)
        found = nearest(model, given)
        assert found is not None, (name, seed)
        data = mujoco.MjData(model)
        data.qpos[:] = found.qpos
        mujoco.mj_fwdPosition(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() <= CLOSED
        for joint in np.flatnonzero(model.jnt_limited):
            if model.jnt_type[joint] in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                least, most = model.jnt_range[joint]
                assert least <= found.qpos[model.jnt_qposadr[joint]] <= most, (name, seed, joint)
        best = Outside(load_again(name), given, found.arm).best(starts)
        ratios.append(found.norm / best)
    return ratios


def load_again(name):
    return model_at(name)[0]
