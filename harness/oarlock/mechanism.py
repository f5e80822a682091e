"""A MuJoCo model made ready for comparison: integrator, solver and softness set, hazards switched off."""

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from oarlock.case_file import Integrator, Settings
from oarlock.cases import Case
from oarlock.errors import InputError, RefusedError, one_line
from oarlock.options import Number, join_options

INTEGRATORS: dict[Integrator, int] = {
    "euler": mujoco.mjtIntegrator.mjINT_EULER,
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "rk4": mujoco.mjtIntegrator.mjINT_RK4,
}
SOLVERS = {
    "newton": mujoco.mjtSolver.mjSOL_NEWTON,
    "cg": mujoco.mjtSolver.mjSOL_CG,
    "pgs": mujoco.mjtSolver.mjSOL_PGS,
}


def load_model(path: Path, parameters: dict[str, Number] | None = None) -> mujoco.MjModel:
    """Reads an MJCF file, or builds the model of a ``model.py`` with ``build(**parameters) -> mujoco.MjSpec``.

    Raises:
        InputError: no such file, malformed, parameters that ``build`` refuses, or no equality that closes a loop.
    """
    if not path.is_file():
        raise InputError(f"no model file '{path}'")
    try:
        if path.suffix == ".py":
            model = _build(path, parameters or {}).compile()
        else:
            model = mujoco.MjModel.from_xml_path(str(path))
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: MuJoCo refuses it: {one_line(error)}") from None
    if model.neq == 0:
        raise InputError(f"{path}: no <equality> element, expected at least one that closes a loop")
    return model


def _build(path: Path, parameters: dict[str, Number]) -> mujoco.MjSpec:
    """Runs a ``model.py``. Whatever goes wrong in it is named in one line, with the call."""
    module = ModuleType(f"model of {path.parent.name}")
    module.__file__ = str(path)
    call = f"{path}: {join_options('build', parameters)}"
    try:
        # Not an import: that would leave compiled files among the models.
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), module.__dict__)
        build = module.__dict__.get("build")
        if not callable(build):
            raise InputError(f"{path}: no function 'build', expected build(**parameters) -> mujoco.MjSpec")
        spec = build(**parameters)
    except InputError:
        raise
    except ValueError as error:  # what build says about its parameters
        raise InputError(f"{call}: {one_line(error)}") from None
    except (Exception, SystemExit) as error:
        raise InputError(f"{call}: {type(error).__name__}: {one_line(error)}") from None
    if not isinstance(spec, mujoco.MjSpec):
        raise InputError(f"{call} gives a {type(spec).__name__}, expected a mujoco.MjSpec")
    return spec


def prepare(
    model: mujoco.MjModel,
    *,
    integrator: Integrator,
    timestep_s: float | None = None,
    settings: Settings | None = None,
) -> mujoco.MjModel:
    """Sets what a run asks for, in place, and gives the model back.

    Autoreset is switched off: after a NaN it would put the time back to 0. The Jacobian is dense: sparse Newton of
    MuJoCo 4.0.0 can use a wrong factor.
    """
    settings = settings or Settings()
    model.opt.integrator = INTEGRATORS[integrator]
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if timestep_s is not None:
        model.opt.timestep = timestep_s
    if settings.solver is not None:
        model.opt.solver = SOLVERS[settings.solver]
    if settings.solref is not None:
        model.eq_solref[:] = settings.solref
    if settings.solimp is not None:
        model.eq_solimp[:] = settings.solimp
    return model


def load_mechanism(
    case: Case, *, integrator: Integrator, timestep_s: float | None = None, settings: str = "default"
) -> mujoco.MjModel:
    """The model of a case, prepared for one run. Raises InputError as ``load_model``."""
    return prepare(
        load_model(case.model_path, case.parameters),
        integrator=integrator,
        timestep_s=timestep_s or case.file.run.timestep_s,
        settings=case.file.setting(settings),
    )


def element_name(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """Name of an element, or its number in ``#`` form where it has none."""
    return mujoco.mj_id2name(model, kind, index) or f"#{index}"


def coordinates(model: mujoco.MjModel) -> list[dict[str, str]]:
    """Name and unit of every entry of qpos: the joint's name, numbered where a joint has several."""
    entries = []
    for index in range(model.njnt):
        name = element_name(model, mujoco.mjtObj.mjOBJ_JOINT, index)
        kind = mujoco.mjtJoint(model.jnt_type[index])
        if kind == mujoco.mjtJoint.mjJNT_HINGE:
            entries.append({"name": name, "unit": "rad"})
        elif kind == mujoco.mjtJoint.mjJNT_SLIDE:
            entries.append({"name": name, "unit": "m"})
        else:
            lengths = 3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0
            entries += [{"name": f"{name}[{i}]", "unit": "m" if i < lengths else "–"} for i in range(lengths + 4)]
    return entries


@dataclass(frozen=True)
class Equality:
    """One equality element, for messages and figures."""

    index: int
    name: str
    kind: str
    bodies: tuple[int, int]
    """Body ids; 0 is the world. (0, 0) for joint and tendon equalities."""


_KINDS = {
    mujoco.mjtEq.mjEQ_CONNECT: "connect",
    mujoco.mjtEq.mjEQ_WELD: "weld",
    mujoco.mjtEq.mjEQ_JOINT: "joint",
    mujoco.mjtEq.mjEQ_TENDON: "tendon",
    mujoco.mjtEq.mjEQ_FLEX: "flex",
}


def equalities(model: mujoco.MjModel) -> list[Equality]:
    """Every equality of the model, active or not."""
    found = []
    for index in range(model.neq):
        kind = _KINDS.get(mujoco.mjtEq(model.eq_type[index]), "flex")
        bodies = (0, 0)
        if kind in ("connect", "weld"):
            objects = (int(model.eq_obj1id[index]), int(model.eq_obj2id[index]))
            sites = model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE
            bodies = tuple(int(model.site_bodyid[i]) for i in objects) if sites else objects
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
        found.append(Equality(index, name, kind, (bodies[0], bodies[1])))
    return found


def refuse_inequalities(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Checks that only equality rows are active: what else there is MuJoCo solves jointly, and we would not.

    Raises:
        RefusedError: a contact, limit or friction row is active; names the element and the time.
    """
    if data.nefc == data.ne:
        return
    row = int(np.flatnonzero(data.efc_type != mujoco.mjtConstraint.mjCNSTR_EQUALITY)[0])
    index = int(data.efc_id[row])
    named = {
        mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF: ("friction of joint", mujoco.mjtObj.mjOBJ_JOINT),
        mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON: ("friction of tendon", mujoco.mjtObj.mjOBJ_TENDON),
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT: ("limit of joint", mujoco.mjtObj.mjOBJ_JOINT),
        mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON: ("limit of tendon", mujoco.mjtObj.mjOBJ_TENDON),
    }
    kind = mujoco.mjtConstraint(data.efc_type[row])
    if kind in named:
        label, object_type = named[kind]
        if kind == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF:
            index = int(model.dof_jntid[index])
        what = f"{label} '{element_name(model, object_type, index)}'"
    else:
        names = [element_name(model, mujoco.mjtObj.mjOBJ_GEOM, int(geom)) for geom in data.contact[index].geom]
        what = f"contact between geoms '{names[0]}' and '{names[1]}'"
    raise RefusedError(
        f"{what} is active at t = {data.time:g} s, expected equality rows only: disable it in the model "
        "(contype/conaffinity, limited, frictionloss)"
    )
