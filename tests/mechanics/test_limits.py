"""What a model may ask for has limits with names: beyond them one line with status 2, at once."""

import os
import time

import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.mechanics import limits
from oarlock.mechanics.load import load_model

AT_ONCE_S = 10.0
"""Of all three commands, in this process, on a busy machine."""

GEOM = '<geom size="0.1" contype="0" conaffinity="0"/>'
PLACE = "<worldbody>"
MODELS = {
    "replicate": (PLACE, f'{PLACE}<replicate count="1e9">{GEOM}</replicate>', "replicate> has count = 1000000000"),
    "nested": (
        PLACE,
        f'{PLACE}<replicate count="100"><replicate count="100">{GEOM}</replicate></replicate>',
        "replicate> has count = 10000",
    ),
    "flex": (PLACE, f'{PLACE}<flexcomp name="f" type="grid" count="999 999 999"/>', "flexcomp> has count"),
    "field": (
        PLACE,
        f'<asset><hfield name="h" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>{PLACE}',
        "nrow × ncol",
    ),
    "keys": (PLACE, f'<size nkey="2000000000"/>{PLACE}', "size> has nkey = 2000000000"),
    "itself": (
        PLACE,
        '<asset><model name="x" file="model.xml"/></asset><worldbody><attach model="x" body="crank" prefix="y"/>',
        "<model> names 'model.xml', which is within itself",
    ),
    "sensor": (
        PLACE,
        f'<sensor><user dim="2000000000" objtype="body" objname="crank"/></sensor>{PLACE}',
        "<user> has dim = 2000000000",
    ),
    "connects": (
        "</equality>",
        '<connect site1="tip1" site2="tip2"/>' * 1000 + "</equality>",
        "1001 equalities, expected",
    ),
    "iterations": ("<option ", '<option iterations="2000000000" tolerance="0" ', "has iterations = 2000000000"),
    "name": ('"pin"', f'"{"x" * 10**6}"', "a name of 1000000 characters"),
    "include": (PLACE, f'<include file="pipe"/>{PLACE}', "include> names 'pipe', which is no regular file"),
    "mesh": (PLACE, f'<asset><mesh file="pipe"/></asset>{PLACE}', "mesh> names 'pipe', which is no regular file"),
    "device": (PLACE, f'<asset><mesh file="/dev/zero"/></asset>{PLACE}', "names '/dev/zero', which is no regular file"),
    "deep": (PLACE, f"{PLACE}{'<body>' * 5000}{'</body>' * 5000}", "element depth exceeded"),
    "digits": ("0.002", "1" * 5000, "number is too large"),
    "long": ("0.002", "1e308", "timestep = 1e+308 s, expected one from 1e-09 to 1e+09 s"),
    "short": ("0.002", "1e-308", "timestep = 1e-308 s"),
    "shorter": ("0.002", "1e-12", "timestep = 1e-12 s"),
}


@pytest.mark.parametrize("kind", list(MODELS))
def test_one_line_at_once(tmp_path, oarlock_here, kind):
    old, new, said = MODELS[kind]
    path = write_model(tmp_path / "m", four_bar().replace(old, new, 1))
    os.mkfifo(path.parent / "pipe")
    began = time.monotonic()
    commands = [
        ("run", path),
        ("new", "fresh", path, "--to", "."),
        ("check", path, "--budget", "0", "--duration", "0.1"),
    ]
    for arguments in commands:
        finished = oarlock_here(*arguments)
        assert finished.returncode == 2, finished.stderr
        (line,) = finished.stderr.splitlines()
        assert said in line
        assert len(line) < 1000
    assert time.monotonic() - began < AT_ONCE_S


@pytest.mark.parametrize(
    "arguments", [("run", "m"), ("new", "fresh", "m", "--to", "."), ("check", "m", "--budget", "0")], ids=lambda a: a[0]
)
def test_an_inertia_that_is_not_positive_definite_is_one_line(tmp_path, oarlock_command, arguments):
    text = four_bar().replace('<joint name="crank"', '<joint name="crank" armature="-5"')
    write_model(tmp_path, text).rename(tmp_path / "m.xml")
    finished = oarlock_command(*("m.xml" if word == "m" else word for word in arguments))
    assert finished.returncode == 2
    (line,) = finished.stderr.splitlines()
    assert "m.xml: the mass matrix is not positive definite" in line


def test_what_is_commented_out_counts_not(tmp_path):
    text = four_bar().replace(PLACE, f'<!-- <replicate count="1e9"/> <include file="pipe"/> -->{PLACE}')
    os.mkfifo(tmp_path / "pipe")
    load_model(write_model(tmp_path, text))


def test_included_files_count(tmp_path):
    (tmp_path / "more.xml").write_text('<mujoco><size nkey="99999"/></mujoco>')
    with pytest.raises(InputError, match="nkey = 99999"):
        load_model(write_model(tmp_path, four_bar().replace(PLACE, f'<include file="more.xml"/>{PLACE}')))


def attaching(folder, files, times):
    """A chain of files, each of which attaches the next so many times."""
    inner = "".join(f'<attach model="m" body="b" prefix="p{i}"/>' for i in range(times))
    for number in range(files):
        last = number == files - 1
        asset = "" if last else f'<asset><model name="m" file="../{folder.name}/m{number + 1}.xml"/></asset>'
        body = f'<body name="b"><geom size="1"/>{"" if last else inner}</body>'
        (folder / f"m{number}.xml").write_text(
            f'<mujoco model="m{number}">{asset}<worldbody>{body}</worldbody></mujoco>'
        )
    return folder / "m0.xml"


@pytest.mark.parametrize(
    ("files", "times", "said"),
    [(30, 2, "attaches models more than 5000 times"), (200, 1, "models within models, more than 100 deep")],
)
def test_models_within_models_have_limits(tmp_path, files, times, said):
    began = time.monotonic()
    with pytest.raises(InputError, match=said):
        load_model(attaching(tmp_path, files, times))
    assert time.monotonic() - began < AT_ONCE_S


def test_some_models_within_models_are_welcome(tmp_path):
    with pytest.raises(InputError, match="no <equality> element"):  # MuJoCo has read it
        load_model(attaching(tmp_path, 5, 2))


def test_a_script_has_the_limits_of_what_comes_out(tmp_path):
    path = tmp_path / "model.py"
    write_model(tmp_path, four_bar())
    path.write_text(
        f"import mujoco\n\ndef build():\n    spec = mujoco.MjSpec.from_file({str(tmp_path / 'model.xml')!r})\n"
        f"    spec.option.iterations = {limits.ITERATIONS + 1}\n    return spec\n"
    )
    with pytest.raises(InputError, match="option iterations = 10001, expected 10000 at most"):
        load_model(path)


def test_a_file_may_be_so_long(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "FILE_BYTES", 100)
    with pytest.raises(InputError, match="expected 100 at most"):
        load_model(write_model(tmp_path, four_bar()))
