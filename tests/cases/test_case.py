"""Case files: data, checked; every mistake is one line with file, key, value and what was expected."""

import contextlib
import json
from pathlib import Path

import pytest
from mechanisms import BOAT, boat_copy, boat_with, four_bar, setup_of, write_model
from oarlock import InputError, load_case, model_names, run, variant_names
from oarlock._core import TimeLaw
from oarlock.cases.case_file import read_case_file

TITLE = 'title = "x"\n'
PUBLISHED = "[[published]]\nsource = 's'\n"


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
        ("[[gates]]\nfigure = 'a'\nmax = 1\nequal = 'b'\ncause = 'c'", "gates.0", "'a'", "not both"),
        ("expect.reactions = 'all'", "expect.reactions", "'all'", "'unique', 'partly unique' or 'not unique'"),
        ("parameters.N = 'two'", "parameters.N", "'two'", "number"),
        ("parameters.N = true", "parameters.N", "True", "number"),
        ("parameters.N = inf", "parameters.N", "inf", "finite"),
        ("variants = [{}]", "variants.0.parameters", "{}", "required"),
        ("variants = [{parameters = {}}]", "variants.0.parameters", "{}", "at least 1"),
        ("variants = [{parameters = {N = 1}, truth = 1}]", "variants.0.truth", "1", "not permitted"),
        ("truth = {file = 'a', source = 'b'}", "truth", "'a'", "names nothing, expected exactly one of joint or site"),
        ("truth = {file = 'a', source = 'b', joint = 'c', site = 'd'}", "truth", "'c'", "names joint and site"),
        ("truth = {file = 'a', source = 'b', equality = 'c'}", "truth.equality", "'c'", "not permitted"),
        (PUBLISHED + "time_s = -1\njoint = 'a'\nposition = 1.0", "published.0.time_s", "-1", "greater than or equal"),
        (PUBLISHED + "joint = 'a'\nposition = 1.0", "published.0.time_s", "'a'", "required"),
        (PUBLISHED + "time_s = 1\nposition = 1.0", "published.0", "1.0", "exactly one of joint, site or equality"),
        (PUBLISHED + "time_s = 1\njoint = 'a'\nsite = 'b'\nposition = 1.0", "published.0", "'b'", "exactly one of"),
        (PUBLISHED + "time_s = 1\njoint = 'a'", "published.0", "'a'", "gives nothing, expected of a joint"),
        (PUBLISHED + "time_s = 1\njoint = 'a'\nposition = [1, 2, 3]", "published.0", "'a'", "a number each"),
        (PUBLISHED + "time_s = 1\nsite = 'a'\nposition = 1.0", "published.0", "'a'", "position = [x, y, z]"),
        (PUBLISHED + "time_s = 1\nsite = 'a'\nposition = [1, 2]", "published.0", "'a'", "position = [x, y, z]"),
        (PUBLISHED + "time_s = 1\nequality = 'a'\nvelocity = 1.0", "published.0", "'a'", "expected of a equality"),
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


# What only the whole file can know: the message names the key itself.


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        ("parameters.t = 1", "parameters.t: not a name that an expression can use"),
        ("parameters.PI = 1", "parameters.PI: not a name"),
        ("parameters.sin = 1", "parameters.sin: not a name"),
        ("parameters.'a b' = 1", "parameters.a b: not a name"),
        ("expect.nv = '6*N'", "unknown name 'N'"),
        ("expect.nv = '6*'", "time law '6*'"),
        ("parameters.N = 2\nexpect.nv = 'N - 3'", "expect.nv = 'N - 3' is -1, expected a whole number"),
        ("parameters.N = 2\nexpect.nv = 'N/4'", "expect.nv = 'N/4' is 0.5, expected a whole number"),
        ("parameters.N = 2\nexpect.nv = 't'", "expect.nv = 't' is 0, expected a whole number"),
        ("parameters.N = 2\nexpect.dof = '1/(N - 2)'", "expect.dof = '1/(N - 2)' is inf"),
        ("variants = [{parameters = {N = 1}}]", "unknown parameter 'N', expected one of: (there are none)"),
        ("parameters.N = 2\nvariants = [{parameters = {M = 1}}]", "unknown parameter 'M', expected one of: N"),
        ("parameters.N = 2\nvariants = [{parameters = {N = 1.5}}]", "parameter N = 1.5, expected an integer"),
        ("parameters.N = 2\nvariants = [{parameters = {N = 2}}]", "variants.0.parameters are those of an earlier"),
        ("parameters.N = 2\nvariants = [{parameters = {N = 1}, expect = {nv = 'M'}}]", "unknown name 'M'"),
        ("beyond = [{where = 'M', experiments = [{mode = 'free'}]}]", "unknown name 'M'"),
        ("beyond = [{where = 't', experiments = [{mode = 'free'}]}]", "beyond.where = 't' depends on t"),
        ("truth = {file = 'a{M}', source = 'b', joint = 'c'}", "unknown parameter in 'a{M}' 'M'"),
        (
            PUBLISHED + "time_s = 11\njoint = 'a'\nposition = 1.0",
            "published value at time_s = 11, expected one within run.duration_s = 10",
        ),
    ],
)
def test_mistakes_between_keys_are_named(tmp_path, toml, message):
    assert f": {message}" in complaint(tmp_path, TITLE + toml)


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


