"""The installed command: its exit status, its two streams, and its files, most in a process of its own."""

import contextlib
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import oarlock
import pytest
from mechanisms import COMMAND, boat_copy, four_bar, only, write_model
from oarlock import model_names
from oarlock.cli.app import COMMANDS
from oarlock.stepping.solvers import SolverSpec
from oarlock.tables.folder import ResultFolder
from tolerances import SOON_S

CALIBRATION_ONLY = "[[experiments]]\nmode = 'calibration'\n"
IMPOSSIBLE = "[[gates]]\nfigure = 'drift_pos_max'\nmax = 1e-30\ncause = 'nothing is'\n"


def complaint(finished):
    """The one line of a user's mistake."""
    assert finished.returncode == 2
    assert finished.stdout == ""
    assert "Traceback" not in finished.stderr
    lines = finished.stderr.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("oarlock: ")
    return lines[0]


# Doing.


def test_list(oarlock_command, oarlock_here):
    plain, machine = oarlock_here("list"), oarlock_command("list", "--json")
    assert (plain.returncode, machine.returncode) == (0, 0)
    entries = json.loads(machine.stdout)
    assert [entry["name"] for entry in entries] == model_names()
    keys = {"name", "title", "nq", "nv", "rows", "rank", "redundancy", "dof", "reference", "tags"}
    assert all(set(entry) == keys for entry in entries)
    boat = only(entries, name="boat")
    assert [boat[key] for key in ("nq", "nv", "rows", "rank", "redundancy", "dof")] == [5, 5, 6, 4, 2, 1]
    assert all(entry["name"] in plain.stdout and entry["title"] in plain.stdout for entry in entries)


def loaded(code):
    """What is loaded in a process of its own once some code has run: names of modules."""
    code = f"import sys\ntry:\n    {code}\nexcept SystemExit:\n    pass\nprint(*sys.modules, file=sys.stderr)"
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    return finished.stderr.split()


HEAVY = ["altair", "vl_convert", "jinja2", "scipy.optimize", "scipy.interpolate", "oarlock.diagnosis.examination"]
"""Each of these takes a tenth of a second or more, and whoever does not use it would wait for it."""


@pytest.mark.parametrize("command", ["", "run", "check", "diff", "sample", "suite"])
def test_a_command_loads_only_what_it_needs(command):
    asked = f"import oarlock.cli.{command or 'app'}"
    assert [name for name in loaded(asked) if name in HEAVY] == []


def test_the_front_door_loads_nothing():
    names = loaded("import oarlock; oarlock.__all__, oarlock.__version__")
    assert [name for name in names if name in (*HEAVY, "mujoco", "polars", "numpy")] == []


ENGINES = ["mujoco", "polars", "pydantic", "numpy", "rich.console"]
"""What only those need who look at models or tables: half of the first second of a command."""


@pytest.mark.parametrize(
    ("command", "useless"),
    [
        ("--help", ENGINES),
        ("list", ["polars"]),
        ("explain T1", ["mujoco", "polars", "numpy"]),
        ("--version", ENGINES),
        ("solvers", ["mujoco", "polars"]),
    ],
)
def test_a_command_waits_for_nothing_that_it_does_not_use(command, useless):
    names = loaded(f"import oarlock.cli.app as a; sys.argv = ['oarlock', *{command.split()}]; a.main()")
    assert "oarlock.cli.app" in names
    assert [name for name in names if name in (*useless, *HEAVY)] == []


def test_help_says_of_a_command_what_its_own_help_begins_with(oarlock_here):
    listed = oarlock_here("--help").stdout.partition("Commands:")[2].partition("Exit status:")[0]
    lines = listed.split("\n  ")[1:]
    said = {name: words.strip().removesuffix("...") for name, words in (line.split(None, 1) for line in lines)}
    assert list(said) == list(COMMANDS)
    for name, words in said.items():
        own = " ".join(oarlock_here(name, "--help").stdout.split())
        assert " ".join(words.split()) in own


DIFF_FILES = 16
"""Files of ours that are read to compare two folders: of the comparison, of tables and checksums, of errors, text; no
engine. The command adds its own five."""


