"""Forces through equalities: where multipliers act, which directions are unique, and what goes through over time."""

import mujoco
import numpy as np
import pytest
from gallery import at_start
from mechanisms import TANGLE, four_bar, setup_of
from oarlock import InputError, load_case, model_names, variant_names
from oarlock.diagnosis.loops.directions import told
from oarlock.diagnosis.loops.forces import body_wrenches
from oarlock.diagnosis.loops.loops import loops_at
from oarlock.diagnosis.loops.uniqueness import find_uniqueness
from oarlock.diagnosis.loops.wrenches import wrenches
from oarlock.mechanics.load import load_model
from oarlock.poses.assembly import Assembly

VIRTUAL_WORK = 1e-12
"""Nm or N per unit multiplier, on mechanisms of 1 m: the same sums in another order, 4e-16 (measured)."""

AGREES = 1e-9
"""Relative to the largest multiplier. Two splits of one force: rounding times the condition of A, 1e3."""

DIFFERS = 1e-3
"""Of the largest part: what is free differs by tenths between null vectors drawn at random."""

STILL = 1e-6
"""rad. A direction that is fixed in its frame, on poses closed to 1e-12."""

SAMPLED = 0.5
"""Degrees. Which poses are looked at moves the average that directions turn about."""

NAMES = [name for model in model_names() for name in variant_names(model)]
WALKED = [name for name in NAMES if int(load_case(name).expected()["nv"]) <= 30]
MOTION_S = 0.5


def compiled(xml):
    return mujoco.MjModel.from_xml_string(xml)


@pytest.fixture(scope="module")
def moving():
    """Name of a case → model, start, poses and MuJoCo's own multipliers along its own walk, every 10 ms."""
    known = {}

    def give(name):
        if name not in known:
            case, model, start, data = at_start(name)
            model.opt.timestep = case.file.run.timestep_s or model.opt.timestep
            every = max(1, round(0.01 / model.opt.timestep))
            count = min(50, round(MOTION_S / model.opt.timestep / every))
            poses, forces = np.zeros((count, model.nq)), np.zeros((count, start.rows))
            for at in range(count):
                mujoco.mj_forward(model, data)
                poses[at], forces[at] = data.qpos, data.efc_force[: data.ne]
                mujoco.mj_step(model, data, every)
            known[name] = model, start, poses, forces
        return known[name]

    return give


def known(value):
    """What is there; not None."""
    assert value is not None
    return value


# Where multipliers act.


@pytest.mark.parametrize("name", ["tangle", *WALKED])
@pytest.mark.parametrize("seed", range(3))
def test_virtual_work(name, seed):
    """Jᵀλ is what the forces and torques do, applied by MuJoCo at the bodies, in any pose, open or closed."""
    case = None if name == "tangle" else load_case(name)
    model = load_model(case.model_path, case.parameters) if case else compiled(TANGLE)
    assembly = Assembly(model)
    pose = model.qpos0.copy()
    mujoco.mj_integratePos(model, pose, 0.3 * np.random.default_rng(seed).normal(size=model.nv), 1.0)
    assembly.place(pose)
    jacobian = assembly.jacobian()
    assert np.abs(jacobian).max() > (1e-3 if name == "cable_finger" else 0.01)  # it has pulleys of 10 mm
    for number in range(len(assembly.equalities)):
        rows = assembly.rows_of(number)
        for column, row in enumerate(range(rows.start, rows.stop)):
            work = np.zeros(model.nv)
            for one in body_wrenches(assembly, number):
                force, torque = one.force[:, column].copy(), one.torque[:, column].copy()
                mujoco.mj_applyFT(assembly.model, assembly.data, force, torque, one.point, one.body, work)
            assert np.abs(work - jacobian[row]).max() <= VIRTUAL_WORK * max(1.0, np.abs(jacobian[row]).max())


# Which are unique.


def parts(found, *names):
    """Unique, free and idle directions of the force and of the torque of a reaction."""
    (one,) = [one for one in found if one.names == names]
    return tuple((part.unique, part.free, part.idle) if part else None for part in (one.force, one.torque))


@pytest.mark.parametrize("name", WALKED)
def test_equalities_are_unique_where_their_multipliers_are(name, moving):
    model, start, poses, _ = moving(name)
    found = find_uniqueness(model, poses)
    assert found.poses >= len(np.unique(np.linspace(0, len(poses) - 1, 24).astype(int))) - 2
    assert {one.names[0]: one.unique for one in found.equalities} == start.unique


