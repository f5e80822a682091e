"""Why an engine's answer differs: the difference vanishes when the cause is taken out of our own solution.

Laws are tried in the order of how little they change. The first under which every state agrees, within what the
engine's precision explains, is the cause; nothing is looked up by the name of an engine. Where none is, the difference
is unexplained, and the nearest law is named.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.base.numbers import short
from oarlock.base.text import quoted
from oarlock.conformance.laws import CONES, EXACT, MUJOCO, Law, Laws, apart, scale
from oarlock.conformance.precision import allowance
from oarlock.engines.answers import Answer

AGREES, UNEXPLAINED, READER, FAILED, SILENT = "agrees", "unexplained", "reader", "failed", "not expressible"

FIRST = 6
"""States that a law is tried on before all are: most laws fail at once."""

NEARLY = 1e-5
"""Relative. So near to a law answers are told by it, with what is left beyond what their precision explains."""

MASS_APART = 1e-6
"""Relative difference of masses that is none: of a mass in single precision, read from a text of six digits."""


FORMS = (MUJOCO, EXACT, Law(curvature=False), Law(rigid=True, curvature=False))
"""Laws that change no element, those with fewer changes first."""

TELLING = 10.0
"""Times: a law that leaves so much less than a simpler one is the cause, though the precision would explain both."""

ROUNDING = 1e-10
"""Relative. A law that leaves no more than that needs no better one."""


@dataclass(frozen=True)
class Cause:
    """What explains an engine's answers.

    Attributes:
        name: causes joined by ``+``: ``agrees``, ``exact``, ``jdotv``, ``rows``, ``cone``, ``mass``, ``compiled``,
            ``float32``, ``residue`` (a little is left), ``history`` (asked once more it answers otherwise); or
            ``unexplained``, ``reader``, ``not expressible``, ``failed``.
        text: in words.
        left: largest relative difference of q̈ that is left once the cause is taken out; None where nothing is compared.
        allowed: the largest of what the precision explains; None likewise.
        law: under which the states agree; None where there is none.
    """

    name: str
    text: str
    left: float | None = None
    allowed: float | None = None
    law: Law | None = None

    def document(self) -> dict[str, Any]:
        """For JSON."""
        contradicted = self.name == UNEXPLAINED and self.law is not None
        told = {"cause": self.name, "verdict": self.text, "left": self.left, "allowed": self.allowed}
        return {**told, "contradicted": contradicted}


def is_single(answer: Answer) -> bool:
    """Whether every number of the accelerations is one of single precision: that is measured, whatever it says."""
    values = answer.qacc
    return bool(values.size and np.abs(values).max() > 0.0 and np.array_equal(values, values.astype(np.float32)))


def tell(laws: Laws, answer: Answer) -> Cause:
    """Tells the cause of an answer to the states, and whether it depends on what was asked before."""
    single = is_single(answer)
    allowed = allowance(laws, laws.solve(MUJOCO), single)
    cause = _tell(laws, answer, allowed, single)
    again = answer.qacc_again
    if again is None or not (apart(again, replace(laws.solve(MUJOCO), qacc=answer.qacc)) > allowed).any():
        return cause
    other = _tell(laws, replace(answer, qacc=again), allowed, single)
    return replace(cause, name=f"{cause.name}+history", text=f"{cause.text}; asked once more: {other.text}")


def _tell(laws: Laws, answer: Answer, allowed: np.ndarray, single: bool) -> Cause:
    first, sizes = np.arange(min(FIRST, len(laws.states))), scale(laws.solve(MUJOCO))
    trusted = np.maximum(allowed, NEARLY)
    nearest: tuple[float, Law] | None = None
    nearly: tuple[float, Law] | None = None
    for law in candidates(laws, answer):
        try:
            part = apart(answer.qacc[first], laws.solve(law, first), sizes[first])
        except InputError:
            continue
        left = apart(answer.qacc, laws.solve(law), sizes) if (part <= trusted[first]).all() else part
        worst = float(left.max())
        if len(left) == len(sizes) and (left <= allowed).all():
            return _likeliest(laws, answer, law, left, allowed, single)
        if len(left) == len(sizes) and (left <= trusted).all() and (nearly is None or worst < nearly[0]):
            nearly = worst, law
        if nearest is None or worst < nearest[0]:
            nearest = worst, law
    assert nearest is not None
    if nearly is not None:
        cause = _explained(nearly[1], np.array([nearly[0]]), allowed, single)
        return replace(cause, name=f"{cause.name}+residue", text=f"{cause.text}, but for {short(nearly[0])}")
    difference, law = nearest
    under = words(law) or "our own solution as it is"
    said = f"unexplained: {short(difference)} is left even {under if under.startswith('without') else f'with {under}'}"
    return Cause(UNEXPLAINED, said, difference, float(allowed.max()))


def _likeliest(laws: Laws, answer: Answer, law: Law, left: np.ndarray, allowed: np.ndarray, single: bool) -> Cause:
    """Of a law and others that change as much of what is known beforehand, the one that leaves far less.

    What a precision explains may be more than what a cause changes: then it is told that the states do not tell them
    apart.
    """
    sizes = scale(laws.solve(MUJOCO))
    found, worst, untold = law, float(left.max()), list[str]()
    for other in FORMS:
        if law not in FORMS or other == law:
            continue
        others = apart(answer.qacc, laws.solve(other), sizes)
        if not (others <= allowed).all():
            continue
        if float(others.max()) < worst / TELLING and worst > ROUNDING:
            found, worst, left = other, float(others.max()), others
        elif single:
            untold.append(words(other) or "as MuJoCo")
    cause = _explained(found, left, allowed, single)
    if found is not law:
        untold = [one for one in untold if one != words(found)]
    elif untold:
        cause = replace(cause, text=f"{cause.text}, which does not tell it from {few(untold, last='or')}")
    return cause


def _explained(law: Law, left: np.ndarray, allowed: np.ndarray, single: bool) -> Cause:
    names = [name for name, changed in _changes(law).items() if changed] or [AGREES]
    text = words(law) or "as MuJoCo"
    if single:
        names.append("float32")
        text += ", within float32"
    return Cause("+".join(names), text, float(left.max()), float(allowed.max()), law)


def _changes(law: Law) -> dict[str, bool]:
    return {
        "exact": law.rigid,
        "jdotv": not law.curvature,
        "rows": bool(law.without),
        "cone": bool(law.cone),
        "mass": bool(law.masses),
        "compiled": bool(law.arrays),
    }


def words(law: Law) -> str:
    """How a law differs from MuJoCo's; empty if it does not."""
    said = []
    if law.rigid:
        said.append("exact rows, no softness")
    if not law.curvature:
        said.append("no J̇v")
    if law.without:
        said.append(f"without {few([quoted(name) for name in law.without])}")
    if law.cone:
        said.append(f"{law.cone} friction cone")
    if law.arrays:
        said.append(f"{few([name for name, _ in law.arrays])} compiled otherwise")
    if law.masses:
        said.append(f"other mass of {few([quoted(name) for name, _ in law.masses])}")
    return ", ".join(said)


