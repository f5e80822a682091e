"""What might help a model, by what was found out about it."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from oarlock.diagnosis.edit.changes import Change, Exclusion, Keyframe
from oarlock.diagnosis.edit.keyframe import new_name, source_key
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.lint.collision import Collision


def exclusions(exam: Examination) -> Iterator[tuple[Exclusion, Collision]]:
    """Of bodies that collide where an equality joins them, each pair once."""
    known: set[tuple[int, int]] = set()
    for one in exam.collisions:
        if one.bodies not in known:
            known.add(one.bodies)
            yield Exclusion(*one.bodies), one


def closed_keyframe(bench: Bench, changes: Sequence[Change] = ()) -> Keyframe | None:
    """The nearest closed pose in the keyframe that the start came from, or in a new one where it came from none.

    It is closed with the coefficients among changes. None where the file starts closed, or there is no such pose.
    """
    exam, base = bench.exam, bench.base
    pose = bench.pose(changes)
    if pose is None or not pose.closed:
        return None
    elsewhere = exam is not base and not (np.array_equal(exam.qpos, base.qpos) and np.array_equal(exam.qvel, base.qvel))
    if pose.consistent and not elsewhere:
        return None
    key = source_key(base.model, base.options.keyframe)
    if key is not None:
        return Keyframe(pose.qpos, pose.qvel, key=key)
    return Keyframe(pose.qpos, pose.qvel, name=new_name(base.model), ctrl=_held(base.model, exam.laws))


def _held(model: mujoco.MjModel, laws: dict[str, str]) -> np.ndarray | None:
    """Constant controls (nu), for a new keyframe to hold; None where one is no constant, or all are 0."""
    held = np.zeros(model.nu)
    for name, law in laws.items():
        actuator = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
        try:
            held[actuator if actuator >= 0 else int(name.removeprefix("#"))] = float(law)
        except ValueError:
            return None
    return held if held.any() else None
