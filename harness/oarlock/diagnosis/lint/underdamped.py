"""T6: rows whose spring has hardly a damper."""

import math
from collections.abc import Iterator

from oarlock.diagnosis.lint.view import Remark, View
from oarlock.diagnosis.runs.stability import stability

DAMPED = 0.3
"""ζ from which a row comes to rest within some oscillations: below it a row rings. solref="2h 0.5" has 0.5."""

FADED = 0.01
"""Of a deviation: a row that has less left has come to rest."""


def look(view: View) -> Iterator[Remark]:
    """A remark an equality."""
    for one in stability(view.model):
        spring, damping = one.settings.spring, one.settings.damping
        if not one.stable or spring <= 0.0:
            continue  # one that grows is T2
        zeta = damping / (2.0 * math.sqrt(spring))
        if zeta >= DAMPED:
            continue
        hertz = math.sqrt(spring * (1.0 - zeta * zeta)) / (2.0 * math.pi)
        rings = math.log(1.0 / FADED) / (0.5 * damping) if damping > 0.0 else math.inf
        lasts = f"for {rings:.2g} s until a hundredth is left" if math.isfinite(rings) else "without end"
        given = " ".join(f"{number:g}" for number in one.settings.given)
        said = f"solref {given} is a damping ratio of {zeta:.2g}: after a push it rings at {hertz:.3g} Hz {lasts}"
        figures = {"zeta": zeta, "hertz": hertz, "rings_s": rings if math.isfinite(rings) else None}
        yield Remark("T6", said, one.name, figures=figures)