def candidates(laws: Laws, answer: Answer) -> Iterator[Law]:
    """The laws that are tried, those with fewer changes first."""
    yield from FORMS
    changes: list[dict[str, Any]] = []
    own_cone = int(laws.model.opt.cone)
    changes += [{"cone": name} for name, cone in CONES.items() if int(cone) != own_cone]
    masses = other_masses(laws, answer)
    changes += [{"arrays": arrays} for arrays in _other_arrays(answer)]
    changes += [{"masses": masses}] if masses else []
    changes += [{"without": names} for names in _left_out(laws, answer)]
    for change in changes:
        for form in FORMS:
            yield replace(form, **change)
    if masses:
        for names in _left_out(laws, answer):
            for form in FORMS:
                yield replace(form, masses=masses, without=names)


def other_masses(laws: Laws, answer: Answer) -> tuple[tuple[str, float], ...]:
    """Bodies of which the engine says that they have another mass: (name, kg)."""
    told = answer.facts.get("body_masses")
    if not isinstance(told, dict):
        return ()
    own = laws.masses()
    pairs = ((name, own[name], float(mass)) for name, mass in told.items() if name in own)
    return tuple((name, mass) for name, true, mass in pairs if abs(mass - true) > MASS_APART * max(true, MASS_APART))


def _other_arrays(answer: Answer) -> list[tuple[tuple[str, tuple[float, ...]], ...]]:
    """Arrays that the engine's compiler made otherwise, as it says: each alone, and all."""
    told = answer.facts.get("compiled_apart")
    if not isinstance(told, dict) or not told:
        return []
    pairs = [(name, tuple(map(float, values))) for name, values in told.items() if isinstance(values, list)]
    return [*((pair,) for pair in pairs), *([tuple(pairs)] if len(pairs) > 1 else [])]


def _left_out(laws: Laws, answer: Answer) -> list[tuple[str, ...]]:
    """Sets of equalities that may have been left out: those it says, single ones, those of a kind, all."""
    names = [one.name for one in laws.equalities]
    told = [one["element"] for one in answer.not_expressible]
    said = tuple(name for name in names if any(f"'{name}'" in element for element in told))
    kept = answer.facts.get("equalities")
    unkept = tuple(name for name in names if name not in kept) if isinstance(kept, list) else ()
    kinds = dict.fromkeys(one.kind.name for one in laws.equalities)
    of_kind = [tuple(one.name for one in laws.equalities if one.kind.name == kind) for kind in kinds]
    sets = [said, unkept, *((name,) for name in names), *of_kind, tuple(names)]
    return list(dict.fromkeys(one for one in sets if one))


def tell_reader(laws: Laws, answer: Answer, rows: int) -> Cause:
    """Tells what a reader lost, from the facts of an engine that is asked about no state."""
    said = []
    own, told = sum(laws.masses().values()), answer.facts.get("total_mass")
    names = []
    other = other_masses(laws, answer)
    if (isinstance(told, int | float) and abs(told - own) > MASS_APART * own) or other:
        lost = few([quoted(name) for name, _ in other])
        whole = f"mass {short(float(told))} kg of {short(own)} kg" if isinstance(told, int | float) else "other masses"
        said.append(whole + (f" ({lost})" if lost else ""))
        names.append("mass")
    kept = answer.facts.get("rows")
    named = answer.facts.get("equalities")
    gone = [one.name for one in laws.equalities if isinstance(named, list) and one.name not in named]
    if isinstance(kept, int) and kept != rows:
        said.append(f"{kept} of {rows} equality rows kept")
        names.append("rows")
    elif gone:
        said.append(f"equalities without {few([quoted(name) for name in gone])}")
        names.append("rows")
    told_all = isinstance(told, int | float) and isinstance(kept, int)
    text = "; ".join(said) or ("its reader keeps masses and rows" if told_all else "its reader tells nothing")
    return Cause("+".join(["reader", *names]), f"on import: {text}" if said else text)
