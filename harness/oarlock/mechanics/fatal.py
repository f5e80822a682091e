"""What MuJoCo does with an error that it cannot go on after, and with warnings: one line of ours, and no file."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from oarlock.base.errors import InputError, one_line
from oarlock.mechanics.load import collected_warnings


@contextmanager
def mujoco_ends_in_a_line(what: object = "") -> Iterator[None]:
    """Turns MuJoCo's fatal errors into one line; its warnings, which it would write to the working folder, are dropped.

    What they warn of is looked at where it matters: rows that do not fit in the memory, states that are not finite.

    Args:
        what: the model, for a message about one of several.

    Raises:
        InputError: MuJoCo cannot go on.
    """
    try:
        with collected_warnings():
            yield
    except (mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise InputError(f"{what}{': ' if what else ''}MuJoCo cannot go on: {one_line(error)[:300]}") from None