@pytest.mark.parametrize(
    "code",
    [
        "from oarlock.compare.compare import diff; diff(*{folders})",
        "import oarlock; oarlock.diff(*{folders})",
        "import oarlock.cli.app as a; sys.argv = ['oarlock', 'diff', *{folders}]; a.main()",
    ],
)
def test_a_comparison_loads_no_engine(pair, code):
    names = loaded(code.format(folders=[str(path) for path in pair]))
    assert "oarlock.compare.figures" in names
    packages = {name.rpartition(".")[0] for name in names}
    files = {name for name in names if name.startswith("oarlock.")} - packages - {"oarlock._core"}
    command = {name for name in files if name.startswith("oarlock.cli.")}
    assert command <= {f"oarlock.cli.{name}" for name in ("app", "console", "diff", "examples", "tables")}
    assert len(files - command) <= DIFF_FILES, files
    assert "mujoco" not in names


def test_every_public_name_is_there():
    assert {name: getattr(oarlock, name) for name in oarlock.__all__}
    assert set(oarlock.__all__) <= set(dir(oarlock))
    with pytest.raises(AttributeError, match="no attribute 'dance'"):
        _ = oarlock.dance


def test_list_fits_a_terminal(oarlock_here, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "dumb")  # 80 columns, and no codes between the words
    lines = oarlock_here("list").stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[0] for line in lines[1:] if not line.startswith(" ")] == model_names()
    assert "…" not in "".join(lines)


def test_standard_output_is_one_document(boat_run):
    """The fixture parsed the whole of it; a second time here, with what must not be in it."""
    document = json.loads(boat_run.out)
    assert set(document) == {"provenance", "runs", "gates"}
    kept = ResultFolder(boat_run.folder).read_json("summary.json")
    assert document == {key: value for key, value in kept.items() if key != "files"}
    assert {"oarlock", "mujoco", "numpy", "platform", "commit", "date", "model_sha256"} <= set(document["provenance"])
    assert "NaN" not in boat_run.out


def test_what_did_not_converge_is_said_and_is_no_failure(boat_run):
    assert boat_run.status == 0
    said = [line for line in boat_run.err.splitlines() if "unconverged" in line]
    assert len(said) == sum(row["status"] == "unconverged" for row in boat_run.rows) > 0
    assert all(line.startswith("oarlock: ") for line in boat_run.err.splitlines())


def test_run_writes_a_table_and_a_file(oarlock_here, tmp_path):
    finished = oarlock_here("run", "boat", "--mode", "free", "--duration", "0.01", "--json", "sub/summary.json")
    assert finished.returncode == 0
    document = json.loads((tmp_path / "sub" / "summary.json").read_text(encoding="utf-8"))
    for row in document["runs"]:
        assert row["run"] in finished.stdout
        assert (tmp_path / "results" / "boat" / "steps" / f"{row['run']}.parquet").is_file()
    assert "not checked" in finished.stderr  # the gates hold at the case's own duration


def test_any_mjcf_file_runs(oarlock_command, tmp_path):
    path = write_model(tmp_path, four_bar())
    finished = oarlock_command("run", path, "--duration", "0.02", "--integrator", "euler", "--json", "-")
    assert (finished.returncode, finished.stderr) == (0, "")
    rows = json.loads(finished.stdout)["runs"]
    assert {row["mode"] for row in rows} == {"calibration", "lockstep", "one-step", "free"}
    assert {row["truth_error_max"] for row in rows} == {None}
    assert (tmp_path / "results" / "model" / "summary.json").is_file()


def test_failed_gate(oarlock_command, oarlock_here, tmp_path):
    folder = boat_copy(tmp_path / "boat", experiments=CALIBRATION_ONLY, gates=IMPOSSIBLE)
    finished = oarlock_command("run", folder)
    assert finished.returncode == 1
    (line,) = [line for line in finished.stderr.splitlines() if "gate failed" in line]
    assert line.startswith("oarlock: gate failed: drift_pos_max = 0.000")
    assert "expected ≤ 1e-30 (nothing is)" in line
    assert finished.stdout.count("calibration-mujoco-rk4") == 1
    shorter = oarlock_here("run", folder, "--duration", "0.01")
    assert shorter.returncode == 0
    assert "1 gate(s) of the case not checked" in shorter.stderr


