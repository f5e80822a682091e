"""What MuJoCo does with an error that it cannot go on after, and with warnings: one line of ours, and no file.

And what numbers do that no matrix can hold, wherever in the work on a model they come up.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from oarlock.base.errors import InputError, one_line
from oarlock.mechanics.given import as_given
from oarlock.mechanics.load import quiet_engine


@contextmanager
def mujoco_ends_in_a_line(what: object = "") -> Iterator[None]:
    """Turns MuJoCo's fatal errors into one line, and keeps it from its own words, as ``quiet_engine`` does.

    So do decompositions that fail: of a model that is sound none does. A message of ours names what was given,
    and not the file that stands for it.

    Args:
        what: the model, for a message about one of several.

    Raises:
        InputError: MuJoCo cannot go on, or a matrix has no decomposition.
    """
    begins = as_given(f"{what}: ") if what else ""
    try:
        with quiet_engine():
            yield
    except InputError as error:
        if (said := as_given(str(error))) == str(error):
            raise
        raise type(error)(said) from None
    except (mujoco.FatalError, mujoco.UnexpectedError) as error:
        raise InputError(f"{begins}MuJoCo cannot go on: {one_line(error)[:300]}") from None
    except np.linalg.LinAlgError as error:
        said = one_line(error)[:300]
        raise InputError(f"{begins}its numbers are too large or too far apart to compute with: {said}") from None
