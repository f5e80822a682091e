"""The native path: bit for bit the Python path, on every model; errors are exceptions, never an exit."""

import subprocess
import sys
import threading
import warnings

import mujoco
import numpy as np
import oarlock._core as _core
import oarlock.stepping.prepared
import pytest
from mechanisms import TANGLE, case_of, four_bar, write_model
from oarlock import InputError, run
from oarlock.cases.case import load_case, model_names, variant_names
from oarlock.cases.conditions import Conditions
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.task import Task
from oarlock.mechanics.load import collected_warnings
from oarlock.stepping import native_path
from oarlock.stepping.solvers import SolverSpec
from oarlock.stepping.start import ConsistentStart
from oarlock.stepping.walkers import LOST
from oarlock.tables.spool import Spool
from walks import require_equal, walked

STEPS, MANY_STEPS = 200, 2000
FEW_STEPS = 150
LARGE = 40
"""Velocities of a model beyond which 200 steps in Python take many seconds."""

MUJOCO, AUTO, TRACKED, PINV = (SolverSpec.parse(text) for text in ("mujoco", "auto", "sr1-tracked", "pinv"))
GIVEN = {
    "qpos": np.zeros(3),
    "qvel": np.zeros(3),
    "act": np.zeros(0),
    "laws": [],
    "switches": [],
    "step_s": 0.002,
    "held": False,
    "beta": 0.0,
    "k": 0.0,
    "observed": None,
    "conserved": False,
    "inequalities": False,
    "snapshots": [],
}
"""What a core's setup of a four-bar is made of."""

EVERY_CASE = [name for model in model_names() for name in variant_names(model)]
EVERY_KIND = [
    Task("calibration", MUJOCO, (), (), "rk4", "default"),
    Task("lockstep", PINV, ("matched", "hard"), (AUTO,), "rk4", "default", "both"),
    Task("one-step", MUJOCO, ("matched", "hard"), (AUTO, TRACKED), "euler", "default"),
    Task("free", MUJOCO, ("matched", "hard"), (MUJOCO, AUTO), "implicit", "default"),
    Task("free", MUJOCO, ("hard",), (TRACKED,), "implicitfast", "default", "projection"),
]


def require_equal_walks(name: str, steps: int) -> None:
    """What is asked of MuJoCo, and what exact constraints make of it."""
    case = load_case(name)
    solvers = (AUTO,) if int(case.expected().get("nv", 0)) > LARGE else (AUTO, TRACKED)
    integrator = case.file.run.integrator
    require_equal(case, Task("lockstep", MUJOCO, ("matched", "hard"), solvers, integrator, "default"), steps)
    free = Task("free", MUJOCO, ("hard",), (AUTO,), integrator, "default", case.file.run.stabilisation)
    ((_, _, walked_steps),) = require_equal(case, free, steps)
    assert len(walked_steps) >= min(steps, 100)


def _mark(name: str) -> list:
    return [pytest.mark.slow] if int(load_case(name).expected().get("nv", 0)) > LARGE else []


@pytest.mark.parametrize("name", [pytest.param(name, marks=_mark(name), id=name) for name in EVERY_CASE])
def test_every_model_walks_the_same_way(name):
    require_equal_walks(name, STEPS)


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY_CASE)
def test_every_model_walks_the_same_way_for_long(name):
    require_equal_walks(name, MANY_STEPS)


@pytest.mark.parametrize("task", EVERY_KIND, ids=lambda task: f"{task.mode}-{task.integrator}")
@pytest.mark.parametrize("name", ["boat", "floating_four_bar", "gear_train", "ring", "welded_frame"])
def test_every_experiment_and_integrator(name, task):
    require_equal(load_case(name), task, FEW_STEPS)


