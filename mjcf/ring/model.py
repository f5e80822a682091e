"""A closed ring of bodies on ball joints, in free flight. SI units and radians."""

import mujoco
import numpy as np

LENGTH, MASS, SECTION = 0.4, 1.0, (0.04, 0.08)
SPIN, FOLD, ROLL = 2.0, 1.5, 1.0
"""Start (rad/s): of the whole ring about z; of bodies about the radius, alternately; of bodies about themselves."""


def build(bodies: int) -> mujoco.MjSpec:
    """A regular polygon in the plane z = 0, its centre of mass at rest in the origin.

    Args:
        bodies: at least 3.
    """
    if bodies < 3:
        raise ValueError(f"bodies = {bodies}, expected at least 3")
    spec = mujoco.MjSpec()
    spec.modelname = "ring"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.gravity = (0, 0, 0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(0, 0, 3))

    turn = 2 * np.pi / bodies
    radius = LENGTH / (2 * np.sin(turn / 2))
    corner = {"pos": (radius * np.cos(turn / 2), -radius * np.sin(turn / 2), 0), "quat": _about_z(np.pi / 2)}
    parent = spec.worldbody
    for index in range(bodies):
        place = corner if index == 0 else {"pos": (LENGTH, 0, 0), "quat": _about_z(turn)}
        parent = parent.add_body(name=f"body{index + 1}", **place)
        kind = mujoco.mjtJoint.mjJNT_BALL if index else mujoco.mjtJoint.mjJNT_FREE
        parent.add_joint(name=f"joint{index + 1}" if index else "free", type=kind)
        parent.add_geom(
            name=f"body{index + 1}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(LENGTH / 2, SECTION[0] / 2, SECTION[1] / 2),
            pos=(LENGTH / 2, 0, 0),
            mass=MASS,
            contype=0,
            conaffinity=0,
            rgba=(0.25, 0.42, 0.66, 1) if index % 2 else (0.80, 0.52, 0.25, 1),
        )
    site = {"size": (0.03, 0.03, 0.03), "rgba": (0.85, 0.33, 0.25, 1)}
    spec.body("body1").add_site(name="first_end", **site)
    parent.add_site(name="last_end", pos=(LENGTH, 0, 0), **site)
    spec.add_equality(
        name="closing",
        type=mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="last_end",
        name2="first_end",
    )
    spec.add_key(name="start", qpos=_start_pose(bodies, corner), qvel=_start_velocity(bodies, corner["pos"]))
    return spec


def _about_z(angle: float) -> np.ndarray:
    return np.array((np.cos(angle / 2), 0, 0, np.sin(angle / 2)))


def _start_pose(bodies: int, corner: dict) -> np.ndarray:
    return np.concatenate((corner["pos"], corner["quat"], np.tile((1.0, 0, 0, 0), bodies - 1)))


def _start_velocity(bodies: int, corner) -> np.ndarray:
    """Velocities that keep the ring closed: what the parts of ω make of the bodies' lengths cancels around it."""
    headings = np.pi / 2 + 2 * np.pi / bodies * np.arange(bodies)
    along = np.column_stack((np.cos(headings), np.sin(headings), np.zeros(bodies)))
    outward = np.column_stack((np.sin(headings), -np.cos(headings), np.zeros(bodies)))
    phase = 2 * np.pi / bodies * np.arange(bodies)
    omega = SPIN * np.array((0, 0, 1)) + FOLD * np.cos(2 * phase)[:, None] * outward
    omega += ROLL * np.cos(phase)[:, None] * along
    sweep = np.cross(omega, LENGTH * along)
    centre = np.mean(np.cumsum(sweep, axis=0) - sweep / 2, axis=0)
    frames = np.stack((along, -outward, np.tile((0.0, 0, 1), (bodies, 1))), axis=1)
    relative = np.diff(omega, axis=0, prepend=0.0)
    return np.concatenate((-centre, np.einsum("nij,nj->ni", frames, relative).ravel()))