@pytest.mark.parametrize(
    "name", ["E", "e", "PI", "π", "TAU", "τ", "t", "sin", "abs", "é", "a b", "2x", "", "x.y", " x"]
)
def test_names_that_mean_something_else_are_refused(tmp_path, name):
    """Its value would be ignored: E is 2.718 whatever the case says."""
    said = complaint(tmp_path, f"{TITLE}[drive]\nconstants = {{ {json.dumps(name)} = 1.5 }}")
    assert f"drive = {{'constants': {{{name!r}: 1.5}}}}: constant '{name}': not a name that" in said


@pytest.mark.parametrize("name", ["x", "_x", "ω", "omega2", "Ek", "pi", "tau", "T"])
def test_other_names_are_constants(tmp_path, name):
    case = read(tmp_path, f"{TITLE}[drive]\nconstants = {{ {json.dumps(name)} = 1.5 }}")
    assert case.drive.values() == {name: 1.5}


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
        run(Path(tmp_path), duration=0.01)


# Parametrised models.

PARAMETRISED = """
title = "row of pendulums"
[parameters]
N = 2
length = 0.5
[expect]
nv = "N + 1"
dof = 1
[run]
duration_s = 0.01
[[experiments]]
mode = "calibration"
[[gates]]
figure = "drift_pos_max"
max = 1.0
cause = "c"
[[variants]]
parameters = { N = 3 }
run.duration_s = 0.004
expect.dof = 2
[[variants.experiments]]
mode = "free"
[[variants.gates]]
figure = "drift_vel_max"
max = 1.0
cause = "c"
[[variants]]
parameters = { N = 3, length = 0.25 }
"""

BUILD = """
import mujoco

def build(N, length):
    if N < 1:
        raise ValueError(f"N = {N}, expected at least 1")
    if N > 9:
        return {}["ten"]
    body = (spec := mujoco.MjSpec()).worldbody
    for i in range(N + 1):
        body = body.add_body(name=f"b{i}", pos=[length, 0, 0])
        body.add_joint(name=f"j{i}", axis=[0, 1, 0])
        body.add_geom(size=[0.1, 0, 0], pos=[length, 0, 0])
    if N != 8:
        spec.add_equality(name="end", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=body.name)
    return spec if N != 7 else 7
"""


@pytest.fixture
def parametrised(tmp_path):
    folder = tmp_path / "row"
    folder.mkdir()
    (folder / "case.toml").write_text(PARAMETRISED, encoding="utf-8")
    (folder / "model.py").write_text(BUILD, encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("given", "name", "slug", "parameters", "listed"),
    [
        ("", "row", "row", {"N": 2, "length": 0.5}, True),
        (":N=2", "row", "row", {"N": 2, "length": 0.5}, True),
        (":N=3", "row:N=3", "row-N=3", {"N": 3, "length": 0.5}, True),
        (":length=0.25, N=3", "row:N=3,length=0.25", "row-N=3-length=0.25", {"N": 3, "length": 0.25}, True),
        (":length=1", "row:length=1.0", "row-length=1.0", {"N": 2, "length": 1.0}, False),
    ],
)
def test_parameters_are_addressed(parametrised, given, name, slug, parameters, listed):
    case = load_case(f"{parametrised}{given}")
    assert (case.name, case.slug, case.parameters, case.listed) == (name, slug, parameters, listed)
    assert [type(value) for value in case.parameters.values()] == [int, float]  # range(2.0) is an error
    assert case.expected()["nv"] == parameters["N"] + 1
    assert setup_of(case, duration_s=0.01).model.nv == parameters["N"] + 1
    assert {path.name for path in parametrised.iterdir()} == {"case.toml", "model.py"}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (":M=3", r"unknown parameter 'M', expected one of: N, length"),
        (":N=two", r"parameter 'N=two' in '.*row:N=two', expected key=number"),
        (":N", r"parameter 'N' in .* expected key=number"),
        (":=3", r"parameter '=3' in .* expected key=number"),
        (":N=3,N=4", r"parameter 'N' in .* is given twice"),
        (":N=3.5", r"parameter N = 3\.5, expected an integer"),
        (":N=1e1", r"parameter N = 10\.0, expected an integer"),
        (":length=nan", r"parameter length = nan, expected a finite number"),
        (":N=" + "9" * 400, r"expected key=number"),
        (":N=0", r"model\.py: build:N=0,length=0\.5: N = 0, expected at least 1"),
        (":N=10", r"model\.py: build:N=10,length=0\.5: KeyError: 'ten'"),
        (":N=7", r"model\.py: build:N=7,length=0\.5 gives a int, expected a mujoco\.MjSpec"),
        (":N=8", r"no <equality> element"),
    ],
)
def test_mistaken_parameters_are_named(parametrised, given, message):
    with pytest.raises(InputError, match=message) as raised:
        setup_of(load_case(f"{parametrised}{given}"))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def build(:", r"build:N=2,length=0\.5: SyntaxError: invalid syntax"),
        ("import gone_for_good", r"ModuleNotFoundError: No module named 'gone_for_good'"),
        ("import sys; sys.exit(3)", r"SystemExit: 3"),
        ("built = 1", r"model\.py: no function 'build', expected build\(\*\*parameters\)"),
        ("def build(N): pass", r"TypeError: build\(\) got an unexpected keyword argument 'length'"),
        ("import mujoco\ndef build(**_): return mujoco.MjSpec.from_string('<mujoco><')", r"build:N=2,length=0\.5: "),
    ],
)
def test_broken_model_scripts_are_named(parametrised, source, message):
    (parametrised / "model.py").write_text(source, encoding="utf-8")
    with pytest.raises(InputError, match=message) as raised:
        setup_of(load_case(parametrised))
    assert "\n" not in str(raised.value)