@pytest.mark.parametrize("task", EVERY_KIND, ids=lambda task: f"{task.mode}-{task.integrator}")
def test_every_equality_at_once(tmp_path, monkeypatch, task):
    """From the model's own pose: it cannot be closed."""
    case = case_of(write_model(tmp_path, TANGLE))

    def as_it_stands(model: mujoco.MjModel, *_given) -> ConsistentStart:
        qvel = np.random.default_rng(1).normal(size=model.nv)
        return ConsistentStart(model.qpos0.copy(), qvel, rows=0, rank=0, dof=0, moved=0.0, unique={})

    monkeypatch.setattr(oarlock.stepping.prepared, "consistent_start", as_it_stands)
    tables = require_equal(case, task, 30)
    assert all(len(steps) > 5 for _, _, steps in tables)
    if task.mode != "calibration":
        assert {len(residual) for _, _, steps in tables for residual in steps["residual"]} == {3 * 3 + 5 * 6 + 2 + 4}


# How runs end.

ENDS = {
    "a law has no value": (
        four_bar(rest='<actuator><motor name="motor" joint="crank"/></actuator>'),
        'drive.ctrl.motor = "sqrt(0.05 - t)"\n',
        "expected a finite control",
    ),
}


@pytest.mark.parametrize("integrator", ["euler", "rk4"])
@pytest.mark.parametrize("what", ENDS)
def test_refusals_are_the_same(tmp_path, what, integrator):
    xml, toml, part = ENDS[what]
    path = write_model(tmp_path / "m", xml, f'title = "m"\n{toml}').parent
    said = []
    for stepping in ("native", "python"):
        with pytest.raises(InputError) as raised:
            run(
                path,
                mode="free",
                form="hard",
                solver=["auto"],
                integrator=integrator,
                duration=1.0,
                stepping=stepping,
            )
        said.append(str(raised.value))
    assert part in said[0]
    assert said[0] == said[1]


@pytest.mark.parametrize("mode", ["free", "lockstep", "one-step"])
def test_a_run_that_diverges_keeps_the_same_steps(tmp_path, mode):
    path = write_model(tmp_path, four_bar())
    case = case_of(path, settings={"wild": {"solref": [-1e9, -1e7]}}, start={"qvel": {"crank": 3.0}})
    task = Task(mode, MUJOCO, ("hard",), (AUTO,), "euler", "wild")
    if mode == "free":
        task = Task(mode, MUJOCO, ("matched",), (MUJOCO, AUTO), "euler", "wild")
    ended = require_equal(case, task, 400)
    assert all(0 < len(steps) < 400 for _, _, steps in ended)
    assert all(status == "diverged" for status, _, _ in ended)


@pytest.mark.parametrize("tilt", [1e-5, 6e-5])
def test_a_loop_that_a_tilted_hinge_opens_ends_the_run_where_it_counts(tmp_path, tilt):
    """The row across its plane is redundant at the start, and cannot be closed once the rocker turns."""
    path = write_model(tmp_path, four_bar(rocker=f'axis="0 1 {tilt}"'))
    free = Task("free", MUJOCO, ("hard",), (AUTO, PINV), "rk4", "default", "projection")
    ended = require_equal(case_of(path, start={"qvel": {"crank": 1.0}}), free, 400)
    for status, message, steps in ended:
        assert status == "diverged"
        assert "can no longer be closed together" in message
        assert 0 < len(steps) < 400
        assert (steps["drift_pos"] <= LOST).all()


@pytest.mark.parametrize("size", [1, 7, 200])
def test_portions_change_nothing(tmp_path, monkeypatch, size):
    """The clock decides how many steps are taken at once: a run must not hang on that, and neither must its chunks."""
    case = load_case(write_model(tmp_path / "bar", four_bar(), 'title = "bar"\n').parent)
    task = Task("lockstep", MUJOCO, ("matched", "hard"), (AUTO, PINV), "rk4", "default")
    monkeypatch.setattr(native_path, "CHUNK_ROWS", 500)
    chunks, append = [], Spool.append
    monkeypatch.setattr(Spool, "append", lambda spool, chunk: (chunks.append(len(chunk)), append(spool, chunk))[1])
    expected = walked(case, task, 1050, "native")
    expected_chunks, chunks[:] = list(chunks), []
    monkeypatch.setattr(native_path, "_portion", lambda steps, took_s: size)
    found = walked(case, task, 1050, "native")
    assert chunks == expected_chunks
    for (*ending, table), (*expected_ending, expected_table) in zip(found, expected, strict=True):
        assert ending == expected_ending
        assert table.equals(expected_table, null_equal=True)


