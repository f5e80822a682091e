"""Problems of a run, as others can read them: they are what a solver is asked, and hold together."""

import json

import numpy as np
import oarlock
import polars as pl
import pytest
from mechanisms import gripper
from oarlock.base.errors import InputError
from oarlock.experiments.problems import COLUMNS

SHORT = {"duration": 0.02}


@pytest.fixture(scope="module")
def boat():
    return oarlock.export_problems("boat", **SHORT)


@pytest.mark.parametrize("form", ["hard", "matched"])
@pytest.mark.parametrize("model", ["boat", "gripping_gripper", "sarrus:cells=2"])
def test_matrices_are_those_of_their_parts_and_answers_solve_them(model, form):
    """A = J M⁻¹ Jᵀ + R and b = aref − J a₀; λ is of the least norm, N spans the null space."""
    problems = oarlock.export_problems(model, form=form, walker="auto" if form == "hard" else "mujoco", **SHORT)
    for step in problems.steps:
        jacobian, mass = step["J"], step["M"]
        matrix = jacobian @ np.linalg.solve(mass, jacobian.T) + np.diag(step["R"])
        scale = np.abs(matrix).max()
        assert np.abs(step["A"] - matrix).max() < 1e-11 * scale
        assert np.allclose(step["b"], step["aref"] - jacobian @ step["a0"], atol=1e-10 * np.abs(step["b"]).max())
        null, multipliers = step["null_space"], step["multipliers"]
        assert np.abs(step["A"] @ null).max(initial=0.0) < 1e-9 * scale
        assert np.allclose(null.T @ null, np.eye(null.shape[1]), atol=1e-12)
        assert step["rank"] + null.shape[1] == step["rows"]
        assert np.abs(null.T @ multipliers).max(initial=0.0) < 1e-7 * max(1.0, np.abs(multipliers).max())
        left = step["A"] @ multipliers - step["b"]
        left -= null @ (null.T @ left)
        assert np.abs(left).max() < 1e-7 * max(1.0, np.abs(step["b"]).max())


def test_the_run_is_that_of_run(boat):
    """The walk at the bottom of the problems is the exact one, projected after every step."""
    steps = oarlock.run("boat", mode="free", form="hard", solver="auto", stabilisation="projection", **SHORT).steps
    qpos = steps.filter(pl.col("mode") == "free")["qpos"].to_list()
    assert np.array_equal([step["qpos"] for step in boat.steps], qpos)


def test_a_file_has_all_of_them(tmp_path, boat):
    arrays = np.load(boat.save(tmp_path / "boat.npz"), allow_pickle=False)
    frame = pl.read_parquet(boat.save(tmp_path / "boat.parquet"))
    head = json.loads(str(arrays["head"]))
    assert head["columns"] == COLUMNS
    assert (head["model"], head["form"], head["walker"]) == ("boat", "hard", "auto")
    assert json.loads(pl.read_parquet_metadata(tmp_path / "boat.parquet")["oarlock"])["columns"] == COLUMNS
    for number, step in enumerate(boat.steps):
        for name, array in step.items():
            assert np.array_equal(arrays[name][number], array)
            assert np.array_equal(np.ravel(frame[name][number]), np.ravel(array))


def test_arrays_whose_shape_changes_are_flat_with_their_starts(tmp_path):
    """A loop that is switched off has no rows for a while."""
    problems = oarlock.export_problems(
        gripper(),
        motion=oarlock.cases.motion.Motion(control={"active:l_pin": "0.01 - t"}),
        duration=0.02,
        walker="mujoco",
    )
    assert {int(step["rows"]) for step in problems.steps} == {4, 7}
    arrays = np.load(problems.save(tmp_path / "switched.npz"))
    starts = arrays["b_start"]
    for number, step in enumerate(problems.steps):
        assert np.array_equal(arrays["b"][starts[number] : starts[number + 1]], step["b"])


def test_every_so_many(boat):
    few = oarlock.export_problems("boat", every=4, **SHORT)
    assert len(few) == -(-len(boat) // 4)
    assert np.array_equal(few.steps[1]["A"], boat.steps[4]["A"])


@pytest.mark.parametrize(
    ("asked", "line"),
    [
        ({"form": "soft"}, "unknown form 'soft'"),
        ({"walker": "nobody"}, "unknown solver 'nobody'"),
        ({"every": 0}, "every = 0, expected a whole number ≥ 1"),
    ],
)
def test_bad_input_is_one_line(asked, line):
    with pytest.raises(InputError, match=line):
        oarlock.export_problems("boat", **SHORT, **asked)


def test_too_much_is_refused(monkeypatch):
    monkeypatch.setattr("oarlock.experiments.problems.BYTES", 10_000)
    with pytest.raises(InputError, match=r"more than 10000 bytes after .* of .* problems, expected a shorter run"):
        oarlock.export_problems("boat", **SHORT)


def test_another_ending_is_refused(tmp_path, boat):
    with pytest.raises(InputError, match=r"expected a file whose name ends in \.npz or \.parquet"):
        boat.save(tmp_path / "boat.csv")


def test_what_was_collected_before_a_run_ends_is_kept():
    """A solver that gives up half-way ends its walk; the problems so far are there."""
    asked = [0]

    def tires(A, b):
        asked[0] += 1
        if asked[0] > 20:
            raise RuntimeError("tired")
        return np.linalg.lstsq(A, b, rcond=1e-10)[0]

    oarlock.register_solver("tires", tires)
    problems = oarlock.export_problems("boat", walker="tires", duration=0.05)
    assert 0 < len(problems) <= 20
    assert "solver 'tires': it raises RuntimeError: tired" in problems.ended
    assert problems.ended.startswith("the run ends at t = 0.0")
