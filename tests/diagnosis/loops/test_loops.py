"""The loops of any model: rows, groups, ranks, what depends on what, and the singular poses along a motion."""

import mujoco
import numpy as np
import pytest
import scipy.integrate
from gallery import at_start
from mechanisms import TANGLE, four_bar, parallelogram
from oarlock import load_case, model_names, variant_names
from oarlock.diagnosis.loops.events import rank_events
from oarlock.diagnosis.loops.loops import find_loops, loops_at
from oarlock.mechanics.load import load_model
from oarlock.poses.assembly import Assembly

CHEAP = 30
"""Velocities. Beyond, a minimal set takes a tenth of a second."""

DEPENDENT = 1e-9
"""Of the largest row. What is left of dependent rows put together: rounding over the smallest singular value kept."""

INDEPENDENT = 1e-6
"""Of the largest singular value. Independent rows of the gallery have 0.05 and more, dependent ones 1e-15."""

SIX_DIGITS = 1e-4
"""Relative singular value. What rounding lengths to six digits makes of a redundant row: 1e-6 (measured)."""

BETWEEN_SAMPLES = 1e-3
"""s. Poses between samples 20 ms apart are on a chord: a²Δt²/8 of 40 rad/s² over a rate of 5 rad/s, 4e-4."""

NAMES = [name for model in model_names() for name in variant_names(model)]
WALKED = [name for name in NAMES if int(load_case(name).expected()["nv"]) <= CHEAP]


def compiled(xml):
    return mujoco.MjModel.from_xml_string(xml)


@pytest.fixture(scope="module")
def started():
    """Name of a case → its model and a data at its start."""
    known = {}

    def give(name):
        if name not in known:
            _, model, _, data = at_start(name)
            known[name] = model, data
        return known[name]

    return give


# Ranks.


@pytest.mark.parametrize("name", WALKED)
def test_ranks_are_those_of_the_case_without_its_rank_cut(name, started):
    loops = find_loops(*started(name))
    expected = load_case(name).expected()
    assert {key: getattr(loops, key) for key in ("rows", "rank", "dof")} == {
        k: expected[k] for k in ("rows", "rank", "dof")
    }
    assert loops.closed
    assert not loops.near_singular


def test_a_model_with_a_sparse_jacobian_is_left_alone():
    case = load_case("n_four_bar:N=40")
    model = load_model(case.model_path, case.parameters)
    data = mujoco.MjData(model)
    assert mujoco.mj_isSparse(model)
    flags = model.opt.disableflags
    loops = find_loops(model, data)
    assert (loops.rows, loops.rank, loops.dof) == (120, 80, 1)
    assert mujoco.mj_isSparse(model)
    assert model.opt.disableflags == flags
    np.testing.assert_array_equal(data.qpos, model.qpos0)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_rank_does_not_hang_on_units(scale, started):
    """Of a weld, whose rotation rows are as large as its torque scale says."""
    xml = load_case("welded_frame").model_path.read_text(encoding="utf-8")
    model = compiled(xml.replace('name="seam"', f'name="seam" torquescale="{scale}"'))
    data = mujoco.MjData(model)
    data.qpos[:] = started("welded_frame")[1].qpos
    loops = find_loops(model, data)
    assert loops.closed
    assert (loops.rank, loops.dof) == (5, 1)


def test_six_digits_do_not_lock_a_ring_that_is_mobile_by_its_proportions():
    """Bricard's ring with lengths off by a millionth no longer closes beyond rounding; it still counts as mobile."""
    xml = load_case("bricard").model_path.read_text(encoding="utf-8")
    loops = find_loops(compiled(xml.replace('pos="0 -1 0">', 'pos="0 -1.000001 0.000001">')))
    (group,) = loops.groups
    assert (loops.rank, loops.dof) == (4, 1)
    assert 0 < group.spectrum.dropped < SIX_DIGITS
    assert group.spectrum.kept > 100 * SIX_DIGITS


def test_no_active_equality():
    for xml in (four_bar().replace('name="pin"', 'name="pin" active="false"'), four_bar(rest=DISABLED)):
        loops = find_loops(compiled(xml))
        assert (loops.rows, loops.rank, loops.dof, loops.loops, loops.groups) == (0, 0, 3, (), ())


DISABLED = '<option><flag equality="disable"/></option>'


# Groups.


ASIDE = """<worldbody><body name="swing" pos="0 1 0"><joint name="swing" axis="1 0 0"/><geom fromto="0 0 0 0 0 0.3"/>
  <body name="bob" pos="0 0 0.3"><joint name="bob" axis="1 0 0"/><geom fromto="0 0 0 0 0.2 0"/>
  <site name="bob" pos="0 0.2 0"/></body></body><site name="peg" pos="0 1.2 0.3"/></worldbody>
  <equality><connect name="hook" site1="bob" site2="peg"/></equality>"""