def test_a_run_writes_the_report_that_the_other_command_writes(oarlock_here, tiny, tmp_path):
    finished = oarlock_here("run", tiny, "--out", "results", "--report", "at/once", "--json", "-")
    assert finished.returncode == 0
    assert json.loads(finished.stdout)["runs"]
    assert f"oarlock: written: {Path('at/once/README.md')}" in finished.stderr.splitlines()
    assert oarlock_here("report", "results", "--to", "after").returncode == 0
    once, after = (
        {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in (tmp_path / "at" / "once", tmp_path / "after")
    )
    assert len(once) >= 6
    assert once == after


def test_a_run_whose_gate_fails_has_a_report(oarlock_here, tmp_path):
    folder = boat_copy(tmp_path / "boat", experiments=CALIBRATION_ONLY, gates=IMPOSSIBLE)
    finished = oarlock_here("run", folder, "--report", "report")
    assert finished.returncode == 1
    assert "oarlock: gate failed: drift_pos_max" in finished.stderr
    assert "1 of 6 gates do not hold" in (tmp_path / "report" / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("report", ["project", "notes.txt", "results", "results/boat", "."])
def test_the_place_of_a_report_is_looked_at_before_the_run(oarlock_here, tmp_path, report):
    (tmp_path / "project").mkdir()
    for name in ("project/main.py", "notes.txt"):
        (tmp_path / name).write_text("mine")
    assert f"'{report}'" in complaint(oarlock_here("run", "boat", "--report", report))
    assert not (tmp_path / "results").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes.txt", "project"]


def test_divergence_keeps_the_streams_clean(oarlock_command):
    finished = oarlock_command("run", "boat", "--mode", "free", "--timestep", "0.1", "--json", "-")
    assert finished.returncode == 1
    rows = json.loads(finished.stdout)["runs"]
    assert {row["status"] for row in rows} == {"diverged"}
    assert all(line.startswith("oarlock: ") for line in finished.stderr.splitlines())


OURS = oarlock.solver_names()
"""As long as no test has brought one of its own, which has no options."""


def test_solvers_are_those_of_the_registry(oarlock_here):
    plain, machine = oarlock_here("solvers"), oarlock_here("solvers", "--json")
    assert (plain.returncode, machine.returncode) == (0, 0)
    entries = json.loads(machine.stdout)
    assert [entry["name"] for entry in entries] == oarlock.solver_names()
    for entry, line in zip(entries, plain.stdout.splitlines()[1:], strict=True):
        if entry["name"] not in OURS:
            continue
        name, options, summary = re.split(r"\s{2,}", line)
        assert (name, summary) == (entry["name"], entry["summary"])
        # What is shown can be asked for as it stands.
        spec = f"{name}:{options.replace(' ', ',')}"
        assert dict(SolverSpec.parse(spec).options) == entry["options"]


# Mistakes.


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("bogus", f"unknown model 'bogus', expected one of: {', '.join(model_names())}"),
        ("gone.xml", "no model file 'gone.xml'"),
        ("boat --solver gauss", "unknown solver 'gauss', expected one of: mujoco, "),
        ("boat --solver sr1:eps=1", "no option 'eps', expected one of: eps_abs"),
        ("boat --solver sr1:eps_abs=small", "expected key=number"),
        ("boat --solver sr1:eps_abs=-1", "eps_abs = -1 of solver 'sr1', expected a finite number > 0"),
        ("boat --mode dance", "unknown mode 'dance', expected one of: lockstep, one-step, free, all"),
        ("boat --form soft", "unknown form 'soft', expected one of: matched, hard, both"),
        ("boat --walker gauss", "unknown solver 'gauss', expected one of: mujoco, "),
        ("boat --integrator rk5", "unknown integrator 'rk5', expected one of: euler, implicit, implicitfast, rk4"),
        ("boat --stabilisation glue", "unknown stabilisation 'glue', expected one of: baumgarte, projection, both"),
        ("boat --stepping native2", "unknown stepping 'native2', expected one of: auto"),
        ("boat --timestep 0", "timestep = 0 s, expected a finite number > 0"),
        ("boat --duration nan", "duration = nan s, expected a finite number > 0"),
        ("boat --rtol 1e-8 --solver pinv", "rtol = 1e-08"),
        ("boat --mode free --duration 0.01 --out taken", "taken"),
        ("boat --mode free --duration 0.01 --json taken/summary.json", "taken"),
        ("bad.xml", "bad.xml: XML that cannot be read: mismatched element <body> at line 1"),
        ("open.xml", "open.xml: no <equality> element"),
        ("case", "case.toml: run.duration_s = -1"),
    ],
)
def test_mistakes_are_one_line(oarlock_here, tmp_path, arguments, named):
    (tmp_path / "taken").write_text("mine")
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><body>")
    (tmp_path / "open.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    write_model(tmp_path / "case", four_bar(), "title = 'x'\nrun.duration_s = -1")
    finished = oarlock_here("run", *arguments.split())
    if "--json taken" in arguments:
        finished.stdout = ""  # the table was printed before
    assert named in complaint(finished)
    assert (tmp_path / "taken").read_text() == "mine"


def test_report_without_results(oarlock_command):
    assert "no 'nowhere/case.json'" in complaint(oarlock_command("report", "nowhere"))


def test_report_of_a_damaged_table(oarlock_here, tmp_path):
    oarlock_here("run", "boat", "--mode", "free", "--duration", "0.01", "--out", "r")
    for table in (tmp_path / "r" / "steps").iterdir():
        table.write_bytes(table.read_bytes()[:100])
    assert "r" in complaint(oarlock_here("report", "r"))
    assert not (tmp_path / "r" / "report").exists()


# Ends that come from outside.


def interrupt(folder, process, number=signal.SIGINT):
    """Interrupts the process once a run is on disk and in the summary."""
    deadline = time.monotonic() + 60
    while not (folder / "summary.json").exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(number)
    return process.communicate(timeout=60)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_interruption_keeps_the_finished_runs(tmp_path, number):
    arguments = [COMMAND, "run", "boat", "--out", tmp_path / "out", "--json", "-"]
    pipe = subprocess.PIPE
    with subprocess.Popen(arguments, stdout=pipe, stderr=pipe, encoding="utf-8", cwd=tmp_path) as process:
        out, err = interrupt(tmp_path / "out", process, number)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert out == ""
    folder = ResultFolder(tmp_path / "out")
    rows = folder.read_json("summary.json")["runs"]
    assert 1 <= len(rows) < 46
    for row in rows:
        assert len(folder.read_steps(row["run"])) == row["steps_done"] == 12_000
    assert not [path for path in folder.path.rglob("*") if path.name.startswith(".")]
    assert err == "oarlock: interrupted; the runs that were finished are kept\n"


def test_a_check_that_is_interrupted_keeps_nothing_and_says_so(tmp_path):
    arguments = [COMMAND, "check", "n_four_bar:N=20", "--duration", "100", "--quiet"]
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, encoding="utf-8", cwd=tmp_path) as process:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(6.0)
            pytest.fail("too short to be interrupted")
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "oarlock: interrupted\n")
    assert list(tmp_path.iterdir()) == []


