"""Where runs of a file begin and what drives them, as the commands say and take it."""

import json
from pathlib import Path

import pytest
from mechanisms import four_bar, write_model

MOTOR = '<actuator><motor name="drive" joint="crank" ctrlrange="-0.1 0.1" ctrllimited="true"/></actuator>'
HOME = '<keyframe><key name="home" ctrl="{}"/><key name="fast" qvel="3 0 0"/></keyframe>'
WEIGHTLESS = ("<option", '<option gravity="0 0 0"')
BRIEF = ("--mode", "free", "--form", "hard", "--solver", "pinv", "--duration", "0.05")


def written(*, ctrl: str | None = None, motor: bool = True) -> Path:
    rest = (MOTOR if motor else "") + ("" if ctrl is None else HOME.format(ctrl))
    return write_model(Path(), four_bar(rest=rest).replace(*WEIGHTLESS)).rename("bar.xml")


@pytest.mark.parametrize(
    ("ctrl", "asked", "said"),
    [
        (None, (), "from the model's own pose, at rest; a random smooth control of every actuator (seed 0)"),
        ("0.05", (), "from keyframe 'home'; the keyframe's controls, held"),
        ("0", (), "from keyframe 'home'; the keyframe's controls, held"),
        ("0", ("--keyframe", "1"), "from keyframe 'fast'; the keyframe's controls, held"),
        ("0.05", ("--keyframe", "none"), "from the model's own pose, at rest; a random smooth control of every"),
        ("0", ("--control", "drive=0.1*sin(9*t)"), "the keyframe's controls, held, but drive = 0.1*sin(9*t)"),
        ("0", ("--controls", "log.csv"), "controls of the log 'log.csv' (2 rows from 0 to 0.02 s, each held until"),
    ],
)
def test_check_run_and_new_say_the_same(oarlock_here, ctrl, asked, said):
    path = written(ctrl=ctrl)
    Path("log.csv").write_text("time,drive\n0,0.1\n0.02,-0.1\n", encoding="utf-8")
    run = oarlock_here("run", path, *BRIEF, *asked)
    check = oarlock_here("check", path, "--budget", "0", "--duration", "0.05", *asked)
    assert (run.returncode, check.returncode) == (0, 0), run.stderr + check.stderr
    assert said in run.stdout
    assert "integrator euler" in run.stdout
    assert said.removeprefix("from ").partition(";")[2] in " ".join(check.stdout.split())
    if "log.csv" in asked:
        return
    new = oarlock_here("new", "bar", path, "--to", "out", *asked)
    assert new.returncode == 0, new.stderr
    assert said.partition("; ")[2] in new.stdout


def test_a_run_says_that_nothing_moves(oarlock_here):
    moving = "nothing moves: give it a start with a velocity"
    still = written(motor=False)
    assert moving in oarlock_here("run", still, *BRIEF).stderr
    assert moving in oarlock_here("run", written(ctrl="0"), *BRIEF, "--replace", "--out", "a").stderr
    assert moving not in oarlock_here("run", written(ctrl="0"), *BRIEF, "--keyframe", "fast", "--out", "b").stderr
    assert moving not in oarlock_here("run", written(), *BRIEF, "--out", "c").stderr


def test_runs_of_another_motion_are_other_results(oarlock_here):
    path = written(ctrl="0.05")
    for asked, refused in (
        ((), False),
        ((), False),
        (("--control", "drive=0.1"), True),
        (("--keyframe", "fast"), True),
    ):
        said = oarlock_here("run", path, *BRIEF, "--out", "out", *asked)
        assert (said.returncode == 2) == refused, said.stderr
        assert ("runs from another start or with other controls" in said.stderr) == refused
    summary = json.loads(Path("out/summary.json").read_text(encoding="utf-8"))
    assert summary["provenance"]["motion"] == "from keyframe 'home'; the keyframe's controls, held"


def test_a_suite_begins_a_file_as_a_run_does(oarlock_here):
    path = written(ctrl="0.05")
    path.write_text(
        path.read_text(encoding="utf-8").replace("<option", '<option integrator="implicit"'), encoding="utf-8"
    )
    said = oarlock_here("suite", path, "--sweep", "timestep=1e-3:2e-3:2", "--jobs", "1")
    assert said.returncode == 0, said.stderr
    rows = json.loads(next(Path("results").rglob("summary.json")).read_text(encoding="utf-8"))["runs"]
    assert {row["integrator"] for row in rows} == {"implicit"}


@pytest.mark.parametrize(
    ("command", "asked", "said"),
    [
        ("run", ("--keyframe", "away"), "unknown keyframe 'away', expected one of: home, fast, none"),
        ("check", ("--controls", "bad.csv"), "bad.csv: column 'drive', row 1: 'x', expected a finite number"),
        ("run", ("--controls", "none.npz"), "none.npz: cannot be read"),
        ("new", ("--controls", "bad.csv"), "is a log, expected laws of time (--control)"),
        ("new", ("--control", "drive"), "--control drive, expected ACTUATOR=VALUE with a number or a law"),
        ("run", ("--control", "drive=2*x"), "unknown name 'x'"),
    ],
)
def test_a_mistake_is_one_line(oarlock_here, command, asked, said):
    path = written(ctrl="0")
    Path("bad.csv").write_text("time,drive\n0,x\n", encoding="utf-8")
    names = ("bar",) if command == "new" else ()
    done = oarlock_here(command, *names, path, *asked)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_case_keeps_its_start(oarlock_here):
    said = oarlock_here("run", "four_bar", *BRIEF, "--keyframe", "none")
    assert said.returncode == 2
    assert "case 'four_bar' says where it starts" in said.stderr
