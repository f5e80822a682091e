"""K equal parallel cranks that carry one rigid coupler: a parallelogram, and K − 2 cranks more than it needs.

SI units and radians; y is up. The coupler hangs on the first crank by a hinge and is tied to the others by connects.
"""

import mujoco
import numpy as np

CRANK, SPACING, RISE = 0.2, 0.3, 0.25
"""Length of a crank; between the feet of neighbours; by how much feet stand higher or lower, at most (m)."""
CRANK_MASS, COUPLER_MASS = 0.3, 0.5
"""Of a crank, and of the coupler for each crank that it is on (kg)."""
RATE = 8.0
"""Of all cranks at the start (rad/s): they go round."""
SEED = 1
"""Of the heights of the feet."""

_CRANK, _COUPLER = (0.25, 0.42, 0.66, 1), (0.80, 0.52, 0.25, 1)
_GHOST = {"contype": 0, "conaffinity": 0}


def build(K: int) -> mujoco.MjSpec:
    """The mechanism, its cranks upright.

    Args:
        K: cranks, at least 2. Their feet are in no line: the coupler joins all their tops.
    """
    if K < 2:
        raise ValueError(f"K = {K}, expected at least 2 cranks")
    spec = mujoco.MjSpec()
    spec.modelname = "n_crank"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.gravity = (0, -9.81, 0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(SPACING * K / 2, 0, 3))

    heights = np.random.default_rng(SEED).uniform(-RISE, RISE, K)
    feet = np.column_stack((SPACING * np.arange(K), heights, np.zeros(K)))
    top = np.array((0, CRANK, 0))
    cranks = []
    for index, foot in enumerate(feet):
        crank = spec.worldbody.add_body(name=f"crank{index + 1}", pos=foot)
        crank.add_joint(name=crank.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        _bar(crank, crank.name, np.zeros(3), top, CRANK_MASS, _CRANK)
        cranks.append(crank)
    coupler = cranks[0].add_body(name="coupler", pos=top)
    coupler.add_joint(name="coupler", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
    tops = feet - feet[0]
    for index in range(1, K):
        name = f"edge{index}"
        _bar(coupler, name, tops[index - 1], tops[index], COUPLER_MASS, _COUPLER)
        sites = {f"coupler{index + 1}": (coupler, tops[index]), f"top{index + 1}": (cranks[index], top)}
        for site, (body, place) in sites.items():
            body.add_site(name=site, pos=place, size=(0.015, 0.015, 0.015), rgba=(0.85, 0.33, 0.25, 1))
        first, second = sites
        spec.add_equality(
            name=f"pin{index + 1}",
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=first,
            name2=second,
        )
    # All cranks turn alike, and the coupler turns back by as much: it stays level.
    names = [joint.name for joint in spec.joints]
    spec.add_key(name="start", qpos=np.zeros(K + 1), qvel=[-RATE if name == "coupler" else RATE for name in names])
    return spec


def _bar(body: mujoco.MjsBody, name: str, start: np.ndarray, end: np.ndarray, mass: float, colour: tuple) -> None:
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=(*start, *end),
        size=(0.01, 0, 0),
        mass=mass,
        rgba=colour,
        **_GHOST,
    )
