"""A MuJoCo model made ready for comparison: integrator, solver and softness set, hazards switched off."""

import copy
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from oarlock.case_file import Integrator, Settings
from oarlock.cases import Case
from oarlock.errors import InputError, one_line
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
        InputError: no such file, malformed, parameters that ``build`` refuses, numbers that are not finite, or no
            equality that closes a loop.
    """
    if not path.is_file():
        raise InputError(f"no model file '{path}'")
    try:
        with collected_warnings() as said:
            if path.suffix == ".py":
                model = _build(path, parameters or {}).compile()
            else:
                model = mujoco.MjModel.from_xml_path(str(path))
    except InputError:
        raise
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{path}: MuJoCo refuses it: {one_line(error)}{_callbacks()}") from None
    for text in said:
        if "NaN" in text:  # MuJoCo takes a NaN for a number that was left out, or computes with it
            raise InputError(f"{path}: {_attribute_with_nan(path)} is not a number, expected finite numbers only")
        warnings.warn(f"{path}: MuJoCo warns: {one_line(text)}", stacklevel=2)
    if model.neq == 0:
        raise InputError(f"{path}: no <equality> element, expected at least one that closes a loop")
    if model.nv == 0:
        raise InputError(f"{path}: no joint, expected a mechanism that can move")
    _require_sound(path, model)
    return model


def _callbacks() -> str:
    """What to know of an error where callbacks are set: MuJoCo's compiler calls them, for a model unknown to Python."""
    getters = {name[4:]: getattr(mujoco, name) for name in dir(mujoco) if name.startswith("get_mjcb_")}
    names = [name for name, get in getters.items() if get() is not None]
    return f"; the process has set {', '.join(names)}, expected no callbacks: take them back" if names else ""


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """MuJoCo's warnings, which it otherwise prints and writes to a file in the working folder."""
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield said
    finally:
        mujoco.set_mju_user_warning(before)


def _attribute_with_nan(path: Path) -> str:
    found = re.search(rb"""\w+\s*=\s*(["'])[^"']*\bnan\b[^"']*\1""", path.read_bytes(), re.IGNORECASE)
    return one_line(found[0].decode(errors="replace")) if found else "an attribute"


_PHYSICS = ("qpos", "body_", "jnt_", "dof_", "geom_", "site_", "eq_", "tendon_", "wrap_", "actuator_", "key_")
"""Prefixes of the fields that motion depends on."""


