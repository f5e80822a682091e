"""What differs between versions of MuJoCo: the ways of old ones give what the installed one has."""

import mujoco
import numpy as np
import pytest
from mechanisms import TANGLE
from oarlock import InputError
from oarlock.base.text import version_numbers
from oarlock.cases.equality_kinds import KIND_OF
from oarlock.mechanics import engine_version
from oarlock.mechanics.load import load_model


@pytest.fixture
def state():
    model = mujoco.MjModel.from_xml_string(TANGLE)
    data = mujoco.MjData(model)
    data.qvel[:] = np.sin(np.arange(model.nv))
    mujoco.mj_forward(model, data)
    return model, data


def test_versions_are_numbers():
    assert [version_numbers(text) for text in ("3.3.7", "3.17.0", "4.0.1.dev2")] == [(3, 3, 7), (3, 17, 0), (4, 0, 1)]


def test_the_tree_of_the_mass_matrix_is_its_lower_half(state):
    lengths, starts, columns, mass, *_ = engine_version.mass_tree(*state)
    full = engine_version.full_mass(*state)
    found = np.zeros_like(full)
    for row, (length, start) in enumerate(zip(lengths, starts, strict=True)):
        found[row, columns[start : start + length]] = mass[start : start + length]
    np.testing.assert_array_equal(found, np.tril(full))


def test_a_path_says_what_moves_a_tendon(state, monkeypatch):
    """The rows of newer versions may have more: what moves both ends alike."""
    model, data = state
    for tendon in range(model.ntendon):
        along = set(engine_version._dofs_along(model, tendon))
        assert along <= set(engine_version.tendon_dofs(model, tendon))
        length = data.ten_length[tendon]
        for dof in set(range(model.nv)) - along:
            moved, push = mujoco.MjData(model), np.zeros(model.nv)
            push[dof] = 0.1
            mujoco.mj_integratePos(model, moved.qpos, push, 1.0)
            mujoco.mj_fwdPosition(model, moved)
            assert moved.ten_length[tendon] == pytest.approx(length, abs=1e-12), (tendon, dof)


def test_islands_are_switched_both_ways(state):
    model, data = state
    for wanted in (False, True):
        engine_version.set_islands(model, wanted)
        mujoco.mj_forward(model, data)
        assert (data.nisland > 0) == wanted


@pytest.mark.parametrize(("version", "lacking"), [((3, 6, 0), True), ((3, 7, 0), False), ((4, 0, 0), False)])
def test_curvature_of_points_came_with_3_7(version, lacking):
    assert [KIND_OF[name].lacks_curvature(version) for name in ("connect", "weld")] == [lacking] * 2
    assert KIND_OF["joint"].lacks_curvature(version)
    assert not KIND_OF["flex"].lacks_curvature(version)  # there is none that is known


def test_what_an_old_version_does_not_know_is_said_with_its_number(tmp_path, monkeypatch):
    path = tmp_path / "new.xml"
    path.write_text('<mujoco><worldbody><body><joint springwing="1"/></body></worldbody></mujoco>', encoding="utf-8")
    with pytest.raises(InputError, match=r"unrecognized attribute: 'springwing'") as now:
        load_model(path)
    monkeypatch.setattr(engine_version, "VERSION", (3, 5, 0))
    with pytest.raises(InputError, match=rf"; this is MuJoCo {mujoco.__version__}, a newer one may know it$") as old:
        load_model(path)
    assert "\n" not in str(old.value)
    if version_numbers(mujoco.__version__) >= engine_version.NEWEST:
        assert "newer" not in str(now.value)
