"""Outlines of shapes: what is inside of one is what MuJoCo's own rays hit."""

import mujoco
import numpy as np
import pytest
from oarlock.base.shapes import coarse, rotated
from oarlock.mechanics.shapes import shapes_of
from oarlock.render.solids import ROUND, hull, outlines

RIM = 1.0 - np.cos(np.pi / ROUND) + 1e-6
"""Of a radius: so far a polygon with as many corners as a circle is drawn with stays inside of it."""

RAYS = 400

GEOMS = {
    "sphere": '<geom type="sphere" size=".2"/>',
    "ellipsoid": '<geom type="ellipsoid" size=".1 .2 .3"/>',
    "capsule": '<geom type="capsule" size=".1 .2"/>',
    "cylinder": '<geom type="cylinder" size=".15 .2"/>',
    "box": '<geom type="box" size=".1 .2 .25"/>',
    "mesh": '<geom type="mesh" mesh="wedge"/>',
    "hfield": '<geom type="hfield" hfield="hill"/>',
}

MODEL = """<mujoco><asset>
<mesh name="wedge" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .3  .3 .3 0"/>
<hfield name="hill" nrow="3" ncol="4" size=".2 .2 .1 .01" elevation="0 1 0 0  1 2 1 0  0 1 0 0"/></asset>
<worldbody><body pos=".1 -.2 .3" quat="{quat}">{geom}</body></worldbody></mujoco>"""


def turn(generator):
    quat = generator.normal(size=4)
    return quat / np.linalg.norm(quat)


def inside(points, polygon):
    """Whether points (n, 2) are inside of a polygon (m, 2), by how often a ray to the right crosses it."""
    x, y = points.T
    first, second = polygon, np.roll(polygon, -1, axis=0)
    crossed = np.zeros(len(points), dtype=int)
    for (ax, ay), (bx, by) in zip(first, second, strict=True):
        between = (ay > y) != (by > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            crossed += between & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    return crossed % 2 == 1


def axes_of(quat):
    return rotated(quat, np.eye(3))


@pytest.mark.parametrize("kind", GEOMS)
@pytest.mark.parametrize("seed", range(4))
def test_what_is_inside_of_an_outline_is_what_a_ray_hits(kind, seed):
    generator = np.random.default_rng(seed)
    quat, axes = turn(generator), axes_of(turn(generator))
    if kind == "hfield":  # what is seen of it from below are its sides, which have no faces
        quat, axes = np.array([1.0, 0.0, 0.0, 0.0]), np.array([[1.0, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])
    text = MODEL.format(quat=" ".join(map(str, quat)), geom=GEOMS[kind])
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    shapes, meshes = shapes_of(model)
    drawn = outlines(shapes, meshes, np.hstack([data.xpos, data.xquat]), axes)
    assert drawn
    middle = axes @ data.geom_xpos[0]
    points = middle[:2] + generator.uniform(-0.5, 0.5, (RAYS, 2))
    hit, there = np.zeros(RAYS, bool), np.zeros(RAYS, bool)
    geom = np.zeros(1, np.int32)
    for at, point in enumerate(points):
        start = np.array([*point, middle[2] + 2.0]) @ axes
        hit[at] = mujoco.mj_ray(model, data, start, -axes[2], None, 1, -1, geom, *([None] * has_normal())) >= 0.0
    for one in drawn:
        there |= inside(points, one.points)
    assert hit.any()
    assert not hit.all()
    wrong = hit != there
    if kind == "hfield":  # a ray meets its sides and bottom, too
        wrong &= there
    # What differs lies within the rim of the outline.
    for point in points[wrong]:
        edges = np.concatenate([segment_distances(point, one.points) for one in drawn])
        assert edges.min() <= RIM * 0.4


def has_normal():
    return "normal" in (mujoco.mj_ray.__doc__ or "")


def segment_distances(point, polygon):
    first, along = polygon, np.roll(polygon, -1, axis=0) - polygon
    lengths = np.maximum(np.square(along).sum(axis=1), 1e-30)
    share = np.clip(((point - first) * along).sum(axis=1) / lengths, 0.0, 1.0)
    return np.linalg.norm(first + share[:, None] * along - point, axis=1)


def test_what_is_nearer_comes_later_and_floors_come_first():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="sphere" size=".1" pos="0 0 1"/><geom type="plane" size="0 0 1" pos="0 0 2"/>'
        '<geom type="sphere" size=".1" pos="0 0 .5"/></worldbody></mujoco>'
    )
    shapes, meshes = shapes_of(model)
    poses = np.array([[0.0, 0, 0, 1, 0, 0, 0]])
    drawn = outlines(shapes, meshes, poses, np.eye(3), wide=3.0)
    assert [one.floor for one in drawn] == [True, False, False]
    assert [one.depth for one in drawn] == [2.0, 0.5, 1.0]
    assert np.ptp(drawn[0].points, axis=0) == pytest.approx([6.0, 6.0])
    assert len(outlines(shapes, meshes, poses, np.eye(3))) == 2
    assert len(outlines(shapes, meshes, poses, np.diag([1.0, -1.0, -1.0]), wide=3.0)) == 2  # from below


def test_faces_that_look_away_are_darker():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="box" size=".1 .1 .1" rgba="1 .5 0 1" euler="0 20 0"/></worldbody></mujoco>'
    )
    shapes, meshes = shapes_of(model)
    dark, light = sorted(
        outlines(shapes, meshes, np.array([[0.0, 0, 0, 1, 0, 0, 0]]), np.eye(3)), key=lambda one: one.fill
    )
    assert np.ptp(dark.points[:, 0]) < np.ptp(light.points[:, 0])
    assert dark.fill[0] == pytest.approx(2 * dark.fill[1])
    assert light.colour.startswith("#f")


def test_meshes_are_made_coarser_together():
    y, x = np.mgrid[:40, :40]
    vertices = np.stack([x.ravel() / 40, y.ravel() / 40, np.zeros(1600)], axis=1)
    at = (np.arange(39)[:, None] * 40 + np.arange(39)).ravel()
    faces = np.concatenate([np.stack([at, at + 1, at + 41], 1), np.stack([at, at + 41, at + 40], 1)])
    meshes = [(vertices, faces), (vertices, faces)]
    assert coarse(meshes, 10_000)[0][1] is faces
    kept = coarse(meshes, 600)
    assert 100 < sum(len(faces) for _, faces in kept) <= 600


def test_a_hull_has_what_it_is_of():
    points = np.random.default_rng(1).normal(size=(60, 2))
    found = hull(points)
    middle = found.mean(axis=0)
    assert inside((points - middle) * (1.0 - 1e-9) + middle, found).all()
    here, there = np.roll(found, -1, 0) - found, np.roll(found, -2, 0) - np.roll(found, -1, 0)
    assert (here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0] > 0).all()
    assert hull(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])).tolist() == [[0.0, 0.0], [2.0, 2.0]]
