"""Where the time of a step goes and how it grows: that the clocks change nothing, and what is made of their figures."""

import json

import numpy as np
import pytest
from oarlock import InputError
from oarlock.bench import growth
from oarlock.bench.growth import PARTS, SOLVERS, STEP, bench_growth, exponent, exponents, parts_us
from oarlock.bench.growth_report import in_words, shares, write_growth_report
from oarlock.bench.steps import BARE, Track
from oarlock.cli.app import main
from oarlock.stepping import native_path

STEPS = 300

UNTIMED = 1e-3
"""Part of a walk that no lap holds: two looks at the clock around thousands, unless something else runs just then."""


@pytest.fixture(scope="module")
def measured():
    return bench_growth((1, 10, 20), rounds=2, steps=40)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("model", ["n_four_bar:N=3,connects=2", "boat", "gear_train"])
def test_the_profiled_walk_ends_where_the_free_run_does(model, solver):
    track = Track(model, STEPS)
    profile = track.profile(solver)()
    qpos, qvel, time_s = profile["state"]
    expected_qpos, expected_qvel, expected_time_s = track.walked(solver).state
    assert np.array_equal(qpos, expected_qpos)
    assert np.array_equal(qvel, expected_qvel)
    assert time_s == expected_time_s
    assert profile["solves"] == STEPS


def test_the_parts_are_the_whole():
    once = Track("n_four_bar:N=5,connects=2", 2000).profile("auto")
    untimed = []
    for _ in range(5):  # one of them is not interrupted between the last lap and the end
        profile = once()
        assert set(profile["parts"]) == set(PARTS)
        whole_ns, parts = profile["whole_ns"], profile["parts"]
        spent_ns = sum(time_ns for time_ns, _ in parts.values())
        assert spent_ns <= whole_ns
        untimed.append(1 - spent_ns / whole_ns)
        # What is taken off is what the looks cost, and leaves every part something.
        looks = sum(looks for _, looks in parts.values())
        taken_us = (spent_ns - looks * profile["look_ns"]) / 2000 / 1e3
        assert sum(parts_us(profile, 2000).values()) == pytest.approx(taken_us)
        assert min(time_ns - looks * profile["look_ns"] for time_ns, looks in parts.values()) > 0
    assert min(untimed) < UNTIMED


def test_looks_at_the_clock_are_counted():
    parts = Track("four_bar", STEPS).profile("auto")()["parts"]
    # The question is asked around W.
    assert {part: looks for part, (_, looks) in parts.items()} == {
        part: STEPS * (2 if part == "question" else 1) for part in PARTS
    }
    parts = Track("four_bar", STEPS).profile("sr1-tracked")()["parts"]
    assert parts["matrix"] == (0, 0)


@pytest.mark.parametrize("power", [0.0, 0.7, 1.0, 2.0, 3.0])
def test_exponents_of_powers_are_found(power):
    sizes = growth.LOOPS
    assert exponent(sizes, [3e-3 * size**power for size in sizes]) == pytest.approx(power, abs=1e-12)
    rng = np.random.default_rng(7)
    noisy = [size**power * np.exp(0.02 * rng.standard_normal()) for size in sizes]
    assert exponent(sizes, noisy) == pytest.approx(power, abs=0.05)


def test_nothing_has_no_exponent():
    assert exponent([10], [1.0]) is None
    assert exponent([1, 2], [0.0, 1.0]) is None


def test_many_loops_have_an_exponent_of_their_own():
    rows = [
        {"name": "auto", "loops": n, "step_us": 100 + n**2, "parts_us": {"solve": n**2, "matrix": 0.0}}
        for n in growth.LOOPS
    ]
    fits = {row["part"]: row for row in exponents(rows)}
    assert list(fits) == [STEP, "solve", "matrix"]
    assert fits[STEP]["all"] < fits[STEP]["many"] < 2
    assert fits["solve"]["all"] == pytest.approx(2)
    assert fits["solve"]["many"] == pytest.approx(2)
    assert fits["matrix"]["all"] is fits["matrix"]["many"] is None


def test_a_row_a_size_and_contender(measured):
    rows = measured["rows"]
    assert [(row["loops"], row["name"]) for row in rows] == [(n, who) for n in (1, 10, 20) for who in (BARE, *SOLVERS)]
    for row in rows:
        assert row["step_us"] > 0
        assert row["velocities"] == 2 * row["loops"] + 1
        if row["name"] == BARE:
            assert row["ratio"] == 1
            assert row["parts_us"] == {}
        else:
            assert list(row["parts_us"]) == list(PARTS)
            assert (row["rows"], row["folded_rows"]) == (6 * row["loops"], 2 * row["loops"])
            assert 0 < row["looks_us"] < row["profiled_us"]
            assert row["unconverged"] == 0
            assert sum(shares(row).values()) == pytest.approx(1)
    assert len(measured["exponents"]) == 1 + len(SOLVERS) * (1 + len(PARTS))
    json.dumps(measured, allow_nan=False)


def test_exponents_in_words():
    assert in_words(1.02) == "like N"
    assert in_words(2.0) == "like N²"
    assert in_words(1.5) == "faster than N, slower than N²"
    assert in_words(3.1) == "faster than N²"


def test_the_page_says_what_was_measured(measured, tmp_path):
    write_growth_report(measured, {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    for name in ("cost", "shares", "parts"):
        assert f"figures/{name}.svg" in text
        assert (tmp_path / "figures" / f"{name}.svg").read_text(encoding="utf-8").startswith("<svg")
    (tables,) = [[line for line in text.splitlines() if line.startswith("| 20 |")]]
    assert len(tables) == 1 + len(SOLVERS)
    assert f"| {measured['inputs']['mujoco']} |" in text
    assert "<svg" not in (tmp_path / "index.html").read_text(encoding="utf-8").partition("<script>")[0]


def test_tables_of_the_page_are_whole(measured, tmp_path):
    write_growth_report(measured, {}, tmp_path)
    lines = (tmp_path / "README.md").read_text(encoding="utf-8").splitlines()
    rules = [number for number, line in enumerate(lines) if line.startswith("|---")]
    assert len(rules) == 3 + len(SOLVERS)
    for number in rules:
        body = [line for line in (lines[number - 1], *lines[number + 1 : number + 4]) if line.startswith("|")]
        assert len(body) >= 3
        assert {line.count("|") for line in body} == {lines[number].count("|")}


def test_without_the_native_path_there_is_nothing_to_time(monkeypatch):
    monkeypatch.setattr(native_path, "refusal", lambda: "another version")
    with pytest.raises(InputError, match="no native stepping: another version"):
        bench_growth((1,), rounds=1, steps=5)


def test_the_command_measures_growth_alone(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(growth, "LOOPS", (1, 2))
    monkeypatch.setattr(growth, "STEPS", 20)
    target = tmp_path / "growth"
    asked = ["oarlock", "bench", "--growth-report", str(target), "--rounds", "1"]
    for more in ([], ["--json", "-"]):
        monkeypatch.setattr("sys.argv", asked + more)
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code in (0, None)
    out, said = capsys.readouterr()
    table, document = out.partition("{")[0], json.loads(out[out.index("{") :])
    assert "MuJoCo's stages" in table
    assert "N = 2" in table
    assert document["rows"] == document["stepping"] == []
    assert {row["loops"] for row in document["growth"]["rows"]} == {1, 2}
    assert (target / "README.md").exists()
    assert str(target) in said
