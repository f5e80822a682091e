"""What may be changed in a model: each change in the text, in the compiled model, and in a line of words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.numbers import exact
from oarlock.cases.equality_kinds import KIND_OF
from oarlock.diagnosis.edit.document import Document, Place
from oarlock.diagnosis.edit.editor import Editor
from oarlock.diagnosis.runs.trials import Setting
from oarlock.mechanics.names import element_name, equalities

NORMALISED = 1e-15
"""MuJoCo normalises the quaternions of keyframes and welds once more."""

_BODY, _KEY, _JOINT = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_KEY, mujoco.mjtObj.mjOBJ_JOINT


class Change(Protocol):
    """A change of a model.

    Attributes:
        fields: beginnings of the names of the arrays that may differ afterwards, besides those that ``apply`` sets.
    """

    @property
    def fields(self) -> tuple[str, ...]:
        """See above."""
        ...

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Writes it into the text of a model.

        Args:
            editors: of the document and of all that it attaches.
            document: the model's.
            model: the same, compiled.

        Raises:
            InputError: the text has no place for it.
        """
        ...

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets what of it a compiled model has room for."""
        ...

    def require(self, model: mujoco.MjModel) -> None:
        """Looks for the rest of it in a model that was compiled from the text.

        Raises:
            InputError: it is not there.
        """
        ...


@dataclass(frozen=True)
class Settings:
    """A timestep, an integrator and so on for ``<option>``, and solref and solimp for every equality."""

    setting: Setting
    fields: tuple[str, ...] = ()

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Changes options that the model has otherwise, where they stand last, and all equalities."""
        authored = Setting.authored(model).option_attributes()
        options = {
            name: value for name, value in self.setting.option_attributes().items() if authored.get(name) != value
        }
        for name, value in options.items():
            sections = document.sections("option")
            own = [place for place in sections if place.file is document.main]
            saying = [place for place in sections if name in place.element.attributes]
            if saying or own:
                editors[document].set((saying or own)[-1], {name: value})
        if options and not any(place.file is document.main for place in document.sections("option")):
            said = {name for place in document.sections("option") for name in place.element.attributes}
            if missing := {name: value for name, value in options.items() if name not in said}:
                editors[document].add("", "option", missing)
        for one, editor in editors.items():
            for place in one.members("equality"):
                if place.element.tag in KIND_OF and KIND_OF[place.element.tag].known:
                    editor.set(place, self.setting.equality_attributes())
            if one is not document and options:  # MuJoCo warns of options that differ in what is attached
                for place in one.sections("option")[-1:]:
                    editor.set(place, options)

    def apply(self, model: mujoco.MjModel) -> None:
        """As ``Setting.apply``."""
        self.setting.apply(model)

    def require(self, model: mujoco.MjModel) -> None:
        """All of it is set by ``apply``."""