def test_portions_fit_the_time_of_a_step():
    assert native_path._portion(1, 0.0) == native_path._GROWTH
    assert native_path._portion(200, 1e-3) == native_path.TICK_STEPS
    assert native_path._portion(8, 8 * native_path.PORTION_S) == 1
    assert native_path._portion(8, 4 * native_path.PORTION_S) == 2


def test_sparse_jacobians_give_the_same_run():
    """Cases ask for dense ones; whoever takes the core directly need not."""
    case = load_case("n_four_bar")
    assert native_path.refusal() == ""
    found = []
    for jacobian in (mujoco.mjtJacobian.mjJAC_DENSE, mujoco.mjtJacobian.mjJAC_SPARSE):
        setup = Laboratory(case, Conditions(duration_s=0.3)).setup("rk4")
        setup.model.opt.jacobian = jacobian
        (table,) = core_run(setup).tables()
        found.append(table["qpos"].values)
    assert np.array_equal(*found)


def core_run(setup) -> _core.Run:
    core = _core.Setup(setup.model, **{**GIVEN, "qpos": setup.start.qpos, "qvel": setup.start.qvel})
    result = core.free_solved(setup.steps, "hard", AUTO.make(), PINV.make())
    assert result.advance(setup.steps) == setup.steps
    return result


# MuJoCo's own errors.


def exhausting() -> mujoco.MjModel:
    """A model whose memory is enough until a limit becomes active, where MuJoCo calls mju_error."""
    xml = four_bar(rocker='limited="true" range="-0.5 0.02"')
    with collected_warnings():
        for memory in range(400, 100_000, 8):
            tight = xml.replace("<default>", f'<size memory="{memory}"/><default>', 1)
            try:
                model = mujoco.MjModel.from_xml_string(tight)
                data = mujoco.MjData(model)
                mujoco.mj_forward(model, data)
            except (ValueError, mujoco.FatalError):
                continue
            if data.ne == 3:  # with less it leaves them out, and only warns
                return model
    raise AssertionError("no such memory")


