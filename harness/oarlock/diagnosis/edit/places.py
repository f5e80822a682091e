"""Where the elements of a model stand in its files, by the names that findings call them by."""

from collections.abc import Iterator

import mujoco

from oarlock.diagnosis.edit.changes import equality_place
from oarlock.diagnosis.edit.document import Document, Place
from oarlock.mechanics.names import element_name

_OBJECT = mujoco.mjtObj
_EQUALITY, _JOINT, _GEOM, _BODY = _OBJECT.mjOBJ_EQUALITY, _OBJECT.mjOBJ_JOINT, _OBJECT.mjOBJ_GEOM, _OBJECT.mjOBJ_BODY

_SORTS = {
    _EQUALITY: "neq",
    _JOINT: "njnt",
    _BODY: "nbody",
    _OBJECT.mjOBJ_TENDON: "ntendon",
    _OBJECT.mjOBJ_ACTUATOR: "nu",
    _GEOM: "ngeom",
    _OBJECT.mjOBJ_SITE: "nsite",
    _OBJECT.mjOBJ_KEY: "nkey",
}
"""What is looked for, in this order → its count in a model."""

_TAGS = {_JOINT: ("joint", "freejoint"), _BODY: ("body",), _GEOM: ("geom",), _OBJECT.mjOBJ_SITE: ("site",)}
"""Tags of what stands in bodies; of what has a section of its own, any tag in it."""

_SECTIONS = {_OBJECT.mjOBJ_TENDON: "tendon", _OBJECT.mjOBJ_ACTUATOR: "actuator", _OBJECT.mjOBJ_KEY: "keyframe"}


def place_of(document: Document, model: mujoco.MjModel, name: str) -> Place | None:
    """The element that ``mechanics.names.element_name`` calls by a name; None where no file of the document has it.

    Args:
        document: the model as it is written.
        model: the same, compiled.
        name: such as ``pin``, or ``joint of 'crank'`` for one without a name.
    """
    for sort, count in _SORTS.items():
        for index in range(getattr(model, count)):
            if element_name(model, sort, index) != name:
                continue
            if (found := _place(document, model, sort, index)) is not None:
                return found
    return None


def line_of(place: Place) -> int:
    """The line of its file on which an element begins, from 1."""
    return place.file.text.count(b"\n", 0, place.element.start) + 1


def body_place(document: Document, model: mujoco.MjModel, index: int) -> Place | None:
    """The element of a body, of the world that of its last section; None where it stands in no file of the document."""
    if index == 0:
        return next(reversed(document.sections("worldbody")), None)
    if name := mujoco.mj_id2name(model, _BODY, index):
        return next((one for one in _candidates(document, _BODY) if one.element.get("name") == name), None)
    bodies = document.bodies()
    return bodies[index - 1] if bodies is not None and len(bodies) == model.nbody - 1 else None


def _place(document: Document, model: mujoco.MjModel, sort: mujoco.mjtObj, index: int) -> Place | None:
    if sort == _EQUALITY:
        return equality_place(document, model, index)
    if name := mujoco.mj_id2name(model, sort, index):
        return next((one for one in _candidates(document, sort) if one.element.get("name") == name), None)
    if sort not in (_JOINT, _GEOM):
        return None
    owners = model.jnt_bodyid if sort == _JOINT else model.geom_bodyid
    body = body_place(document, model, int(owners[index]))
    if body is None:
        return None
    alike = [one for one in range(index) if owners[one] == owners[index] and not mujoco.mj_id2name(model, sort, one)]
    own = [one for one in document.children(body) if one.element.tag in _TAGS[sort] and not one.element.get("name")]
    return own[len(alike)] if len(alike) < len(own) else body


def _candidates(document: Document, sort: mujoco.mjtObj) -> Iterator[Place]:
    if sort in _SECTIONS:
        yield from document.members(_SECTIONS[sort])
        return
    for place in document.everything():
        # A joint of a tendon is another one's name.
        inside = place.element.parent is None or place.element.parent.tag not in ("fixed", "spatial", "default")
        if place.element.tag in _TAGS[sort] and inside:
            yield place
