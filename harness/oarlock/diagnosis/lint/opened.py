"""S1, as far as one look at the start tells: how far the equalities stand open there, and how fast they come apart."""

from collections.abc import Iterator, Sequence

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.gaps import Opening, openings_of
from oarlock.stepping.closing import CONSISTENT

ROUNDED = 1e-5
"""m or rad, and per s: what six digits of a file leave open in a mechanism of some metres. No user's mistake."""


def look(view: View) -> Iterator[Remark]:
    """One remark, where no closed pose was looked for: a check has more to say of it."""
    if not view.equalities or view.posed:
        return
    assembly = view.given
    openings = openings_of(assembly, assembly.residual())
    speeds = openings_of(assembly, assembly.jacobian() @ view.data.qvel, rates=True)
    if max(one.largest for one in (*openings, *speeds)) > CONSISTENT:
        yield of(openings, speeds)


def of(openings: Sequence[Opening], speeds: Sequence[Opening], more: Sequence[str] = ()) -> Remark:
    """What is said of a start that is not consistent, by the equality that is furthest open.

    Args:
        openings: of all active equalities.
        speeds: the same of their rates.
        more: what else is known of the opening.
    """
    worst = max(openings, key=lambda one: one.largest)
    fastest = max(speeds, key=lambda one: one.largest)
    element, said = fastest.equality, []
    if worst.largest > CONSISTENT:
        element = worst.equality
        said = [f"stands open by {worst} at the start", *more]
    if fastest.largest > CONSISTENT:
        whose = "" if fastest.equality == element else f"{quoted(fastest.equality)} "
        said.append(f"{whose}comes apart at {fastest.told('/s')} at the start")
    size = max(worst.largest, fastest.largest)
    if size <= ROUNDED:
        said.append("as a file of six digits leaves it")
    figures = {"opening": worst.largest, "speed": fastest.largest}
    return Remark("S1", "; ".join(said), element, "note" if size <= ROUNDED else None, figures)
