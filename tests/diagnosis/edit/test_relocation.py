"""Changed copies of models of several files: what is copied, what stays, and by which names files find one another."""

import shutil

import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock.base.errors import InputError
from oarlock.diagnosis.edit import copy
from oarlock.diagnosis.edit.changes import Coefficients, Exclusion, Keyframe, Settings
from oarlock.diagnosis.edit.copy import write_changed
from oarlock.diagnosis.runs.trials import Setting
from oarlock.mechanics.load import load_model
from oarlock.mechanics.mjcf import differences
from strange import FILES, TETRAHEDRON

SETTING = Setting(0.0005, "implicitfast", (0.001, 0.5), (0.9999, 0.9999, 0.001, 0.5, 2.0))
MAIN = """<mujoco>
  <include file="parts/common.xml"/>
  <worldbody>
    <body name="a"><joint name="a" axis="0 1 0"/><geom type="mesh" mesh="knob"/></body>
    <body name="b" pos="0.5 0 0"><joint name="b" axis="0 1 0"/><geom size="0.1"/></body>
  </worldbody>
  <include file="loop.xml"/>
</mujoco>
"""
COMMON = """<mujoco>
  <asset><mesh name="knob" file="../shapes/knob.obj"/></asset>
  <include file="deep/option.xml"/>
</mujoco>
"""
OPTION = """<mujocoinclude><option timestep="0.004"/></mujocoinclude>
"""
LOOP = """<mujocoinclude>
  <equality>
    <joint name="gear" joint1="a" joint2="b"/>
  </equality>
</mujocoinclude>
"""


@pytest.fixture
def nested(tmp_path):
    """A main file, whose includes lie in folders of their own, with a mesh that is found beside one of them only."""
    folder = tmp_path / "model"
    (folder / "parts" / "deep").mkdir(parents=True)
    (folder / "shapes").mkdir()
    for name, text in [
        ("main.xml", MAIN),
        ("parts/common.xml", COMMON),
        ("parts/deep/option.xml", OPTION),
        ("loop.xml", LOOP),
        ("shapes/knob.obj", TETRAHEDRON),
    ]:
        (folder / name).write_text(text)
    return folder


def test_a_change_in_an_included_file_makes_a_copy_of_it_beside(nested):
    out = nested / "fixed.xml"
    assert [
        path.name for path in write_changed(nested / "main.xml", out, [Coefficients(0, (0.1, 1.0, 0.0, 0.0, 0.0))])
    ] == [
        "fixed-loop.xml",
        "fixed.xml",
    ]
    assert out.read_text() == MAIN.replace("loop.xml", "fixed-loop.xml")
    assert (nested / "fixed-loop.xml").read_text() == LOOP.replace('"b"/>', '"b" polycoef="0.1 1 0 0 0"/>')
    assert load_model(out).eq_data[0, 0] == 0.1


def test_an_include_within_an_include_takes_the_way_to_it_along(nested):
    out = nested / "fixed.xml"
    written = write_changed(nested / "main.xml", out, [Settings(Setting(0.001, "euler"))])
    assert {path.name for path in written} == {"fixed-common.xml", "fixed-option.xml", "fixed.xml"}
    assert out.read_text() == MAIN.replace("parts/common.xml", "fixed-common.xml")
    # The mesh was found beside the file that names it, and is named from where its copy lies.
    assert (nested / "fixed-common.xml").read_text() == COMMON.replace("../shapes", "shapes").replace(
        "deep/option.xml", "fixed-option.xml"
    )
    assert (nested / "fixed-option.xml").read_text() == OPTION.replace("0.004", "0.001")
    assert load_model(out).opt.timestep == 0.001


def test_names_beside_the_copy_are_not_those_of_the_author(nested):
    (nested / "loop.xml").rename(nested / "fixed-loop.xml")
    main = MAIN.replace("loop.xml", "fixed-loop.xml")
    (nested / "main.xml").write_text(main)
    out = nested / "fixed.xml"
    write_changed(nested / "main.xml", out, [Settings(SETTING)])
    assert (nested / "fixed-loop.xml").read_text() == LOOP
    assert "solref" in (nested / "fixed-fixed-loop.xml").read_text()
    shutil.copy(nested / "fixed-loop.xml", nested / "fixed-fixed-loop.xml")
    (nested / "main.xml").write_text(main.replace("fixed-loop.xml", "fixed-fixed-loop.xml"))
    before = (nested / "fixed-fixed-loop.xml").read_text()
    out.unlink()
    write_changed(nested / "main.xml", nested / "fixed.xml", [Settings(SETTING)])
    assert (nested / "fixed-fixed-loop.xml").read_text() == before


