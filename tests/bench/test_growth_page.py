"""The page of a growth and its command: that they say what was measured, and what was not."""

import copy
import dataclasses
import json

import pytest
from oarlock.bench import families, growth, measurement
from oarlock.bench.budget import Budget
from oarlock.bench.growth import PROFILED, SOLVERS
from oarlock.bench.growth_report import write_growth_report
from oarlock.bench.measurement import measure
from oarlock.bench.standings import in_words
from oarlock.cli.app import main

JUDGED = (("net:k=2",), ("n_four_bar:N=2",))


def few(name, *sizes):
    return dataclasses.replace(families.families([name])[0], sizes=sizes)


@pytest.fixture(scope="module")
def measured():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(growth, "steps_for", lambda step_s: 20)
        return measure([few("chain-twice", 1, 10), few("coupler", 3, 4)], 1, Budget(60.0), judged=JUDGED)


@pytest.fixture
def text(measured, tmp_path):
    write_growth_report(measured, {}, tmp_path)
    return (tmp_path / "README.md").read_text(encoding="utf-8")


def test_the_page_says_what_was_measured(measured, text, tmp_path):
    for name in ("ratios", "shares"):
        assert f"figures/{name}.svg" in text
        assert (tmp_path / "figures" / f"{name}.svg").read_text(encoding="utf-8").startswith("<svg")
    rows = {(row["family"], row["size"], row["name"]): row for row in measured["rows"]}
    for solver in SOLVERS:
        row = rows["chain-twice", 10, solver]
        assert f"| {row['ratio']:.2f} / {row['ratio_to_fastest']:.2f} |" in text
    assert "Everything was walked." in text
    assert f"| {measured['inputs']['mujoco']} |" in text
    assert "<svg" not in (tmp_path / "index.html").read_text(encoding="utf-8").partition("<script>")[0]
    states = [line for line in text.splitlines() if line.startswith("| n_four_bar:N=2 |")]
    assert len(states) == 2 * 4
    assert sum("rank 2" in line for line in states) == 2  # the rank cut takes two of four away at 1e-6 rad
    json.dumps(measured, allow_nan=False)


def test_tables_of_the_page_are_whole(measured, text):
    lines = text.splitlines()
    rules = [number for number, line in enumerate(lines) if line.startswith("|---")]
    # Standings, auto; costs and exponents a family; parts a solver and MuJoCo's; errors twice, memory, provenance.
    assert len(rules) == 2 + 2 * len(measured["families"]) + len(PROFILED) + 1 + 2 + 1 + 1
    for number in rules:
        body = [lines[number - 1]]
        for line in lines[number:]:
            if not line.startswith("|"):
                break
            body.append(line)
        assert len(body) >= 3
        assert len({line.rstrip().count("|") for line in body}) == 1, body[:3]


def test_what_is_wrong_without_a_word_is_named(measured, tmp_path):
    wrong = copy.deepcopy(measured)
    (row,) = (row for row in wrong["errors"] if (row["model"], row["name"]) == ("net:k=2", "pinv"))
    row["multipliers"] = 0.25
    write_growth_report(wrong, {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    (named,) = (line for line in text.splitlines() if line.startswith("- multipliers: "))
    assert "pinv at net:k=2, generic (2e-01)" in named
    assert "- acceleration: none." in text
    row["status"] = "inaccurate"
    write_growth_report(wrong, {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "2e-01, inaccurate" in text
    assert "pinv at net:k=2" not in text


def test_what_was_not_walked_has_no_figure_and_is_said(measured, tmp_path):
    less = copy.deepcopy(measured)
    for row in less["rows"]:
        if (row["family"], row["name"]) == ("coupler", "sr1-tracked") or (row["size"], row["name"]) == (10, "pinv"):
            row |= dict.fromkeys(growth.FIGURES) | {"parts_us": {}, "left_out": "10 ms a step, too long"}
    less["exponents"] = growth.exponents(less["rows"])
    write_growth_report(less, {}, tmp_path)
    text = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "- coupler, `n_crank:K=3`: sr1-tracked: 10 ms a step, too long." in text
    assert "- chain-twice, `n_four_bar:N=10,connects=2`: pinv: 10 ms a step, too long." in text
    assert "Everything was walked." not in text


def test_exponents_in_words():
    assert in_words(1.02) == "like N"
    assert in_words(2.0) == "like N²"
    assert in_words(1.5) == "faster than N, slower than N²"
    assert in_words(3.1) == "faster than N²"


def test_the_command_measures_growth_alone(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(families, "FAMILIES", (few("chain", 1, 2), few("coupler", 3)))
    monkeypatch.setattr(growth, "steps_for", lambda step_s: 20)
    monkeypatch.setattr(measurement, "bench_errors", lambda *_: [])
    target = tmp_path / "growth"
    asked = ["oarlock", "bench", "--growth-report", str(target), "--family", "chain", "--rounds", "1", "--budget", "60"]
    for more in ([], ["--json", "-"]):
        monkeypatch.setattr("sys.argv", asked + more)
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code in (0, None)
    out, said = capsys.readouterr()
    table, document = out.partition("{")[0], json.loads(out[out.index("{") :])
    assert "exponent" in table
    assert "n_four_bar:N=2" in table
    assert document["rows"] == document["stepping"] == []
    assert {(row["family"], row["size"]) for row in document["growth"]["rows"]} == {("chain", 1), ("chain", 2)}
    assert (target / "README.md").exists()
    assert str(target) in said


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--family", "nets"], "unknown family 'nets', expected one of: chain, "),
        (["--growth", "--budget", "0"], "budget = 0.0 s, expected a positive number"),
        (["--growth", "--budget", "nan"], "budget = nan s, expected a positive number"),
    ],
)
def test_bad_requests_are_one_line(arguments, expected, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["oarlock", "bench", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