def test_loops_that_share_no_joint_are_apart():
    loops = find_loops(compiled(four_bar(rest=ASIDE)))
    assert [group.equalities for group in loops.groups] == [("pin",), ("hook",)]
    assert [group.joints for group in loops.groups] == [("crank", "coupler", "rocker"), ("swing", "bob")]
    assert [(group.shape, group.rank, group.dof) for group in loops.groups] == [("planar", 2, 1), ("planar", 2, 0)]
    assert np.asarray(loops.groups[1].normal).tolist() == pytest.approx([1, 0, 0])


def test_a_coupling_joins_loops():
    rest = ASIDE + '<equality><joint name="gear" joint1="swing" joint2="crank"/></equality>'
    loops = find_loops(compiled(four_bar(rest=rest)))
    (group,) = loops.groups
    assert group.shape == "spatial"  # each is planar, in planes of their own
    assert [loop.path.shape for loop in loops.loops] == ["planar", "planar", "coupling"]
    assert loops.loops[2].ends == ("swing", "crank")
    assert (loops.loops[2].rows[0].unit, loops.loops[0].rows[0].unit) == ("rad", "m")


def test_a_floating_base_is_no_part_of_the_loop_it_carries(started):
    model, data = started("floating_four_bar")
    loops = find_loops(model, data)
    (group,) = loops.groups
    assert (group.dofs, group.dof, loops.dof) == (3, 1, 7)


def test_every_kind_has_its_rows_and_units():
    loops = find_loops(compiled(TANGLE))
    found = {loop.name: [row.unit for row in loop.rows] for loop in loops.loops}
    assert found["connect bodies"] == ["m"] * 3
    assert found["weld sites"] == ["m"] * 3 + ["rad"] * 3
    assert found["angles"] == ["rad"]
    assert len(loops.null) == sum(map(len, found.values()))
    assert not loops.closed


# Planes and zero rows.


def test_a_plane_that_is_no_plane_of_the_world():
    """No row is zero, but one direction of the connect holds nothing."""
    turned = (
        four_bar()
        .replace("<worldbody>", '<worldbody><frame euler="0.4 0.3 0.2">')
        .replace("</worldbody>", "</frame></worldbody>")
    )
    straight, tilted = find_loops(compiled(four_bar())), find_loops(compiled(turned))
    assert straight.loops[0].zero_rows == ("y",)
    assert tilted.loops[0].zero_rows == ()
    assert straight.groups[0].dependencies == ()
    (dependency,) = tilted.groups[0].dependencies
    assert dependency.equalities == ("pin",)
    for loops in (straight, tilted):
        assert loops.groups[0].shape == "planar"
        assert (loops.rank, loops.redundancy) == (2, 1)
    parts = np.array([part for _, part in dependency.rows])
    assert abs(parts @ tilted.groups[0].normal) == pytest.approx(np.linalg.norm(parts))


def test_spatial_loops_are_not_planar(started):
    for name in ("bennett", "bricard", "spatial_slider_crank", "sarrus"):
        assert [group.shape for group in find_loops(*started(name)).groups] == ["spatial"]


# What depends on what.


@pytest.mark.parametrize("name", [*WALKED, "tangle"])
def test_dependent_sets_are_dependent_and_minimal(name, started):
    model, data = (compiled(TANGLE), None) if name == "tangle" else started(name)
    assembly = Assembly(model, data)
    assembly.place(assembly.data.qpos)
    loops = loops_at(assembly)
    jacobian = assembly.whitened(assembly.jacobian())
    for block in assembly.blocks:
        jacobian[block] /= np.linalg.norm(jacobian[block], axis=1).max()
    assert sum(len(group.dependencies) for group in loops.groups) == loops.redundancy - sum(
        g.zero for g in loops.groups
    )
    for dependency in (one for group in loops.groups for one in group.dependencies):
        chosen = [assembly.rows.index(row) for row, _ in dependency.rows]
        parts = np.array([part for _, part in dependency.rows])
        assert np.abs(parts @ jacobian[chosen]).max() <= DEPENDENT
        assert dependency.equalities == tuple(dict.fromkeys(row.equality for row, _ in dependency.rows))
        sigma = np.linalg.svd(jacobian[chosen], compute_uv=False)
        assert len(chosen) > model.nv or sigma[-1] <= DEPENDENT
        if len(chosen) > 1:
            assert sigma[len(chosen) - 2] > INDEPENDENT  # without any one of them the rest is independent


def test_equalities_that_are_redundant_with_one_another_are_named(started):
    (group,) = find_loops(*started("gear_train")).groups
    assert [one.equalities for one in group.dependencies] == [("first_mesh", "second_mesh", "direct_mesh")]
    (group,) = find_loops(*started("triple_crank")).groups
    assert [one.equalities for one in group.dependencies] == [("pin2", "pin3")]
    again = '<equality><connect name="again" site1="tip1" site2="tip2"/></equality>'
    (group,) = find_loops(compiled(four_bar(rest=again))).groups
    assert [one.equalities for one in group.dependencies] == [("pin", "again")] * 2
    assert all(one.proportional for one in group.dependencies)


