"""``oarlock close``: one command from an open URDF to a closed model that a check finds nothing wrong with."""

import json
from pathlib import Path
from typing import get_args

import pytest
from mechanisms import four_bar
from oarlock.cli.close import KINDS
from oarlock.closing.joining import Kind
from oarlock.stepping.closing import CLOSED
from places import FIXTURES

URDF = FIXTURES / "closing" / "four_bar.urdf"
PIN = '<equality><connect name="pin" site1="tip1" site2="tip2"/></equality>'


def test_an_open_urdf_is_closed_with_one_command(oarlock_here):
    said = oarlock_here("close", URDF, "-o", "closed.xml")
    assert (said.returncode, said.stderr) == (0, "oarlock: written: closed.xml\n")
    assert "'pin' (connect) joins 'closing_pin_1' and 'closing_pin_2'." in said.stdout
    checked = oarlock_here("check", "closed.xml", "--json", "-", "--fail-above", CLOSED)
    assert checked.returncode == 0, checked.stderr
    document = json.loads(checked.stdout)
    assert [one for one in document["findings"] if one["severity"] != "note"] == []
    assert document["loops"]["dof"] == 1
    assert [one["metres"] <= CLOSED for one in document["drift"] if one["level"] == "position"] == [True]


def test_the_json_says_what_was_joined_and_found(oarlock_here):
    said = oarlock_here("close", URDF, "-o", "closed.xml", "--as", "hinge", "--json", "-")
    assert said.returncode == 0
    document = json.loads(said.stdout)
    (joined,) = document["joined"]
    assert (joined["name"], joined["as"]) == ("pin", "hinge")
    assert document["files"] == ["closed.xml"]
    assert 0 <= document["gap"] <= CLOSED
    assert document["lint"] == []


def test_what_the_lint_finds_is_said(oarlock_here):
    """A weld where a pin leaves the mechanism its degree of freedom, drawn closed."""
    Path("open.xml").write_text(four_bar().replace(PIN, ""))
    said = oarlock_here(
        "close", "open.xml", "--pair", "coupler", "rocker", "--at", "0.5,0,0.5", "--as", "weld", "-o", "c.xml"
    )
    assert said.returncode == 1
    assert "L10" in said.stdout
    assert Path("c.xml").is_file()


def test_what_stays_open_is_said_with_status_1(oarlock_here):
    Path("open.xml").write_text(four_bar(pivot="3 0 0").replace(PIN, ""))
    said = oarlock_here("close", "open.xml", "--pair", "tip1", "tip2", "-o", "c.xml")
    assert (said.returncode, said.stdout) == (1, "")
    (line,) = said.stderr.splitlines()
    assert line.startswith("oarlock: open.xml: no pose closes the loops: tip1_tip2 stays open by ")
    assert line.endswith(" m or rad at best; nothing is written")
    assert not Path("c.xml").exists()


def test_a_weld_that_cannot_be_closed_names_what_can(oarlock_here):
    asked = ("close", str(URDF), "--pair", "closing_pin_1", "closing_pin_2", "-o", "c.xml")
    said = oarlock_here(*asked, "--as", "weld")
    assert said.returncode == 1
    assert "; a weld holds the orientation too, expected --as hinge or --as connect" in said.stderr
    assert oarlock_here(*asked, "--as", "hinge").returncode == 0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("gone.xml -o c.xml", "oarlock: no model file 'gone.xml'"),
        ("open.xml --pair tip1 tip2", "oarlock: close: no --out, expected --out OUT.xml"),
        ("open.xml -o c.xml --pair tip1", "oarlock: --pair tip1 without another name, expected two: --pair A B"),
        ("open.xml --pair tip1 -o c.xml", "oarlock: --pair tip1 without another name, expected two: --pair A B"),
        ("open.xml --pair -o c.xml", "oarlock"),
        ("open.xml -o c.xml --pair tip1 tp2", "oarlock: no site, frame or body 'tp2', expected tip2"),
        ("open.xml -o c.xml --pair tip1 tip2 --as glue", "oarlock: unknown kind 'glue', expected one of: connect, "),
        ("open.xml -o c.xml --pair tip1 tip2 --at 1,2", "oarlock: --at 1,2, expected X,Y,Z, three finite numbers in m"),
        ("open.xml -o c.xml --at 1,2,3", "oarlock: --at with 0 pairs, expected one --pair"),
        ("open.xml -o open.xml --pair tip1 tip2", "oarlock: 'open.xml' is the model itself"),
        ("open.xml -o no/c.xml --pair tip1 tip2", "oarlock: 'no/c.xml' cannot be written: no folder "),
        ("open.xml -o c.xml", "oarlock: no --pair, and no frames called closing_NAME_1 and closing_NAME_2"),
    ],
)
def test_a_mistake_is_one_line(oarlock_here, arguments, line):
    Path("open.xml").write_text(four_bar().replace(PIN, ""))
    said = oarlock_here("close", *arguments.split())
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr.startswith(line)
    assert len(said.stderr.splitlines()) == 1
    assert not Path("c.xml").exists()


def test_the_kinds_are_those_that_there_are():
    assert get_args(Kind) == KINDS
