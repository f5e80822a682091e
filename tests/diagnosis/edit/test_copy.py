"""Copies of a model: whole or not at all, through links, and to what is no file."""

import difflib
import re

import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.diagnosis.edit import copy
from oarlock.diagnosis.edit.changes import Coefficients, Exclusion, Keyframe, Settings
from oarlock.diagnosis.edit.copy import write_changed
from oarlock.diagnosis.edit.keyframe import write_keyframe
from oarlock.diagnosis.runs.trials import Setting
from oarlock.mechanics.load import load_model


def test_a_copy_that_is_not_the_same_model_is_not_left_behind(tmp_path, monkeypatch):
    path = write_model(tmp_path, four_bar())
    out = tmp_path / "out.xml"
    out.write_text("the user's own")
    monkeypatch.setattr(copy, "differences", lambda *_: ["body_mass"])
    with pytest.raises(InputError, match="another body_mass"):
        write_keyframe(path, out, np.zeros(load_model(path).nq))
    assert out.read_text() == "the user's own"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["model.xml", "out.xml"]


def test_a_copy_through_a_link_names_files_as_seen_from_where_it_lies(tmp_path):
    path = write_model(tmp_path, four_bar())
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "link.xml").symlink_to("far/away/copy.xml")
    write_keyframe(path, tmp_path / "link.xml", np.zeros(load_model(path).nq))
    assert (tmp_path / "link.xml").is_symlink()
    assert load_model(tmp_path / "far" / "away" / "copy.xml").nkey == 1


# The author's text.

NASTY = """<?xml version="1.0" encoding="utf-8"?>
<?editor fold="yes"?>
<!-- a -- four-bar; <equality> of this comment holds nothing -->
<mujoco model='bars &amp; "pins"'>
	<option gravity = "0 0 -9.81"   timestep='0.002' />
	<default>
		<geom type="capsule"/><equality solref="0.01 1"/>
		<default class="stiff"><equality solref='0.004 1'/></default>
	</default>
	<worldbody>
		<body name="crank ä"><joint name='a&lt;b' axis="0 1 0"/><geom fromto="0 0 0 .1 0 .2" size=".01"/></body>
		<body  pos="0.4 0 0"> <!-- it has no name -->
			<joint	name="c" axis="0 1 0"
				damping="0.1"	/>
			<geom fromto="0 0 0 -.1 0 .2" size=".01"/>
			<body name="rod" pos="-.1 0 .2"><joint name="d" axis="0 1 0"/><geom fromto="0 0 0 -.2 0 0" size=".01"/>
			</body>
		</body>
	</worldbody>
	<!-- <equality><weld body1="nobody"/></equality> -->
	<equality>
		<!-- the pin: <connect/> -->
		<connect class='stiff'
			body1="rod" body2="crank ä" anchor="-.2 0 0"/>
	</equality>
	<equality><joint joint1='a&lt;b' joint2="c" polycoef="0.1 1 0 0 0"/></equality>
	<equality/>
	<actuator><motor joint="c"/></actuator>
	<keyframe>
		<key name="first" qpos="0 0 0"/>   <!-- at rest -->
		<key qpos='0.1 0.1
			0.1' qvel="1 1 1" ctrl="0.25"/>
	</keyframe>
</mujoco>
<!-- the end -->
"""
POSE, SPEED = np.array([0.1, 1 / 3, -1e-17]), np.array([0.0, -2 / 3, 0.0])
SETTING = Setting(0.0005, "implicitfast", (0.001, 0.5), (0.9999, 0.9999, 0.001, 0.5, 2.0))
SOFT = "solref={0}0.001 0.5{0} solimp={0}0.9999 0.9999 0.001 0.5 2{0}"


def written(tmp_path, text, changes, name="out.xml"):
    source, out = tmp_path / "model.xml", tmp_path / name
    source.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert write_changed(source, out, changes) == [out]
    return out.read_bytes()


