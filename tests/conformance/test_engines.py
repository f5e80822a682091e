"""Engines that are really there, each in its environment: slow, and skipped where none was made."""

import pytest
from oarlock.conformance.session import conform
from oarlock.conformance.versions import changes
from oarlock.engines import environments
from oarlock.engines.registry import parse_engine
from tolerances import AT_REST

pytestmark = pytest.mark.slow

STATES = 8


def row_of(tmp_path, model, name):
    """The row of a model and an engine; the test is skipped without its environment."""
    engine = parse_engine(name)
    if environments.find(engine) is None:
        pytest.skip(f"no environment for {name}: {environments.how_to(engine)}")
    (row,) = conform([model], [name], states=STATES, out=tmp_path / "out", jobs=1).rows
    return row


@pytest.mark.parametrize("model", ["four_bar", "stewart", "gripper"])
def test_mjx_leaves_out_the_curvature(tmp_path, model):
    """Found by cause; where nothing moves it agrees to rounding."""
    row = row_of(tmp_path, model, "mjx")
    assert row["cause"] == "jdotv"
    assert row["facts"]["jdotv"] is False
    assert row["qacc_rest"] < AT_REST


@pytest.mark.parametrize(("version", "cause"), [("3.6", "jdotv"), ("3.7", "agrees"), ("4.0", "agrees")])
def test_versions_of_mujoco(tmp_path, version, cause):
    row = row_of(tmp_path, "four_bar", f"mujoco@{version}")
    assert row["cause"] == cause


def test_what_aref_holds_is_measured_where_closed_loops_do_not_show_it(tmp_path):
    """The cranks of this one turn in parallel, so that J̇v is 0 as long as its loops are closed: open states show it."""
    before, after = row_of(tmp_path, "triple_crank", "mujoco@3.6"), row_of(tmp_path, "triple_crank", "mujoco@4.0")
    assert before["qacc_mujoco"] < AT_REST
    assert (before["cause"], after["cause"]) == ("jdotv", "agrees")
    (line,) = changes([before, after])
    assert line.startswith("triple_crank: 3.6.0 → 4.0.0: at the same states no J̇v before, as MuJoCo after; aref of ")
    assert "largest gap 0.000935 → 0.000985" in line


def test_single_precision_is_told_from_formulation(tmp_path):
    """MuJoCo Warp asked once takes J̇v from the call before, and asked twice has it: both within single precision."""
    row = row_of(tmp_path, "four_bar", "mujoco_warp")
    assert row["single"]
    assert "float32" in row["cause"]
    assert "unexplained" not in row["verdict"]
    assert 1e-9 < row["qacc_rest"] < row["allowed"]


@pytest.mark.parametrize("name", ["pinocchio", "exudyn"])
def test_rigid_engines_are_exact(tmp_path, name):
    row = row_of(tmp_path, "four_bar", name)
    assert row["cause"] == "exact"
    assert row["qacc_exact"] < row["allowed"] < row["qacc_mujoco"]


@pytest.mark.parametrize("name", ["drake", "newton"])
def test_readers_are_judged_by_what_they_keep(tmp_path, name):
    row = row_of(tmp_path, "gripper", name)
    assert row["cause"].startswith("reader")
    assert row["difference"] is None
    assert "on import" in row["verdict"]
