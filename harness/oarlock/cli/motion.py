"""The options that say where a run starts and what drives it: the same for every command that has them."""

from collections.abc import Sequence
from typing import Annotated

import typer

from oarlock.base.errors import InputError

KeyframeOption = Annotated[
    str | None,
    typer.Option(metavar="NAME|NUMBER|none", help="Start here; none: the model's own pose [default: the first one]."),
]
ControlsOption = Annotated[
    str | None,
    typer.Option(
        metavar="KIND|FILE",
        help="keyframe, constant or random (smooth), or a log FILE.csv or FILE.npz of time and actuators, each value "
        "held until the next [default: the keyframe's, where the run starts from one, else random].",
    ),
]
ControlOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ACTUATOR=VALUE", help="The control of an actuator, a number or a law of the time t; may be repeated."
    ),
]
StatesOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="A log of what a program really did, in place of MuJoCo's own run: FILE.npz with time, qpos, qvel, "
        "ctrl and act before every step, or FILE.csv with qpos0, qpos1 …",
    ),
]
SeedOption = Annotated[int, typer.Option(metavar="N", help="Of random controls.")]


def given_controls(given: Sequence[str] | None) -> dict[str, float | str]:
    """Actuator → its control, from ``ACTUATOR=VALUE``.

    Raises:
        InputError: one is not of that form.
    """
    found: dict[str, float | str] = {}
    for text in given or ():
        name, sign, value = text.partition("=")
        if not sign or not name or not value.strip():
            raise InputError(f"--control {text}, expected ACTUATOR=VALUE with a number or a law of the time t")
        try:
            found[name] = float(value)
        except ValueError:
            found[name] = value
    return found
