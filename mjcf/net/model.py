"""A net of k × k irregular quadrilaterals of rods, hanging in its plane. SI units and radians; y is up.

Columns of k rods hang down, and a beam leads from each of their joints to the next column: it hangs on the left one by
a hinge and is tied to the right one by a connect, so that every beam closes a loop. The columns hang on the ground; or
the whole net is one kinematic tree, with a row of rods on top of them, pinned at its first corner only.
"""

import math

import mujoco
import numpy as np

SIDE = 0.5
"""Of a quadrilateral (m), before its corners are moved."""
SCATTER = 0.12
"""By how much a corner is moved at most, as a part of the side: all quadrilaterals differ, none is nearly flat."""
LEAN = 0.3
"""By how much a row hangs to the right of the one above it at the start, as a part of the side."""
DENSITY, RADIUS = 2.0, 0.01
"""Of a rod: kg/m and m."""
HALF_PIN = 0.05
"""Half the distance of the two connects of a doubled pin (m)."""
SEED = 1
"""Of the corners, and of which pins are doubled."""

_GROUND, _COLUMN, _BEAM = (0.6, 0.6, 0.6, 1), (0.25, 0.42, 0.66, 1), (0.80, 0.52, 0.25, 1)


def build(k: int, tree: int, doubled: float) -> mujoco.MjSpec:
    """The net, as it is at rest at its start.

    Args:
        k: quadrilaterals along a side.
        tree: 0: the columns hang on the ground; 1: all rods are one tree.
        doubled: part of the loops that are closed by two connects on the axis of the hinge, as a 3-D model would, so
            that their rows repeat one another.
    """
    if k < 1:
        raise ValueError(f"k = {k}, expected at least 1")
    if tree not in (0, 1):
        raise ValueError(f"tree = {tree}, expected 0 or 1")
    if not 0 <= doubled <= 1:
        raise ValueError(f"doubled = {doubled}, expected a part between 0 and 1")
    spec = mujoco.MjSpec()
    spec.modelname = "net"
    spec.compiler.degree = False
    spec.option.timestep = 1e-3
    spec.option.gravity = (0, -9.81, 0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.worldbody.add_light(pos=(SIDE * k / 2, 0, 3))

    random = np.random.default_rng(SEED)
    corners = _corners(k, random)
    twice = set(random.permutation(k * k)[: math.floor(doubled * k * k + 0.5)].tolist())
    above: mujoco.MjsBody = spec.worldbody
    hinge = corners[0, 0]
    columns = [[above]]
    for i in range(k):
        if tree:
            above = _rod(above, f"top{i + 1}", hinge, corners[i, 0], corners[i + 1, 0], _GROUND)
            hinge = corners[i + 1, 0] - corners[i, 0]
            if not i:
                columns = [[above]]
        columns.append([above])
    for i, column in enumerate(columns):
        for j in range(k):
            start, end = corners[i, j], corners[i, j + 1]
            if j:
                place = corners[i, j] - corners[i, j - 1]
            elif tree:
                place = corners[i, 0] - corners[max(i - 1, 0), 0]
            else:
                place = corners[i, 0]
            column.append(_rod(column[-1], f"column{i + 1}_{j + 1}", place, start, end, _COLUMN))
    for i in range(k):
        for j in range(1, k + 1):
            place, start, end = corners[i, j] - corners[i, j - 1], corners[i, j], corners[i + 1, j]
            beam = _rod(columns[i][j], f"beam{i + 1}_{j}", place, start, end, _BEAM)
            tied = corners[i + 1, j] - corners[i + 1, j - 1]
            _close(spec, beam, end - start, columns[i + 1][j], tied, f"loop{i + 1}_{j}", i * k + j - 1 in twice)
    return spec


def _corners(k: int, random: np.random.Generator) -> np.ndarray:
    """Where the corners are at the start, (k + 1, k + 1, 3): by columns from the left, then downwards."""
    across, down = np.meshgrid(np.arange(k + 1.0), np.arange(k + 1.0), indexing="ij")
    even = SIDE * np.stack((across + LEAN * down, -down, np.zeros_like(down)), axis=-1)
    even[..., :2] += SIDE * SCATTER * random.uniform(-1, 1, (k + 1, k + 1, 2))
    return even


def _rod(parent, name: str, place: np.ndarray, start: np.ndarray, end: np.ndarray, colour: tuple) -> mujoco.MjsBody:
    """A rod between two corners, on a hinge at the first, which is at a place of its parent (m)."""
    body = parent.add_body(name=name, pos=place)
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
    along = end - start
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=(0, 0, 0, *along),
        size=(RADIUS, 0, 0),
        mass=DENSITY * np.linalg.norm(along),
        contype=0,
        conaffinity=0,
        rgba=colour,
    )
    return body


def _close(spec, beam, end: np.ndarray, column, place: np.ndarray, name: str, doubled: bool) -> None:
    """Ties a beam's end to a column's, by one connect or by two on the axis of their hinge."""
    for number, offset in enumerate((-HALF_PIN, HALF_PIN) if doubled else (0.0,)):
        tie = f"{name}_{number + 1}" if doubled else name
        for body, where, suffix in ((beam, end, "beam"), (column, place, "column")):
            body.add_site(name=f"{tie}_{suffix}", pos=where + np.array((0, 0, offset)), size=(0.02, 0.02, 0.02))
        spec.add_equality(
            name=tie,
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"{tie}_beam",
            name2=f"{tie}_column",
        )
