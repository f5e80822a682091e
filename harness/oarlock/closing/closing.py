"""An open tree whose loops are closed: equalities between two named ends, and a keyframe in which they are closed."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import mujoco
import numpy as np

from oarlock.base.cores import one_thread
from oarlock.base.errors import InputError, choose
from oarlock.base.numbers import figure
from oarlock.base.scratch import scratch_folder
from oarlock.closing.ends import End, Ends, as_drawn, require_apart
from oarlock.closing.joining import Joining, Kind, joined_by, require_open
from oarlock.closing.urdf import is_urdf, save_as_mjcf
from oarlock.diagnosis.edit.changes import Keyframe
from oarlock.diagnosis.edit.copy import write_changed
from oarlock.diagnosis.edit.keyframe import new_name, source_key
from oarlock.diagnosis.edit.place import require_place
from oarlock.diagnosis.loops.poses import ClosedPose, nearest_closed
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.mechanics.load import load_model
from oarlock.mechanics.servos import holding
from oarlock.poses.assembly import Assembly

MARKER = re.compile(r"closing_(.+)_([12])")
"""Names of frames that are meant to meet, as onshape-to-robot writes them."""


@dataclass(frozen=True)
class Closing:
    """What became of an open tree.

    Attributes:
        joinings: the equalities that were added.
        files: what was written, the copy last; empty where no pose closes the loops.
        keyframe: name of the keyframe with the closed pose.
        pose: the closed pose, or the best one.
        gap: how far the loops stand open in it, m or rad: of the keyframe as it is written.
    """

    joinings: tuple[Joining, ...]
    files: tuple[Path, ...]
    keyframe: str
    pose: ClosedPose
    gap: float

    @property
    def reached(self) -> bool:
        """Whether a pose closes the loops."""
        return bool(self.files)

    def told(self) -> list[str]:
        """What was done, in sentences."""
        joined = [
            f"'{one.name}' ({one.kind}) joins '{one.first.name}' and '{one.second.name}'" for one in self.joinings
        ]
        pose, way = self.pose, "the start is closed"
        if pose.moved_joint:
            most = f"{pose.moved_joint} moves by {figure(pose.moved, pose.moved_unit)}, most of all"
            way = f"it is {figure(pose.norm, 'rad')} from the start; {most}"
        beyond = [f"It is beyond the {one.limit} by {figure(one.by, one.unit)}." for one in pose.outside]
        return [
            f"{'; '.join(joined)}.",
            f"Keyframe '{self.keyframe}' has the nearest closed pose: {way}. Its loops are closed to "
            f"{figure(self.gap, 'm or rad')}.",
            *beyond,
        ]

    def document(self) -> dict[str, Any]:
        """For JSON; lengths in m, angles in rad."""
        return {
            "files": [str(path) for path in self.files],
            "keyframe": self.keyframe,
            "gap": self.gap,
            "qpos": self.pose.qpos.tolist(),
            "moved": self.pose.norm,
            "joined": [
                {"name": one.name, "as": one.kind, "first": one.first.name, "second": one.second.name}
                for one in self.joinings
            ],
        }


def close(
    file: str | Path,
    out: str | Path,
    pair: Sequence[tuple[str, str]] = (),
    *,
    kind: Kind = "connect",
    at: Sequence[float] | None = None,
) -> Closing:
    """Closes loops of an open tree, and writes it as MJCF with a keyframe in the nearest closed pose.

    Args:
        file: MJCF, whose text stays as it is elsewhere, or URDF.
        out: the copy; what is there is replaced. Not written where no pose closes the loops.
        pair: names of two sites, frames or bodies each; none: every ``closing_NAME_1`` with ``closing_NAME_2``.
        kind: how each is joined: ``connect`` or ``ball``, ``hinge``, ``weld``; ``--as`` of the command.
        at: where two bodies are joined in the model's own pose, (3), world, m; None: at the second one's origin.

    Returns:
        What was done: ``files`` is empty where no pose closes the loops.

    Raises:
        InputError: the source is malformed, there is nothing to close, nothing has one of the names, two ends are
            joined already or are parts of one body, or the copy cannot be written.
    """
    source, out, pairs = Path(file), Path(out), list(pair)
    choose("kind", kind, get_args(Kind))
    if at is not None and len(pairs) != 1:
        raise InputError(f"--at with {len(pairs)} pairs, expected one --pair")
    if not source.is_file():
        raise InputError(f"no model file '{source}'")
    require_place(source, out)
    with one_thread(), mujoco_ends_in_a_line(source):
        if not is_urdf(source):
            return _close(source, out, pairs, kind, at)
        with scratch_folder() as folder:
            # Meshes are named from the folder of the copy, in which the file would be in the way.
            saved = folder / source.with_suffix(".xml").name
            save_as_mjcf(source, saved)
            try:
                return _close(saved, out, pairs, kind, at)
            except InputError as error:
                raise InputError(str(error).replace(str(saved), str(source))) from None


def _close(
    source: Path, out: Path, pairs: Sequence[tuple[str, str]], kind: Kind, at: Sequence[float] | None
) -> Closing:
    model = load_model(source, closed=False)
    ends = Ends(source)
    named = {pair: _name(pair) for pair in pairs or _marked(ends, model)}
    found = ends.find([name for pair in named for name in pair])
    joinings = list[Joining]()
    for number, (pair, name) in enumerate(named.items()):
        first, second = found[2 * number : 2 * number + 2]
        require_apart(model, first, second)
        bodies = first.moving and second.moving
        if at is not None and not bodies:
            named = next(one.name for one in (first, second) if not one.moving)
            raise InputError(f"a point (--at) for '{named}', which has a place of its own: expected two bodies")
        if bodies:
            first, second = as_drawn(model, first, second, at)
        require_open(model, first, second)
        if any({one.first.name, one.second.name} == {*pair} for one in joinings):
            raise InputError(f"the pair '{pair[0]}' '{pair[1]}' is given twice, expected it once")
        joinings.append(Joining(name, first, second, kind))
    with scratch_folder() as folder:
        write_changed(source, folder / out.name, joinings)
        closed = load_model(folder / out.name)
    key = source_key(closed, None)
    pose = nearest_closed(closed, None if key is None else closed.key_qpos[key])
    if not pose.closed:
        return Closing(tuple(joinings), (), "", pose, max(one.largest for one in pose.left))
    keyframe = new_name(closed)
    ctrl = holding(closed, pose.qpos) if key is None else None
    files = write_changed(source, out, [*joinings, Keyframe(pose.qpos, pose.qvel, name=keyframe, like=key, ctrl=ctrl)])
    return Closing(tuple(joinings), tuple(files), keyframe, pose, _gap(out, keyframe))


def _name(pair: tuple[str, str]) -> str:
    """What the equality of two ends is called."""
    marks = [MARKER.fullmatch(name) for name in pair]
    if marks[0] and marks[1] and marks[0][1] == marks[1][1]:
        return marks[0][1]
    return "_".join(pair)


def _marked(ends: Ends, model: mujoco.MjModel) -> list[tuple[str, str]]:
    """The pairs that are marked by their names and not joined yet."""
    marks = {name: mark for name in ends.names if (mark := MARKER.fullmatch(name))}
    names = list(dict.fromkeys(mark[1] for mark in marks.values()))
    if not names:
        raise InputError(
            "no --pair, and no frames called closing_NAME_1 and closing_NAME_2, expected at least one pair to join"
        )
    pairs = [(f"closing_{name}_1", f"closing_{name}_2") for name in names]
    for pair in pairs:
        for here, there in (pair, pair[::-1]):
            if here not in marks:
                raise InputError(f"no frame '{here}' beside '{there}', expected both")
    found = ends.find([name for pair in pairs for name in pair])
    left = [pair for number, pair in enumerate(pairs) if not _joined(model, found[2 * number : 2 * number + 2])]
    if not left:
        require_open(model, found[0], found[1])
    return left


def _joined(model: mujoco.MjModel, pair: Sequence[End]) -> bool:
    return joined_by(model, pair[0], pair[1]) is not None


def _gap(path: Path, keyframe: str) -> float:
    """The largest deviation of a row in a keyframe, m or rad."""
    model = load_model(path)
    assembly = Assembly(model)
    assembly.place(model.key(keyframe).qpos)
    return float(np.abs(assembly.residual()).max(initial=0.0))
