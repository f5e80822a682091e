"""Tells a data that was made of a model from those of others."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.errors import InputError

SIZES = ("nq", "nv", "na", "nu", "nbody", "njnt", "ngeom", "nsite", "neq", "ntendon", "nmocap", "nM")

_DYNAMICS = ("qpos0", "body_", "jnt_", "dof_", "geom_", "site_", "eq_", "tendon_", "wrap_", "actuator_")
"""Beginnings of the names of the arrays that a motion depends on."""

_LOOKS = ("_rgba", "_user", "_group", "_matid")
"""Ends of the names of those of them that it does not."""


class MadeOf:
    """Knows one model.

    Args:
        model: its data are let through whatever becomes of it; kept as long as this is.
        own: a copy as it was: data of another model are, if that is the same.
    """

    def __init__(self, model: mujoco.MjModel, own: mujoco.MjModel):
        self._own = own
        # Kept, so that no other model comes to have such an address.
        self._known = {model._address: model}

    def require(self, data: mujoco.MjData) -> None:
        """Refuses what is no data, or that of another model.

        Raises:
            InputError: it is; the message names the first thing that differs.
        """
        if not isinstance(data, mujoco.MjData):
            raise InputError(f"data is a {type(data).__name__}, expected an MjData")
        theirs = data.model
        if theirs._address in self._known:
            return
        for name in SIZES:
            if (found := getattr(theirs, name)) != (size := getattr(self._own, name)):
                raise InputError(
                    f"data of a model with {name} = {found}, expected {size}: one that was made of this model"
                )
        for name in _arrays(self._own):
            if not np.array_equal(getattr(theirs, name), getattr(self._own, name), equal_nan=True):
                raise InputError(
                    f"data of another model of the same size, whose {name} differs, expected one that was made of "
                    "this model"
                )
        self._known[theirs._address] = theirs


def _arrays(model: mujoco.MjModel) -> Iterator[str]:
    for name in dir(model):
        if name.startswith(_DYNAMICS) and not name.endswith(_LOOKS):
            value = getattr(model, name)
            if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
                yield name
