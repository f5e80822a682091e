"""Options of a run: what is refused, what the keywords are, and what listens."""

import inspect
from dataclasses import fields

import oarlock
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.cases.case import load_case
from oarlock.cases.conditions import Conditions
from oarlock.diagnosis.options import CheckOptions
from oarlock.experiments.modes import ASKABLE
from oarlock.experiments.options import RunOptions
from suites import Heard


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"mode": "dance"}, f"unknown mode 'dance', expected one of: {', '.join(ASKABLE)}"),
        ({"form": "soft"}, "unknown form 'soft', expected one of: matched, hard, both"),
        ({"integrator": "rk5"}, "unknown integrator 'rk5'"),
        ({"stabilisation": "glue"}, "unknown stabilisation 'glue'"),
        ({"stepping": "fast"}, "unknown stepping 'fast', expected one of: auto, native, python"),
        ({"solver": ["pinv", "gauss"]}, "unknown solver 'gauss'"),
        ({"walker": "gauss"}, "unknown solver 'gauss'"),
        ({"timestep": 0.0}, "timestep = 0 s, expected a finite number > 0"),
        ({"duration": float("inf")}, "duration = inf s, expected a finite number > 0"),
        ({"threads": 0}, "threads = 0, expected a whole number ≥ 1"),
        ({"threads": 1.5}, "threads = 1.5, expected a whole number ≥ 1"),
        ({"threads": "2"}, "threads = '2', expected a whole number ≥ 1"),
    ],
)
def test_what_is_refused(asked, said):
    with pytest.raises(InputError) as refused:
        RunOptions(**asked)
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize(("function", "kind"), [(oarlock.run, RunOptions), (oarlock.check, CheckOptions)])
def test_the_fields_are_the_keywords(function, kind):
    shown = inspect.signature(function).parameters
    for one in fields(kind):
        assert shown[one.name].kind is inspect.Parameter.KEYWORD_ONLY
        assert f"        {one.name}: " in kind.__doc__
    assert "keywords" not in shown
    with pytest.raises(InputError, match="unknown argument 'duration_s', expected one of: "):
        function("boat", duration_s=1.0)


def test_keywords_come_on_top_of_options(tmp_path):
    model = write_model(tmp_path / "bar", four_bar())
    options = RunOptions(mode="free", solver="pinv", form="hard", duration=0.02)
    heard = Heard()
    whole = oarlock.run(model, options, progress=heard)
    assert {row["steps"] for row in whole.rows} == {10}
    assert heard.names == [row["run"] for row in whole.rows]
    assert heard.done == heard.ahead == 20
    shorter = oarlock.run(model, options, duration=0.01)
    assert {row["steps"] for row in shorter.rows} == {5}
    assert [row["run"] for row in shorter.rows] == [row["run"] for row in whole.rows]


def test_own_conditions():
    case = load_case("boat")
    run = case.file.run
    assert Conditions().own(case)
    assert Conditions(timestep_s=run.timestep_s, duration_s=run.duration_s).own(case)
    for other in (
        Conditions(timestep_s=1e-5),
        Conditions(duration_s=1.0),
        Conditions(solref_s=0.01),
        Conditions(seed=0),
    ):
        assert not other.own(case)
