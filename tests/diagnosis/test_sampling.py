"""Sampled states: closed, inside, spread over all that can be reached, with velocities that the rows admit."""

import mujoco
import numpy as np
import oarlock
import pytest
from gallery import at_start
from mechanisms import four_bar, parallelogram, write_model
from oarlock import InputError, model_names, sample
from tolerances import CLOSED

QUICK = ["boat", "cable_finger", "gripping_gripper", "floating_four_bar", "bennett"]
PARTS = 40
"""Of a turn. Every part of an arc that can be reached has a sample, of some ten that would be there on average."""

RATES = 1e-11
"""Relative to the velocity and J: rounding over the smallest singular value of the gallery."""


def require_consistent(model, drawn):
    """As plain MuJoCo sees every state."""
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    single = np.isin(model.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    limited = np.flatnonzero(model.jnt_limited.astype(bool) & single)
    for qpos, qvel in zip(drawn.qpos, drawn.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() <= CLOSED
        rows = data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv)
        scale = np.abs(rows).max() * np.abs(qvel).max()
        assert np.abs(data.efc_vel[: data.ne]).max() <= RATES * scale
        values = qpos[model.jnt_qposadr[limited]]
        assert (model.jnt_range[limited, 0] <= values).all()
        assert (values <= model.jnt_range[limited, 1]).all()
        for tendon in np.flatnonzero(model.tendon_limited):
            assert model.tendon_range[tendon, 0] <= data.ten_length[tendon] <= model.tendon_range[tendon, 1]


def require_model(name, count):
    drawn = sample(name, count, seed=3)
    assert len(drawn) == count
    require_consistent(at_start(name)[1], drawn)
    assert drawn.open.max() <= CLOSED
    assert drawn.singular.min() > 0.0
    assert (drawn.branch == 0).sum() >= count // 2
    assert np.ptp(drawn.qpos, axis=0).max() > 0.05


@pytest.mark.parametrize("name", QUICK)
def test_states_are_consistent_and_inside(name):
    require_model(name, 40)


@pytest.mark.slow
@pytest.mark.parametrize("name", model_names())
def test_a_thousand_states_of_every_model(name):
    require_model(name, 1000)


# Spread.


def compiled(**attributes):
    return mujoco.MjModel.from_xml_string(four_bar(**attributes))


def reachable(least=-np.inf, largest=np.inf, count=7200):
    """By brute force: angles of the crank, and for both ways to assemble whether the rocker (its angle) is in range."""
    crank = np.linspace(-np.pi, np.pi, count, endpoint=False)
    elbow = 0.3 * np.exp(1j * crank)  # z + i x: turning about y adds to its angle
    pivot, coupler, rocker = 0.7j, 0.2 + 0.5j, 0.5 - 0.2j
    to = pivot - elbow
    far, a, b = np.abs(to), abs(coupler), abs(rocker)
    along = (far**2 + a**2 - b**2) / (2 * far)
    up = np.sqrt(np.maximum(a**2 - along**2, 0.0))
    tips = [elbow + to / far * (along + side * 1j * up) for side in (1, -1)]
    angles = [np.angle((tip - pivot) / rocker) for tip in tips]
    return crank, angles, [(angle >= least) & (angle <= largest) for angle in angles]


def arcs_of(inside):
    """How many pieces a circle's subset is in."""
    changes = int((inside != np.roll(inside, 1)).sum()) // 2
    return changes or int(inside.all())


@pytest.mark.parametrize(("least", "largest"), [(None, None), (-0.4, 0.3), (-0.2, 2.0)])
def test_samples_cover_what_brute_force_reaches(least, largest):
    limits = {} if least is None else {"rocker": f'range="{least} {largest}"'}
    crank, _, inside = reachable(*(() if least is None else (least, largest)))
    drawn = sample(compiled(**limits), 800, seed=0)
    # Whether a sample is one way or the other: the side of the coupler's tip.
    elbow, tip = 0.3 * np.exp(1j * drawn.qpos[:, 0]), None
    tip = elbow + (0.2 + 0.5j) * np.exp(1j * drawn.qpos[:, :2].sum(axis=1))
    way = np.where(((tip - elbow) / (0.7j - elbow)).imag > 0, 0, 1)
    turned = np.angle(np.exp(1j * drawn.qpos[:, 0]))
    assert sum(map(arcs_of, inside)) == len(np.unique(drawn.branch))
    for side, reached in enumerate(inside):
        part = np.floor((crank + np.pi) / (2 * np.pi) * PARTS)
        full = [number for number in range(PARTS) if reached[part == number].all()]
        hit = np.unique(np.floor((turned[way == side] + np.pi) / (2 * np.pi) * PARTS))
        assert set(full) <= set(hit.tolist())
    assert len({(label, side) for label, side in zip(drawn.branch.tolist(), way.tolist(), strict=True)}) == len(
        np.unique(drawn.branch)
    )


def test_a_branch_is_filled_evenly():
    """The share of every eighth of the arc length that a branch has, in the metric of the walk: an eighth."""
    drawn = sample(compiled(), 2000, seed=1, branches="start")
    assert set(drawn.branch) == {0}
    crank, angles, _ = reachable()
    side = int(np.argmin([np.abs(angle[len(crank) // 2]) for angle in angles]))  # the start: all angles are 0
    rocker = np.unwrap(angles[side])
    pivot, elbow = 0.7j, 0.3 * np.exp(1j * crank)
    tip = pivot + (0.5 - 0.2j) * np.exp(1j * rocker)
    coupler = np.unwrap(np.angle((tip - elbow) / (0.2 + 0.5j)) - crank)
    steps = np.sqrt(np.gradient(crank) ** 2 + np.gradient(coupler) ** 2 + np.gradient(rocker) ** 2)
    length = np.cumsum(steps)
    at = np.interp(np.angle(np.exp(1j * drawn.qpos[:, 0])), crank, length) / length[-1]
    shares = np.histogram(at, bins=8, range=(0, 1))[0] / len(at)
    assert np.abs(shares - 0.125).max() < 0.04  # neighbours on a walk are not independent: 2000 count as some 400


def test_a_range_that_divides_a_branch_divides_it():
    """No walk passes a limit: the crank turns half way round either way, and not over the top."""
    drawn = sample(compiled(rocker='range="-0.4 0.3"'), 200, seed=0, branches="start")
    assert drawn.qpos[:, 2].min() >= -0.4
    assert drawn.qpos[:, 2].max() <= 0.3
    assert drawn.coverage["filled"].min() > 0.9


# The same again, and what is beside positions.


def test_a_seed_gives_the_same_bits_and_another_others(tmp_path):
    one, two, other = (sample("boat", 20, seed=seed) for seed in (5, 5, 6))
    for name in ("qpos", "qvel", "branch", "singular"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert (one.qpos != other.qpos).any()
    files = [drawn.save(tmp_path / f"{number}.npz") for number, drawn in enumerate((one, two))]
    assert files[0].read_bytes() == files[1].read_bytes()
    kept = np.load(files[0])
    np.testing.assert_array_equal(kept["qpos"], one.qpos)
    assert kept["coordinates"].tolist() == list(one.coordinates)
    arrays = {"qpos", "qvel", "branch", "singular", "open", "depth"}
    assert set(kept) == {*arrays, "coordinates", "speeds", "model", "seed", "energy"}


def test_kinetic_energy_is_shared_evenly():
    """A mean of ½ kT for each degree of freedom, whatever it weighs: 3 % of 1 500 draws, thrice."""
    arm = '<body pos="0.2 0 0"><joint/><geom type="sphere" size="0.05"/></body>'
    model = compiled(body=arm)
    drawn = sample(model, 1500, seed=0)
    data, mass, energies = mujoco.MjData(model), np.zeros((model.nv, model.nv)), []
    for qpos, qvel in zip(drawn.qpos, drawn.qvel, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, mass)
        energies.append(0.5 * qvel @ mass @ qvel)
    dof = 2
    assert np.mean(energies) / dof == pytest.approx(drawn.energy, rel=0.09)
    rest = sample(model, 10, seed=0, speed=0.0)
    assert (rest.qvel == 0.0).all()
    np.testing.assert_array_equal(rest.qpos, sample(model, 10, seed=0, speed=7.0).qpos)


def test_the_distance_from_a_singular_pose_is_known():
    """Of a parallelogram, which is singular where it lies flat: the singular value that is lost there."""
    model = mujoco.MjModel.from_xml_string(parallelogram())
    drawn = sample(model, 300, seed=0)
    data, lost = mujoco.MjData(model), []
    for pose in drawn.qpos:
        data.qpos[:] = pose
        mujoco.mj_fwdPosition(model, data)
        lost.append(np.linalg.svd(data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv))[1][1])
    np.testing.assert_allclose(drawn.singular, lost / np.median(lost), rtol=1e-9)
    assert drawn.singular.min() < 0.05
    assert drawn.branches["singular_least"].min() == drawn.singular.min()


def test_bodies_in_one_another_are_told(tmp_path):
    xml = four_bar().replace('contype="0" conaffinity="0"', "")
    path = write_model(tmp_path, xml)
    drawn = sample(path, 60)
    assert (drawn.depth > 0).any()
    assert "in one another" in drawn.said()
    assert drawn.document()["touching"] == int((drawn.depth > 0).sum())


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"n": 0}, "n = 0, expected a whole number ≥ 1"),
        ({"seed": 1.5}, "seed = 1.5, expected a whole number"),
        ({"speed": -1}, "speed = -1, expected a finite number ≥ 0"),
        ({"branches": "some"}, "branches = 'some', expected 'all' or 'start'"),
    ],
)
def test_bad_input_is_a_line(asked, message):
    with pytest.raises(InputError, match=message):
        sample("four_bar", **asked)


def test_a_model_that_cannot_move_or_close_is_refused():
    locked = four_bar(rest='<equality><joint joint1="crank"/></equality>')
    with pytest.raises(InputError, match="0 degrees of freedom"):
        sample(mujoco.MjModel.from_xml_string(locked))
    with pytest.raises(InputError, match="no pose near the start closes the loops"):
        sample(compiled(pivot="2 0 0"))


def test_the_command_says_what_it_did(oarlock_here, tmp_path):
    said = oarlock_here("sample", "four_bar", "-n", "20", "-o", "poses.npz", "--report", "page", "--json", "out.json")
    assert said.returncode == 0
    assert "20 consistent states of four_bar" in said.stdout
    assert len(np.load(tmp_path / "poses.npz")["qpos"]) == 20
    assert "| crank |" in (tmp_path / "page" / "README.md").read_text(encoding="utf-8")
    assert oarlock_here("sample", "four_bar", "-n", "0").returncode == 2


def test_it_is_an_answer_like_others():
    drawn = sample("four_bar", 10)
    assert isinstance(drawn, oarlock.Answer)
    assert set(drawn.frames) == {"states", "branches", "coverage"}
    assert drawn.states.height == 10
    assert "<table>" in drawn._repr_html_()


def test_it_begins_where_every_command_does():
    """The first keyframe, the one that is asked for, or the model's own pose."""
    key = '<keyframe><key name="up" qpos="0.4 0 0"/><key name="down" qpos="-0.4 0 0"/></keyframe>'
    model = compiled(rest=key, joint='range="-0.6 0.6"', rocker='limited="false"')
    near = {name: sample(model, 5, keyframe=name, branches="start", speed=0.0) for name in (None, "up", "down", "none")}
    np.testing.assert_array_equal(near[None].qpos, near["up"].qpos)
    assert (near["down"].qpos != near["up"].qpos).any()
    assert (near["none"].qpos != near["up"].qpos).any()
    with pytest.raises(InputError, match="expected one of: up, down"):
        sample(model, 5, keyframe="left")


def test_a_steep_coupling_is_closed_to_rounding():
    """A screw of 0.5 mm a turn: its row is 12 566 times as long as that of a hinge."""
    nut = '<body pos="2 0 0"><joint name="nut" type="slide" axis="1 0 0"/><geom type="sphere" size="0.01"/></body>'
    turn = '<body pos="3 0 0"><joint name="screw"/><geom type="sphere" size="0.01"/></body>'
    steep = '<equality><joint joint1="screw" joint2="nut" polycoef="0 12566.37 0 0 0"/></equality>'
    xml = four_bar(rest=steep).replace("</worldbody>", f"{nut}{turn}</worldbody>")
    drawn = sample(mujoco.MjModel.from_xml_string(xml), 60)
    assert drawn.open.max() <= CLOSED
    assert np.ptp(drawn.qpos[:, -1]) > 1.0  # the screw turns
