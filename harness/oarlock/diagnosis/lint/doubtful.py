"""L8: a rank that hangs on a small number, with the axes that are off by about as much."""

from collections.abc import Iterator

from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.loops.rank import CUT, NEAR


def look(view: View) -> Iterator[Remark]:
    """A remark a group of loops."""
    if not view.equalities or not view.loops.closed:
        return
    for group in view.loops.groups:
        spectrum = group.spectrum
        if not spectrum.doubtful:
            continue
        small = spectrum.dropped > CUT / NEAR
        what, value = ("zero", spectrum.dropped) if small else ("one that counts", spectrum.kept)
        said = f"rank {group.rank} takes a singular value of {value:.2g} of the largest for {what}"
        tilts = [
            f"the axis of {quoted(one.joint)} is tilted by {one.radians:.3g} rad"
            for one in view.tilts({*group.equalities})
        ]
        names = group.equalities
        figures = {"also": list(names[1:]), "singular_value": value}
        yield Remark("L8", "; ".join([*tilts, said]), names[0], figures=figures)
