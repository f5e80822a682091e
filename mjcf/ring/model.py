"""A closed ring of bodies in free flight, on ball joints or hinges. SI units and radians."""

from itertools import pairwise

import mujoco
import numpy as np

LENGTH, MASS, SECTION = 0.4, 1.0, (0.04, 0.08)
SPIN, FOLD, ROLL = 2.0, 1.5, 1.0
"""Start (rad/s): of the whole ring about z; of bodies about the radius, alternately; of bodies about themselves."""

_SITE = {"size": (0.03, 0.03, 0.03), "rgba": (0.85, 0.33, 0.25, 1)}
_END = (LENGTH, 0, 0)


def build(bodies: int, planar: int, apart: int) -> mujoco.MjSpec:
    """A regular polygon in the plane z = 0, its centre of mass at rest in the origin.

    Args:
        bodies: at least 3; in a plane at least 4, for a triangle is rigid.
        planar: 0: on ball joints, in space; 1: on hinges, in the plane.
        apart: 0: each body hangs on the one before, and one connect closes the ring; 1: every body is on its own, and
            a connect ties it to the one before.
    """
    for name, value in (("planar", planar), ("apart", apart)):
        if value not in (0, 1):
            raise ValueError(f"{name} = {value}, expected 0 or 1")
    least = 4 if planar else 3
    if bodies < least:
        raise ValueError(f"bodies = {bodies}, expected at least {least}")
    spec = mujoco.MjSpec()
    spec.modelname = "ring"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.gravity = (0, 0, 0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(0, 0, 3))

    corners, headings = _polygon(bodies)
    chain: list[mujoco.MjsBody] = []
    for index in range(bodies):
        if index and not apart:
            body = chain[-1].add_body(name=f"body{index + 1}", pos=_END, quat=_about_z(2 * np.pi / bodies))
            kind = mujoco.mjtJoint.mjJNT_HINGE if planar else mujoco.mjtJoint.mjJNT_BALL
            body.add_joint(name=f"joint{index + 1}", type=kind)
        else:
            body = spec.worldbody.add_body(name=f"body{index + 1}", pos=corners[index], quat=_about_z(headings[index]))
            _set_free(body, f"free{index + 1}" if apart else "free", planar, headings[index])
        body.add_geom(
            name=f"body{index + 1}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=(LENGTH / 2, SECTION[0] / 2, SECTION[1] / 2),
            pos=(LENGTH / 2, 0, 0),
            mass=MASS,
            contype=0,
            conaffinity=0,
            rgba=(0.25, 0.42, 0.66, 1) if index % 2 else (0.80, 0.52, 0.25, 1),
        )
        chain.append(body)
    if apart:
        for before, after in pairwise(chain):
            _tie(spec, before, after, f"{before.name}_end", f"{after.name}_begin", f"tie_{before.name}")
    _tie(spec, chain[-1], chain[0], "last_end", "first_end", "closing")

    pieces = bodies if apart else 1
    pose = [_pose(corners[index], headings[index], planar) for index in range(pieces)]
    if not apart:
        pose.append(np.zeros(bodies - 1) if planar else np.tile((1.0, 0, 0, 0), bodies - 1))
    velocity = _start_velocity(bodies, planar, apart)
    spec.add_key(name="start", qpos=np.concatenate(pose), qvel=velocity)
    return spec


def _polygon(bodies: int) -> tuple[np.ndarray, np.ndarray]:
    """Where each body begins, (n, 3), and its heading, (n)."""
    turn = 2 * np.pi / bodies
    radius = LENGTH / (2 * np.sin(turn / 2))
    around = turn * (np.arange(bodies) - 0.5)
    corners = radius * np.column_stack((np.cos(around), np.sin(around), np.zeros(bodies)))
    return corners, np.pi / 2 + turn * np.arange(bodies)


def _set_free(body: mujoco.MjsBody, name: str, planar: int, heading: float) -> None:
    """Lets a body go: anywhere, or in the plane by two slides along the world's axes and a hinge."""
    if not planar:
        body.add_freejoint(name=name)
        return
    for axis, local in (("x", -heading), ("y", np.pi / 2 - heading)):  # axes are the body's own
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        body.add_joint(name=f"{name}_{axis}", type=slide, axis=(np.cos(local), np.sin(local), 0))
    body.add_joint(name=f"{name}_turn", type=mujoco.mjtJoint.mjJNT_HINGE)


def _tie(spec: mujoco.MjSpec, before: mujoco.MjsBody, after: mujoco.MjsBody, end: str, begin: str, name: str) -> None:
    before.add_site(name=end, pos=_END, **_SITE)
    after.add_site(name=begin, **_SITE)
    sites = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "name1": end, "name2": begin}
    spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_CONNECT, **sites)


def _about_z(angle: float) -> np.ndarray:
    return np.array((np.cos(angle / 2), 0, 0, np.sin(angle / 2)))


def _pose(corner: np.ndarray, heading: float, planar: int) -> np.ndarray:
    """Coordinates of a free body; those of a planar one count from where it was put."""
    return np.zeros(3) if planar else np.concatenate((corner, _about_z(heading)))


def _start_velocity(bodies: int, planar: int, apart: int) -> np.ndarray:
    """Velocities that keep the ring closed: what the parts of ω make of the bodies' lengths cancels around it."""
    _, headings = _polygon(bodies)
    along = np.column_stack((np.cos(headings), np.sin(headings), np.zeros(bodies)))
    outward = np.column_stack((np.sin(headings), -np.cos(headings), np.zeros(bodies)))
    phase = 2 * np.pi / bodies * np.arange(bodies)
    if planar:
        omega = np.outer(SPIN + FOLD * np.cos(2 * phase), (0.0, 0, 1))
    else:
        omega = SPIN * np.array((0, 0, 1)) + FOLD * np.cos(2 * phase)[:, None] * outward
        omega += ROLL * np.cos(phase)[:, None] * along
    sweep = np.cross(omega, LENGTH * along)
    places = np.cumsum(sweep, axis=0) - sweep  # of where each body begins, beside the first
    begins = places - np.mean(places + sweep / 2, axis=0)
    relative = omega if apart else np.diff(omega, axis=0, prepend=0.0)
    if planar:
        turns = relative[:, 2]
        return np.column_stack((begins[:, :2], turns)).ravel() if apart else np.concatenate((begins[0, :2], turns))
    frames = np.stack((along, -outward, np.tile((0.0, 0, 1), (bodies, 1))), axis=1)
    own = np.einsum("nij,nj->ni", frames, relative)
    return np.column_stack((begins, own)).ravel() if apart else np.concatenate((begins[0], own.ravel()))
