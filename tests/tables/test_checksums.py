"""What is kept has checksums: one changed byte, and it is named or done again; none is believed."""

import json
import os
import random
import re
import time

import polars as pl
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError, diff, run
from oarlock import suite as suite_of
from oarlock.batch.suite import plan_suite
from oarlock.report.case_report import write_report
from oarlock.tables import checksums
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import Ledger
from suites import TINY, UNITS

SHARE = 0.02
"""Of the time of a suite: what its checksums may take."""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return write_model(tmp_path_factory.mktemp("case") / "tiny", four_bar(), TINY).parent


@pytest.fixture
def kept(case, tmp_path):
    run(case, out=tmp_path / "kept")
    return tmp_path / "kept"


@pytest.fixture
def suite(case, tmp_path):
    suite_of(case, out=tmp_path / "out", jobs=2)
    return tmp_path / "out"


def unfinished(case, out):
    """Names of the units that a suite would do again."""
    (member,) = plan_suite([str(case)], out).members
    return [unit.name for unit in member.units if not member.ledger.finished(unit.name, unit.digest)]


@pytest.mark.parametrize("indent", [None, 1])
def test_every_changed_byte_of_a_document_shows(indent):
    content = checksums.sealed({"a": [1.5, "0" * 32, {"checksum": "0" * 32}], "ä": None}, indent)
    assert json.loads(content)["a"][0] == 1.5
    assert checksums.holds(content)
    for at in range(len(content)):
        changed = bytearray(content)
        changed[at] ^= 1
        assert not checksums.holds(bytes(changed))
    for cut in range(len(content)):
        assert not checksums.holds(content[:cut])
    assert not checksums.holds(content + b"{}")


def test_one_changed_digit_of_a_ledger_is_done_again(case, suite):
    assert unfinished(case, suite) == []
    path = suite / "tiny" / "units.json"
    text = path.read_text()
    digit = re.search(r'"drift_pos_max": \d', text)
    assert digit
    path.write_text(text[: digit.end() - 1] + str((int(digit[0][-1]) + 1) % 10) + text[digit.end() :])
    assert len(unfinished(case, suite)) == UNITS
    with pytest.raises(InputError, match=r"units\.json' is not what was written"):
        diff(suite, suite)


def test_bytes_inside_a_table_are_done_again_and_named(case, suite):
    path = sorted((suite / "tiny" / "steps").glob("*.parquet"))[0]
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    for at in range(middle, min(middle + 200, len(content) - 1)):
        content[at] ^= 0x55
    path.write_bytes(content)
    assert len(unfinished(case, suite)) == 1
    folder = ResultFolder(suite / "tiny")
    with pytest.raises(InputError, match=r"is not what was written with 'summary.json' \(checksum\)"):
        folder.verified(f"steps/{path.name}")


def test_a_suite_mends_what_was_damaged(case, suite):
    path = sorted((suite / "tiny" / "steps").glob("*.parquet"))[0]
    path.write_bytes(path.read_bytes()[:-1])
    (suite / "tiny" / "summary.json").write_text("{}")
    assert suite_of(case, out=suite, jobs=2).repeated == 1
    assert unfinished(case, suite) == []
    write_report(suite / "tiny", suite / "report")


@pytest.mark.parametrize("name", ["summary.json", "case.json", "sketch.json"])
def test_retyped_json_is_named(kept, tmp_path, name):
    document = json.loads((kept / name).read_text())
    for retyped in (json.dumps(document), json.dumps({k: v for k, v in document.items() if k != "checksum"})):
        (kept / name).write_text(retyped)
        with pytest.raises(InputError, match=name):
            write_report(kept, tmp_path / "report")
        if name != "sketch.json":  # a comparison draws nothing
            with pytest.raises(InputError, match=name):
                diff(kept, kept)


