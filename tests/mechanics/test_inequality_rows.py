"""A gripper that grips, its whole answer in the matched form against MuJoCo's own."""

import mujoco
import numpy as np
import pytest
from inequality_cases import gripper
from oarlock.base import core
from oarlock.mechanics.inertia import whiten
from tolerances import MATCHED_ACCELERATION, MATCHED_FORCE, SOLVED_BY_MUJOCO

STEPS, EVERY = 400, 5
"""Steps of 1 ms: the fingers come to the box after some 80. Every so many is asked."""


class Answers:
    """The whole answer of the states of one model, step after step."""

    def __init__(self, model: mujoco.MjModel):
        self.model = model
        self.system, self.inequalities = core.ConstrainedSystem(), core.Inequalities()
        self.solver = core.make_solver("auto")
        self.last: np.ndarray | None = None

    def _moved(self, data: mujoco.MjData, force: np.ndarray) -> np.ndarray:
        found = np.zeros((1, self.model.nv))
        mujoco.mj_solveM(self.model, data, found, force[None])
        return found[0]

    def groups(self, data: mujoco.MjData) -> tuple[list[int], np.ndarray, np.ndarray]:
        """Numbers of rows, μ and friction of the groups of inequality rows."""
        dims, mu, friction, row = [], [], [], data.ne
        while row < data.nefc:
            kind = int(data.efc_type[row])
            elliptic = kind == int(mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC)
            contact = data.contact[data.efc_id[row]] if elliptic else None
            losses = (mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF, mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON)
            dims.append(contact.dim if contact else 0 if kind in map(int, losses) else 1)
            mu.append(contact.mu if contact else 1.0)
            friction.append(contact.friction.copy() if contact else np.ones(5))
            row += max(dims[-1], 1)
        return dims, np.array(mu), np.array(friction).reshape(-1, 5)

    def ask(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray, core.InequalityReport]:
        """Accelerations, constraint forces (nv each) and what is reported of a state."""
        model, ne, rows = self.model, data.ne, data.efc_J.reshape(-1, self.model.nv).copy()
        own, other, aref = rows[:ne], rows[ne:], data.efc_aref.copy()
        start = data.qacc_smooth.copy()
        self.system.assemble_factored(whiten(model, data, own), own, start, aref[:ne], data.efc_R[:ne].copy())
        report = self.inequalities.solve(
            self.system,
            whiten(model, data, other),
            other,
            aref[ne:],
            data.efc_D[ne:].copy(),
            data.efc_frictionloss[ne:].copy(),
            *self.groups(data),
            self.last,
        )
        pushed = start + self._moved(data, self.inequalities.generalised_force)
        self.system.renew(pushed, aref[:ne])
        qfrc = self.system.force(self.solver.solve_system(self.system)[0])
        self.last = found = pushed + self._moved(data, qfrc)
        assert self.inequalities.certify(found, self.inequalities.forces).holds
        return found, qfrc + self.inequalities.generalised_force, report


def gradient(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """What MuJoCo's own answer leaves of M a − f − Jᵀ f(a), relative."""
    needed = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, needed, data.qacc)
    parts = needed, data.qfrc_smooth, data.qfrc_constraint
    return float(np.linalg.norm(needed - data.qfrc_smooth - data.qfrc_constraint) / sum(map(np.linalg.norm, parts)))


CONDIMS = [("elliptic", dim) for dim in (1, 3, 4, 6)] + [("pyramidal", dim) for dim in (1, 3, 4, 6)]


@pytest.mark.parametrize(("cone", "condim"), CONDIMS)
def test_a_gripper_is_solved_as_mujoco_solves_it(cone: str, condim: int):
    model = mujoco.MjModel.from_xml_string(gripper(cone=cone, condim=condim, impratio=1.0 if condim < 4 else 5.0))
    data, answers = mujoco.MjData(model), Answers(model)
    compared, iterations = 0, []
    for step in range(STEPS):
        data.ctrl[:] = 0.1
        mujoco.mj_step1(model, data)
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        if step % EVERY == 0:
            acceleration, qfrc, report = answers.ask(data)
            assert report.status == "converged"
            iterations.append(report.iterations)
            if gradient(model, data) < SOLVED_BY_MUJOCO:
                compared += 1
                scale = float(np.linalg.norm(data.qfrc_constraint))
                np.testing.assert_allclose(qfrc, data.qfrc_constraint, rtol=0, atol=MATCHED_FORCE * scale)
                scale = max(1.0, float(np.abs(data.qacc).max()))
                np.testing.assert_allclose(acceleration, data.qacc, rtol=0, atol=MATCHED_ACCELERATION * scale)
        mujoco.mj_step2(model, data)
    assert compared >= 0.9 * STEPS / EVERY
    assert data.ncon >= 8, "it grips"
    # Five steps lie between one question and the next.
    assert np.mean(iterations) <= 2.0, iterations