LARGE = {
    "run": ["run", "n_four_bar:N=100", "--mode", "lockstep", "--solver", "pinv", "--solver", "svd"],
    "in Python": ["run", "n_four_bar:N=100", "--mode", "free", "--stepping", "python"],
    "suite": ["suite", "n_four_bar:N=100", "--jobs", "1"],
    "check": ["check", "n_four_bar:N=100", "--duration", "1000"],
    "bench": ["bench", "--size", "192", "--rounds", "100"],
}


@pytest.mark.slow
@pytest.mark.parametrize("command", LARGE)
@pytest.mark.parametrize(("after_s", "number"), [(1.0, signal.SIGTERM), (6.0, signal.SIGINT)])
def test_an_interruption_waits_for_nothing_large(tmp_path, command, after_s, number):
    """At the start, which has its own loops, and in the midst of it."""
    with subprocess.Popen([COMMAND, *LARGE[command]], cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(after_s)
            pytest.fail("too short to be interrupted")
        began = time.monotonic()
        process.send_signal(number)
        assert process.wait(60) == 130
        assert time.monotonic() - began < SOON_S


def test_what_was_to_be_ignored_stays_ignored(tmp_path):
    """Under nohup, the end of the terminal is none of the command."""
    script = 'trap "" HUP; "$0" run four_bar --mode free --duration 2 --out out & sleep 1; kill -HUP $!; wait $!'
    arguments = ["sh", "-c", script, COMMAND]
    done = subprocess.run(arguments, capture_output=True, encoding="utf-8", cwd=tmp_path, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "summary.json").exists()


@pytest.mark.parametrize("asked", [("list", "--json"), ("check", "four_bar", "--budget", "0", "--duration", "0.05")])
def test_reader_that_goes_away_is_no_failed_gate(asked):
    with subprocess.Popen([COMMAND, *asked], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.close()
        _, err = process.communicate(timeout=60)
    assert b"Traceback" not in err
    assert process.returncode == 141


def test_help_names_the_contract(oarlock_here):
    text = oarlock_here("run", "--help").stdout
    contract = {"solver", "form", "mode", "walker", "integrator", "timestep", "duration", "rtol", "out", "json"}
    contract |= {"stabilisation", "ignore-inequalities"}
    assert contract <= set(re.findall(r"--([a-z-]+)", text))
