"""Solvers that a user brings along: in every experiment, held to their word, wrong ones in one line."""

import numpy as np
import oarlock
import polars as pl
import pytest
from mechanisms import four_bar
from oarlock.base import core
from oarlock.base.errors import InputError
from oarlock.cases.case import NO_CODE
from oarlock.stepping.solvers import SolverSpec, solver_names

XML = four_bar()


def least_squares(A, b):
    return np.linalg.lstsq(A, b, rcond=1e-10)[0]


class Counts:
    """Carries how often it was asked, and says it as its iterations."""

    def __init__(self):
        self.asked = 0

    def solve(self, A, b):
        self.asked += 1
        return np.linalg.pinv(A, hermitian=True) @ b, self.asked


def test_it_stands_in_a_lockstep_report_beside_ours(tmp_path):
    oarlock.register_solver("least-squares", least_squares, "by LAPACK")
    assert core.solvers()["least-squares"] == ("by LAPACK", {})
    results = oarlock.run(XML, solver=["least-squares", "pinv"], duration=0.02)
    rows = {row["run"]: row for row in results.summary.to_dicts()}
    for mode in ("lockstep-hard-along-mujoco", "lockstep-matched-along-mujoco", "free-hard"):
        theirs = next(row for run, row in rows.items() if run.startswith(f"{mode}-least-squares"))
        assert theirs["status"] == "done"
        assert theirs["min_norm_error_max"] < 1e-8
    (page,) = results.report(tmp_path).glob("*.md")
    assert "least-squares" in page.read_text()


@pytest.mark.parametrize("path", ["native", "python"])
def test_one_of_a_class_carries_what_it_likes_and_begins_anew_with_every_run(path):
    oarlock.register_solver("counts", Counts)
    asked = {"mode": "free", "form": "hard", "integrator": "euler", "duration": 0.02}
    for _ in range(2):
        steps = oarlock.run(XML, solver="counts", stepping=path, **asked).steps
        iterations = steps.filter(pl.col("solver") == "counts")["iterations"].to_list()
        assert iterations == list(range(1, len(iterations) + 1))
    solver = oarlock.make_solver("counts")
    matrix, rhs = np.diag([1.0, 2.0]), np.array([1.0, 4.0])
    assert [solver.solve(matrix, rhs)[1].iterations for _ in range(2)] == [1, 2]
    twin = solver.clone()
    assert (twin.solve(matrix, rhs)[1].iterations, solver.solve(matrix, rhs)[1].iterations) == (3, 3)
    solver.reset()
    x, info = solver.solve(matrix, rhs)
    assert np.array_equal(x, [1.0, 2.0])
    assert info.iterations == 1


def test_a_wrong_answer_is_not_taken_at_its_word():
    oarlock.register_solver("twice", lambda A, b: 2.0 * least_squares(A, b))
    _, info = oarlock.make_solver("twice").solve(np.diag([1.0, 2.0]), np.array([1.0, 4.0]))
    assert info.status == "inaccurate"
    for value in (np.nan, np.inf):
        oarlock.register_solver("unbounded", lambda A, b, value=value: np.array([b[0], value]))
        with pytest.raises(
            InputError, match=rf"(?i)solver 'unbounded': it gives x\[1\] = {value}, expected finite numbers"
        ):
            oarlock.make_solver("unbounded").solve(np.eye(2), np.ones(2))


def giving_up(after):
    """A solver that answers so many times and then raises; made anew it counts from 0."""

    class GivesUp:
        def __init__(self):
            self.asked = 0

        def solve(self, A, b):
            self.asked += 1
            if self.asked > after:
                raise ValueError(f"no more than {after}")
            return least_squares(A, b)

    return GivesUp


@pytest.mark.parametrize("path", ["native", "python"])
@pytest.mark.parametrize("mode", ["lockstep", "one-step"])
def test_one_that_gives_up_ends_its_own_runs_alone(path, mode):
    oarlock.register_solver("five", giving_up(5))
    oarlock.register_solver("three", giving_up(3))
    asked = {"mode": mode, "duration": 0.04, "stepping": path}
    results = oarlock.run(XML, solver=["five", "pinv", "three", "auto"], **asked)
    rows = {(row["form"], row["solver"]): row for row in results.rows if row["mode"] == mode}
    assert len(rows) == 8
    for (_, solver), row in rows.items():
        if solver in ("pinv", "auto"):
            assert (row["status"], row["steps_done"]) == ("done", 20)
        else:
            assert row["status"] == "diverged"
            assert f"solver '{solver}': it raises ValueError: no more than" in row["message"]
            assert 0 < row["steps_done"] < 20
    alone = oarlock.run(XML, solver=["pinv", "auto"], **asked)
    for row, steps in zip(alone.rows, alone.tables, strict=True):
        beside = next(
            table for one, table in zip(results.rows, results.tables, strict=True) if one["run"] == row["run"]
        )
        same = ["step", "qpos", "residual", "multipliers"]
        assert beside.select(same).collect().equals(steps.select(same).collect())


