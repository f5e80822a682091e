"""URDF as MuJoCo reads it, saved as MJCF: every link is a body, also those that a fixed joint holds, and frames."""

import os
from pathlib import Path

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.files import write_bytes
from oarlock.diagnosis.edit.changes import numbers
from oarlock.diagnosis.edit.document import Document, Place
from oarlock.diagnosis.edit.editor import Editor
from oarlock.mechanics.limits import require_moderate
from oarlock.mechanics.load import collected_warnings
from oarlock.mechanics.refusal import refusal

ABOVE = 3
"""Folders above that of a model in which its package is looked for."""


def is_urdf(path: Path) -> bool:
    """Whether a file is URDF, whatever it is called.

    Raises:
        InputError: it cannot be read, or is no XML.
    """
    return Document(path).main.root.tag == "robot"


def save_as_mjcf(source: Path, out: Path) -> None:
    """Writes the model of a URDF file as MJCF.

    MuJoCo writes six digits, which tilt axes by 1e-7 rad: a planar loop would not close. Bodies and joints get all of
    their digits.

    Args:
        source: the file.
        out: what is written; its folder exists. Meshes are named from there.

    Raises:
        InputError: MuJoCo refuses the file, or it comes back as another model.
    """
    require_moderate(source)
    try:
        with collected_warnings():
            spec = mujoco.MjSpec.from_file(str(source))
            spec.compiler.fusestatic = False  # a link of a fixed joint is a name for a place
            folder = (source.parent / spec.meshdir).resolve()
            for mesh in spec.meshes:
                if found := _in_package(mesh.file, source.parent.resolve()):
                    mesh.file = Path(os.path.relpath(found, folder)).as_posix()
            model = spec.compile()
            text = spec.to_xml()
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        raise InputError(f"{source}: {refusal(error)}") from None
    write_bytes(out, text.encode())
    document = Document(out)
    bodies = document.bodies()
    if bodies is None or len(bodies) != model.nbody - 1:
        raise InputError(f"{source}: MuJoCo saves other bodies than it reads, expected the same")
    editor, joint = Editor(document), 0
    if model.nmesh:
        meshdir = Path(os.path.relpath(folder, out.parent.resolve())).as_posix()
        editor.set(document.sections("compiler")[0], {"meshdir": meshdir})
    for index, place in enumerate(bodies, 1):
        _restore(editor, place, {"pos": model.body_pos[index], "quat": model.body_quat[index]})
        for child in document.children(place):
            if child.element.tag in ("joint", "freejoint"):
                _restore(editor, child, {"axis": model.jnt_axis[joint]})
                joint += 1
    write_bytes(out, editor.text(document.main))
    _require_same(source, model, out)


def _in_package(name: str, folder: Path) -> Path | None:
    """The file of a name such as package://robot/meshes/arm.stl, which MuJoCo does not look for in packages.

    It is looked for in the folder of the model and those above, with the name of the package and without it.
    """
    scheme, between, rest = name.partition("://")
    if not between or scheme not in ("package", "model"):
        return None
    inside = Path(*Path(rest).parts[1:])
    places = (place / part for place in (folder, *folder.parents[:ABOVE]) for part in (Path(rest), inside))
    return next((place for place in places if place.is_file()), None)


def _restore(editor: Editor, place: Place, values: dict[str, np.ndarray]) -> None:
    """Gives attributes that are written all of their digits; what is not written is MuJoCo's default."""
    given = {name: numbers(value) for name, value in values.items() if name in place.element.attributes}
    editor.set(place, given)


def _require_same(source: Path, model: mujoco.MjModel, out: Path) -> None:
    with collected_warnings():
        saved = mujoco.MjModel.from_xml_path(str(out))
    for name in ("body_parentid", "body_pos", "body_quat", "jnt_type", "jnt_bodyid", "jnt_axis"):
        before, after = getattr(model, name), getattr(saved, name)
        if before.shape != after.shape or np.abs(before - after).max(initial=0.0) > _ROUNDING:
            raise InputError(f"{source}: MuJoCo saves another {name} than it reads, expected the same")


_ROUNDING = 1e-15
"""Quaternions and axes are normalised once more."""