def test_parameters_of_a_model_without_any():
    with pytest.raises(InputError, match=r"unknown parameter 'N', expected one of: \(there are none\)"):
        load_case("boat:N=3")


def test_a_folder_with_two_models(parametrised):
    write_model(parametrised, four_bar())
    with pytest.raises(InputError, match=r"holds model\.xml and model\.py, expected one of the two"):
        load_case(parametrised)


def test_variants_of_a_case(parametrised):
    names = variant_names(parametrised)
    assert names == [str(parametrised), f"{parametrised}:N=3", f"{parametrised}:N=3,length=0.25"]
    plain, three, small = (load_case(name) for name in names)
    assert [experiment.mode for case in (plain, three, small) for experiment in case.file.experiments] == [
        "calibration",
        "free",
        "calibration",
    ]
    assert [gate.figure for case in (plain, three, small) for gate in case.file.gates] == [
        "drift_pos_max",
        "drift_vel_max",
        "drift_pos_max",
    ]
    assert [case.file.run.duration_s for case in (plain, three, small)] == [0.01, 0.004, 0.01]
    assert [case.expected() for case in (plain, three)] == [{"nv": 3, "dof": 1}, {"nv": 4, "dof": 2}]
    assert variant_names("boat") == ["boat"]


def test_what_is_run_of_parameters_in_a_range(parametrised):
    """Of what is listed, what is listed counts."""
    with open(parametrised / "case.toml", "a") as file:
        for bound, solver in ((2, "cholesky"), (5, "auto")):
            file.write(f"[[beyond]]\nwhere = 'N - {bound}'\nrun.duration_s = 0.002\n")
            file.write(f"[[beyond.experiments]]\nmode = 'free'\nsolvers = ['{solver}']\n")
    found = {}
    for count in (1, 3, 4, 5, 6):
        file = load_case(f"{parametrised}:N={count}").file
        found[count] = [(experiment.mode, *experiment.solvers) for experiment in file.experiments], file.run.duration_s
    assert found == {
        1: ([("calibration", "pinv")], 0.01),
        3: ([("free", "pinv")], 0.004),
        4: ([("free", "cholesky")], 0.002),
        5: ([("free", "cholesky")], 0.002),
        6: ([("free", "auto")], 0.002),
    }
    assert len(variant_names(parametrised)) == 3


def test_gates_are_held_for_listed_parameters_only(parametrised):
    """Bounds were set for the defaults and the variants; for others they say nothing."""
    listed, other = run(f"{parametrised}:N=3,length=0.25"), run(f"{parametrised}:N=4")
    assert {row["case"] for row in other.rows} == {"row:N=4"}
    assert [(v.gate.figure, v.held) for v in listed.verdicts if v.run != "start"] == [("drift_pos_max", True)]
    assert [(v.gate.figure, v.held) for v in other.verdicts if v.run != "start"] == [("drift_pos_max", None)]


@pytest.mark.parametrize(("expected", "held"), [("not unique", False), ("unique", True)])
def test_expected_reactions_are_held_against_the_model(tmp_path, expected, held):
    write_model(tmp_path / "bar", four_bar(), f'{TITLE}[expect]\nreactions = "{expected}"\n')
    results = run(tmp_path / "bar", mode="free", solver="pinv", duration=0.01)
    (verdict,) = results.verdicts
    assert (verdict.value, verdict.held) == ("unique", held)
    assert f"reactions = unique of start, expected {expected}" in verdict.line()


def test_words_can_be_bounded(tmp_path):
    toml = f"{TITLE}[run]\nduration_s = 0.01\n[[experiments]]\nmode = 'calibration'\n"
    gate = "[[gates]]\ncause = 'c'\nfigure = 'status'\nequal = '{}'\n"
    write_model(tmp_path / "bar", four_bar(), toml + gate.format("done") + gate.format("diverged"))
    assert [verdict.held for verdict in run(tmp_path / "bar").verdicts] == [True, False]
    write_model(tmp_path / "bar", four_bar(), toml + gate.format("done").replace("status", "drift_pos_max"))
    with pytest.raises(InputError, match=r"bounds 'drift_pos_max', expected a figure in words"):
        run(tmp_path / "bar")