def changed(before: bytes, after: bytes) -> list[tuple[str, str]]:
    """The pieces of two texts that differ, as difflib aligns their words."""
    words = [re.findall(r"\s|[^\s\"'=]+|[\"'=]", text.decode()) for text in (before, after)]
    matcher = difflib.SequenceMatcher(None, *words, autojunk=False)
    return [
        ("".join(words[0][a:b]), "".join(words[1][c:d]))
        for kind, a, b, c, d in matcher.get_opcodes()
        if kind != "equal"
    ]


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_nothing_but_what_was_asked_for_changes(tmp_path, ending, mark):
    before = (mark + NASTY.replace("\n", ending)).encode()
    changes = [
        Settings(SETTING),
        Keyframe(POSE, SPEED, key=1),
        Exclusion(1, 2),
        Coefficients(1, (0.2, 1.0, 0.0, 0.0, 0.0)),
    ]
    after = written(tmp_path, before, changes)
    wanted = mark + NASTY
    for old, new in [
        ("timestep='0.002' />", "timestep='0.0005' integrator='implicitfast' />"),
        ('anchor="-.2 0 0"/>', 'anchor="-.2 0 0" ' + SOFT.format('"') + "/>"),
        ('polycoef="0.1 1 0 0 0"/>', 'polycoef="0.2 1 0 0 0" ' + SOFT.format('"') + "/>"),
        ('<body  pos="0.4 0 0">', '<body  pos="0.4 0 0" name="body2">'),
        (
            "qpos='0.1 0.1\n\t\t\t0.1' qvel=\"1 1 1\"",
            f"qpos='0.1 {1 / 3!r} -1e-17' qvel=\"0 {-2 / 3!r} 0\"",
        ),
        ("</mujoco>", '\t<contact>\n\t\t<exclude body1="crank ä" body2="body2"/>\n\t</contact>\n</mujoco>'),
    ]:
        assert wanted.count(old) == 1
        wanted = wanted.replace(old, new)
    assert after.decode() == wanted.replace("\n", ending)


def test_a_copy_without_changes_is_the_file(tmp_path):
    assert written(tmp_path, "\ufeff" + NASTY, []).decode() == "\ufeff" + NASTY


def test_a_new_keyframe_has_all_but_the_pose_of_another(tmp_path):
    source = tmp_path / "model.xml"
    source.write_text(NASTY, encoding="utf-8")
    assert write_keyframe(source, tmp_path / "out.xml", POSE, SPEED, like=1) == "closed"
    pieces = changed(source.read_bytes(), (tmp_path / "out.xml").read_bytes())
    key = f'<key name="closed" ctrl="0.25" qpos="0.1 {1 / 3!r} -1e-17" qvel="0 {-2 / 3!r} 0"/>'
    assert [old for old, _ in pieces] == [""]
    assert pieces[0][1].strip() == key
    model = load_model(tmp_path / "out.xml")
    assert model.key("closed").ctrl.tolist() == [0.25]
    np.testing.assert_array_equal(model.key("closed").qpos, POSE)


STATE = """<mujoco><option timestep="0.001"/><worldbody>
<body name="m" mocap="true" pos="0 0 1"/>
<body name="b"><joint name="j" axis="0 1 0"/><geom size=".1" pos=".2 0 0"/></body>
</worldbody><equality><connect body1="b" body2="m" anchor="0 0 1"/></equality>
<actuator><general joint="j" dyntype="integrator" ctrlrange="-1 1"/></actuator>
<keyframe>
<key name="k" time="2" qpos="0.5" ctrl="0.125" act="0.3" mpos="0.1 0.2 0.3" mquat="0 1 0 0"/>
</keyframe></mujoco>"""


def test_the_state_of_a_keyframe_stays_in_a_file_of_one_line(tmp_path):
    """A file without a line for each element stays so."""
    text = STATE.replace("\n", "")
    after = written(tmp_path, text, [Keyframe(np.array([0.25]), np.zeros(1), name="closed", like=0)])
    key = '<key name="closed" time="2" ctrl="0.125" act="0.3" mpos="0.1 0.2 0.3" mquat="0 1 0 0" qpos="0.25"/>'
    assert after.decode() == text.replace("</keyframe>", key + "</keyframe>")
    model = load_model(tmp_path / "out.xml")
    for field in ("key_time", "key_act", "key_ctrl", "key_mpos", "key_mquat"):
        first, second = getattr(model, field)
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("\n  <contact/>", "\n  <contact>\n    {}\n  </contact>"),
        ("\n  <contact />", "\n  <contact>\n    {}\n  </contact>"),
        ("\n  <contact></contact>", "\n  <contact>\n    {}\n  </contact>"),
        ("\n  <contact>\n  </contact>", "\n  <contact>\n    {}\n  </contact>"),
        ("\n  <contact> <!-- none --> </contact>", "\n  <contact> <!-- none --> {}</contact>"),
        (
            '\n  <contact>\n      <exclude body1="a" body2="c"/> <!-- why -->\n  </contact>',
            '\n  <contact>\n      <exclude body1="a" body2="c"/> <!-- why -->\n      {}\n  </contact>',
        ),
        ("\n  <contact/><contact/>", "\n  <contact/><contact>{}</contact>"),
        ("<contact/>", "<contact>\n  {}\n</contact>"),
    ],
)
def test_what_is_added_stands_where_the_author_would_put_it(tmp_path, before, after):
    model = four_bar()
    before, after = (text.replace('"a"', '"crank"').replace('"c"', '"rocker"') for text in (before, after))
    source = model.replace("</mujoco>", before + "</mujoco>")
    exclude = '<exclude body1="crank" body2="coupler"/>'
    assert written(tmp_path, source, [Exclusion(1, 2)]).decode() == model.replace(
        "</mujoco>", after.format(exclude) + "</mujoco>"
    )
