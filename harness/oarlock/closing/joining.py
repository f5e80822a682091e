"""The equalities that close a loop, as a change of the text."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import quoted
from oarlock.closing.ends import End
from oarlock.diagnosis.edit.changes import free_name, numbers
from oarlock.diagnosis.edit.document import Document
from oarlock.diagnosis.edit.editor import Editor
from oarlock.diagnosis.edit.places import body_place
from oarlock.mechanics.names import Equality, element_name, equalities

Kind = Literal["connect", "ball", "hinge", "weld"]

REACH = 0.1
"""m. The second point of a hinge along its axis, as onshape-to-robot has it."""

SAME = 1e-9
"""m. Two points that are nearer are one."""

_SITE, _EQUALITY, _BODY = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_EQUALITY, mujoco.mjtObj.mjOBJ_BODY


@dataclass(frozen=True)
class Joining:
    """Two ends that are joined: the origins of their frames, with a hinge a point of their z axes too, or all of them.

    Attributes:
        name: of the equality.
        first, second: the ends.
        kind: how.
    """

    name: str
    first: End
    second: End
    kind: Kind = "connect"
    fields: tuple[str, ...] = ("eq_", "neq", "nemax", "site_", "nsite", "stat.")

    def edit(self, editors: Mapping[Document, Editor], document: Document, model: mujoco.MjModel) -> None:
        """Adds the sites that there are not, and equalities between them."""
        editor = editors[document]
        names = {
            sort: {mujoco.mj_id2name(model, sort, index) for index in range(count)}
            for sort, count in ((_SITE, model.nsite), (_EQUALITY, model.neq))
        }
        taken, equal = names[_SITE] | editor_names(editor, "site"), names[_EQUALITY] | editor_names(editor, "equality")
        sites = [
            end.site or self._add_site(editor, document, model, end, end.name, taken)
            for end in (self.first, self.second)
        ]
        tag = "weld" if self.kind == "weld" else "connect"
        name = free_name(self.name, equal)
        editor.add("equality", tag, {"name": name, "site1": sites[0], "site2": sites[1]})
        if self.kind == "hinge":
            axis = [
                self._add_site(editor, document, model, _moved(end), f"{site}_axis", taken)
                for end, site in zip((self.first, self.second), sites, strict=True)
            ]
            equal.add(name)
            second = free_name(f"{name}_axis", equal)
            editor.add("equality", tag, {"name": second, "site1": axis[0], "site2": axis[1]})

    def _add_site(
        self, editor: Editor, document: Document, model: mujoco.MjModel, end: End, wanted: str, taken: set[str | None]
    ) -> str:
        place = body_place(document, model, end.body)
        if place is None:
            name = element_name(model, _BODY, end.body)
            raise InputError(
                f"body '{name}' of '{end.name}' is a copy of one in the file, or comes from another file, expected "
                "one that stands there"
            )
        name = free_name(wanted, taken)
        taken.add(name)
        turned = {} if np.array_equal(end.quat, [1.0, 0.0, 0.0, 0.0]) else {"quat": numbers(end.quat)}
        editor.insert(place, "site", {"name": name, "pos": numbers(end.pos), **turned})
        return name

    def apply(self, model: mujoco.MjModel) -> None:
        """A compiled model has no room for it."""

    def require(self, model: mujoco.MjModel) -> None:
        """Looks for the two ends among the equalities."""
        if joined_by(model, self.first, self.second) is None:
            raise InputError(f"no equality of '{self.first.name}' and '{self.second.name}'")


def _moved(end: End) -> End:
    return End(end.name, end.body, end.along(REACH), np.array([1.0, 0.0, 0.0, 0.0]))


def editor_names(editor: Editor, section: str) -> set[str | None]:
    """Names of what was added to a section so far, or of the elements of a tag that were inserted."""
    return {attributes.get("name") for where, tag, attributes in editor.additions if section in (where, tag)}


def joined_by(model: mujoco.MjModel, first: End, second: End) -> Equality | None:
    """The equality that joins the points of two ends already."""
    for one in equalities(model):
        if not one.kind.joins_points:
            continue
        theirs = [_point(model, one, end) for end in (0, 1)]
        for ours in ((first, second), (second, first)):
            if all(
                end.body == body and float(np.abs(end.pos - pos).max()) <= SAME
                for end, (body, pos) in zip(ours, theirs, strict=True)
            ):
                return one
    return None


def _point(model: mujoco.MjModel, equality: Equality, end: int) -> tuple[int, np.ndarray]:
    """Body, and the point in its frame, (3), m."""
    if equality.sites:
        return equality.bodies[end], model.site_pos[equality.sites[end]]
    return equality.bodies[end], equality.anchor(model, end)


def require_open(model: mujoco.MjModel, first: End, second: End) -> None:
    """Checks that two ends are not joined.

    Raises:
        InputError: they are.
    """
    if (by := joined_by(model, first, second)) is not None:
        raise InputError(
            f"'{first.name}' and '{second.name}' are joined already, by {quoted(by.name)}, expected an open pair"
        )