@dataclass(frozen=True)
class Keyframe:
    """A pose and its velocities in a keyframe: in one that there is, of which all else stays, or in a new one.

    Attributes:
        qpos: (nq).
        qvel: (nv).
        key: number of the keyframe that is changed; None: a new one.
        name: of the new one.
        like: number of the keyframe that a new one has all else of: time, activations, controls, mocap poses.
        ctrl: of the new one, (nu); None: as ``like``, or none.
    """

    qpos: np.ndarray
    qvel: np.ndarray
    key: int | None = None
    name: str = ""
    like: int | None = None
    ctrl: np.ndarray | None = None
    fields: tuple[str, ...] = ("key_", "nkey")

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Sets qpos, and qvel where there is any, or adds the keyframe."""
        if self.key is None:
            given = {"qpos": self.qpos, "qvel": self.qvel, "ctrl": self.ctrl}
            written = {name: numbers(value) for name, value in given.items() if value is not None and np.any(value)}
            kept = {} if self.like is None else _all_but_the_pose(document, model, self.like)
            editors[document].add("keyframe", "key", {"name": self.name, **(kept | written)})
            return
        place = key_place(document, model, self.key)
        if place is None:
            raise InputError("the keyframe of the start comes from another file by <attach>, expected one of its own")
        attributes = {"qpos": numbers(self.qpos)}
        if "qvel" in place.element.attributes or np.any(self.qvel):
            attributes["qvel"] = numbers(self.qvel)
        editors[document].set(place, attributes)

    def apply(self, model: mujoco.MjModel) -> None:
        """A new keyframe has no room in a compiled model."""

    def require(self, model: mujoco.MjModel) -> None:
        """Compares the keyframe."""
        key = mujoco.mj_name2id(model, _KEY, self.name) if self.key is None else self.key
        wanted = [(self.qpos, model.key_qpos[key]), (self.qvel, model.key_qvel[key])]
        if self.like is not None and self.key is None:
            arrays = [getattr(model, f"key_{name}") for name in _KEPT if self.ctrl is None or name != "ctrl"]
            wanted += [(array[self.like], array[key]) for array in arrays]
        if any(np.abs(given - there).max(initial=0.0) > NORMALISED for given, there in wanted):
            raise InputError("another state in the keyframe, expected the one that was given")


@dataclass(frozen=True)
class Exclusion:
    """No contacts between two bodies, given by number."""

    body1: int
    body2: int
    fields: tuple[str, ...] = ("nexclude", "exclude_")

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Adds ``<exclude>``; a body without a name gets one, since MuJoCo excludes bodies by name."""
        names = [self._named(editors[document], document, model, body) for body in (self.body1, self.body2)]
        editors[document].add("contact", "exclude", {"body1": names[0], "body2": names[1]})

    def _named(self, editor: Editor, document: Document, model: mujoco.MjModel, body: int) -> str:
        if name := mujoco.mj_id2name(model, _BODY, body):
            return name
        bodies = document.bodies()
        if bodies is None or len(bodies) != model.nbody - 1:
            raise InputError(
                f"body {element_name(model, _BODY, body)} has no name and is a copy of one in the file, expected a "
                "name to exclude its contacts by"
            )
        taken = {mujoco.mj_id2name(model, _BODY, index) for index in range(model.nbody)}
        name = free_name(f"body{body}", taken)
        editor.set(bodies[body - 1], {"name": name})
        return name

    def apply(self, model: mujoco.MjModel) -> None:
        """A compiled model has no room for it."""

    def require(self, model: mujoco.MjModel) -> None:
        """Looks for the pair."""
        first, second = sorted((self.body1, self.body2))
        if (first << 16) + second not in model.exclude_signature.tolist():
            raise InputError("no exclusion of the two bodies")


@dataclass(frozen=True)
class Constants:
    """What an equality, given by its number, asks for: the numbers of one of its attributes."""

    equality: int
    values: tuple[float, ...]
    fields: tuple[str, ...] = ()

    attribute: ClassVar[str]
    at: ClassVar[slice]
    """Where the numbers stand in ``eq_data`` of a compiled model."""

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Sets the attribute."""
        place = equality_place(document, model, self.equality)
        if place is None:
            name = equalities(model)[self.equality].name
            raise InputError(f"equality '{name}' is a copy of one in the file, expected one that stands there alone")
        editors[document].set(place, {self.attribute: numbers(np.array(self.values))})

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets the numbers of the equality."""
        model.eq_data[self.equality, self.at] = self.values

    def require(self, model: mujoco.MjModel) -> None:
        """All of it is set by ``apply``."""


@dataclass(frozen=True)
class Coefficients(Constants):
    """The polynomial (5) of a joint or tendon equality."""

    attribute = "polycoef"
    at = slice(0, 5)


