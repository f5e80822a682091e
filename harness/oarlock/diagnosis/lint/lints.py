"""The list of lints, and how all of them look at a model."""

from collections.abc import Callable, Iterator

import numpy as np

from oarlock.diagnosis.lint import (
    absolute,
    collision,
    contradictory,
    damper,
    defined,
    doubled,
    doubtful,
    drawn,
    feeding,
    gears,
    gyration,
    jump,
    locked,
    opened,
    opposed,
    pin,
    ranges,
    reach,
    relpose,
    servo,
    swapped,
    underdamped,
    unit,
    unused,
)
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.mechanics.load import collected_warnings

LINTS: dict[str, Callable[[View], Iterator[Remark]]] = {
    "contradictory": contradictory.look,
    "opposed": opposed.look,
    "pin": pin.look,
    "collision": collision.look,
    "servo": servo.look,
    "damper": damper.look,
    "feeding": feeding.look,
    "unit": unit.look,
    "ranges": ranges.look,
    "reach": reach.look,
    "absolute": absolute.look,
    "gyration": gyration.look,
    "jump": jump.look,
    "swapped": swapped.look,
    "gears": gears.look,
    "unused": unused.look,
    "relpose": relpose.look,
    "drawn": drawn.look,
    "doubtful": doubtful.look,
    "doubled": doubled.look,
    "underdamped": underdamped.look,
    "defined": defined.look,
    "opened": opened.look,
    "locked": locked.look,
}
"""Name of a lint → what it has to say of a model."""


def look(view: View) -> dict[str, list[Remark]]:
    """What each lint has to say, by its name.

    Raises:
        InputError: an active equality of a kind whose rows are not known.
    """
    with collected_warnings(), np.errstate(all="ignore"):  # what is beyond all bounds, the run tells
        return {name: list(one(view)) for name, one in LINTS.items()}
