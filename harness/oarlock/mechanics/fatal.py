"""What MuJoCo does with an error that it cannot go on after, and with warnings: one line of ours, and no file."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from oarlock.base.errors import InputError, one_line
from oarlock.mechanics.load import quiet_engine


@contextmanager
def mujoco_ends_in_a_line(what: object = "") -> Iterator[None]:
    """Turns MuJoCo's fatal errors into one line, and keeps it from its own words, as ``quiet_engine`` does.

    Args:
        what: the model, for a message about one of several.

    Raises:
        InputError: MuJoCo cannot go on.
    """
    try:
        with quiet_engine():
            yield
    except (mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise InputError(f"{what}{': ' if what else ''}MuJoCo cannot go on: {one_line(error)[:300]}") from None