@pytest.mark.parametrize("place", ["model/elsewhere", ".", "model/parts"])
def test_from_another_folder_the_names_lead_to_the_same_files(nested, tmp_path, place):
    source, out = nested / "main.xml", tmp_path / place / "fixed.xml"
    out.parent.mkdir(exist_ok=True)
    (written,) = write_changed(source, out, [])
    assert differences(load_model(source), load_model(written)) == []
    ways = {"model/elsewhere": "../{}", ".": "model/{}", "model/parts": "../{}"}
    wanted = MAIN
    for name in ("loop.xml", "parts/common.xml"):
        way = ways[place].format(name).replace("../parts/", "" if place == "model/parts" else "../parts/")
        wanted = wanted.replace(f'"{name}"', f'"{way}"')
    assert out.read_text() == wanted


def test_a_folder_of_meshes_is_named_once_from_another_folder(tmp_path):
    """Files that are found beside the model stay as they are written: the folder is said to <compiler>."""
    folder = tmp_path / "model"
    (folder / "out").mkdir(parents=True)
    (folder / "knob.obj").write_text(TETRAHEDRON)
    asset = '<asset><mesh name="one" file="knob.obj"/><mesh name="two" file="knob.obj" scale="2 2 2"/></asset>'
    text = four_bar(rest=asset)
    write_model(folder, text)
    write_changed(folder / "model.xml", folder / "out" / "copy.xml", [])
    compiler = '<compiler angle="radian"/>'
    assert (folder / "out" / "copy.xml").read_text() == text.replace(compiler, compiler[:-2] + ' meshdir=".."/>')
    stripped = text.replace(compiler, '<compiler angle="radian" strippath="true"/>').replace("knob", "some/where/knob")
    write_model(folder, stripped)
    write_changed(folder / "model.xml", folder / "out" / "copy.xml", [])
    assert "some/where/knob" in (folder / "out" / "copy.xml").read_text()
    (folder / "shapes").mkdir()
    (folder / "knob.obj").rename(folder / "shapes" / "knob.obj")
    text = text.replace(compiler, "<compiler angle=\"radian\" assetdir='shapes'/>")
    write_model(folder, text)
    write_changed(folder / "model.xml", folder / "out" / "copy.xml", [])
    assert (folder / "out" / "copy.xml").read_text() == text.replace("'shapes'", "'../shapes'")


@pytest.mark.parametrize("name", list(FILES))
@pytest.mark.parametrize("place", ["gripper", "elsewhere"])
def test_files_of_other_authors(strange, tmp_path, name, place):
    shutil.copytree(strange, tmp_path / "files")
    source, out = tmp_path / "files" / FILES[name], tmp_path / "files" / place / "fixed.xml"
    out.parent.mkdir(exist_ok=True)
    model = load_model(source)
    changes = [Settings(SETTING), Keyframe(model.qpos0 + 0.0, np.full(model.nv, 1 / 3), name="new")]
    before = {path: path.read_bytes() for path in (tmp_path / "files").rglob("*.*")}
    written = write_changed(source, out, changes)
    assert {path: path.read_bytes() for path in before} == before
    assert {*before, *written} == set((tmp_path / "files").rglob("*.*"))
    SETTING.apply(model)
    copy = load_model(out)
    assert [field for field in differences(model, copy) if not field.startswith(("key_", "nkey"))] == []
    np.testing.assert_array_equal(copy.key("new").qvel, np.full(model.nv, 1 / 3))


def test_a_keyframe_in_an_included_file_is_changed_in_a_copy_of_that(nested):
    key = '<mujocoinclude>\n  <keyframe><key name="k" qpos="0 0" ctrl=""/></keyframe>\n</mujocoinclude>\n'
    (nested / "key.xml").write_text(key)
    main = MAIN.replace("</mujoco>", '  <include file="key.xml"/>\n</mujoco>')
    (nested / "main.xml").write_text(main)
    write_changed(nested / "main.xml", nested / "out.xml", [Keyframe(np.array([1 / 3, 0.0]), np.zeros(2), key=0)])
    assert (nested / "out.xml").read_text() == main.replace("key.xml", "out-key.xml")
    assert (nested / "out-key.xml").read_text() == key.replace("0 0", f"{1 / 3!r} 0")


