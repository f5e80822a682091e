"""N four-bar loops in a row: N + 1 cranks on the ground, N couplers between their tops, 2N + 1 slender rods in all.

Every coupler hangs on the crank before it by a hinge and on the next one by ``connects`` ball joints, an equality each:
one closes a planar loop; two on the axis of the hinge close it as a 3-D model would, and repeat one another. Loops that
stand apart share no crank: N mechanisms that do not know of one another, in one model.
"""

import math

import mujoco

LENGTH = 1.0  # m, of every rod
MASS = 1.0  # kg
ACROSS = MASS * LENGTH**2 / 12  # kg m², of a slender rod about its middle
ALONG = 1e-9  # none by theory, and never turned about here; MuJoCo wants a positive number
PUSH = 1.0  # m/s, of the first crank's top at the start
HALF_PIN = 0.05  # m, between a joint's middle and its two connects
ROOM = 2.0  # m, between the feet of loops that stand apart

CRANK_COLOUR = [0.25, 0.42, 0.66, 1]
COUPLER_COLOUR = [0.80, 0.52, 0.25, 1]


def build(N: int, connects: int, apart: int) -> mujoco.MjSpec:
    """The model of N loops, in a row or apart, each closed by one or two connects. Cranks stand upright at q = 0."""
    if N < 1:
        raise ValueError(f"N = {N}, expected at least one loop")
    if connects not in (1, 2):
        raise ValueError(f"connects = {connects}, expected 1 or 2")
    if apart not in (0, 1):
        raise ValueError(f"apart = {apart}, expected 0 or 1")
    spec = mujoco.MjSpec()
    spec.modelname = "n_four_bar"
    spec.option.timestep = 1e-3
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = [0, -9.81, 0]
    spec.worldbody.add_light(pos=[0.5 * N, 0.5, 4])
    offsets = [0.0] if connects == 1 else [-HALF_PIN, HALF_PIN]

    feet = [i * LENGTH for i in range(N + 1)]
    if apart:
        feet = [i * (LENGTH + ROOM) + end for i in range(N) for end in (0.0, LENGTH)]
    tops = []
    for i, foot in enumerate(feet):
        crank = _rod(spec.worldbody, f"crank{i}", pos=[foot, 0, 0], along=[0, LENGTH, 0], colour=CRANK_COLOUR)
        crank.add_site(name=f"B{i}", pos=[0, LENGTH, 0], size=[0.03, 0, 0])
        tops.append(crank)
    for i in range(N):
        before, after = (tops[2 * i], tops[2 * i + 1]) if apart else (tops[i], tops[i + 1])
        coupler = _rod(before, f"coupler{i}", pos=[0, LENGTH, 0], along=[LENGTH, 0, 0], colour=COUPLER_COLOUR)
        for k, offset in enumerate(offsets):
            loop = f"loop{i}" if connects == 1 else f"loop{i}_{k}"
            coupler.add_site(name=f"{loop}_end", pos=[LENGTH, 0, offset], size=[0.03, 0, 0])
            after.add_site(name=f"{loop}_top", pos=[0, LENGTH, offset], size=[0.03, 0, 0])
            spec.add_equality(
                name=loop,
                type=mujoco.mjtEq.mjEQ_CONNECT,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                name1=f"{loop}_end",
                name2=f"{loop}_top",
            )

    # Upright, every crank turning to the right and every coupler turning back, so that it stays level.
    rate = PUSH / LENGTH
    model = spec.compile()
    qvel = [math.nan] * model.nv
    for index in range(model.njnt):
        qvel[model.jnt_dofadr[index]] = -rate if model.joint(index).name.startswith("crank") else rate
    spec.add_key(name="start", qpos=[0.0] * model.nq, qvel=qvel)
    return spec


def _rod(parent: mujoco.MjsBody, name: str, pos: list, along: list, colour: list) -> mujoco.MjsBody:
    """A slender rod on a hinge about z at its first end."""
    body = parent.add_body(name=name, pos=pos)
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    body.explicitinertial = True
    body.mass = MASS
    body.ipos = [0.5 * x for x in along]
    body.inertia = [ALONG if x else ACROSS for x in along]
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0, 0, 0, *along],
        size=[0.03, 0, 0],
        contype=0,
        conaffinity=0,
        mass=0,
        rgba=colour,
    )
    return body
