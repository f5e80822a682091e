"""A run without the contacts of some pairs of bodies, or of another model, to see what those do to the loops."""

import mujoco
import numpy as np

from oarlock.diagnosis.runs.drifts import Drift, drift_of
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rerun import rerun
from oarlock.diagnosis.runs.walking import own_copy

CLASSES = 31
"""Kinds of geoms at most that bits of a mask can tell apart, one a kind."""

NEVER = -1e6
"""m. Margin of an explicit pair at which it never touches."""

Pair = tuple[int, int]


def separated(model: mujoco.MjModel, pairs: set[Pair]) -> mujoco.MjModel | None:
    """A copy in which some pairs of bodies do not collide, and nothing else is different.

    A compiled model takes no more excludes. So geoms are put into classes that collide alike, and each gets a bit:
    contype says which class a geom is of, conaffinity with which classes it collides.

    Args:
        model: left alone.
        pairs: of bodies, by their numbers.

    Returns:
        None where there are more classes than bits.
    """
    own = own_copy(model)
    apart = {frozenset(pair) for pair in pairs}
    bodies = {body for pair in pairs for body in pair}
    keys = [
        (int(kind), int(affinity), int(body) if body in bodies else -1)
        for kind, affinity, body in zip(model.geom_contype, model.geom_conaffinity, model.geom_bodyid, strict=True)
    ]
    classes = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    if len(classes) > CLASSES:
        return None
    for geom, key in enumerate(keys):
        own.geom_contype[geom] = 1 << classes[key]
        own.geom_conaffinity[geom] = sum(
            1 << number
            for other, number in classes.items()
            if (key[0] & other[1] or other[0] & key[1]) and frozenset((key[2], other[2])) not in apart
        )
    for body in range(model.nbody):
        start, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        mine = slice(start, start + count) if count else slice(0, 0)
        own.body_contype[body] = np.bitwise_or.reduce(own.geom_contype[mine], initial=0)
        own.body_conaffinity[body] = np.bitwise_or.reduce(own.geom_conaffinity[mine], initial=0)
    for pair in range(model.npair):
        ends = (int(model.geom_bodyid[geom]) for geom in (model.pair_geom1[pair], model.pair_geom2[pair]))
        if frozenset(ends) in apart:
            own.pair_margin[pair] = NEVER
    return own


def drifts_without(recording: Recording, pairs: set[Pair]) -> dict[str, Drift]:
    """How far each equality opens in the same run without the contacts of some pairs of bodies.

    Args:
        recording: MuJoCo's run as configured.
        pairs: of bodies, by their numbers.

    Returns:
        Equality → its drift; empty where they cannot be told apart by masks, or the run does not stay finite.
    """
    model = separated(recording.model, pairs)
    again = rerun(recording, model) if model is not None else None
    if model is None or again is None:
        return {}
    return {
        one.name: drift_of(model, recording.layout, place, again.position, recording.time)
        for place, one in enumerate(recording.layout.equalities)
    }
