"""The Sarrus linkage with two, three or more legs, one or many. SI units and radians, z is up.

Many stand on one another, each on the platform of the one below, so that all are one kinematic tree; or apart on the
ground, where every leg and every platform is a tree of its own.
"""

import mujoco
import numpy as np

LINK, WIDTH, LINK_MASS, PLATFORM_MASS = 0.5, 0.04, 1.0, 2.0
RADIUS, THICKNESS = 0.2, 0.04
START = 0.4
"""Angle of every lower link over the horizontal in the pose that the model is built in, which is its start."""
STIFFNESS, SPRING_ANGLE = 60.0, 1.0
"""Spring of a base hinge (N m/rad) for each linkage that it carries, and where it is at rest (rad)."""
ROOM = 2.0
"""Between the middles of linkages that stand apart (m)."""
HALF_HINGE = 0.1
"""Half the distance between the two points that hold a leg's hinge at the platform."""

LINK_COLOUR, PLATFORM_COLOUR, SITE_COLOUR = (0.25, 0.42, 0.66, 1), (0.6, 0.6, 0.6, 0.5), (0.85, 0.33, 0.25, 1)


def build(legs: int, cells: int, apart: int) -> mujoco.MjSpec:
    """Platforms on legs of two links each, with parallel hinges within a leg.

    Args:
        legs: of a linkage, at least 2. They stand at equal angles, two at 120°: opposite ones would be in one plane.
        cells: number of linkages.
        apart: 0: each stands on the one before, and its platform hangs on its first leg; 1: all stand on the ground,
            and platforms float until equalities hold them.
    """
    if legs < 2:
        raise ValueError(f"legs = {legs}, expected at least 2: a single leg does not guide the platform")
    if cells < 1:
        raise ValueError(f"cells = {cells}, expected at least 1")
    if apart not in (0, 1):
        raise ValueError(f"apart = {apart}, expected 0 or 1")
    spec = mujoco.MjSpec()
    spec.modelname = "sarrus"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(0, 0, 3))
    ground = spec.worldbody
    for cell in range(cells):
        name = f"cell{cell + 1}_" if cell else ""
        if apart:
            _cell(spec, spec.worldbody, name, legs, np.array((cell * ROOM, 0, 0)), floating=True, carried=1)
        else:
            ground = _cell(spec, ground, name, legs, np.zeros(3), floating=False, carried=cells - cell)
    return spec


def _cell(spec: mujoco.MjSpec, ground, name: str, legs: int, middle: np.ndarray, *, floating: bool, carried: int):
    """One linkage around a point of a body, its ground. Gives its platform."""
    platform = _platform(ground, name, middle + _height()) if floating else None
    for leg in range(legs):
        upper, axis = _leg(ground, f"{name}leg{leg + 1}", 2 * np.pi * leg / max(legs, 3), middle, carried * STIFFNESS)
        if platform is None:
            platform = _platform(upper, name, _towards(axis, -np.cos(START)) - RADIUS * _outward(axis), axis)
            continue
        for side, offset in (("left", -HALF_HINGE), ("right", HALF_HINGE)):
            names = [f"{name}leg{leg + 1}_{side}", f"{name}platform{leg + 1}_{side}"]
            upper.add_site(name=names[0], pos=_towards(axis, -np.cos(START)) + offset * axis, **_SITE)
            platform.add_site(name=names[1], pos=RADIUS * _outward(axis) + offset * axis, **_SITE)
            spec.add_equality(
                name=names[0],
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=names[0],
                name2=names[1],
            )
    return platform


_SITE = {"size": (0.015, 0.015, 0.015), "rgba": SITE_COLOUR}
_GHOST = {"contype": 0, "conaffinity": 0}


def _height() -> np.ndarray:
    """From the middle of a linkage to that of its platform at the start (m)."""
    return np.array((0, 0, 2 * LINK * np.sin(START)))


def _outward(axis: np.ndarray) -> np.ndarray:
    """Horizontal direction away from the middle, for a leg with hinges about ``axis``."""
    return np.cross((0, 0, 1), axis)


def _towards(axis: np.ndarray, outward: float) -> np.ndarray:
    """Along a link at the start (m); ``outward`` is ± cos of its angle."""
    return LINK * (outward * _outward(axis) + np.sin(START) * np.array((0, 0, 1)))


def _link(parent, name: str, pos, axis: np.ndarray, direction: np.ndarray):
    body = parent.add_body(name=name, pos=pos)
    frame = np.column_stack((direction / LINK, axis, np.cross(direction / LINK, axis)))
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, frame.ravel())
    size = (LINK / 2, WIDTH / 2, WIDTH / 2)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=size,
        pos=direction / 2,
        quat=quat,
        mass=LINK_MASS,
        rgba=LINK_COLOUR,
        **_GHOST,
    )
    return body


def _leg(ground, name: str, heading: float, middle: np.ndarray, stiffness: float):
    """Lower and upper link. Gives the upper one, and the direction of the leg's hinges.

    A rotation about the hinges raises the lower link and lowers the upper one.
    """
    axis = np.array((np.sin(heading), -np.cos(heading), 0.0))
    out, back = _towards(axis, np.cos(START)), _towards(axis, -np.cos(START))
    lower = _link(ground, f"{name}_lower", middle + RADIUS * _outward(axis), axis, out)
    spring = {"stiffness": stiffness, "springref": SPRING_ANGLE, "ref": START}
    lower.add_joint(name=f"{name}_base", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, **spring)
    upper = _link(lower, f"{name}_upper", out, axis, back)
    upper.add_joint(name=f"{name}_knee", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    return upper, axis


def _platform(parent, name: str, pos: np.ndarray, axis: np.ndarray | None = None):
    """A platform, on a hinge of a leg, or free where there is no such axis."""
    platform = parent.add_body(name=f"{name}platform", pos=pos)
    if axis is None:
        platform.add_freejoint(name=f"{name}platform")
    else:
        hinge = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": axis, "pos": RADIUS * _outward(axis)}
        platform.add_joint(name=f"{name}platform", **hinge)
    platform.add_geom(
        name=f"{name}platform",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(RADIUS, THICKNESS / 2, 0),
        mass=PLATFORM_MASS,
        rgba=PLATFORM_COLOUR,
        **_GHOST,
    )
    return platform