def test_an_error_of_mujoco_is_an_exception_on_every_thread():
    assert native_path.refusal() == ""
    model = exhausting()

    def fresh() -> _core.Run:
        return _core.Setup(model, **{**GIVEN, "qvel": np.array([0.0, 0.0, 1.0])}).bare(1000)

    runs = [fresh() for _ in range(8)]
    taken = _core.advance_all(runs, 1000)
    assert len(set(taken)) == 1
    assert 0 < taken[0] < 1000  # in mid-run
    for one in runs:
        with pytest.raises(mujoco.FatalError, match=r"insufficient|memory|arena|stack"):
            _ = one.end

    said: list[str] = []

    def walk() -> None:
        try:
            fresh().walk()
        except mujoco.FatalError as error:
            said.append(str(error))

    threads = [threading.Thread(target=walk) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(said) == 4


# When it cannot be taken.


def test_another_version_of_mujoco_is_said_and_stepped_in_python(monkeypatch):
    reason = "MuJoCo 4.0.1 is installed, native stepping knows 3.17.0, 4.0.0"
    monkeypatch.setattr(native_path, "refusal", lambda: reason)
    asked = {"mode": "free", "form": "hard", "solver": "auto", "duration": 0.01}
    with pytest.warns(UserWarning, match="stepping in Python, which is slower: MuJoCo 4.0.1 is installed"):
        results = run("boat", **asked)
    assert {row["stepping"] for row in results.rows} == {"python"}
    with pytest.raises(InputError, match=r"no native stepping: MuJoCo 4\.0\.1"):
        run("boat", stepping="native", **asked)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run("boat", stepping="python", **asked)


def test_the_table_says_which_path_was_taken():
    asked = {"mode": "free", "form": "hard", "solver": ["auto", "mujoco"], "duration": 0.01}
    for stepping, expected in (("auto", "native"), ("python", "python")):
        rows = run("boat", stepping=stepping, **asked).rows
        assert {row["stepping"] for row in rows if row["solver"] == "auto"} == {expected}
    with pytest.raises(InputError, match="unknown stepping 'fast', expected one of: auto, native, python"):
        run("boat", stepping="fast", **asked)


def in_a_fresh_process(text: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", text], capture_output=True, encoding="utf-8", timeout=60, check=False)


FRESH = """
import numpy as np, mujoco
from oarlock import _core
body = "<body><freejoint/><geom size='1'/></body>"
model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{{body}}</worldbody></mujoco>")
try:
    {}
except ValueError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ("_core.open_mujoco('/nowhere/libmujoco.so')", "'/nowhere/libmujoco.so' is not loaded"),
        ("_core.open_mujoco('a\\0b')", "is no path of a library"),
        ("_core.open_mujoco(_core.__file__)", "has no function mj_version"),
        (
            "_core.Setup(model, qpos=np.zeros(7), qvel=np.zeros(6), act=np.zeros(0), laws=[], switches=[], "
            "step_s=0.002, held=False, beta=0, "
            "k=0, observed=None, conserved=False, inequalities=False, snapshots=[])",
            "MuJoCo's library is not opened yet",
        ),
    ],
)
def test_nothing_is_called_before_the_library_is_known(call, message):
    done = in_a_fresh_process(FRESH.format(call))
    assert done.returncode == 0, done.stderr
    assert message in done.stdout


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"qpos": np.zeros(4)}, "4 positions and 3 velocities, expected 3 and 3"),
        ({"qvel": np.zeros(2)}, "3 positions and 2 velocities, expected 3 and 3"),
        ({"observed": ("qpos", 3)}, "the model has no qpos 3"),
        ({"observed": ("site", 9)}, "the model has no site 9"),
        ({"observed": ("geom", 0)}, "the model has no geom 0, expected qpos or site"),
        ({"laws": [(0, _core.TimeLaw("t"))]}, "the model has no actuator 0"),
    ],
)
def test_what_does_not_fit_the_model_is_refused(changes, message):
    assert native_path.refusal() == ""
    model = mujoco.MjModel.from_xml_string(four_bar())
    with pytest.raises(InputError, match=message):
        _core.Setup(model, **{**GIVEN, **changes}).bare(1)


def test_only_models_are_taken_for_models():
    assert native_path.refusal() == ""
    with pytest.raises(InputError, match=r"expected a mujoco\.MjModel"):
        _core.Setup(7, **GIVEN)


def test_a_run_takes_one_thread_at_a_time():
    assert native_path.refusal() == ""
    setup = _core.Setup(mujoco.MjModel.from_xml_string(four_bar()), **GIVEN)
    one = setup.bare(10**9)
    with pytest.raises(InputError, match=r"runs\[1\] is there twice, expected each run once"):
        _core.advance_all([one, one], 10)
    begun = threading.Event()

    def walk() -> None:
        begun.set()
        one.advance(300_000)

    def look() -> None:
        while thread.is_alive():
            _ = one.state

    thread = threading.Thread(target=walk)
    thread.start()
    begun.wait(60)
    with pytest.raises(InputError, match="the run is in use by another thread, expected one thread at a time"):
        look()
    thread.join()
    assert one.state[2] == pytest.approx(300_000 * 0.002)


def test_later_changes_of_a_model_are_not_seen():
    assert native_path.refusal() == ""
    model = mujoco.MjModel.from_xml_string(four_bar())
    setup = _core.Setup(model, **{**GIVEN, "qvel": np.array([0.1, 0.0, 0.0])})
    model.opt.gravity[:] = 0
    model.opt.timestep = 10.0
    del model
    one = setup.bare(5)
    assert one.advance(9) == 5
    _, qvel, time = one.state
    assert time == pytest.approx(0.01)
    assert abs(qvel).max() > 0.01  # it has fallen
