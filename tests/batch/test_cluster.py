"""The suite on a dask.distributed cluster: the same figures, nothing lost, nothing done twice that need not be."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import Counter as Count
from contextlib import closing, contextmanager

import dask
import pytest
from mechanisms import four_bar, write_model
from oarlock.batch.cluster import Cluster
from oarlock.batch.suite import carry_out, plan_suite, status_of
from oarlock.batch.workers import LocalWorkers, LostError
from oarlock.tables.figures import TIMING_FIGURES
from oarlock.tables.folder import OCCASION
from places import TESTS
from suites import (
    KILL,
    SILENCE_S,
    TINY,
    UNITS,
    Counter,
    carried_out,
    interrupted_and_resumed,
    late_once,
    noted,
    notes,
    python_model,
    slow_with_a_pulse,
)

TWO = (
    TINY[: TINY.index("[[experiments]]")] + TINY[TINY.index('[[experiments]]\nmode = "free"') : TINY.index("[[gates]]")]
)
"""A case of two units, the free runs."""


def silent(text):
    raise AssertionError(text)


@pytest.fixture(scope="module")
def cluster():
    with closing(Cluster("local", 2, silent)) as made:
        yield made


@pytest.fixture
def counted(monkeypatch):
    """Suites whose units note that they are done."""
    monkeypatch.setattr("oarlock.batch.suite.run_unit", noted)


@contextmanager
def scheduler(*more):
    """The address of a scheduler without workers, a process of its own, with more arguments than usual."""
    code = "from distributed.cli.dask_scheduler import main; main()"
    arguments = [sys.executable, "-c", code, "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    arguments += ["--dashboard-address", "127.0.0.1:0", *more]
    with subprocess.Popen(arguments, stderr=subprocess.PIPE, encoding="utf-8") as process:
        assert process.stderr is not None
        address = next(line.split()[-1] for line in process.stderr if "Scheduler at:" in line)
        threading.Thread(target=process.stderr.read, daemon=True).start()
        try:
            yield address, process
        finally:
            process.kill()


@contextmanager
def worker(address, *, before="", threads=1):
    """A worker of a scheduler, a process of its own that executes ``before`` first."""
    code = f"import sys; {before}\nfrom distributed.cli.dask_worker import main; main()"
    arguments = [sys.executable, "-c", code, address, "--no-nanny", "--nthreads", str(threads)]
    arguments += ["--host", "127.0.0.1", "--no-dashboard", "--memory-limit", "0"]
    paths = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": paths}
    with subprocess.Popen(arguments, env=environment, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def timeless(document):
    for row in document["runs"]:
        row.update(dict.fromkeys(TIMING_FIGURES))
    document["provenance"] = {k: v for k, v in document["provenance"].items() if k not in OCCASION}
    return document


def complaint(finished):
    """The one line of a command that ends with status 2."""
    assert finished.returncode == 2
    assert finished.stdout == ""
    (line,) = finished.stderr.splitlines()
    assert line.startswith("oarlock: ")
    return line


# Local clusters.


def test_a_killed_worker_loses_only_what_it_had_in_work(tiny, tmp_path, counted, cluster):
    with closing(LocalWorkers(2)) as workers:
        expected = carried_out([tiny], tmp_path / "local", workers).document()
    (tmp_path / "notes").unlink()
    suite = plan_suite([str(tiny)], tmp_path / "out")
    victim = suite.members[0].units[1].name
    (tmp_path / "wait_for_death").write_text(victim)

    def kill():
        while not (found := [int(process) for what, name, process in notes(tmp_path) if name == victim]):
            time.sleep(0.01)
        (tmp_path / "wait_for_death").unlink()
        os.kill(found[0], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    carry_out(suite, cluster)
    killer.join()
    assert timeless(suite.document()) == timeless(expected)
    assert status_of(suite) == 0
    names = [unit.name for unit in suite.members[0].units]
    begun = Count(name for what, name, _ in notes(tmp_path) if what == "begins")
    ended = Count(name for what, name, _ in notes(tmp_path) if what == "ends")
    assert begun == {**dict.fromkeys(names, 1), victim: 2}
    assert ended == dict.fromkeys(names, 1)
    assert carried_out([tiny], tmp_path / "out", cluster).repeated == 0


def test_units_that_kill_their_workers_fail_by_themselves(tiny, tmp_path, counted, cluster):
    killer = python_model(tmp_path / "killer", KILL, TWO)
    heard = Counter()
    suite = carried_out([killer, tiny], tmp_path / "out", cluster, progress=heard)
    killed, whole = suite.members
    assert {str(why) for why in killed.ledger.failures().values()} == {"failed: its worker died, twice"}
    assert len(killed.ledger.failures()) == 2
    assert whole.ledger.failures() == {}
    assert len(whole.ledger.rows()) == 7
    assert sum(1 for message in heard.said.values() if message) == 2
    assert status_of(suite) == 1
    begun = Count(name for what, name, _ in notes(tmp_path) if what == "begins")
    # The free runs are called the same in both cases.
    expected = Count([unit.name for unit in whole.units] + 2 * [unit.name for unit in killed.units])
    assert begun == expected


def test_an_item_that_wants_to_end_its_process_fails(cluster):
    error = cluster.submit(sys.exit, "enough").exception()
    assert str(error) == "enough"
    assert cluster.submit(str.upper, "a").result() == "A"


def test_command(tiny, oarlock_command):
    arguments = ["suite", tiny, "--out", "out", "--scheduler", "local", "--jobs", "2"]
    finished = oarlock_command(*arguments, "--json", "-")
    assert finished.returncode == 0
    assert len(json.loads(finished.stdout)["runs"]) == 7
    lines = finished.stderr.splitlines()
    assert sorted(line.split()[0] for line in lines[:UNITS]) == ["tiny"] * UNITS
    assert lines[UNITS:] == ["  out/report/tiny/README.md", "  out/report/README.md"]
    again = oarlock_command(*arguments)
    assert again.returncode == 0
    assert again.stderr.splitlines() == [f"running: {UNITS} of {UNITS} kept from before"]


@pytest.mark.slow
def test_an_interruption_keeps_what_is_finished(tmp_path):
    err = interrupted_and_resumed(tmp_path, "--scheduler", "local")
    assert [line for line in err.splitlines() if not line.startswith("  long ")] == [
        "oarlock: interrupted; the runs that were finished are kept"
    ]


# Clusters that run elsewhere.


@pytest.mark.slow
def test_workers_that_come_and_go(tiny, tmp_path, counted, monkeypatch):
    """The first worker comes late, and has several threads: one unit at a time all the same."""
    monkeypatch.setattr("oarlock.batch.cluster._ALONE_S", 0.1)
    said = []
    with scheduler() as (address, _), closing(Cluster(address, None, said.append)) as workers:
        while not said:
            time.sleep(0.01)
        with worker(address, threads=4):
            assert status_of(carried_out([tiny], tmp_path / "out", workers)) == 0
        assert [what for what, _, _ in notes(tmp_path)] == ["begins", "ends"] * UNITS
        with worker(address, threads=1):
            assert carried_out([tiny], tmp_path / "out", workers, fresh=True).repeated == UNITS
    assert set(said) == {f"scheduler {address}: no worker there; waiting for one"}
    assert len({process for _, _, process in notes(tmp_path)}) == 2


def test_command_with_an_address(tiny, oarlock_here):
    with scheduler() as (address, _), worker(address):
        finished = oarlock_here("suite", tiny, "--out", "out", "--scheduler", address)
    assert finished.returncode == 0
    lines = finished.stderr.splitlines()
    assert sorted(line.split()[0] for line in lines[:UNITS]) == ["tiny"] * UNITS
    assert len(lines) == UNITS + 2


WITHOUT = "sys.modules['oarlock'] = None"
OTHER = "from oarlock.batch import digest; digest.program = lambda: 'another'"


def test_a_worker_without_the_same_program_is_left_out(tiny, oarlock_here):
    with scheduler() as (address, _), worker(address, before=WITHOUT):
        line = complaint(oarlock_here("suite", tiny, "--out", "out", "--scheduler", address))
    assert line.startswith(f"oarlock: scheduler {address}: no worker there can be used: ModuleNotFoundError: ")
    assert "oarlock" in line.rpartition("ModuleNotFoundError")[2]


@pytest.mark.slow
def test_units_go_to_the_workers_that_can_do_them(tiny, tmp_path):
    said = []
    with (
        scheduler() as (address, _),
        worker(address),
        closing(Cluster(address, None, said.append)) as workers,
    ):
        carried_out([tiny], tmp_path / "out", workers)
        with worker(address, before=OTHER):
            while not said:
                time.sleep(0.01)
            assert status_of(carried_out([tiny], tmp_path / "out", workers, fresh=True)) == 0
    (line,) = said
    assert line.endswith("is left out: its oarlock, or what that builds on, is another one than here")


def test_a_model_that_is_not_there_is_refused(tiny, tmp_path, cluster):
    suite = plan_suite([str(tiny)], tmp_path / "out")
    tiny.rename(tmp_path / "moved")
    carry_out(suite, cluster)
    assert len(suite.members[0].ledger.failures()) == UNITS
    assert all(why.status == "refused" for why in suite.members[0].ledger.failures().values())
    assert status_of(suite) == 2


@pytest.mark.slow
def test_a_scheduler_that_dies_ends_the_suite(tmp_path):
    long = write_model(tmp_path / "long", four_bar(), TINY.replace("0.02", "4.0")).parent
    suite = plan_suite([str(long)], tmp_path / "out")

    class Listener(Counter):
        def finished(self, label, seconds=None, message=""):
            super().finished(label, seconds, message)
            process.kill()

    heard = Listener()
    with (
        scheduler() as (address, process),
        worker(address),
        closing(Cluster(address, None, silent)) as workers,
        pytest.raises(LostError, match=f"scheduler {address}: the scheduler is gone"),
    ):
        carry_out(suite, workers, progress=heard)
    assert 1 <= len(heard.said) < UNITS
    assert len(suite.members[0].ledger.entries) == len(heard.said)


STOP = "os.kill(os.getpid(), signal.SIGSTOP)"
STOP_ONCE = f"(HERE.parent / 'was_here').exists() or ((HERE.parent / 'was_here').touch(), {STOP})"
LIMIT_S = 4.0


@pytest.mark.slow
def test_what_a_stopped_worker_had_is_done_elsewhere(tiny, tmp_path):
    """Of processes here, another one takes its place."""
    once = python_model(tmp_path / "once", STOP_ONCE)
    said = []
    with closing(Cluster("local", 2, said.append, LIMIT_S)) as workers:
        suite = carried_out([once, tiny], tmp_path / "out", workers)
        assert status_of(suite) == 0
        assert carried_out([tiny], tmp_path / "out", workers, fresh=True).repeated == UNITS
    assert (tmp_path / "was_here").exists()
    (line,) = said
    assert line.endswith(" does not go on, and is replaced if it can be")


@pytest.mark.slow
def test_what_goes_on_may_take_as_long_as_it_likes(tmp_path):
    with scheduler() as (address, _), worker(address), closing(Cluster(address, None, silent, SILENCE_S)) as workers:
        assert workers.submit(slow_with_a_pulse, str(tmp_path / "a")).result(60) == 1


@pytest.mark.slow
def test_a_late_worker_that_nobody_replaces_goes_on(tmp_path):
    """Without a nanny a worker cannot be restarted: once it has ended what was late, it is as good as before."""
    said = []
    with (
        scheduler() as (address, _),
        worker(address),
        closing(Cluster(address, None, said.append, SILENCE_S)) as workers,
    ):
        assert workers.submit(late_once, str(tmp_path / "a")).result(60) == "in time"
    (line,) = said
    assert line.endswith(" does not go on, and is replaced if it can be")


@pytest.mark.slow
def test_what_never_ends_fails_and_nothing_else_does(tiny, tmp_path):
    never = python_model(tmp_path / "never", STOP, TWO)
    with closing(Cluster("local", 2, lambda _: None, LIMIT_S)) as workers:
        stopped, whole = carried_out([never, tiny], tmp_path / "out", workers).members
    expected = "failed: no step within the time that a run may be silent (--unit-timeout), twice"
    assert {str(why) for why in stopped.ledger.failures().values()} == {expected}
    assert whole.ledger.failures() == {}


@pytest.mark.slow
def test_a_stopped_worker_elsewhere_holds_up_nobody(tmp_path):
    once = python_model(tmp_path / "once", STOP_ONCE)
    said = []
    with (
        scheduler() as (address, _),
        worker(address),
        worker(address),
        closing(Cluster(address, None, said.append, LIMIT_S)) as workers,
    ):
        assert status_of(carried_out([once], tmp_path / "out", workers)) == 0
    assert said != []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl to make a certificate")
def test_encrypted_as_dask_is_configured(tiny, oarlock_here, tmp_path, monkeypatch):
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    make = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=oarlock"]
    subprocess.run([*make, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    names = {"CA_FILE": certificate}
    for role in ("CLIENT", "SCHEDULER", "WORKER"):
        names |= {f"{role}__CERT": certificate, f"{role}__KEY": key}
    for name, value in names.items():
        monkeypatch.setenv(f"DASK_DISTRIBUTED__COMM__TLS__{name}", str(value))
    dask.config.refresh()
    try:
        with scheduler("--protocol", "tls") as (address, _), worker(address):
            assert address.startswith("tls://")
            assert oarlock_here("suite", tiny, "--out", "out", "--scheduler", address).returncode == 0
            for name in names:
                monkeypatch.delenv(f"DASK_DISTRIBUTED__COMM__TLS__{name}")
            dask.config.refresh()
            line = complaint(oarlock_here("suite", tiny, "--out", "other", "--scheduler", address))
    finally:
        monkeypatch.undo()
        dask.config.refresh()
    assert "no answer: TLS expects" in line


# Mistakes.


@pytest.mark.parametrize("address", ["bogus", "tcp://", "127.0.0.1:8786", "tcp://127.0.0.1:many", "tcp://host:1/path"])
def test_malformed_addresses(tiny, oarlock_here, address):
    line = complaint(oarlock_here("suite", tiny, "--scheduler", address))
    assert (
        line
        == f"oarlock: scheduler '{address}', expected local or the address of one, tcp://HOST:PORT or tls://HOST:PORT"
    )


def test_nobody_answers(tiny, oarlock_here):
    began = time.monotonic()
    line = complaint(oarlock_here("suite", tiny, "--scheduler", "tcp://127.0.0.1:9"))
    assert line.startswith("oarlock: scheduler tcp://127.0.0.1:9: no answer: ")
    assert time.monotonic() - began < 10


def test_without_the_extra(tiny, oarlock_here, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    line = complaint(oarlock_here("suite", tiny, "--scheduler", "local"))
    assert line == "oarlock: --scheduler needs dask.distributed: pip install 'oarlock[cluster]'"


def test_other_commands_do_not_pay_for_it(tmp_path):
    code = "import sys, oarlock.cli.app, oarlock.cli.suite; sys.exit('distributed' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False).returncode == 0
