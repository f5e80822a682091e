"""A tower of tensegrity cells: prisms of three free bars, held by cables that do not stretch. SI units and radians.

Three bars lead from the lower to the upper triangle of a cell, which is turned; nine cables are the sides of both and
lead from each lower corner to the upper end of the bar beside. Bars of neighbouring cells meet end to end in a connect.
So a cell is a rigid truss, in which every bar may still turn about itself; and the triangle between two cells has each
of its sides twice, one cable a cell.
"""

import mujoco
import numpy as np

RADIUS, HEIGHT, TWIST = 0.5, 0.8, np.deg2rad(100.0)
"""Of a triangle's corners; of a cell (m); of the upper triangle against the lower one, by turns to either side. At 150°
the truss could bear a stress of its own and give way a little; this is far from there."""
BAR_MASS, BAR_RADIUS = 1.0, 0.02
TUMBLE = (0.5, 0.3, 1.0)
"""Of the whole tower at the start, about its middle (rad/s, along the world's axes)."""
ROLL = 2.0
"""Of the bars about themselves at the start (rad/s), each cell's the other way."""

_BARS = ((0.25, 0.42, 0.66, 1), (0.80, 0.52, 0.25, 1))


def build(cells: int) -> mujoco.MjSpec:
    """The tower in free flight, its middle in the origin and at rest.

    Args:
        cells: number of prisms on one another.
    """
    if cells < 1:
        raise ValueError(f"cells = {cells}, expected at least 1")
    spec = mujoco.MjSpec()
    spec.modelname = "tensegrity"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.gravity = (0, 0, 0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(0, 0, HEIGHT * cells))

    turn, pose, velocity = 0.0, [], []
    for cell in range(cells):
        after = turn + (-TWIST if cell % 2 else TWIST)
        height = HEIGHT * (cell - cells / 2)
        lower, upper = _triangle(turn, height), _triangle(after, height + HEIGHT)
        for bar in range(3):
            place, rate = _bar(spec, f"bar{cell + 1}_{bar + 1}", lower[bar], upper[bar], cell)
            pose.append(place)
            velocity.append(rate)
        for bar in range(3):
            beside = (bar + 1) % 3
            for kind, ends in (
                ("lower", (("low", bar), ("low", beside))),
                ("upper", (("high", bar), ("high", beside))),
                ("side", (("high", bar), ("low", beside))),
            ):
                _cable(spec, f"{kind}{cell + 1}_{bar + 1}", [f"{end}{cell + 1}_{of + 1}" for end, of in ends])
            if cell:
                spec.add_equality(
                    name=f"node{cell}_{bar + 1}",
                    type=mujoco.mjtEq.mjEQ_CONNECT,
                    objtype=mujoco.mjtObj.mjOBJ_SITE,
                    name1=f"high{cell}_{bar + 1}",
                    name2=f"low{cell + 1}_{bar + 1}",
                )
        turn = after
    spec.add_key(name="start", qpos=np.concatenate(pose), qvel=np.concatenate(velocity))
    return spec


def _triangle(turn: float, height: float) -> np.ndarray:
    """Its corners, (3, 3)."""
    around = turn + 2 * np.pi / 3 * np.arange(3)
    return np.column_stack((RADIUS * np.cos(around), RADIUS * np.sin(around), np.full(3, height)))


def _bar(spec: mujoco.MjSpec, name: str, low: np.ndarray, high: np.ndarray, cell: int) -> tuple[np.ndarray, np.ndarray]:
    """A free bar between two points. Gives its coordinates and velocities at the start."""
    middle, half = (low + high) / 2, np.linalg.norm(high - low) / 2
    along = (high - low) / (2 * half)
    quat = np.array((1 + along[2], -along[1], along[0], 0))  # the least turn from z to there
    quat /= np.linalg.norm(quat)
    body = spec.worldbody.add_body(name=name, pos=middle, quat=quat)
    body.add_freejoint(name=name)
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=(BAR_RADIUS, half, 0),
        mass=BAR_MASS,
        contype=0,
        conaffinity=0,
        rgba=_BARS[cell % 2],
    )
    for end, place in (("low", -half), ("high", half)):
        body.add_site(name=name.replace("bar", end), pos=(0, 0, place), size=(0.03, 0.03, 0.03))
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, quat)
    spin = turned.reshape(3, 3).T @ np.array(TUMBLE) + np.array((0, 0, -ROLL if cell % 2 else ROLL))
    return np.concatenate((middle, quat)), np.concatenate((np.cross(TUMBLE, middle), spin))


def _cable(spec: mujoco.MjSpec, name: str, sites: list[str]) -> None:
    """A straight tendon between two sites, as long for ever as in the pose that the model is built in."""
    tendon = spec.add_tendon(name=name, width=0.005, rgba=(0.3, 0.3, 0.3, 1))
    for site in sites:
        tendon.wrap_site(site)
    spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_TENDON, objtype=mujoco.mjtObj.mjOBJ_TENDON, name1=name)
