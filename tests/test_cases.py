"""Case files: data, checked; every mistake is one line with file, key, value and what was expected."""

import contextlib
from pathlib import Path

import pytest
from mechanisms import BOAT, boat_copy, boat_with, four_bar, setup_of, write_model
from oarlock import InputError, load_case, model_names, run
from oarlock._core import TimeLaw
from oarlock.cases import read_case_file

TITLE = 'title = "x"\n'


def read(tmp_path, toml):
    path = tmp_path / "case.toml"
    path.write_text(toml, encoding="utf-8")
    return read_case_file(path)


def complaint(tmp_path, toml):
    """The message, checked for its form: one line that names the file."""
    with pytest.raises(InputError) as raised:
        read(tmp_path, toml)
    text = str(raised.value)
    assert text.startswith(f"{tmp_path / 'case.toml'}: ")
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("toml", "key", "value", "expected"),
    [
        ("durration = 3", "durration", "3", "not permitted"),
        ("[run]\nduration = 3", "run.duration", "3", "not permitted"),
        ("tags = 3", "tags", "3", "list"),
        ("[run]\nduration_s = 'long'", "run.duration_s", "'long'", "number"),
        ("[run]\nduration_s = -1", "run.duration_s", "-1", "greater than 0"),
        ("[run]\nduration_s = 0", "run.duration_s", "0", "greater than 0"),
        ("[run]\nduration_s = nan", "run.duration_s", "nan", "finite"),
        ("[run]\ntimestep_s = inf", "run.timestep_s", "inf", "finite"),
        ("[run]\nstabilisation = 'glue'", "run.stabilisation", "'glue'", "'baumgarte', 'projection' or 'both'"),
        ("[run]\nintegrator = 'rk5'", "run.integrator", "'rk5'", "'euler', 'implicit', 'implicitfast' or 'rk4'"),
        ("rank_cut = 2", "rank_cut", "2", "less than 1"),
        ("baumgarte.k = -1", "baumgarte.k", "-1", "greater than or equal to 0"),
        ("start.qpos.crank = nan", "start.qpos.crank", "nan", "finite"),
        ("start.qpos.crank = 'up'", "start.qpos.crank", "'up'", "number"),
        ("settings.a.solref = [1]", "settings.a.solref", "[1]", "required"),
        ("settings.a.solver = 'gauss'", "settings.a.solver", "'gauss'", "'newton', 'cg' or 'pgs'"),
        ("expect.rank = 4.5", "expect.rank", "4.5", "integer"),
        ("experiments = []", "experiments", "[]", "at least 1"),
        ("[[experiments]]\nmode = 'fre'", "experiments.0.mode", "'fre'", "'lockstep'"),
        ("[[experiments]]\nmode = 'free'\nforms = ['soft']", "experiments.0.forms.0", "'soft'", "'hard'"),
        ("[[gates]]\nfigure = 'a'\ncause = 'b'", "gates.0", "'a'", "expected min or max"),
        ("[[gates]]\nfigure = 'a'\nmax = 1", "gates.0.cause", "'a'", "required"),
        ("drive.ctrl.m = '1 +'", "drive", "'1 +'", "time law '1 +'"),
        ("drive.ctrl.m = ''", "drive", "''", "is empty"),
        ("drive.ctrl.m = 'k*t'", "drive", "'k*t'", "unknown name 'k'"),
        ("drive.constants.t = 1\ndrive.ctrl.m = 't'", "drive", "'t'", "the time"),
        ("drive.constants.a = 'b'\ndrive.constants.b = 1", "drive", "'b'", "unknown name 'b'"),
    ],
)
def test_mistakes_are_named(tmp_path, toml, key, value, expected):
    text = complaint(tmp_path, TITLE + toml)
    assert f": {key}" in text
    assert value in text
    assert expected in text


def test_title_is_required(tmp_path):
    assert ": title = {}: Field required" in complaint(tmp_path, "")


@pytest.mark.parametrize("toml", ["title = ", "title = 'a'\ntitle = 'b'", "[run\n", "\x00"])
def test_malformed_toml(tmp_path, toml):
    assert "not valid TOML" in complaint(tmp_path, toml)


def test_binary_file(tmp_path):
    (tmp_path / "case.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"case\.toml: not valid TOML"):
        read_case_file(tmp_path / "case.toml")


def test_long_values_are_cut(tmp_path):
    assert len(complaint(tmp_path, TITLE + f"rank_cut = '{'a b' * 500}'")) < 300 + len(str(tmp_path))


@pytest.mark.parametrize("value", ["true", "'12'"])
def test_what_is_not_a_number_is_not_taken_for_one(tmp_path, value):
    assert "run.duration_s" in complaint(tmp_path, TITLE + f"[run]\nduration_s = {value}")


@pytest.mark.parametrize("bound", ["max = inf", "min = -inf", "max = nan", "min = 2\nmax = 1"])
def test_gates_that_cannot_fail_or_cannot_hold_are_refused(tmp_path, bound):
    assert "gates.0" in complaint(tmp_path, TITLE + f"[[gates]]\nfigure = 'a'\ncause = 'b'\n{bound}")


def test_constants_do_not_depend_on_time(tmp_path):
    """A constant is evaluated once: 2*t would silently be 0 for ever."""
    assert "drive" in complaint(tmp_path, TITLE + "drive.constants.w = '2*t'\ndrive.ctrl.m = 'w'")


# The language of the laws.


@pytest.mark.parametrize(
    "source",
    [
        '__import__("os")',
        "__import__",
        "open('/etc/passwd')",
        "t.__class__",
        "lambda: 1",
        "[1, 2]",
        "t; t",
        "exec",
        "{}",
    ],
)
def test_laws_are_not_python(tmp_path, source):
    toml = TITLE + f"[drive.ctrl]\nm = '''{source}'''"
    assert "time law" in complaint(tmp_path, toml)


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("2*t", 6.0),
        ("a^2 - t", 13.0),
        ("sin(0)", 0.0),
        ("PI", 3.141592653589793),
        ("-t", -3.0),
        ("1e-3*t", 3e-3),
    ],
)
def test_laws_compute(source, value):
    assert TimeLaw(source, {"a": 4.0}).at(3.0) == pytest.approx(value, rel=1e-15, abs=0)