@pytest.mark.parametrize(
    ("name", "mechanism", "modelling", "idle"),
    [
        ("bricard", 1, 1, 0),  # 30 / 1 / 1 in maximal coordinates
        ("sarrus", 1, 1, 0),  # 30 / 1 / 1
        ("sarrus:legs=3", 4, 2, 0),  # 45 / 1 / 4
        ("bennett", 3, 1, 0),  # 20 / 1 / 3
        ("triple_crank", 1, 0, 2),  # planar 12 / 1 / 1
        ("stewart", 0, 0, 0),  # 72 / 6 / 0
        ("four_bar", 0, 0, 1),
        ("n_four_bar:connects=2", 0, 2, 6),  # planar 14 of 14
        ("floating_four_bar", 0, 1, 3),  # a four-bar in 3-D: 20 rows, 3 redundant
    ],
)
def test_redundancy_of_the_mechanism_is_that_of_maximal_coordinates(name, mechanism, modelling, idle, moving):
    """Whatever the equalities that close the loops: the tables of the literature count rows of ideal joints."""
    model, start, poses, _ = moving(name)
    (found,) = find_uniqueness(model, poses).redundancy
    assert (found.mechanism, found.modelling, found.idle) == (mechanism, modelling, idle)
    assert mechanism + modelling + idle == start.rows - start.rank


def test_sarrus_all_forces_unique_and_some_torques_not(moving):
    model, _, poses, _ = moving("sarrus")
    found = find_uniqueness(model, poses)
    assert len(found.joints) == 5
    for one in (*found.joints, *found.together):
        assert (known(one.force).free, known(one.torque).free) == (0, 1)
        assert str(one.torque) == "not unique along z of the world"
        assert one.verdict == "partly unique"
    assert parts(found.equalities, "leg2_left") == ((1, 2, 0), None)  # alone it is not even a hinge


def test_bennett_no_reaction_is_unique(moving):
    model, _, poses, _ = moving("bennett")
    found = find_uniqueness(model, poses)
    for one in (*found.equalities, *found.together, *found.joints):
        assert one.verdict == "not unique"
    # Five constraints of a hinge, and not one direction of them is known; about the hinge there is no torque.
    assert parts(found.together, "joint4_near", "joint4_far") == ((0, 3, 0), (0, 2, 1))


def test_bricard_every_hinge_shares_one_wrench(moving):
    model, _, poses, _ = moving("bricard")
    found = find_uniqueness(model, poses)
    for one in (*found.joints, *found.together):
        assert (known(one.force).free, known(one.torque).free) == (1, 1)
        assert known(one.force).turns_rad > 0.1  # no frame holds it still
    assert all(known(one.force).free == 2 for one in found.equalities)


def test_triple_crank_forces_along_the_cranks(moving):
    """Forces α u and β u along the cranks, α (d₂ × u) + β (d₃ × u) = 0: they turn in the world, not in the cranks."""
    model, _, poses, _ = moving("triple_crank")
    found = find_uniqueness(model, poses)
    for one, crank in zip(found.equalities, ("crank2", "crank3"), strict=True):
        assert str(one.force) == f"not unique along z of {crank}"
        assert (known(one.force).unique, known(one.force).idle) == (1, 1)
        assert known(one.force).turns_rad <= STILL
        assert known(one.force).world_turns_rad > 1.0
    for one in found.joints:
        assert known(one.force).free == 1
        assert parts([one], *one.names)[1] == (0, 0, 3)  # hinges of a plane: no torque at all
    assembly = Assembly(model)
    assembly.place(poses[20])
    assembly.close()
    loops = loops_at(assembly)
    in_plane = np.linalg.svd(loops.null[[0, 2, 3, 5]])
    assert in_plane[1][1] <= AGREES  # one direction; the rest of null(Jᵀ) is out of the plane
    null = in_plane[0][:, 0]
    along = np.array([-np.sin(assembly.data.qpos[0]), np.cos(assembly.data.qpos[0])])
    alpha, beta = along @ null[:2], along @ null[2:]
    cross = [x * along[1] - z * along[0] for x, z in ((0.6, 0.0), (0.4, 0.3))]
    assert abs(alpha * cross[0] + beta * cross[1]) <= AGREES
    assert max(abs(alpha), abs(beta)) > 0.1


