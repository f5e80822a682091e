"""The table of steps side by side: who takes part, and what the ratios are of. No times are tested."""

import json

import pytest
from oarlock import InputError
from oarlock.bench.steps import BARE, CONTACTS, EXACT, PROJECTED, RUNS, Track, bench_stepping
from oarlock.cli.app import main
from oarlock.stepping import native_path
from oarlock.stepping.python_path import PythonPath
from oarlock.stepping.solvers import SolverSpec


def test_everyone_takes_part():
    (table,) = bench_stepping(["boat"], rounds=2, steps=30)
    by_name = {row["name"]: row for row in table}
    assert len(by_name) == len(table)
    assert by_name[BARE]["ratio"] == 1
    assert all(row["step_us"] > 0 and row["ratio"] > 0 for row in table)
    for part in ("exact free run, auto", "exact free run, sr1-tracked", "lockstep", "Python path", "on all cores"):
        assert any(part in name for name in by_name), part
    assert {row["name"] for row in table if row["speedup"]} == {
        f"{RUNS} runs, on all cores",
        f"{RUNS} runs of {BARE}, on all cores",
    }
    # Of MuJoCo's settings one is the fastest, by the median.
    bare = [row for row in table if row["name"].startswith(BARE)]
    assert min(row["step_us"] for row in bare) == pytest.approx(
        next(row["step_us"] for row in bare if row["ratio_to_fastest"] == 1)
    )


@pytest.mark.parametrize("model", CONTACTS)
def test_a_step_with_contacts_is_timed_beside_mj_step_at_its_default_tolerance(model):
    (table,) = bench_stepping([model], rounds=1, steps=5, names=(BARE, EXACT, PROJECTED))
    assert [row["name"] for row in table] == [BARE, EXACT, PROJECTED]
    assert Track(model, 5).model.opt.tolerance == 1e-8


class Watched:
    """A solver, with how many others its answers took."""

    def __init__(self, own):
        self._own, self.fallbacks = own, []

    def __getattr__(self, name):
        return getattr(self._own, name)

    def solve_system(self, *given):
        answer = self._own.solve_system(*given)
        self.fallbacks.append(answer[1].fallbacks)
        return answer


def test_a_tower_whose_tendons_come_open_stays_with_the_sparse_factor():
    """From the 59th step on what is dropped has come near the shift that the first step chose."""
    track, made = Track("tensegrity:cells=20", 80), []

    def make(spec: SolverSpec) -> Watched:
        made.append(Watched(track.solver(spec.name)))
        return made[-1]

    PythonPath(track.prepared(), track.terms, make).free(SolverSpec("auto"), "hard", None, judged=False)
    fallbacks = [count for one in made for count in one.fallbacks]
    assert len(fallbacks) >= 80
    assert not any(fallbacks)


def test_without_the_native_path_there_is_nothing_to_time(monkeypatch):
    monkeypatch.setattr(native_path, "refusal", lambda: "another version")
    with pytest.raises(InputError, match="no native stepping: another version"):
        list(bench_stepping(["boat"], rounds=1, steps=5))


def test_the_command_writes_json_alone(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["oarlock", "bench", "--model", "four_bar", "--rounds", "1", "--json", "-"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None)
    document = json.loads(capsys.readouterr().out)
    assert document["rows"] == []
    assert {row["model"] for row in document["stepping"]} == {"four_bar"}