def test_a_sign_before_a_power_is_not_misread():
    """−t² is −9 at 3 s in any textbook; a language that reads (−t)² must refuse to guess."""
    with contextlib.suppress(ValueError):
        assert TimeLaw("-t^2").at(3.0) == -9.0


def test_constants_may_use_earlier_ones(tmp_path):
    case = read(tmp_path, TITLE + "[drive]\nconstants = {a = 2, b = '3*a'}\nctrl.m = 'a*b*t'")
    assert case.drive.values() == {"a": 2.0, "b": 6.0}
    assert case.drive.laws()["m"].at(0.5) == 6.0


# From file to run: names that only the model, the core or the summary can know.


def short(tmp_path, experiments="", gates=""):
    return boat_copy(tmp_path / "short", duration_s=0.002, experiments=experiments, gates=gates)


@pytest.mark.parametrize(
    ("experiment", "message"),
    [
        ("mode = 'free'\nsettings = ['soggy']", r"unknown settings 'soggy', expected one of: default, stiff, cg, pgs"),
        ("mode = 'free'\nsolvers = ['gauss']", r"unknown solver 'gauss', expected one of: mujoco, .*sr1"),
        ("mode = 'free'\nsolvers = ['sr1:eps=1']", r"'sr1' has no option 'eps', expected one of: eps_abs"),
        ("mode = 'lockstep'\nwalker = 'gauss'", r"unknown solver 'gauss'"),
        ("mode = 'lockstep'\nsolvers = ['mujoco']", r"name one besides mujoco"),
    ],
)
def test_unknown_names_in_experiments(tmp_path, experiment, message):
    with pytest.raises(InputError, match=message):
        run(short(tmp_path, f"[[experiments]]\n{experiment}\n"))


@pytest.mark.parametrize(
    ("gate", "message"),
    [
        ("figure = 'drift'", r"names 'drift', expected one of: .*drift_pos_max"),
        ("figure = 'drift_pos_max'\nwhere = {sover = 'pinv'}", r"names 'sover', expected one of: .*solver"),
        ("figure = 'status'", r"'status'"),
    ],
)
def test_unknown_names_in_gates(tmp_path, gate, message):
    calibration = "[[experiments]]\nmode = 'calibration'\n"
    with pytest.raises(InputError, match=message):
        run(short(tmp_path, calibration, f"[[gates]]\ncause = 'c'\nmax = 1\n{gate}\n"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"truth": {"file": "reference.csv", "joint": "crnk", "source": ""}}, r"\[truth\] .*'crnk'.* crank, oar2_yaw"),
        ({"drive": {"ctrl": {"motor": "1"}}}, r"\[drive\] .*'motor'.* motor_angle, motor_speed"),
        ({"start": {"qpos": {"crnk": 1}}}, r"\[start\] qpos .*'crnk'.* crank, oar2_yaw"),
    ],
)
def test_unknown_names_in_the_model(changes, message):
    with pytest.raises(InputError, match=message):
        setup_of(boat_with(**changes))


# Finding a case.


def test_every_way_to_name_a_model(tmp_path):
    assert "boat" in model_names()
    by_name, by_folder, by_file = load_case("boat"), load_case(BOAT), load_case(BOAT / "model.xml")
    assert by_name.file == by_folder.file == by_file.file
    assert [case.name for case in (by_name, by_folder, by_file)] == ["boat"] * 3
    bare = write_model(tmp_path / "bare", four_bar())
    assert load_case(bare).file.gates == []
    beside = (BOAT / "model.xml").read_text(encoding="utf-8")
    other = tmp_path / "bare" / "other.xml"
    other.write_text(beside, encoding="utf-8")
    assert load_case(other).name == "other"


@pytest.mark.parametrize("name", ["bogus", "Boat", "", "boat/", "../boat", "/nowhere", "/nowhere/x.xml"])
def test_unknown_models(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"unknown model .*boat|no model file"):
        load_case(name)


def test_case_without_its_model(tmp_path):
    (tmp_path / "case.toml").write_text(TITLE)
    with pytest.raises(InputError, match=r"no model file '.*model\.xml'"):
        run(Path(tmp_path), duration_s=0.01)