def test_files_of_others_stay_and_earlier_copies_are_replaced(nested):
    (nested / "fixed-loop.xml").write_text("of somebody else, as is 'fixed-common.xml'")
    for _ in range(2):
        written = write_changed(nested / "main.xml", nested / "fixed.xml", [Settings(SETTING)])
        assert {path.name for path in written} == {
            *("fixed-loop-2.xml", "fixed-common.xml", "fixed-option.xml", "fixed.xml")
        }
    assert (nested / "fixed-loop.xml").read_text() == "of somebody else, as is 'fixed-common.xml'"


def test_nothing_is_left_of_a_copy_that_is_another_model(nested, monkeypatch):
    (nested / "out-loop.xml").write_text("an old copy")
    before = {path: path.read_bytes() for path in nested.rglob("*.*")}
    monkeypatch.setattr(copy, "differences", lambda *_: ["body_mass"])
    with pytest.raises(InputError, match="another body_mass"):
        write_changed(nested / "main.xml", nested / "out.xml", [Settings(SETTING)])
    assert {path: path.read_bytes() for path in nested.rglob("*.*")} == before


# Models within models.

UNIT = """<mujoco model="unit">
  <option timestep="0.002"/>
  <worldbody><body name="arm"><joint name="hinge" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body></worldbody>
  <equality><connect name="pin" body1="arm" anchor="0 0 0"/></equality>
</mujoco>
"""
PARENT = """<mujoco>
  <option timestep="0.002"/>
  <asset><model name="unit" file="unit.xml"/></asset>
  <worldbody>
    <frame><attach model="unit" prefix="left_"/></frame>
    <frame pos="1 0 0"><attach model="unit" prefix="right_"/></frame>
  </worldbody>
  <equality><joint joint1="left_hinge" joint2="right_hinge"/></equality>
</mujoco>
"""


def test_what_is_attached_is_changed_in_a_copy_of_its_own(tmp_path):
    (tmp_path / "unit.xml").write_text(UNIT)
    (tmp_path / "parent.xml").write_text(PARENT)
    out = tmp_path / "out.xml"
    written = write_changed(tmp_path / "parent.xml", out, [Settings(SETTING), Exclusion(1, 2)])
    assert [path.name for path in written] == ["out-unit.xml", "out.xml"]
    model = load_model(out)
    np.testing.assert_array_equal(model.eq_solref, np.tile(SETTING.solref, (3, 1)))
    soft = ' solref="0.001 0.5" solimp="0.9999 0.9999 0.001 0.5 2"/>'
    step = 'timestep="0.0005" integrator="implicitfast"'
    assert (tmp_path / "out-unit.xml").read_text() == UNIT.replace('"0 0 0"/>', '"0 0 0"' + soft).replace(
        'timestep="0.002"', step
    )
    contact = '  <contact>\n    <exclude body1="left_arm" body2="right_arm"/>\n  </contact>\n'
    assert out.read_text() == PARENT.replace('timestep="0.002"', step).replace("unit.xml", "out-unit.xml").replace(
        '"right_hinge"/>', '"right_hinge"' + soft
    ).replace("</mujoco>", contact + "</mujoco>")


def test_an_equality_that_is_a_copy_cannot_be_changed_alone(tmp_path):
    source = tmp_path / "model.xml"
    source.write_text("""<mujoco><worldbody><replicate count="2" offset="1 0 0">
      <body name="a"><joint name="j" axis="0 1 0"/><geom size=".1"/>
        <body pos=".3 0 0"><joint name="k" axis="0 1 0"/><geom size=".1"/></body></body></replicate></worldbody>
      <equality><joint name="e" joint1="j" joint2="k"/></equality></mujoco>""")
    out = tmp_path / "out.xml"
    with pytest.raises(InputError, match="equality 'e1' is a copy of one in the file"):
        write_changed(source, out, [Coefficients(1, (0.1, 1.0, 0.0, 0.0, 0.0))])
    with pytest.raises(InputError, match="body #2 has no name and is a copy of one in the file"):
        write_changed(source, out, [Exclusion(1, 2)])
    assert not out.exists()
    write_changed(source, out, [Settings(SETTING)])
    np.testing.assert_array_equal(load_model(out).eq_solref, np.tile(SETTING.solref, (2, 1)))


def test_a_copy_to_a_pipe_names_files_in_full(nested, tmp_path):
    pipe = tmp_path / "pipe"
    pipe.symlink_to("/dev/null")
    assert write_changed(nested / "main.xml", pipe, [Exclusion(1, 2)]) == [pipe]
    with pytest.raises(InputError, match="has to lie beside the copy, expected a file to write to"):
        write_changed(nested / "main.xml", pipe, [Settings(SETTING)])
