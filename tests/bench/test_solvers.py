"""The table of solvers side by side: who takes part, who is right, and what is refused. No times are tested."""

import json
import signal
import threading
import time

import pytest
from oarlock import InputError
from oarlock.base import core
from oarlock.bench.solvers import bench
from oarlock.cli.app import main
from oarlock.stepping.solvers import solver_names
from tolerances import SOON_S

OURS = solver_names()
"""As long as no test has brought one of its own."""


def test_every_solver_takes_part_and_those_that_promise_the_minimum_norm_give_it():
    (table,) = bench([6], rounds=1)
    names = [row["name"] for row in table if not row["library"]]
    assert names == OURS
    right = {row["name"] for row in table if row["right"]}
    assert {"auto", "sr1-tracked", "pinv", "svd", "cholesky", "cg", "minres"} <= right
    assert not right & {"sr1", "cholesky-regularised"}  # what they are known to lose
    assert any(row["right"] for row in table if row["library"])
    assert all(row["solve_ns"] > 0 and row["given_ns"] > 0 for row in table)
    assert min(row["solve_ratio_to_best"] for row in table if row["right"]) == 1


def test_sizes_are_refused_by_name():
    with pytest.raises(InputError, match=r"n has shape 7, expected a multiple of 6"):
        list(bench([7], rounds=1))


def test_the_command_writes_json_alone(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["oarlock", "bench", "--size", "6", "--rounds", "1", "--json", "-"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code in (0, None)
    document = json.loads(capsys.readouterr().out)
    assert {row["n"] for row in document["rows"]} == {6}
    assert document["provenance"]["core_profile"]


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="needs signals for a thread")
def test_an_interruption_waits_for_no_round():
    """A round at 192 rows takes seconds."""
    main = threading.main_thread().ident
    assert main is not None
    timer = threading.Timer(0.5, signal.pthread_kill, (main, signal.SIGINT))
    timer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        core.bench_solvers(192, 100)
    assert time.monotonic() - began < 0.5 + SOON_S
