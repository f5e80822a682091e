"""Loading models: from MJCF files, and from the ``model.py`` of a parametrised one."""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.base.options import Number, join_options
from oarlock.cases.case import refuse_code
from oarlock.mechanics.engine_version import full_mass
from oarlock.mechanics.given import COMPILED, as_given, compiled_at
from oarlock.mechanics.limits import require_moderate, require_moderate_model
from oarlock.mechanics.refusal import refusal


def load_model(path: Path, parameters: dict[str, Number] | None = None, *, closed: bool = True) -> mujoco.MjModel:
    """Loads an MJCF file, or builds the model of a ``model.py`` by its ``build(**parameters) -> mujoco.MjSpec``.

    A file of ``mechanics.given`` that stands for a compiled model gives a copy of that.

    Args:
        path: the file.
        parameters: of ``build``.
        closed: whether there must be an equality.

    Raises:
        InputError: the file is missing or malformed, ``build`` refuses the parameters, a number is not finite, or the
            model has no joint or no equality.
    """
    if not path.is_file():
        raise InputError(f"no model file '{path}'")
    try:
        if path.suffix not in (".py", COMPILED):
            require_moderate(path)
        with collected_warnings() as said:
            if path.suffix == ".py":
                model = build_spec(path, parameters or {}).compile()
            elif path.suffix == COMPILED:
                model = compiled_at(path)
            else:
                model = mujoco.MjModel.from_xml_path(str(path))
    except InputError:
        raise
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise InputError(f"{path}: {refusal(error)}{_callbacks()}") from None
    for text in said:
        if "NaN" in text:  # MuJoCo takes a NaN for a number that was left out, or computes with it
            raise InputError(f"{path}: {_attribute_with_nan(path)} is not a number, expected finite numbers only")
        if "Inertia matrix" in text and not _has_inertia(model):
            raise InputError(
                f"{path}: the mass matrix is not positive definite in the model's own pose, expected masses, "
                "inertias and armatures > 0"
            )
        warnings.warn(as_given(f"{path}: MuJoCo warns: {one_line(text)}"), stacklevel=2)
    if model.neq == 0 and closed:
        raise InputError(f"{path}: no <equality> element, expected at least one that closes a loop{_ropes(model)}")
    if model.nv == 0:
        raise InputError(f"{path}: no joint, expected a mechanism that can move")
    _require_sound(path, model)
    require_moderate_model(path, model)
    return model


def _ropes(model: mujoco.MjModel) -> str:
    """What is said of a tendon that only its limit holds: a rope, where a rod may have been meant."""
    for tendon in np.flatnonzero(model.tendon_limited).tolist():
        if (
            model.wrap_type[model.tendon_adr[tendon]] != mujoco.mjtWrap.mjWRAP_JOINT
            and model.tendon_range[tendon, 0] <= 0
        ):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, tendon) or f"#{tendon}"
            return (
                f"; the limit of tendon '{name}' holds it as a rope, which pulls and never pushes: "
                f'<tendon tendon1="{name}"/> in <equality> holds its length both ways, as a rod does'
            )
    return ""


def as_asked(model: mujoco.MjModel, like: mujoco.MjModel) -> None:
    """Gives a model that was compiled anew the options of another, and where a keyframe has its mocap bodies."""
    for name in dir(like.opt):  # those that were asked for, and what was switched off
        value = getattr(like.opt, name)
        if isinstance(value, np.ndarray):
            getattr(model.opt, name)[:] = value
        elif not name.startswith("_") and not callable(value):
            setattr(model.opt, name, value)
    model.body_pos[:], model.body_quat[:] = like.body_pos, like.body_quat


def takes_degrees(path: Path) -> bool:
    """Whether angles in a file of MJCF are degrees; False of what is no text."""
    if path.suffix in (".py", COMPILED):
        return False
    with collected_warnings():
        return bool(mujoco.MjSpec.from_file(str(path)).compiler.degree)


def _has_inertia(model: mujoco.MjModel) -> bool:
    """Whether the mass matrix of a model in its own pose is positive definite."""
    data = mujoco.MjData(model)
    with collected_warnings():
        mujoco.mj_fwdPosition(model, data)
        matrix = full_mass(model, data)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(matrix).all())


def _callbacks() -> str:
    """Names the callbacks that are set, for the message of an error: MuJoCo's compiler calls them too."""
    getters = {name[4:]: getattr(mujoco, name) for name in dir(mujoco) if name.startswith("get_mjcb_")}
    names = [name for name, get in getters.items() if get() is not None]
    return f"; the process has set {', '.join(names)}, expected no callbacks: take them back" if names else ""


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collects MuJoCo's warnings, which it otherwise prints and writes to a file in the working folder."""
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield said
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def quiet_engine() -> Iterator[None]:
    """Keeps MuJoCo from its own words in the block: the status of a run tells that it went wrong.

    Except what a status does not tell: that MuJoCo's memory did not suffice becomes a warning of Python's.
    """
    with collected_warnings() as said:
        yield
    short = (re.sub(r"\s*Time = .*", "", one_line(text)) for text in said if "memory" in text)
    for text in dict.fromkeys(short):
        warnings.warn(f"MuJoCo warns: {text}", stacklevel=3)


_NAMING = re.compile(r"name|class|model|file|dir|mesh|texture|material|body|joint|site|tendon|geom|key|target|prefix")
"""Attributes whose values are names or paths, in which nan is a word."""


def _attribute_with_nan(path: Path) -> str:
    """The first attribute of which a number is none, with its element's tag and name."""
    for tag, text in re.findall(r"<(\w+)((?:\s+[\w:]+\s*=\s*(?:\"[^\"]*\"|'[^']*'))+)", _text(path)):
        given = {name: value for name, _, value in re.findall(r"([\w:]+)\s*=\s*([\"'])(.*?)\2", text, re.DOTALL)}
        for name, value in given.items():
            if not _NAMING.match(name) and any(word.lower().lstrip("+-") == "nan" for word in value.split()):
                whose = (
                    f" of {tag} '{given['name']}'"
                    if "name" in given
                    else f" of {tag}"
                    if tag in ("option", "compiler", "size")
                    else f" of a {tag}"
                )
                return one_line(f'{name}="{value}"{whose}')
    return "an attribute"


def _text(path: Path) -> str:
    """The text of a file; what is not UTF-8 is replaced."""
    return path.read_bytes().decode("utf-8", errors="replace")


_PHYSICS = ("qpos", "body_", "jnt_", "dof_", "geom_", "site_", "eq_", "tendon_", "wrap_", "actuator_", "key_")
"""Prefixes of the fields of a model that its motion depends on."""


def _require_sound(path: Path, model: mujoco.MjModel) -> None:
    """Refuses numbers that are not finite and names that are not UTF-8, which MuJoCo both accepts."""
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


def build_spec(path: Path, parameters: dict[str, Number]) -> mujoco.MjSpec:
    """Runs a ``model.py``. An error in it becomes one line that names the call.

    Raises:
        InputError: it is not as expected, or refuses the parameters.
    """
    refuse_code(path)
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
