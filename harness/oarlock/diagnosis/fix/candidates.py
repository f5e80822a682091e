"""What might help a model, by what was found out about it."""

from collections.abc import Iterator
from typing import Protocol

import mujoco
import numpy as np

from oarlock.diagnosis.edit.changes import Coefficients, Exclusion, Keyframe
from oarlock.diagnosis.edit.keyframe import new_name, source_key
from oarlock.diagnosis.examination import Examination
from oarlock.diagnosis.fix.bench import Bench
from oarlock.mechanics.names import equalities

_BODY = mujoco.mjtObj.mjOBJ_BODY


class Collision(Protocol):
    """Two bodies that an equality joins and that collide; ``depth`` in m. Bodies by name, by ``#number`` or number."""

    @property
    def body1(self) -> str | int: ...  # noqa: D102

    @property
    def body2(self) -> str | int: ...  # noqa: D102

    @property
    def equality(self) -> str: ...  # noqa: D102

    @property
    def depth(self) -> float: ...  # noqa: D102


class Offset(Protocol):
    """A joint or tendon equality, by name, that polynomial coefficients (5) would close at the start as it is."""

    @property
    def equality(self) -> str: ...  # noqa: D102

    @property
    def polycoef(self) -> tuple[float, ...]: ...  # noqa: D102


def exclusions(exam: Examination) -> Iterator[tuple[Exclusion, Collision]]:
    """Of bodies that collide where an equality joins them; none where nobody looked for those."""
    found: tuple[Collision, ...] = tuple(getattr(exam, "collisions", None) or ())
    known = set()
    for one in found:
        first, second = getattr(one, "bodies", None) or (_body(exam.model, body) for body in (one.body1, one.body2))
        if first is None or second is None or first == second or {first, second} in map(set, known):
            continue
        known.add((first, second))
        yield Exclusion(first, second), one


def _body(model: mujoco.MjModel, body: str | int) -> int | None:
    if isinstance(body, str) and (index := mujoco.mj_name2id(model, _BODY, body)) >= 0:
        return index
    number = body.removeprefix("#") if isinstance(body, str) else str(body)
    return int(number) if number.isdigit() and int(number) < model.nbody else None


def coefficients(exam: Examination) -> Iterator[Coefficients]:
    """Of couplings whose start is open by their offset only; none where nobody looked for those."""
    found: tuple[Offset, ...] = tuple(getattr(exam, "offsets", None) or ())
    by_name = {one.name: one.index for one in equalities(exam.model)}
    for one in found:
        if one.equality in by_name:
            yield Coefficients(by_name[one.equality], tuple(one.polycoef))


def closed_keyframe(bench: Bench) -> Keyframe | None:
    """The nearest closed pose in the keyframe that the start came from, or in a new one where it came from none.

    None where the file starts closed, or there is no such pose.
    """
    exam, base = bench.exam, bench.base
    pose = exam.pose
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