@pytest.mark.parametrize("name", WALKED)
def test_removable_is_what_the_rank_without_it_says(name, started):
    model, data = started(name)
    assembly = Assembly(model, data)
    assembly.place(assembly.data.qpos)
    loops, jacobian = loops_at(assembly), assembly.jacobian()
    for number, loop in enumerate(loops.loops):
        without = np.delete(jacobian, np.arange(len(jacobian))[assembly.rows_of(number)], axis=0)
        lost = loops.rank - (np.linalg.matrix_rank(without, tol=INDEPENDENT) if len(without) else 0)
        assert (loop.removable, loop.freed) == (lost == 0, lost)


# Along a motion.


STEP = 0.02
SINGULAR_POSES = 10
"""Of N = 2 in 10 s: mechanisms of problem A02, whose rods lie level ten times."""


def n_four_bar_motion(step_s, *, open_by=0.0):
    """The exact motion, and when its rods lie level. Cranks may be turned a little, so that the loops are open."""
    k = 9.81 * (1.5 + 2) / (1.0 + 2)

    def level(_, state):
        return np.cos(state[0])

    times = np.arange(0.0, 10.0, step_s)
    found = scipy.integrate.solve_ivp(
        lambda _, state: [state[1], k * np.sin(state[0])],
        (0, 10),
        [0, 1],
        "DOP853",
        times,
        rtol=1e-12,
        atol=1e-12,
        events=level,
    )
    angle = -found.y[0]
    qpos = np.column_stack([angle, -angle, angle + open_by, -angle, angle])
    return times, qpos, found.t_events[0]


@pytest.mark.parametrize("open_by", [0.0, 1e-3])
def test_singular_poses_between_samples_are_found(open_by):
    case = load_case("n_four_bar")
    model = load_model(case.model_path, case.parameters)
    names = [model.joint(index).name for index in range(model.njnt)]
    assert names == ["crank0", "coupler0", "crank1", "coupler1", "crank2"]
    times, qpos, level = n_four_bar_motion(STEP, open_by=open_by)
    history = rank_events(model, qpos, times)
    assert history.rank == 4
    assert level[0] == pytest.approx(0.7143555293, abs=1e-9)  # the benchmark's own
    assert [event.kind for event in history.events] == ["singular"] * SINGULAR_POSES
    assert {(event.rank, event.lost) for event in history.events} == {(2, 2)}
    assert {event.equalities for event in history.events} == {("loop0", "loop1")}
    found = np.array([event.time_s for event in history.events])
    assert np.abs(found - level).max() <= BETWEEN_SAMPLES + 2 * open_by
    for event in history.events:
        assert event.start_s <= event.time_s + STEP
        assert event.time_s - STEP <= event.end_s
    # No sample is there: the samples alone would not tell.
    assert np.abs(times[:, None] - level).min() > 1e-5


def test_a_motion_that_comes_near():
    """A parallelogram whose ground is 0.2 mm longer folds almost flat: it comes near to what the exact one passes."""
    angles = np.linspace(0.1, 3.0, 200)
    path = np.column_stack([angles, -angles, angles])
    exact = rank_events(compiled(parallelogram()), path, angles)
    assert [event.kind for event in exact.events] == ["singular"]
    assert exact.events[0].time_s == pytest.approx(np.pi / 2, abs=1e-3)
    longer = parallelogram().replace('<body name="rocker" pos="1 0 0">', '<body name="rocker" pos="1.0002 0 0">')
    near = rank_events(compiled(longer), path, angles)
    assert [event.kind for event in near.events] == ["near"]
    assert near.events[0].smallest > 10 * exact.events[0].smallest


def test_a_motion_without_events(started):
    model, data = started("triple_crank")
    turned = np.linspace(0, 2 * np.pi, 100)
    history = rank_events(model, np.column_stack([turned, -turned, turned, turned]), turned)
    assert (history.rank, history.events) == (3, ())
    assert history.smallest.min() > 0.1
    assert history.dropped.max() < DEPENDENT
    assert history.removable == {"pin2": False, "pin3": False}
    assert data.qpos[0] == 0.0


def test_what_is_removable_along_a_motion(started):
    """A second connect on a hinge's axis is removable throughout, and so is the first; not so a loop of its own."""
    model, _ = started("n_four_bar:connects=2")
    _, qpos, _ = n_four_bar_motion(0.1)
    history = rank_events(model, qpos, np.arange(len(qpos)) * 0.1)
    assert set(history.removable.values()) == {True}
    alone, _ = started("n_four_bar")
    assert set(rank_events(alone, qpos, np.arange(len(qpos)) * 0.1).removable.values()) == {False}
