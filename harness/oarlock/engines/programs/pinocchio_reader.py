# /// script
# requires-python = ">=3.10"
# dependencies = ["pin>=4.1,<5", "numpy", "pyarrow"]
#
# [tool.oarlock]
# title = "Pinocchio, its own reader of MJCF"
# package = "pin"
# several = true
# questions = ["forward"]
# equalities = ["connect", "weld"]
# closed = true
# ///
"""Pinocchio reads the MJCF itself: what it keeps, and the accelerations of the mechanism that it makes of it.

Accelerations are those of its ``constraintDynamics`` with the constraints that it read. Forces of actuators, springs
and dampers are given.
"""

# pyright: reportMissingImports=false

from importlib import import_module
from typing import Any

import numpy as np
from shared.compiled import BALL, FREE, Compiled, matrix, unit
from shared.exchange import Answer, NotExpressible, answer_all, tell
from shared.family import Ask

MU, ACCURACY, ITERATIONS = 1e-8, 1e-14, 50

POSE = "qpos0"
"""Name of the pose that the file is written in, among those that the reader makes."""


def _facts(pin: Any, model: Any, constraints: Any) -> dict[str, Any]:
    data = model.createData()
    pin.framesForwardKinematics(model, data, dict(_poses(model)).get(POSE, pin.neutral(model)))
    bodies = [(index, frame) for index, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY]
    on = [frame.parentJoint for _, frame in bodies]
    return {
        "total_mass": float(sum(inertia.mass for inertia in model.inertias)),
        # Of bodies that share a joint it keeps the sum only.
        "body_masses": {
            frame.name: float(model.inertias[frame.parentJoint].mass)
            for _, frame in bodies
            if on.count(frame.parentJoint) == 1 and frame.parentJoint > 0
        },
        "body_places": {frame.name: data.oMf[index].translation.tolist() for index, frame in bodies},
        "rows": sum(3 if one.type == pin.ContactType.CONTACT_3D else 6 for one in constraints),
        "velocities": int(model.nv),
        "cone": None,
        "jdotv": True,
    }


def _poses(model: Any) -> list[tuple[str, Any]]:
    return [(one.key(), one.data()) for one in model.referenceConfigurations]


def _forward(pin: Any, ask: Ask, answer: Answer, model: Any, constraints: Any) -> None:
    compiled, data = Compiled(ask.model), model.createData()
    datas = pin.StdVec_RigidConstraintData()
    for one in constraints:
        datas.append(one.createData())
    pin.initConstraintDynamics(model, data, constraints, datas)
    settings = pin.ProximalSettings(ACCURACY, ACCURACY, MU, ITERATIONS)
    for row in range(len(ask)):
        qpos, qvel, force = (ask.states[name][row] for name in ("qpos", "qvel", "qfrc_applied"))
        q, v, tau = qpos.copy(), qvel.copy(), force.copy()
        free = []
        for joint, kind in enumerate(compiled.jnt_type.tolist()):
            at, dof = int(compiled.jnt_qposadr[joint]), int(compiled.jnt_dofadr[joint])
            if kind not in (FREE, BALL):
                continue
            at += 3 if kind == FREE else 0
            quat = unit(qpos[at : at + 4])
            q[at : at + 4] = quat[[1, 2, 3, 0]]
            if kind == FREE:
                turn = matrix(quat)
                v[dof : dof + 3], tau[dof : dof + 3] = turn.T @ qvel[dof : dof + 3], turn.T @ force[dof : dof + 3]
                free.append((dof, turn))
        a = pin.constraintDynamics(model, data, q, v, tau, constraints, datas, settings).copy()
        if not np.isfinite(a).all():
            raise NotExpressible("model", "what the reader keeps has no accelerations: bodies without mass")
        held = pin.rnea(model, model.createData(), q, v, a) - tau
        for dof, turn in free:
            a[dof : dof + 3] = turn @ (a[dof : dof + 3] + np.cross(v[dof + 3 : dof + 6], v[dof : dof + 3]))
            held[dof : dof + 3] = turn @ held[dof : dof + 3]
        answer.add(time=ask.states["time"][row], qacc=a, qfrc_constraint=held, qpos=qpos, qvel=qvel)
        tell(row + 1, len(ask))


def answered(ask: Ask, answer: Answer) -> None:
    """Answers one question."""
    pin = import_module("pinocchio")
    answer.versions = {"pin": pin.__version__, "numpy": np.__version__}
    try:
        model, constraints = pin.buildModelAndLegacyConstraintsFromMJCF(str(ask.folder / "model.xml"))
    except (ValueError, RuntimeError) as error:
        raise NotExpressible("model", f"the reader refuses it: {' '.join(str(error).split())}") from None
    answer.facts = _facts(pin, model, constraints)
    answer.expressed = ["connect", "weld"]
    size = int(ask.model["nv"]), int(ask.model["nq"])
    if (int(model.nv), int(model.nq)) != size:
        why = f"the reader keeps {model.nv} velocities and {model.nq} positions of {size[0]} and {size[1]}"
        answer.missing.append({"element": "model", "why": why})
    if ask.question != "forward":
        answer.missing.append({"element": f"question '{ask.question}'", "why": "expected forward"})
    if not answer.missing:
        _forward(pin, ask, answer, model, constraints)


if __name__ == "__main__":
    answer_all(answered, "pinocchio_reader")