def _require_sound(path: Path, model: mujoco.MjModel) -> None:
    """Refuses numbers that are not finite and names that are no text: MuJoCo lets both pass."""
    fields = {f"option {name}": getattr(model.opt, name) for name in dir(model.opt) if not name.startswith("_")}
    del fields["option timestep"]  # it may be replaced: prepare looks at the one that is used
    fields |= {name: getattr(model, name) for name in dir(model) if name.startswith(_PHYSICS)}
    # Infinities first: they were written, and what was computed from them is NaN.
    for bad in (np.isinf, np.isnan):
        for name, value in fields.items():
            if isinstance(value, np.ndarray | float) and np.asarray(value).dtype.kind == "f" and bad(value).any():
                raise InputError(f"{path}: {name} holds {'inf' if bad is np.isinf else 'nan'}, expected finite numbers")
    try:
        model.names.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: a name holds the byte {error.object[error.start]:#x}, expected UTF-8") from None


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

    Raises:
        InputError: the timestep is not a positive number.
    """
    settings = settings or Settings()
    model.opt.integrator = INTEGRATORS[integrator]
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if timestep_s is not None:
        model.opt.timestep = timestep_s
    if not (np.isfinite(model.opt.timestep) and model.opt.timestep > 0):
        raise InputError(f"timestep of the model = {model.opt.timestep:g} s, expected a finite number > 0")
    if settings.solver is not None:
        model.opt.solver = SOLVERS[settings.solver]
    if settings.solref is not None:
        model.eq_solref[:] = settings.solref
    if settings.solimp is not None:
        model.eq_solimp[:] = settings.solimp
    return model


def unsolved(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a prepared model for walks on which MuJoCo's constraint solver is not asked.

    Without what only that solver needs: islands, and a Jacobian that is dense whatever its size.
    """
    model = copy.copy(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return model


def load_mechanism(
    case: Case,
    *,
    integrator: Integrator,
    timestep_s: float | None = None,
    settings: str = "default",
    solref_s: float | None = None,
) -> mujoco.MjModel:
    """The model of a case, prepared for one run. Raises InputError as ``load_model``.

    ``solref_s`` is the time constant of every equality, with the damping ratio 1, in place of that of the settings.
    """
    chosen = case.file.setting(settings)
    if solref_s is not None:
        chosen = chosen.model_copy(update={"solref": (solref_s, 1.0)})
    return prepare(
        load_model(case.model_path, case.parameters),
        integrator=integrator,
        timestep_s=timestep_s or case.file.run.timestep_s,
        settings=chosen,
    )


def jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """J of all constraint rows, (nefc, nv); a view of MuJoCo's arena where the model's Jacobian is dense.

    MuJoCo makes room for rows that it then leaves out because they are zero: the array may be longer than J.
    """
    if mujoco.mj_isSparse(model):
        nefc = data.nefc
        dense = np.zeros((nefc, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.efc_J, data.efc_J_rownnz[:nefc], data.efc_J_rowadr[:nefc], data.efc_J_colind
        )
        return dense
    return data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)


def closing_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """J of the equality rows, (ne, nv); those of limits and contacts come after them. As ``jacobian``."""
    return jacobian(model, data)[: data.ne]


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
    """One equality element, for messages, figures and J̇v."""

    index: int
    name: str
    kind: str
    bodies: tuple[int, int]
    """Body ids of the ends of a connect or weld; 0 is the world. (0, 0) for other kinds."""
    sites: tuple[int, int] | None
    """Site ids, for a connect or weld between sites."""
    rows: int
    """Rows that it has while it is active; 0 where they are not known."""
    unit: str
    """Unit of its rows' deviations."""

    def anchor(self, model: mujoco.MjModel, end: int) -> np.ndarray:
        """Anchor of a connect or weld between bodies: the point of that end's body (0 or 1), body frame, (3), m."""
        # A connect keeps the first body's anchor first, a weld the second body's.
        start = 3 * end if self.kind == "connect" else 3 * (1 - end)
        return model.eq_data[self.index, start : start + 3].copy()


_KINDS = {
    mujoco.mjtEq.mjEQ_CONNECT: ("connect", 3),
    mujoco.mjtEq.mjEQ_WELD: ("weld", 6),
    mujoco.mjtEq.mjEQ_JOINT: ("joint", 1),
    mujoco.mjtEq.mjEQ_TENDON: ("tendon", 1),
}


def equalities(model: mujoco.MjModel) -> list[Equality]:
    """Every equality of the model, active or not."""
    found = []
    for index in range(model.neq):
        kind, rows = _KINDS.get(mujoco.mjtEq(model.eq_type[index]), ("flex", 0))
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        bodies, sites = (0, 0), None
        if kind in ("connect", "weld"):
            bodies = first, second
            if model.eq_objtype[index] == mujoco.mjtObj.mjOBJ_SITE:
                sites = first, second
                bodies = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        name = element_name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
        found.append(Equality(index, name, kind, bodies, sites, rows, _unit(model, kind, first)))
    return found


def _unit(model: mujoco.MjModel, kind: str, first: int) -> str:
    slides = mujoco.mjtJoint.mjJNT_SLIDE
    if kind == "joint":
        return "m" if model.jnt_type[first] == slides else "rad"
    if kind == "tendon":
        start, count = int(model.tendon_adr[first]), int(model.tendon_num[first])
        if model.wrap_type[start] == mujoco.mjtWrap.mjWRAP_JOINT:
            joints = model.wrap_objid[start : start + count]
            units = {"m" if model.jnt_type[joint] == slides else "rad" for joint in joints}
            return units.pop() if len(units) == 1 else "m or rad"
    return "m or rad" if kind in ("weld", "flex") else "m"
