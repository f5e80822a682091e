"""Couplings that the start contradicts: whether the pose is what is off, or the constant of the polynomial.

Both close the start, and where both have the same run no measurement tells them apart. So a coupling is taken at its
word, and the pose is moved, unless one of these speaks against the constant:

    1. two keyframes or more, in different poses, all miss it by the same;
    2. read in another unit, or from where MuJoCo counts, it fits (A2);
    3. no pose near the start meets it inside of all ranges, and with another constant one does;
    4. the coupling is pulled open again from the closed pose, by something that lasts (S4), twice as far as with
       the constant that closes the start as it is given.

Before all of them: where another keyframe meets it as it is written, the start is what is off. Before the last: where
another coupling with the same polycoef holds at the start. No constant is taken with which the run opens further;
of what A2 names, with which it opens more than ``NAMED`` times as far. A ratio in another unit is closed where both
joints are at zero, and is written anew all the same.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.base.text import quoted
from oarlock.diagnosis.edit.changes import Coefficients, Constants
from oarlock.diagnosis.edit.copy import require_room
from oarlock.diagnosis.edit.keyframe import source_key
from oarlock.diagnosis.fix.bench import Bench
from oarlock.diagnosis.fix.candidates import NAMED, UNMET, Offset, closes_inside, run_closed
from oarlock.diagnosis.fix.words import drifts
from oarlock.diagnosis.lint.opened import ROUNDED
from oarlock.mechanics.coupled import coupled, coupled_ids
from oarlock.mechanics.names import Equality, element_name
from oarlock.poses.assembly import Assembly
from oarlock.stepping.closing import CONSISTENT

ALIKE = 0.01
"""Of an opening: keyframes that miss a coupling by the same agree to that; two digits are no accident."""

APART = 0.1
"""Of an opening: keyframes whose coupled coordinates differ by less are one pose, and say nothing twice."""

HALF = 0.5
"""Of a drift: a constant has to leave less, where the closed pose opens again. As of a remedy of S4."""

UNIT = "it was written in another unit, or from another zero (A2)"
"""What a finding names."""

WRITTEN = 1e-12
"""m or rad: so near to a constant the shortest number is written. A closed start promises no more."""


def choose_offsets(bench: Bench) -> tuple[list[Offset], list[str]]:
    """The constants that are off, and what is said of those that would close the start and are not taken.

    Raises:
        InputError: as of the runs.
    """
    taken, said = list[Offset](), list[str]()
    if bench.exam.moved or bench.exam.pose is None:
        return taken, said
    start = _Start(bench)
    decided = [(one, *start.written(one)) for one in start.couplings()]
    taken += (together := _named_together(bench, start, [each for each in decided if each[2] == UNIT]))
    for one, polycoef, for_it, against in sorted(decided, key=lambda each: not each[2]):  # what is sure first
        if any(each.change.equality == one.index for each in together):
            continue
        offset = Offset(one, start.polycoef(one), Coefficients(one.index, polycoef), for_it)
        try:
            require_room(bench.base.path, offset.change)
        except InputError as error:
            said.append(f"{offset}: {error}")
            continue
        if not against:
            for_it, against = _tried(bench, [each.change for each in taken], offset, start.holds_alike(one))
        if against:
            said.append(f"{offset}, which {'would close the start' if start.opens(one) else 'A2 names'}: {against}")
        else:
            taken.append(replace(offset, why=for_it))
    return taken, said


def _named_together(
    bench: Bench, start: "_Start", named: Sequence[tuple[Equality, tuple[float, ...], str, str]]
) -> list[Offset]:
    """What A2 names of several couplings, where they hold together: one alone contradicts the others."""
    offsets = [Offset(one, start.polycoef(one), Coefficients(one.index, new), why) for one, new, why, _ in named]
    if len(offsets) < 2:
        return []
    try:
        for one in offsets:
            require_room(bench.base.path, one.change)
    except InputError:
        return []
    kept, moved = run_closed(bench, [one.change for one in offsets]), run_closed(bench, [])
    return offsets if kept.drift <= max(bench.target, NAMED * moved.drift) else []


class _Start:
    """The couplings at the start, and at the keyframes of the file."""

    def __init__(self, bench: Bench):
        self._bench, self._exam = bench, bench.exam
        self._model = bench.base.model
        self._assembly = Assembly(self._model, bench.data(self._model))
        self._rows = {one.index: self._assembly.rows_of(place) for place, one in enumerate(self._assembly.equalities)}
        self._own = self._seen(self._exam.qpos)

    def couplings(self) -> Iterator[Equality]:
        """Joint and tendon equalities that are open by more than rounding, or written in another unit."""
        for one in self._assembly.equalities:
            if one.kind.holds not in ("joints", "tendons"):
                continue
            if self.opens(one) or self._in_another_unit(one, self.polycoef(one)) is not None:
                yield one

    def opens(self, one: Equality) -> bool:
        """Whether it is open at the start by more than rounding."""
        return abs(self._own.off[one.index]) > ROUNDED

    def polycoef(self, one: Equality) -> tuple[float, ...]:
        """As it is written."""
        return tuple(self._model.eq_data[one.index, :5].tolist())

    def written(self, one: Equality) -> tuple[tuple[float, ...], str, str]:
        """The polynomial that closes a coupling, what the file says for it, and against it."""
        off, given = self._own.off[one.index], self.polycoef(one)
        if not self.opens(one) and (unit := self._in_another_unit(one, given)) is not None:
            return unit
        wanted = (_short(given[0] + off), *given[1:])
        met, alike = list[str](), list[str]()
        for name, seen in self._elsewhere.items():
            drawn = given[0] == 0.0 and not np.any(seen.x[one.index])  # which is closed by definition
            if abs(seen.off[one.index]) <= ROUNDED and not drawn:
                met.append(name)
            elif abs(seen.off[one.index] - off) <= ALIKE * abs(off) and self._apart(one, seen):
                alike.append(name)
        if met:
            return wanted, "", f"keyframe {quoted(met[0])} meets it as it is written"
        own = source_key(self._model, self._bench.base.options.keyframe)
        if alike and len(alike) == len(self._elsewhere) - self._same(one) and own is not None:
            names = few([quoted(self._key(own)), *map(quoted, alike)])
            return wanted, f"keyframes {names} miss it by the same", ""
        unit = self._in_another_unit(one, given)
        return unit or (wanted, "", "")

    def holds_alike(self, one: Equality) -> str:
        """A coupling of the same sort and polynomial that holds at the start; empty where there is none."""
        for other in self._assembly.equalities:
            same = other.index != one.index and other.kind is one.kind
            if same and abs(self._own.off[other.index]) <= CONSISTENT and self.polycoef(other) == self.polycoef(one):
                return other.name
        return ""

    def _in_another_unit(self, one: Equality, given: tuple[float, ...]) -> tuple[tuple[float, ...], str, str] | None:
        for remark in (remark for every in self._exam.remarks.values() for remark in every):
            if remark.code == "A2" and remark.element == one.name and "wanted" in remark.figures:
                wanted = np.atleast_1d(remark.figures["wanted"]).tolist()
                polycoef = tuple(map(_short, wanted)) if len(wanted) > 1 else (_short(wanted[0]), *given[1:])
                return polycoef, UNIT, ""
        return None

    # Keyframes.

    @cached_property
    def _elsewhere(self) -> "dict[str, _Seen]":
        """The keyframes besides that of the start."""
        own = source_key(self._model, self._bench.base.options.keyframe)
        return {self._key(key): self._seen(self._model.key_qpos[key]) for key in range(self._model.nkey) if key != own}

    def _key(self, key: int) -> str:
        return element_name(self._model, mujoco.mjtObj.mjOBJ_KEY, key)

    def _seen(self, qpos: np.ndarray) -> "_Seen":
        self._assembly.place(qpos)
        residual, off, x = self._assembly.residual(), dict[int, float](), dict[int, np.ndarray]()
        for one in self._assembly.equalities:
            off[one.index] = float(np.abs(residual[self._rows[one.index]]).max(initial=0.0))
            if one.kind.holds in ("joints", "tendons"):
                off[one.index] = float(residual[self._rows[one.index]][0])
                ids = coupled_ids(self._model, one.index)
                places = [coupled(one.kind).position(self._model, self._assembly.data, index) for index in ids]
                x[one.index] = np.array(places) if len(ids) > 1 else qpos.copy()
        return _Seen(off, x)

    def _apart(self, one: Equality, seen: "_Seen") -> bool:
        """Whether a coupling is in another pose than at the start; of a single element, whether the model is."""
        distance = float(np.abs(seen.x[one.index] - self._own.x[one.index]).max(initial=0.0))
        return distance > APART * abs(self._own.off[one.index])

    def _same(self, one: Equality) -> int:
        """Keyframes that only repeat the start."""
        return sum(not self._apart(one, seen) for seen in self._elsewhere.values())


@dataclass(frozen=True)
class _Seen:
    """A pose: what each equality is off by, m or rad, and the x of what a coupling couples."""

    off: dict[int, float]
    x: dict[int, np.ndarray]


def _tried(bench: Bench, taken: Sequence[Constants], offset: Offset, alike: str) -> tuple[str, str]:
    """What speaks for a constant and against it once both ways were run, with others that were taken before."""
    why = offset.why
    if not why and closes_inside(bench, taken, offset.change):
        why = UNMET
    if not why and alike:
        return "", f"{quoted(alike)}, which has the same polycoef, holds at the start"
    lasts = any(one.equality == offset.equality.name and one.attribute == "polycoef" for one in bench.exam.lasting)
    if not why and not lasts:
        return "", "the closed pose holds the coupling as it is written"
    kept, moved = run_closed(bench, [*taken, offset.change]), run_closed(bench, taken)
    held = f"{drifts(kept)} with it, {drifts(moved)} with the closed pose instead"
    if not why:
        if moved.drift <= bench.target or kept.drift >= HALF * moved.drift:
            return "", held
        why = f"from the closed pose it is pulled open again (S4): {held}"
    if kept.drift > max(bench.target, (NAMED if why == UNIT else 1.0) * moved.drift):
        return "", held
    return why, ""


def _short(value: float) -> float:
    """The number of fewest digits that is the same but for ``WRITTEN``."""
    every = (0.0, *(float(f"{value:.{digits}g}") for digits in range(1, 18)))
    return next(number for number in every if abs(number - value) <= WRITTEN)
