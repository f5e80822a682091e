"""Both paths are one thing to those who step: made of the same, asked the same, and the same is got of them."""

import mujoco
import numpy as np
import oarlock.tables.columns
import pytest
from mechanisms import four_bar
from oarlock.base.errors import InputError, RefusedError
from oarlock.cases.case_file import Baumgarte
from oarlock.mechanics.controls import drive
from oarlock.stepping import native_path
from oarlock.stepping.native_path import NativePath
from oarlock.stepping.path import Path
from oarlock.stepping.paths import fitting_path
from oarlock.stepping.prepared import Prepared
from oarlock.stepping.projection import TRACKED
from oarlock.stepping.python_path import PythonPath
from oarlock.stepping.solvers import SolverSpec
from oarlock.tables.figures import COLUMNS, Column

PATHS: list = [NativePath, PythonPath]


def bare(xml: str, crank: float = 1.0, steps: int = 20, laws: dict[str, str] | None = None) -> Prepared:
    """A model that no case is about."""
    model = mujoco.MjModel.from_xml_string(xml)
    return Prepared(model, drive(model, laws or {}), model.qpos0.copy(), np.array([crank, 0.0, 0.0]), steps)


def free(path: Path):
    return path.free(SolverSpec("auto"), "hard", TRACKED)


def test_a_model_without_a_case_walks_on_either():
    tables = []
    for kind in PATHS:
        (steps,), ending = free(kind(bare(four_bar(), crank=0.0), Baumgarte()))
        assert ending is None
        tables.append(steps.frame().drop("step_us", "solve_ns"))
    assert len(tables[0]) == 20
    assert tables[0]["projection"].unique().to_list() == ["landed"]
    assert tables[0].equals(tables[1])


def test_a_run_that_is_not_judged_is_the_same_run():
    """What stands beside it has no part in it."""
    kept = ("qpos", "multipliers", "error_estimate", "drift_pos", "projection_rounds", "rank")
    walked = []
    for kind in PATHS:
        for judged in (True, False):
            path = kind(bare(four_bar()), Baumgarte())
            (steps,), _ = path.free(SolverSpec("auto"), "hard", TRACKED, judged=judged)
            walked.append(steps.frame())
            lacking = walked[-1].select("min_norm_error", "trajectory_diff").null_count().row(0)
            assert lacking == ((0, 0) if judged else (20, 20))
    assert all(frame.select(kept).equals(walked[0].select(kept)) for frame in walked[1:])
    assert walked[1].drop("step_us", "solve_ns").equals(walked[3].drop("step_us", "solve_ns"))


def test_the_native_path_says_why_it_cannot_be_taken(monkeypatch):
    monkeypatch.setattr(native_path, "refusal", lambda: "another MuJoCo")
    with pytest.raises(InputError, match="no native stepping: another MuJoCo"):
        NativePath(bare(four_bar()), Baumgarte())


@pytest.mark.parametrize(("refusal", "expected"), [("", "native"), ("another MuJoCo", "python")])
def test_the_native_path_is_taken_where_it_can_be(monkeypatch, refusal, expected):
    assert native_path.refusal() == ""
    monkeypatch.setattr(native_path, "refusal", lambda: refusal)
    assert fitting_path(bare(four_bar()), Baumgarte()).name == expected


DRIVEN = four_bar(rest='<actuator><motor name="motor" joint="crank"/></actuator>')


@pytest.mark.parametrize(
    ("prepared", "part"),
    [
        (lambda: bare(DRIVEN, 1.0, 500, {"motor": "sqrt(0.01 - t)"}), "expected a finite control"),
    ],
)
def test_both_end_in_the_same_way(prepared, part):
    """Whoever steps gets the rows until then, and what it was; nothing is raised."""
    ends = []
    for kind in PATHS:
        (steps,), ending = free(kind(prepared(), Baumgarte()))
        assert ending is not None
        assert isinstance(ending.error, RefusedError)
        assert part in ending.reason
        ends.append((len(steps), ending.step, ending.time_s, ending.reason))
    assert ends[0] == ends[1]
    assert 0 < ends[0][0] == ends[0][1] < 500


@pytest.mark.parametrize("kind", PATHS)
@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ([*COLUMNS, Column("slip", "float", "new", ("free",))], "a free walk has no column 'slip', expected what"),
        ([one for one in COLUMNS if one.name != "qpos"], "a free walk has a column 'qpos', expected what"),
    ],
)
def test_a_path_that_the_table_of_figures_does_not_describe(monkeypatch, kind, columns, message):
    monkeypatch.setattr(oarlock.tables.columns, "COLUMNS", columns)
    with pytest.raises(InputError, match=message):
        free(kind(bare(four_bar()), Baumgarte()))