def test_one_that_walks_and_gives_up_ends_all_that_walk_along():
    oarlock.register_solver("seven", giving_up(7))
    results = oarlock.run(XML, solver=["pinv", "seven"], walker="seven", mode="lockstep", form="hard", duration=0.04)
    rows = [row for row in results.rows if row["mode"] == "lockstep"]
    assert [row["status"] for row in rows] == ["diverged"] * 2
    assert all("solver 'seven'" in row["message"] for row in rows)
    walked = oarlock.run(XML, solver="pinv", walker="seven", mode="lockstep", form="hard", duration=0.01)
    assert walked.provenance["python_solvers"] == "seven"


def raises(A, b):
    raise ZeroDivisionError("no pivot")


@pytest.mark.parametrize(
    ("solver", "line"),
    [
        (lambda A, b: b[:1], r"solver 'own': it gives x of the shape \(1,\), expected 2 numbers"),
        (lambda A, b: None, "solver 'own': it gives x of the shape None, expected 2 numbers"),
        (lambda A, b: (b, "many"), "expected x, or x and a number of iterations"),
        (raises, "solver 'own': it raises ZeroDivisionError: no pivot"),
        (lambda: None, "solver 'own': it raises TypeError: .*takes 0 positional arguments"),
    ],
)
def test_what_it_does_wrong_is_one_line(solver, line):
    oarlock.register_solver("own", solver)
    with pytest.raises(InputError, match=line):
        oarlock.make_solver("own").solve(np.eye(2), np.ones(2))


@pytest.mark.parametrize("path", ["native", "python"])
@pytest.mark.parametrize("asked", [{"mode": "free"}, {"mode": "lockstep"}, {"mode": "lockstep", "walker": "own"}])
@pytest.mark.parametrize(
    "solver", [lambda A, b: b[:1], lambda A, b: b * np.nan, raises], ids=["shape", "nan", "raises"]
)
def test_one_that_never_answers_costs_its_own_runs_alone(path, asked, solver, tmp_path):
    oarlock.register_solver("own", solver)
    given = {**asked, "form": "hard", "duration": 0.01, "stepping": path, "out": tmp_path / "results"}
    results = oarlock.run(XML, solver=["own", "pinv"], **given)
    rows = {row["solver"]: row for row in results.rows if row["mode"] == asked["mode"]}
    assert (rows["own"]["status"], rows["own"]["steps_done"]) == ("diverged", 0)
    assert rows["own"]["message"].startswith("step 0, t = 0 s: solver 'own': it ")
    along = asked.get("walker") == "own"
    assert (rows["pinv"]["status"], rows["pinv"]["steps_done"]) == (("diverged", 0) if along else ("done", 5))
    page = results.report(tmp_path / "page")
    assert "solver 'own': it " in (page / "index.html").read_text(encoding="utf-8")
    assert "**Called in Python:** own. Every solve is a call" in (page / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "solver", "line"),
    [
        ("pinv", least_squares, "name = 'pinv', expected"),
        ("mujoco", least_squares, "name = 'mujoco', expected"),
        ("a/b", least_squares, "name = 'a/b', expected"),
        ("own", 3, "a function of A and b"),
        ("own", int, "class int has no method 'solve'"),
    ],
)
def test_what_cannot_be_registered_is_one_line(name, solver, line):
    with pytest.raises(InputError, match=line):
        oarlock.register_solver(name, solver)


def test_it_has_no_options():
    oarlock.register_solver("own", least_squares)
    with pytest.raises(InputError, match="solver 'own' has no options"):
        oarlock.make_solver("own", eps=1.0)
    with pytest.raises(InputError, match=r"expected one of: .*, own"):
        oarlock.make_solver("owm")


def test_the_command_takes_a_module_and_a_name(tmp_path, monkeypatch):
    (tmp_path / "mysolvers.py").write_text(
        "import numpy as np\n\ndef direct(A, b):\n    return np.linalg.lstsq(A, b, rcond=1e-10)[0]\n"
    )
    monkeypatch.chdir(tmp_path)
    spec = SolverSpec.parse("mysolvers:direct")
    assert str(spec) == "mysolvers.direct"
    assert "mysolvers.direct" in solver_names()
    results = oarlock.run(XML, mode="free", form="hard", solver="mysolvers:direct", duration=0.01)
    assert results.summary.filter(results.summary["solver"] == "mysolvers.direct")["status"].to_list() == ["done"]
    for text, line in (
        ("mysolvers:missing", "solver 'mysolvers:missing': AttributeError"),
        ("nosuchmodule:f", "solver 'nosuchmodule:f': ModuleNotFoundError"),
    ):
        with pytest.raises(InputError, match=line):
            SolverSpec.parse(text)
    monkeypatch.setenv(NO_CODE, "1")
    with pytest.raises(InputError, match="is code, which --no-code"):
        SolverSpec.parse("mysolvers:direct")
