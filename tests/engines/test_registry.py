"""Heads of programs, how engines are written, and their environments."""

import sys

import pytest
from fake_engines import program
from oarlock.base.errors import InputError
from oarlock.engines import environments, registry
from oarlock.engines.registry import PRECISIONS, QUESTIONS, parse_engine, programs, read_program


def test_every_program_has_a_head():
    found = programs()
    assert {"mujoco", "mjx", "mujoco_warp", "drake", "newton"} <= set(found)
    for one in found.values():
        assert one.requirements
        assert one.title
        assert one.package in " ".join(one.requirements)
        assert set(one.questions) <= set(QUESTIONS)
        assert set(one.precisions) <= set(PRECISIONS)


@pytest.mark.parametrize(
    ("text", "name", "requirements"),
    [
        ("mujoco@3.7", "mujoco@3.7", {"mujoco==3.7.*"}),
        ("mujoco@3.3.7", "mujoco@3.3.7", {"mujoco==3.3.7.*"}),
        ("mjx@3.17:precision=float32", "mjx@3.17:precision=float32", {"mujoco-mjx==3.17.*", "mujoco==3.17.*", "jax"}),
        ("mjx:precision=float64", "mjx", {"jax"}),
        ("mujoco=/usr/bin/python3", "mujoco", {"numpy"}),
        ("mjx:precision=float32=/opt/jax/bin/python", "mjx:precision=float32", {"jax"}),
    ],
)
def test_engines_as_they_are_written(text, name, requirements):
    engine = parse_engine(text)
    assert engine.name == name
    assert requirements <= set(engine.requirements)


def test_an_interpreter_is_taken_whole():
    assert parse_engine("mujoco=/a=b/c:d/python").python == "/a=b/c:d/python"
    assert parse_engine("mjx:precision=float32=/opt/py").python == "/opt/py"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bullet", "unknown engine 'bullet', expected one of: .*mujoco"),
        ("mujoco@latest", "expected NAME, NAME@VERSION or NAME=PYTHON"),
        ("mujoco@", "expected NAME, NAME@VERSION or NAME=PYTHON"),
        ("mjx:precision=half", "unknown precision of engine 'mjx' 'half'"),
        ("mjx:precision", "expected key=value"),
        ("/no/such/program.py", "cannot be read"),
    ],
)
def test_a_mistake_is_one_line(text, message):
    with pytest.raises(InputError, match=message) as error:
        parse_engine(text)
    assert "\n" not in str(error.value)


def test_a_program_without_a_head(tmp_path):
    path = tmp_path / "bare.py"
    path.write_text("print()")
    with pytest.raises(InputError, match="has no head"):
        read_program(path)


def test_a_program_of_the_users_own(tmp_path):
    engine = parse_engine(str(program(tmp_path, "true")))
    assert engine.name == "true"
    assert environments.find(engine).python == sys.executable
    with pytest.raises(InputError, match="no package of its own"):
        parse_engine(f"{tmp_path / 'true.py'}@1.0")


@pytest.mark.parametrize(
    ("requirement", "held"),
    [
        ("numpy", True),
        ("numpy>=1", True),
        ("numpy>=1,<2", False),
        ("numpy==999.*", False),
        ("no-such-package", False),
        ("numpy!=999", True),
        ("numpy~=2.0", True),
        ("numpy>=2; python_version > '3'", True),
    ],
)
def test_what_an_interpreter_holds(requirement, held):
    assert environments._holds(requirement) is held


def test_an_environment_is_a_folder_by_its_requirements(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    places = {environments.place(parse_engine(text)) for text in ("mujoco@3.6", "mujoco@3.7", "mjx", "mjx@3.17")}
    assert len(places) == 4
    assert {place.parent for place in places} == {tmp_path / "oarlock" / "engines"}
    assert environments.place(parse_engine("mjx")) == environments.place(parse_engine("mjx:precision=float32"))
    assert environments.find(parse_engine("mujoco@3.6")) is None


@pytest.mark.parametrize("uv", [None, "/opt/uv"])
def test_how_to_make_one_is_a_line_to_copy(monkeypatch, tmp_path, uv):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(environments, "_uv", lambda: uv)
    said = environments.how_to(parse_engine("mjx@3.17"))
    assert "\n" not in said
    assert "'oarlock conform … --install'" in said
    assert "mujoco-mjx==3.17.*" in said
    assert ("/opt/uv venv" in said) is bool(uv)
    assert "--target" in environments.how_to(parse_engine("mujoco@3.6"))


def test_an_installer_that_fails_leaves_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    broken = [sys.executable, "-c", "import sys; sys.exit('no such version')"]
    monkeypatch.setattr(environments, "commands", lambda engine, folder: [broken])
    with pytest.raises(InputError, match=r"engine 'mujoco@3\.6' cannot be installed: no such version"):
        environments.make(parse_engine("mujoco@3.6"))
    assert list((tmp_path / "oarlock" / "engines").iterdir()) == []


def test_a_digest_is_of_what_a_program_takes(tmp_path, monkeypatch):
    """A file of ``shared/`` counts for those that import it, also by way of another one."""
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "far.py").write_text("x = 1")
    (shared / "near.py").write_text("from shared.far import x")
    (shared / "other.py").write_text("y = 1")
    monkeypatch.setattr(registry, "SHARED", shared)
    path = program(tmp_path, "true")
    path.write_text(path.read_text() + "\nfrom shared import near\n")
    one = read_program(path)
    before = one.digest
    (shared / "other.py").write_text("y = 2")
    assert one.digest == before
    (shared / "far.py").write_text("x = 2")
    assert one.digest != before
