"""The Sarrus linkage with two, three or more legs. SI units and radians, z is up."""

import mujoco
import numpy as np

LINK, WIDTH, LINK_MASS, PLATFORM_MASS = 0.5, 0.04, 1.0, 2.0
RADIUS, THICKNESS = 0.2, 0.04
START = 0.4
"""Angle of every lower link over the horizontal in the pose that the model is built in, which is its start."""
STIFFNESS, SPRING_ANGLE = 60.0, 1.0
"""Spring of every base hinge (N m/rad), and where it is at rest (rad)."""
HALF_HINGE = 0.1
"""Half the distance between the two points that hold a leg's hinge at the platform."""

LINK_COLOUR, PLATFORM_COLOUR, SITE_COLOUR = (0.25, 0.42, 0.66, 1), (0.6, 0.6, 0.6, 0.5), (0.85, 0.33, 0.25, 1)


def build(legs: int) -> mujoco.MjSpec:
    """A platform on legs of two links each, with parallel hinges within a leg.

    Args:
        legs: at least 2. They stand at equal angles, two at 120°: opposite ones would be in one plane.
    """
    if legs < 2:
        raise ValueError(f"legs = {legs}, expected at least 2: a single leg does not guide the platform")
    spec = mujoco.MjSpec()
    spec.modelname = "sarrus"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(0, 0, 3))
    platform = None
    for leg in range(legs):
        upper, axis = _leg(spec, f"leg{leg + 1}", 2 * np.pi * leg / max(legs, 3))
        if platform is None:
            platform = _platform(upper, axis)
            continue
        for side, offset in (("left", -HALF_HINGE), ("right", HALF_HINGE)):
            names = [f"leg{leg + 1}_{side}", f"platform{leg + 1}_{side}"]
            upper.add_site(name=names[0], pos=_towards(axis, -np.cos(START)) + offset * axis, **_SITE)
            platform.add_site(name=names[1], pos=RADIUS * _outward(axis) + offset * axis, **_SITE)
            spec.add_equality(
                name=names[0],
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=names[0],
                name2=names[1],
            )
    return spec


_SITE = {"size": (0.015, 0.015, 0.015), "rgba": SITE_COLOUR}
_GHOST = {"contype": 0, "conaffinity": 0}


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


def _leg(spec: mujoco.MjSpec, name: str, heading: float):
    """Lower and upper link. Gives the upper one, and the direction of the leg's hinges.

    A rotation about the hinges raises the lower link and lowers the upper one.
    """
    axis = np.array((np.sin(heading), -np.cos(heading), 0.0))
    out, back = _towards(axis, np.cos(START)), _towards(axis, -np.cos(START))
    lower = _link(spec.worldbody, f"{name}_lower", RADIUS * _outward(axis), axis, out)
    spring = {"stiffness": STIFFNESS, "springref": SPRING_ANGLE, "ref": START}
    lower.add_joint(name=f"{name}_base", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, **spring)
    upper = _link(lower, f"{name}_upper", out, axis, back)
    upper.add_joint(name=f"{name}_knee", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    return upper, axis


def _platform(upper, axis: np.ndarray):
    """The platform, on a hinge of the first leg."""
    platform = upper.add_body(name="platform", pos=_towards(axis, -np.cos(START)) - RADIUS * _outward(axis))
    platform.add_joint(name="platform", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, pos=RADIUS * _outward(axis))
    platform.add_geom(
        name="platform",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(RADIUS, THICKNESS / 2, 0),
        mass=PLATFORM_MASS,
        rgba=PLATFORM_COLOUR,
        **_GHOST,
    )
    return platform
