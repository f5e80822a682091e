"""What readers of MJCF outside MuJoCo take, as far as an export has to mind it."""

from dataclasses import dataclass

from oarlock.base.errors import choose


@dataclass(frozen=True)
class Reader:
    """One reader.

    Attributes:
        name: of the engine.
        program: that reads back.
        title: for messages.
        equalities: kinds that it takes.
        one_root: whether of the world's bodies it takes the first only.
        weights: whether it gives a body a mass that has shapes and does not say that it weighs nothing.
        shifts: whether it loses the ``ref`` of the first of several joints.
        seats: whether it misplaces joints of a body that has several and lies off its parent.
        gravity: whether it takes the gravity of the file.
        sites: whether it takes sites.
        actuators: whether it takes motors of joints.
    """

    name: str
    program: str
    title: str
    equalities: tuple[str, ...]
    one_root: bool = False
    weights: bool = False
    shifts: bool = False
    seats: bool = False
    gravity: bool = True
    sites: bool = True
    actuators: bool = True


READERS = {
    reader.name: reader
    for reader in (
        Reader(
            "pinocchio",
            "pinocchio_reader",
            "Pinocchio",
            ("connect", "weld"),
            one_root=True,
            weights=True,
            shifts=True,
            actuators=False,
        ),
        Reader("drake", "drake", "Drake", ("connect",), seats=True, sites=False),
        Reader("newton", "newton", "Newton", ("connect", "weld", "joint"), gravity=False),
    )
}
"""Name → reader."""


def reader_of(name: str) -> Reader:
    """A reader by its name.

    Raises:
        InputError: it is not known.
    """
    return READERS[choose("reader", name, list(READERS))]