@dataclass(frozen=True)
class RelativePose(Constants):
    """The relative pose (7) of the bodies of a weld: where its anchor is in the frame of the first one, and w x y z.

    In the text it takes the place of one that MuJoCo computed, which it marks in ``eq_data``.
    """

    fields: tuple[str, ...] = ("eq_data",)

    attribute = "relpose"
    at = slice(3, 10)

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets the numbers of the weld, with a quaternion of length 1."""
        super().apply(model)
        turn = np.array(self.values[3:])
        mujoco.mju_normalize4(turn)
        model.eq_data[self.equality, 6:10] = turn

    def require(self, model: mujoco.MjModel) -> None:
        """Compares them."""
        there, wanted = model.eq_data[self.equality, self.at].copy(), np.array(self.values)
        mujoco.mju_normalize4(wanted[3:])
        if np.abs(there - wanted).max() > NORMALISED:
            raise InputError("another relative pose of a weld, expected the one that was given")


@dataclass(frozen=True)
class Armature:
    """The inertia that the drives of some joints, given by their numbers, add to each of them, kg m² or kg."""

    joints: tuple[int, ...]
    value: float
    fields: tuple[str, ...] = ("dof_", "body_invweight0", "tendon_invweight0", "actuator_acc0", "stat")

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Sets the attribute of each joint."""
        for joint in self.joints:
            name = mujoco.mj_id2name(model, _JOINT, joint)
            own = [place for place in document.everything() if place.element.tag == "joint" and name]
            own = [
                place for place in own if place.element.get("name") == name and "joint" not in place.element.attributes
            ]
            if len(own) != 1:
                said = element_name(model, _JOINT, joint)
                raise InputError(f"joint '{said}' does not stand alone in the file, expected one with a name there")
            editors[document].set(own[0], {"armature": exact(self.value)})

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets it, and what MuJoCo computes of it when it compiles a model."""
        constants = model.eq_data.copy()
        for joint in self.joints:
            model.dof_armature[model.jnt_dofadr[joint]] = self.value
        mujoco.mj_setConst(model, mujoco.MjData(model))
        model.eq_data[:] = constants

    def require(self, model: mujoco.MjModel) -> None:
        """Looks at each joint."""
        if any(model.dof_armature[model.jnt_dofadr[joint]] != self.value for joint in self.joints):
            raise InputError("another armature of a joint, expected the one that was given")


@dataclass(frozen=True)
class Switched:
    """An equality, given by its number, that is switched on."""

    equality: int
    fields: tuple[str, ...] = ()

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Sets the attribute."""
        place = equality_place(document, model, self.equality)
        if place is None:
            name = equalities(model)[self.equality].name
            raise InputError(f"equality '{name}' is a copy of one in the file, expected one that stands there alone")
        editors[document].set(place, {"active": "true"})

    def apply(self, model: mujoco.MjModel) -> None:
        """Switches it on."""
        model.eq_active0[self.equality] = 1

    def require(self, model: mujoco.MjModel) -> None:
        """All of it is set by ``apply``."""


_KEPT = ("time", "act", "ctrl", "mpos", "mquat")
"""Of a keyframe, besides its pose and velocities: attributes, and arrays of a model after ``key_``."""


def _all_but_the_pose(document: Document, model: mujoco.MjModel, key: int) -> dict[str, str]:
    """Attributes of a keyframe as its author wrote them; as they are compiled, where it stands in no file."""
    if (place := key_place(document, model, key)) is not None:
        return {name: attribute.text for name, attribute in place.element.attributes.items() if name in _KEPT}
    arrays = {name: np.ravel(getattr(model, f"key_{name}")[key]) for name in _KEPT}
    return {name: numbers(array) for name, array in arrays.items() if array.any()}


# Places.


def key_place(document: Document, model: mujoco.MjModel, key: int) -> Place | None:
    """The element of a keyframe; None where it stands in no file of the document."""
    return _of(document.members("keyframe"), mujoco.mj_id2name(model, _KEY, key), key, model.nkey)


def equality_place(document: Document, model: mujoco.MjModel, index: int) -> Place | None:
    """The element of an equality; None where it is a copy of another one, or comes from elsewhere."""
    places = [place for place in document.members("equality") if place.element.tag in KIND_OF]
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_EQUALITY, index)
    return _of(places, name, index, model.neq)


def _of(places: Sequence[Place], name: str | None, index: int, count: int) -> Place | None:
    """By name, or by order where the model has exactly those of the file."""
    if name:
        named = [place for place in places if place.element.get("name") == name]
        return named[0] if len(named) == 1 else None
    return places[index] if len(places) == count else None


def free_name(wanted: str, taken: set[str | None]) -> str:
    """A name that is not taken, numbered if need be."""
    name, count = wanted, 1
    while name in taken:
        count += 1
        name = f"{wanted}{count}"
    return name


def numbers(values: np.ndarray) -> str:
    """Numbers with all their digits."""
    return " ".join(map(exact, np.asarray(values, dtype=float).tolist()))
