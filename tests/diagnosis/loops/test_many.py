"""What many loops are spared: it must be what the long way gives."""

import mujoco
import numpy as np
import pytest
from oarlock import load_case
from oarlock.diagnosis.loops import events, wrenches
from oarlock.diagnosis.loops.curves import Linkage
from oarlock.diagnosis.loops.loops import find_loops
from oarlock.mechanics.load import collected_warnings, load_model
from oarlock.poses.assembly import Assembly
from tolerances import SAME_FORMULA

MOVED = 0.02
"""rad or m. Poses are disturbed by so much, and left open."""

POSES = 12


def disturbed(name):
    """A model, poses around its start, and multipliers for its rows."""
    case = load_case(name)
    model, random = load_model(case.model_path, case.parameters), np.random.default_rng(0)
    qpos = np.tile(model.key_qpos[0] if model.nkey else model.qpos0, (POSES, 1))
    for pose in qpos:
        mujoco.mj_integratePos(model, pose, random.uniform(-MOVED, MOVED, model.nv), 1.0)
    return model, qpos, random.normal(size=(POSES, len(Assembly(model).rows)))


@pytest.mark.parametrize("name", ["net:k=3", "n_four_bar:connects=2", "net:tree=1,doubled=1", "ring:planar=1,apart=1"])
def test_forces_of_repeated_rows_are_split_as_by_eigenvectors(name, monkeypatch):
    model, qpos, multipliers = disturbed(name)
    spared = wrenches.wrenches(model, qpos, multipliers)
    monkeypatch.setattr(wrenches, "_repeats", lambda *_: None)
    for short, long in zip(spared, wrenches.wrenches(model, qpos, multipliers), strict=True):
        assert short.free.force is not None
        np.testing.assert_allclose(short.free.force, long.free.force, rtol=0, atol=1e4 * SAME_FORMULA)


@pytest.mark.parametrize("name", ["net:k=6", "n_four_bar:N=31,connects=2"])
def test_singular_values_of_products_are_those_of_the_rows(name):
    model, qpos, _ = disturbed(name)
    assembly = Assembly(model)
    rank = find_loops(model).rank
    assert rank >= events.MANY
    for pose in qpos:
        assembly.place(pose)
        rows = assembly.whitened(assembly.jacobian())
        sizes = np.linalg.svd(rows, compute_uv=False)
        found = events._sizes(events.fold(rows).rows, rank)
        np.testing.assert_allclose(found[:2], sizes[[0, rank - 1]], rtol=1e4 * SAME_FORMULA)


def test_a_dip_between_the_poses_that_are_looked_at_is_seen(monkeypatch):
    """A long motion through a singular pose, looked at every fifth pose: around the dip it is looked at everywhere."""
    case = load_case("n_four_bar:N=31")
    model = load_model(case.model_path, case.parameters)
    angles = np.linspace(-0.4, 1.1, 151) - np.pi / 2  # of cranks from the upright; level at −π/2
    qpos = np.zeros((len(angles), model.nq))
    for joint in range(model.njnt):
        crank = model.joint(joint).name.startswith("crank")
        qpos[:, model.jnt_qposadr[joint]] = angles if crank else -angles
    times = np.arange(len(angles)) * 1e-3
    whole = events.rank_events(model, qpos, times)
    monkeypatch.setattr(events, "LOOKS", 31)
    some = events.rank_events(model, qpos, times)
    assert len(whole.events) == len(some.events) == 1
    assert some.events[0].time_s == pytest.approx(whole.events[0].time_s, abs=1e-5)
    assert (some.events[0].kind, some.events[0].lost) == ("singular", 31)
    low = whole.smallest < events.DIP * np.median(whole.smallest)
    np.testing.assert_allclose(some.smallest[low], whole.smallest[low], rtol=1e-6)


def test_along_is_the_part_of_the_right_handed_motion():
    case = load_case("four_bar")
    model = load_model(case.model_path, case.parameters)
    loops = find_loops(model)
    linkage = Linkage(Assembly(model), loops, 0, 1.0)
    linkage.place(loops.qpos)
    assert linkage.oriented
    rows = linkage._assembly.jacobian()[linkage._holding][:, linkage.dofs] * linkage._units
    motion = np.linalg.svd(rows)[2][-1]
    motion *= np.sign(np.linalg.det(np.vstack([rows, motion])))
    for seed in range(5):
        move = np.random.default_rng(seed).normal(size=len(motion))
        assert linkage.along(loops.qpos, move) == pytest.approx(float(motion @ move), abs=1e-10)


SLED = """<body name="a{n}" pos="0 {n} 0"><joint name="a{n}" axis="0 1 0"/><geom size="0.1" pos="0.3 0 0"/>
  <body name="b{n}" pos="0.3 0 0"><joint name="b{n}" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body></body>"""


def sleds(count: int, kilobytes: int) -> str:
    """Chains of two links, each pinned to the world."""
    bodies = "".join(SLED.format(n=n) for n in range(count))
    pins = "".join(f'<connect body1="b{n}" body2="world" anchor="0.2 0 0"/>' for n in range(count))
    return f"""<mujoco><size memory="{kilobytes}K"/><default><geom contype="0" conaffinity="0"/></default>
      <worldbody>{bodies}</worldbody><equality>{pins}</equality></mujoco>"""


def rows_of(text: str, jacobian: mujoco.mjtJacobian) -> int:
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError:  # too little to compile it
        return 0
    model.opt.jacobian = jacobian
    data = mujoco.MjData(model)
    with collected_warnings():
        mujoco.mj_fwdPosition(model, data)
    return data.ne


def test_what_memory_does_not_hold_as_a_dense_jacobian_is_looked_at_as_a_sparse_one():
    count = 60
    dense, sparse = mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_SPARSE
    room = next(size for size in range(50, 5000, 50) if rows_of(sleds(count, size), sparse) > 0)
    text = sleds(count, room)
    assert rows_of(text, dense) == 0  # MuJoCo leaves all of them out
    short, long = (find_loops(mujoco.MjModel.from_xml_string(each)) for each in (text, sleds(count, 50_000)))
    assert short.rank == long.rank > 0
    assert [group.equalities for group in short.groups] == [group.equalities for group in long.groups]