def test_boat_along_the_oars():
    """Over the paper's 12 s the free direction turns by ±44.5° in the world, and not in the oars."""
    case = load_case("boat")
    setup = setup_of(case, duration_s=12.0)
    data, poses = setup.data(), []
    with setup.drive.installed():
        for step in range(setup.steps):
            if step % 20 == 0:
                poses.append(data.qpos.copy())
            mujoco.mj_step(setup.model, data)
    found = find_uniqueness(setup.model, np.array(poses))
    for one, oar in zip(found.equalities, ("oar2", "oar3"), strict=True):
        assert str(one.force) == f"not unique along y of {oar}"
        assert known(one.force).turns_rad <= STILL
        assert np.degrees(known(one.force).world_turns_rad) == pytest.approx(44.5, abs=SAMPLED)


@pytest.mark.parametrize("name", ["bricard", "bennett", "sarrus", "triple_crank", "boat", "welded_frame", "delta"])
def test_what_is_free_is_what_multipliers_of_one_motion_differ_by(name, moving):
    """Null vectors drawn at random reach every free direction and no unique one, in whatever basis."""
    model, _, poses, _ = moving(name)
    found = find_uniqueness(model, poses[:1])
    assembly = Assembly(model)
    assembly.place(poses[0])
    assembly.close()
    loops = loops_at(assembly)
    drawn = loops.null @ np.random.default_rng(0).normal(size=(loops.null.shape[1], 20))
    for number, one in enumerate(found.equalities):
        wrench = body_wrenches(assembly, number)[0]
        for part, act in ((one.force, wrench.force), (one.torque, wrench.torque)):
            if part is None:
                continue
            vectors = act @ drawn[assembly.rows_of(number)]
            frame = np.eye(3)
            if part.frame != "world":
                frame = assembly.data.xmat[model.body(part.frame).id].reshape(3, 3)
            free = frame @ part.basis
            rest = vectors - free @ (free.T @ vectors)
            plane = loops.groups[0].normal
            if plane is not None:
                rest -= np.outer(plane, plane @ rest)
            assert np.abs(rest).max() <= AGREES
            assert np.linalg.svd(vectors, compute_uv=False)[part.free - 1] > DIFFERS or not part.free


def test_couplings():
    """Of three gears in a circle no tooth's force is known, and the bearings' all are; of two it is."""
    case = load_case("gear_train")
    found = find_uniqueness(load_model(case.model_path))
    assert [one.coupled for one in found.equalities] == [False] * 3
    assert all(one.unique for one in found.joints)
    assert found.redundancy[0].mechanism == 1
    xml = case.model_path.read_text(encoding="utf-8").replace('name="direct_mesh"', 'name="direct_mesh" active="false"')
    assert [one.coupled for one in find_uniqueness(compiled(xml)).equalities] == [True, True]


def test_a_plane_of_its_own():
    """A planar loop that stands askew in the world: idle across its plane, unique in it."""
    turned = four_bar().replace("<worldbody>", '<worldbody><frame euler="0.4 0.3 0.2">')
    found = find_uniqueness(compiled(turned.replace("</worldbody>", "</frame></worldbody>")))
    assert parts(found.equalities, "pin") == ((2, 0, 1), None)
    assert (found.redundancy[0].mechanism, found.redundancy[0].idle) == (0, 1)


def test_directions_are_told_in_the_frame_in_which_they_turn_least():
    def about_z(angle):
        return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])

    angles = np.linspace(0, 1, 11)
    frames = {"world": [np.eye(3)] * 11, "arm": [about_z(x) for x in angles], "hand": [about_z(3 * x) for x in angles]}
    along = told([about_z(x)[:, :1] for x in angles], 0, frames)
    assert (along.unique, along.free, along.frame) == (2, 1, "arm")
    assert along.turns_rad <= STILL
    assert along.world_turns_rad == pytest.approx(0.5, abs=1e-3)
    assert str(along) == "not unique along x of arm"
    across = told([about_z(x)[:, 1:] for x in angles], 0, frames)
    assert str(across) == "not unique across x of arm"
    still = told([np.eye(3)[:, 2:]] * 11, 1, frames)
    assert (still.frame, still.unique, str(still)) == ("world", 1, "not unique along z of the world")


# Over time.


