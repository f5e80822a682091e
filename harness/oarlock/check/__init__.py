"""``oarlock check``: why a loop comes apart, and what would hold it.

The parts, in the order that data flows:

- ``examination`` loads a model and looks at it, part by part, with
- ``loops``, ``uniqueness`` and ``events``: what closes what, ranks, unique reactions, and where they change;
- ``poses``: the nearest consistent start, or who stands in its way;
- ``recording``, ``exact`` and ``drifts``: MuJoCo's own run and the exact one;
- ``row_law``: the drift by cause; ``stability`` and ``prediction``: what other settings would do;
- ``recipe`` and ``trials``: what would hold it, tried; ``wrenches``: the forces.
- ``verdicts`` makes ``findings`` of it, ``document`` data, ``page`` a report, ``checked`` what a notebook sees.
"""

from oarlock.check.checked import Checked, check

__all__ = ["Checked", "check"]