def test_garbled_files_are_never_believed(kept, tmp_path):
    """Bytes changed, cut, added, emptied, at random; each is one line of report and diff, or changes nothing there."""
    chosen = random.Random(0)
    files = [path for path in kept.rglob("*") if path.is_file()]
    for number in range(40):
        path = chosen.choice(files)
        whole = path.read_bytes()
        content = bytearray(whole)
        at = chosen.randrange(len(content))
        match number % 4:
            case 0:
                content[at] ^= 1 << chosen.randrange(8)
            case 1:
                del content[at:]
            case 2:
                content[at:at] = chosen.randbytes(50)
            case _:
                content[at : at + 20] = bytes(len(content[at : at + 20]))
        if bytes(content) == whole:
            continue
        path.write_bytes(content)
        folder = ResultFolder(kept)
        check = folder.read_json if path.suffix == ".json" else folder.verified
        with pytest.raises(InputError):
            check(str(path.relative_to(kept)))
        path.write_bytes(whole)
    write_report(kept, tmp_path / "report")


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("summary.json", lambda path: path.write_text("[" * 100_000), "summary.json"),
        ("summary.json", lambda path: path.write_text("1" * 5_000), "cannot be read"),
        ("summary.json", lambda path: (path.unlink(), os.mkfifo(path)), "regular file"),
        ("case.json", lambda path: (path.unlink(), os.mkfifo(path)), "regular file"),
        ("case.json", lambda path: (path.unlink(), path.mkdir()), "is not a regular"),
        ("summary.json", lambda path: ResultFolder(path.parent).write_json(path.name, {}), "has no 'runs'"),
        ("case.json", lambda path: ResultFolder(path.parent).write_json(path.name, {}), "does not hold"),
        ("sketch.json", lambda path: ResultFolder(path.parent).write_json(path.name, {"a": 1}), "does not hold"),
    ],
)
def test_hostile_folders_are_one_line(kept, tmp_path, name, damage, said):
    damage(kept / name)
    with pytest.raises(InputError, match=said) as caught:
        write_report(kept, tmp_path / "report")
    assert "\n" not in str(caught.value)


def test_a_ledger_that_is_a_pipe_is_done_again(case, suite):
    for name in ("units.json", f"steps/{os.listdir(suite / 'tiny' / 'steps')[0]}"):
        (suite / "tiny" / name).unlink()
        os.mkfifo(suite / "tiny" / name)
    assert len(unfinished(case, suite)) == UNITS
    assert Ledger.read(suite / "tiny").entries == {}


@pytest.mark.parametrize("name", ["res[1]", "res*", "res?", "~", "k=1", "file:", "{a,b}"])
def test_paths_are_no_patterns(case, tmp_path, monkeypatch, name):
    """Beside a folder that the pattern would match, whose figures must not be among its own."""
    monkeypatch.chdir(tmp_path)
    for other in ("res1", "resX"):
        run(case, out=other, mode="free", duration=0.01)
    results = run(case, out=name)
    assert results.folder is not None
    write_report(ResultFolder(results.folder).path, tmp_path / name / "report")
    folder = ResultFolder(results.folder)
    for row in results.rows:
        table = folder.read_steps(row["run"])
        assert len(table) == row["steps_done"]
        with folder.scanning(row["run"]) as lazy:
            assert lazy.collect().columns == table.columns
    assert diff(name, name).worse == []


def test_checksums_cost_little(case, tmp_path):
    began = time.perf_counter()
    suite_of(case, out=tmp_path / "out", jobs=1)
    took = time.perf_counter() - began
    began = time.perf_counter()
    for path in (tmp_path / "out" / "tiny").rglob("*.parquet"):
        checksums.of_bytes(path.read_bytes())
        checksums.of_file(path)
    assert time.perf_counter() - began < SHARE * took


def test_a_table_without_rows_is_a_table(tmp_path):
    folder = ResultFolder(tmp_path)
    sums = folder.write_table("empty", pl.LazyFrame({"step": []}, schema={"step": pl.Int64}))
    folder.write_json("summary.json", {"files": sums})
    assert folder.verified("steps/empty.parquet").is_file()