@pytest.mark.parametrize("name", ["boat", "bricard", "sarrus", "welded_frame", "gripper", "cable_loop", "delta"])
def test_two_solutions_of_one_motion_agree_on_what_is_determined(name, moving):
    """MuJoCo's multipliers, and the same with null vectors added; minimum-norm ones have nothing free."""
    model, start, poses, forces = moving(name)
    closed = Assembly(model)
    others, least, works = np.zeros_like(forces), np.zeros_like(forces), np.zeros((len(poses), model.nv))
    rng = np.random.default_rng(0)
    for at, pose in enumerate(poses):
        closed.place(pose)
        closed.close()
        poses[at] = closed.data.qpos
        closed.place(poses[at])
        jacobian = closed.jacobian()
        left = np.linalg.svd(jacobian)[0]
        null = left[:, start.rank :]
        others[at] = forces[at] + null @ rng.normal(size=null.shape[1]) * np.abs(forces[at]).max()
        least[at] = left[:, : start.rank] @ (left[:, : start.rank].T @ forces[at])
        works[at] = jacobian.T @ forces[at]
    scale = np.abs(forces).max()
    for one, two, three in zip(*(wrenches(model, poses, values) for values in (forces, others, least)), strict=True):
        for field in ("force", "torque", "ends"):
            series = [(getattr(each.total, field), getattr(each.free, field)) for each in (one, two, three)]
            if series[0][0] is None:
                continue
            determined = [total - free for total, free in series]
            assert np.abs(determined[0] - determined[1]).max() <= AGREES * scale
            assert np.abs(determined[0] - determined[2]).max() <= AGREES * scale
            assert np.abs(series[2][1]).max() <= AGREES * scale
    if start.rows > start.rank + sum(len(loop.zero_rows) for loop in loops_at(closed).loops):
        free = [w.free for w in wrenches(model, poses, others)]
        assert (
            max(np.abs(s).max() for f in free for s in (f.force, f.torque, f.ends) if s is not None) > DIFFERS * scale
        )


@pytest.mark.parametrize("name", ["welded_frame", "gripper", "cable_loop", "gear_train"])
def test_what_goes_through_does_the_work_of_the_multipliers(name, moving):
    model, _, poses, forces = moving(name)
    assembly = Assembly(model)
    found = wrenches(model, poses, forces)
    for at in range(0, len(poses), 10):
        assembly.place(poses[at])
        work = np.zeros(model.nv)
        for number, one in enumerate(found):
            if one.total.ends is not None:
                loop = loops_at(assembly).loops[number]
                for name_, value in zip(one.ends, one.total.ends[at], strict=True):
                    if loop.equality.kind.name == "joint":
                        work[model.joint(name_).dofadr[0]] += value
                    else:
                        tendon = model.tendon(name_).id
                        first, count = model.ten_J_rowadr[tendon], model.ten_J_rownnz[tendon]
                        entries = assembly.data.ten_J.ravel()[first : first + count]
                        work[model.ten_J_colind[first : first + count]] += value * entries
                continue
            torque = np.zeros(3) if one.total.torque is None else one.total.torque[at]
            ends = body_wrenches(assembly, number)
            for end, sign in zip(ends, (1.0, -1.0), strict=True):
                mujoco.mj_applyFT(
                    assembly.model,
                    assembly.data,
                    sign * known(one.total.force)[at],
                    sign * torque,
                    end.point,
                    end.body,
                    work,
                )
        expected = assembly.jacobian().T @ forces[at]
        assert np.abs(work - expected).max() <= AGREES * np.abs(forces).max()


def test_forces_in_the_frames_of_the_bodies(moving):
    """The pull of a hanging rod is along the world's vertical, and turned in its own frame by how it hangs."""
    xml = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="rod" euler="0 30 0"><freejoint/>
      <geom type="capsule" size="0.02" fromto="0 0 -0.5 0 0 0.5" mass="2"/></body></worldbody><compiler angle="degree"/>
      <equality><connect name="left" body1="rod" anchor="0 0 0.25"/>
      <connect name="right" body1="rod" anchor="0 0 -0.25"/></equality></mujoco>"""
    model = compiled(xml)
    weight = 2 * 9.81
    forces = np.tile([0, 0, weight / 2] * 2, (4, 1))
    left, right = wrenches(model, np.tile(model.qpos0, (4, 1)), forces)
    assert left.ends == ("rod", "world")
    expected = weight / 2 * np.array([-np.sin(np.pi / 6), 0, np.cos(np.pi / 6)])
    np.testing.assert_allclose(left.in_frame(known(left.total.force), 0), np.tile(expected, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(left.in_frame(known(left.total.force), 1), forces[:, :3], atol=1e-12)
    # Along the rod it is for the modelling to say which of the two carries; both carry alike: nothing of it is free.
    np.testing.assert_allclose(known(left.free.force) + known(right.free.force), 0, atol=1e-12)


def test_rows_that_do_not_fit_are_refused(moving):
    model, _, poses, forces = moving("boat")
    with pytest.raises(InputError, match=r"multipliers of the shape \(50, 5\), expected \(50, 6\): poses × rows"):
        wrenches(model, poses, forces[:, :5])
