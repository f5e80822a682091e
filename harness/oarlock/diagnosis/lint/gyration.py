"""A2: an inertia that no body of its size and mass has.

CAD programs give moments of inertia in kg mm² or kg cm² as often as in kg m².
"""

import math
from collections.abc import Iterator

import numpy as np

from oarlock.base.errors import few
from oarlock.diagnosis.lint.view import Remark, View, told

MOST = 10.0
"""Radius of gyration, of the distance from the centre of mass to the end of the body. Of a solid body it is below 1."""

UNITS = {"kg mm²": 1e-6, "kg cm²": 1e-4}
"""In kg m²."""

SOLID = (0.15, 1.5)
"""Radius of gyration of a body, of the same distance: a ball has 0.63, a rod 0.58, a ring 1."""


def look(view: View) -> Iterator[Remark]:
    """One remark, with all the bodies of which it is true."""
    model, found = view.model, []
    for body in np.flatnonzero(model.body_weldid):
        mass, inertia = float(model.body_mass[body]), float(model.body_inertia[body].max())
        reach = _reach(view, int(body))
        if mass <= 0.0 or reach <= 0.0:
            continue
        radius = math.sqrt(inertia / mass)
        if radius > MOST * reach:
            found.append((int(body), inertia, mass, radius, reach))
    if not found:
        return
    body, inertia, mass, radius, reach = found[0]
    fits = (
        f"{unit} were meant? times {factor:g} it is {told(radius * math.sqrt(factor))} m"
        for unit, factor in UNITS.items()
        if SOLID[0] * reach < radius * math.sqrt(factor) < SOLID[1] * reach
    )
    names = [view.body(one) for one, *_ in found]
    others = f"; the same of {few([repr(name) for name in names[1:]])}" if names[1:] else ""
    said = (
        f"inertia {told(inertia)} kg m² of {told(mass)} kg is a radius of gyration of {told(radius)} m, and the body "
        f"ends {told(reach)} m from its centre of mass: {next(fits, 'another unit was meant?')}{others}"
    )
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, [one for one, *_ in found]))
    figures = {"also": names[1:], "radius": radius, "loops": view.around(joints.tolist())}
    yield Remark("A2", said, names[0], figures=figures)


def _reach(view: View, body: int) -> float:
    """From the centre of mass of a body to the end of what is drawn of it, or to where it holds others, m."""
    model, data = view.model, view.data
    centre, welded = data.xipos[body], model.body_weldid == model.body_weldid[body]
    geoms = view.geoms_of(body)
    places = [*data.xpos[welded | welded[model.body_parentid]], *data.xanchor[welded[model.jnt_bodyid]]]
    ends = [float(np.linalg.norm(place - centre)) for place in places]
    drawn = np.linalg.norm(data.geom_xpos[geoms] - centre, axis=1) + model.geom_rbound[geoms]
    return max([*ends, *drawn.tolist()], default=0.0)
