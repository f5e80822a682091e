"""A process that was forked from one in which polars had computed says so, and does not wait for ever."""

import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing, sys, warnings
warnings.simplefilter("ignore", DeprecationWarning)  # of later Pythons, for a fork beside threads
import oarlock

def asked(call):
    try:
        answer = eval(call)
        print(len(answer.document()) > 0, flush=True)
    except oarlock.InputError as error:
        print(error, flush=True)

if __name__ == "__main__":
    if sys.argv[1] == "used":
        oarlock.run("four_bar", mode="free", solver="mujoco", duration=0.01)
    elif sys.argv[1] == "loaded":
        import polars
        import oarlock.batch.session, oarlock.report.case_report
    else:
        import polars
    for call in sys.argv[2:]:
        process = multiprocessing.get_context("fork").Process(target=asked, args=(call,))
        process.start()
        process.join(60)
        if process.is_alive():
            print("hangs", flush=True)
            process.kill()
"""
CALLS = [
    "oarlock.run('four_bar', mode='free', solver='mujoco', duration=0.01)",
    "oarlock.check('four_bar', budget=0, duration=0.01)",
]


def said(tmp_path, how):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    suite = f"oarlock.suite('four_bar', out={str(tmp_path / 'out')!r}, jobs=1)"
    calls = [*CALLS, suite] if how == "used" else CALLS
    done = subprocess.run(
        [sys.executable, script, how, *calls], capture_output=True, encoding="utf-8", timeout=200, check=True
    )
    return done.stdout.splitlines()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells whose threads there are")
@pytest.mark.parametrize("how", ["imported", "loaded"])
def test_before_polars_computed_a_fork_works(tmp_path, how):
    assert said(tmp_path, how) == ["True", "True"]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a fork is no way to start a process")
def test_afterwards_it_is_refused_with_what_to_do(tmp_path):
    lines = said(tmp_path, "used")
    assert len(lines) == 3
    for line in lines:
        assert line.startswith("this process was forked from one in which polars had computed")
        assert "expected one started with multiprocessing's 'spawn' or 'forkserver'" in line
