"""Fixed files: what is in them, that they hold what they promise in plain MuJoCo, and that all else stays as it was."""

import difflib
import json
import math
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.base.numbers import figure
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import examine
from oarlock.diagnosis.fix.fix import fix_model
from oarlock.diagnosis.lint.collision import Collision
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.verdict.verdicts import judge
from places import FIXTURES, REPOSITORY

CHECKED, MODELS = FIXTURES / "check", REPOSITORY / "mjcf"

AGAIN = 1e-6
"""Relative. The same run in plain MuJoCo: the energy is not asked for there, and nothing else differs."""

# Plain MuJoCo.


def drift(path: Path, duration_s: float, key: int | None = None, ctrl=None) -> float:
    """The largest gap of an equality, m or rad, from the file's own start, with controls held; inf: not finite."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    if ctrl is not None:
        data.ctrl[:] = ctrl
    worst = 0.0
    for _ in range(round(duration_s / model.opt.timestep)):
        mujoco.mj_forward(model, data)
        if data.warning[int(mujoco.mjtWarning.mjWARN_BADQACC)].number:
            return math.inf
        worst = max([worst, *gaps(model, data)])
        mujoco.mj_step(model, data)
    return worst


def gaps(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[float]:
    """Distances of the two points of an equality, angles of its two frames, and deviations of couplings."""
    for equality in np.unique(data.efc_id[: data.ne]):
        rows = data.efc_pos[: data.ne][data.efc_id[: data.ne] == equality]
        kind = mujoco.mjtEq(int(model.eq_type[equality]))
        if kind not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            yield from np.abs(rows)
            continue
        yield float(np.sqrt((rows[:3] ** 2).sum()))
        if kind == mujoco.mjtEq.mjEQ_WELD:
            sine = float(np.sqrt((rows[3:] ** 2).sum())) / model.eq_data[equality, 10]
            yield 2.0 * math.asin(min(1.0, sine))


def fixed(source: Path, out: Path, collisions=(), **asked):
    exam = begin(str(source), CheckOptions(**asked))
    for _ in examine(exam):
        pass
    exam.collisions = tuple(collisions) or exam.collisions
    return fix_model(exam, judge(exam), out), exam


def collides(source: Path, body1: str, body2: str, equality: str, depth: float) -> Collision:
    model = mujoco.MjModel.from_xml_path(str(source))
    numbers = sorted(int(one.removeprefix("#")) if "#" in one else model.body(one).id for one in (body1, body2))
    return Collision(body1, body2, (numbers[0], numbers[1]), equality, depth, 0.0)


# What changed.

VALUE = r"""=("[^"]*"|'[^']*')"""
STRIPPED = {
    "option": rf"(timestep|integrator|solver|iterations|tolerance|ls_iterations){VALUE}",
    "connect|weld|joint|tendon": rf"(solref|solimp|polycoef|relpose){VALUE}",
    "key": rf"(qpos|qvel){VALUE}",
    "body": r'name="body\d+"',
}
"""Elements → attributes that a fix may change."""
ADDED = re.compile(r"\s*</?(exclude|key|contact|keyframe|option|compiler)\b[^<]*>\s*")


def stripped(text: str) -> str:
    """A text without the attributes that a fix may change."""
    for tags, attributes in STRIPPED.items():
        text = re.sub(rf"<({tags})\b[^>]*>", lambda tag, found=attributes: re.sub(rf"\s*\b{found}", "", tag[0]), text)
    return re.sub(r"[ \t]+(/?>)", r"\1", text)


def assert_only_fixes(source: Path, out: Path, beside: Sequence[str] = ()) -> None:
    """Every line of the copy is one of the source, one with other settings, or an element that a fix may add.

    Files that are copied ``beside`` it are named there and not where they were.
    """
    before, after = (path.read_bytes().decode() for path in (source, out))
    for name in beside:
        after = re.sub(rf'"{name}"', lambda _, name=name: f'"{name.removeprefix("fixed-")}"', after)
    before, after = (stripped(text).splitlines(keepends=True) for text in (before, after))
    for kind, a, b, c, d in difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes():
        if kind == "replace":  # an empty section that was filled
            assert [ADDED.fullmatch(line) for line in before[a:b] if not ADDED.fullmatch(line)] == []
        assert kind in ("equal", "insert", "replace"), before[a:b]
        if kind != "equal":
            assert [line for line in after[c:d] if not ADDED.fullmatch(line)] == []


# What is in it.

SERVO = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0" damping="0.01"/><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank">
      <joint name="crank"/><geom fromto="0 0 0 0 0 0.3"/>
      <body name="coupler" pos="0 0 0.3"><joint name="coupler"/><geom fromto="0 0 0 0.5 0 0.2"/></body>
    </body>
    <body name="rocker" pos="0.7 0 0"><joint name="rocker"/><geom fromto="0 0 0 -0.2 0 0.5"/></body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.5 0 0.2"/></equality>
  <actuator><position joint="crank" kp="50" kv="2"/></actuator>
  <keyframe>
    <key name="home" qpos="0.4 -0.1 0.1" ctrl="0.4"/> <!-- by eye -->
  </keyframe>
</mujoco>
"""


def test_a_start_that_is_open_is_closed_in_its_own_keyframe(tmp_path):
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(SERVO)
    fix, exam = fixed(source, out, duration=0.5, target=1e-5)
    assert fix.reached, fix.reason
    assert_only_fixes(source, out)
    assert '" ctrl="0.4"/> <!-- by eye -->' in out.read_text()
    assert drift(source, 0.5, key=0) > 0.01
    assert drift(out, 0.5, key=0) == pytest.approx(fix.after.drift, rel=AGAIN)
    assert fix.after.drift <= 1e-5
    model = mujoco.MjModel.from_xml_path(str(out))
    np.testing.assert_array_equal(model.key_qpos[0], exam.pose.qpos)
    assert (model.nkey, model.key_ctrl[0, 0]) == (1, 0.4)
    assert "S1" in fix.mended
    assert {one.code for one in fix.left} & {"S1", "D1", "D3"} == set()


def test_changed_lines_lead_from_the_model_to_the_copy(tmp_path):
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(four_bar(pivot="0.69 0 0"))
    fix, _ = fixed(source, out, duration=0.3, target=1e-5)
    lines = source.read_text().splitlines()
    assert [one.file for one in fix.lines] == ["fixed.xml"] * len(fix.lines)
    assert {one.before is None for one in fix.lines} == {True, False}
    for one in sorted(fix.lines, key=lambda one: one.number, reverse=True):
        if one.before is not None:
            assert lines[one.number - 1] == one.before
            lines[one.number - 1] = one.after
    added = {}
    for one in fix.lines:
        if one.before is None:
            added.setdefault(one.number, []).append(one.after)
    for number, new in sorted(added.items(), reverse=True):
        lines[number:number] = new
    assert lines == out.read_text().splitlines()


def test_the_page_has_a_chapter_on_the_fix(tmp_path):
    (tmp_path / "model.xml").write_text(SERVO)
    checked = oarlock.check(tmp_path / "model.xml", duration=0.3, target=1e-5)
    checked.report(tmp_path / "before")
    assert "What the fix changed" not in (tmp_path / "before" / "README.md").read_text()
    fix = checked.fix(tmp_path / "fixed.xml")
    checked.report(tmp_path / "page")
    html, text = ((tmp_path / "page" / name).read_text() for name in ("index.html", "README.md"))
    assert '<h2 id="fixed">7. What the fix changed</h2>' in html
    chapter = text.split("## 7. What the fix changed")[1]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in chapter.splitlines() if line.startswith("|")]
    changed = [row for row in rows if row[0] == "fixed.xml"]
    assert [row[1] for row in changed] == [str(one.number) for one in fix.lines]
    assert "<key name=" in changed[-1][2].replace("\\", "")
    told = next(row for row in rows if row[0] == "the user's controls")
    assert told[1:] == [figure(fix.before.drift, "m"), figure(fix.after.drift, "m")]
    assert "Not found any more" in chapter


@pytest.mark.parametrize("code", ["S1", "C4", "D1"])
def test_what_a_fix_mends_says_so(oarlock_here, code):
    assert "--fix OUT.xml" in oarlock_here("explain", code).stdout


def test_a_start_that_is_no_keyframe_becomes_the_first_one(tmp_path):
    source, out = write_model(tmp_path, four_bar(pivot="0.69 0 0")), tmp_path / "fixed.xml"
    fix, exam = fixed(source, out, duration=0.5, target=1e-5)
    assert fix.reached, fix.reason
    assert fix.begins == "keyframe 'closed'"
    assert_only_fixes(source, out)
    np.testing.assert_array_equal(mujoco.MjModel.from_xml_path(str(out)).key_qpos, [exam.pose.qpos])
    assert drift(source, 0.5) > 5e-3
    assert drift(out, 0.5, key=0) == pytest.approx(fix.after.drift, rel=AGAIN)


def test_bodies_that_collide_at_their_pin_are_excluded(tmp_path):
    text = SERVO.replace(' contype="0" conaffinity="0"', "").replace("0.4 -0.1 0.1", "0 0 0").replace('ctrl="0.4"', "")
    text = text.replace("0 0 0 0.5 0 0.2", "0 0 0 0.5 0 0.23")  # the pin is beside the middle of the coupler's end
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(text)
    pins = [collides(source, "coupler", "rocker", "pin", 0.04)] * 2
    fix, _ = fixed(source, out, pins, duration=0.5, target=1e-3, controls="keyframe")
    assert fix.reached, fix.reason
    assert [one.what for one in fix.changes] == [
        "no contacts of 'coupler' and 'rocker', which 'pin' joins and which collide by 40 mm"
    ]
    exclude = '  <contact>\n    <exclude body1="coupler" body2="rocker"/>\n  </contact>\n'
    assert out.read_text() == text.replace("</mujoco>", exclude + "</mujoco>")
    assert drift(source, 0.5, key=0) > 5 * drift(out, 0.5, key=0)
    assert fix.changes[0].without.drift == pytest.approx(drift(source, 0.5, key=0), rel=AGAIN)


def test_an_open_start_is_closed_though_softness_opens_more(tmp_path):
    """By itself the closed start changes nothing of the drift; with settings that hold, it is all that is left."""
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(SERVO.replace("0.4 -0.1 0.1", "1e-4 0 0").replace("<connect", '<connect solref="0.1 1"'))
    fix, _ = fixed(source, out, duration=0.3, target=1e-5, controls="keyframe")
    assert 1e-5 < drift(source, 0.001, key=0) < 0.1 * drift(source, 0.3, key=0)
    assert fix.reached, fix.reason
    assert len(fix.changes) == 2
    assert drift(out, 0.3, key=0) <= 1e-5


def test_the_keyframe_of_an_attached_model_is_written_anew(tmp_path):
    key = '<keyframe><key name="k" qpos="0.2 0 0" ctrl="0.25"/></keyframe></mujoco>'
    unit = re.sub(r"<keyframe>.*</mujoco>", key, SERVO, flags=re.DOTALL).replace("<mujoco>", '<mujoco model="unit">', 1)
    (tmp_path / "unit.xml").write_text(unit)
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text("""<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <asset><model name="unit" file="unit.xml"/></asset>
  <worldbody><frame><attach model="unit" prefix="u_"/></frame></worldbody>
</mujoco>
""")
    pins = [collides(source, "u_coupler", "u_rocker", "u_pin", 0.0)]
    fix, exam = fixed(source, out, pins, duration=0.2, target=1e-3)
    assert fix.begins == "keyframe 'closed'"
    model = mujoco.MjModel.from_xml_path(str(out))
    np.testing.assert_array_equal(model.key("closed").qpos, exam.pose.qpos)
    assert model.key("closed").ctrl.tolist() == [0.25]
    assert '<key name="closed" ctrl="0.25" qpos=' in out.read_text()
    assert model.nexclude == 1
    assert_only_fixes(source, out)


def test_bodies_that_are_copies_cannot_be_excluded(tmp_path):
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text("""<mujoco><worldbody><replicate count="2" offset="1 0 0">
      <body name="a"><joint name="j" axis="0 1 0"/><geom size=".1"/>
        <body pos=".3 0 0"><joint name="k" axis="0 1 0"/><geom size=".1"/></body></body></replicate></worldbody>
      <equality><joint name="e" joint1="j" joint2="k"/></equality></mujoco>""")
    fix, _ = fixed(source, out, [collides(source, "a0", "#2", "e0", 0.1)], duration=0.05, target=1e-2)
    assert fix.changes == ()
    assert len(fix.left_out) == 1
    assert "has no name and is a copy of one in the file" in fix.left_out[0]


def test_what_does_not_help_is_left_out(tmp_path):
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(SERVO.replace("0.4 -0.1 0.1", "0 0 0"))
    fix, _ = fixed(source, out, duration=0.5, target=1e-3, controls="keyframe")
    assert fix.changes == ()
    assert fix.reached
    assert out.read_bytes() == source.read_bytes()
    assert next(fix.told()).startswith("nothing to fix")


def test_a_target_out_of_reach_still_gives_the_best_file(tmp_path):
    gear = """<mujoco><option timestep="0.001"/><worldbody>
      <body><joint name="a" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/></body>
      <body><joint name="b" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
      <equality><joint joint1="a" joint2="b" polycoef="0 1 0.4 0 0"/></equality></mujoco>"""
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(gear)
    fix, _ = fixed(source, out, duration=0.1, target=1e-14, budget=0.5)
    assert not fix.reached
    assert "opens by" in fix.reason
    assert 1e-14 < drift(out, 0.1) < 0.1 * drift(source, 0.1)
    assert_only_fixes(source, out)


def test_loops_that_cannot_be_closed_leave_the_file_as_it_is(tmp_path):
    source, out = CHECKED / "unreachable.xml", tmp_path / "fixed.xml"
    fix, _ = fixed(source, out)
    assert out.read_bytes() == source.read_bytes()
    assert "no pose near the start closes the loops" in fix.reason
    assert next(fix.told()).startswith("nothing that was tried helps")


def test_what_has_no_place_is_refused(tmp_path):
    path = write_model(tmp_path, four_bar())
    checked = oarlock.check(path, budget=0, duration=0.01)
    for out, said in ((path, "is the model itself"), (tmp_path / "no" / "out.xml", "no folder")):
        with pytest.raises(InputError, match=said):
            checked.fix(out)
    assert checked.document()["fix"] is None
    with pytest.raises(InputError, match="by a script"):
        oarlock.check("n_four_bar", budget=0, duration=0.01).fix(tmp_path / "out.xml")


# The command.


def test_the_command_writes_the_file_and_says_what_changed(oarlock_here):
    text = four_bar(pivot="0.699 0 0").replace("<connect", '<connect solref="0.2 1"')
    source = write_model(Path(), text)
    said = oarlock_here("check", source, "--fix", "fixed.xml", "--json", "out.json")
    assert said.returncode == 0, said.stderr
    assert "Fixed: fixed.xml" in said.stdout
    assert "changed  a keyframe 'closed' with the nearest closed pose" in said.stdout
    fix = json.loads(Path("out.json").read_text())["fix"]
    assert fix["reached"]
    assert fix["drift"] <= fix["target"] < fix["drift_before"]
    assert fix["drift"] == pytest.approx(drift(Path("fixed.xml"), 2.0, key=0), rel=AGAIN)
    assert set(fix["mended"]) >= {"D1", "S1"}
    again = oarlock_here("check", "fixed.xml", "--budget", "0", "--fail-above", fix["target"])
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize("flag", ["--fix", "--write-tuned"])
def test_a_target_out_of_reach_costs_nothing_else(oarlock_here, flag):
    said = oarlock_here(
        *("check", CHECKED / "diverges.xml", "--target", "1e-15", "--budget", "0.3", "--duration", "0.1"),
        *(flag, "out.xml", "--report", "page", "--json", "out.json"),
    )
    assert said.returncode == 1
    assert "warning: out.xml" in said.stderr
    assert Path("out.xml").is_file()
    assert any(Path("page").glob("*.html"))
    assert json.loads(Path("out.json").read_text())["recipe"]["outcome"] in ("not-reached", "undecided")


# All that there are.

QUICK = ["damped_gripper.xml", "tilted_hinge.xml"]
FILES = sorted(path.relative_to(CHECKED).as_posix() for path in CHECKED.rglob("*.xml"))
PARTS = {"gripper_2f/defaults.xml", "biped_leg/common.xml", "none.xml"}
SLOW = [name for name in FILES if name not in PARTS and name not in QUICK]
GALLERY = sorted(path.parent.name for path in MODELS.glob("*/model.xml"))


@pytest.mark.parametrize(
    "source",
    [
        *(pytest.param(CHECKED / name, id=name) for name in QUICK),
        *(pytest.param(CHECKED / name, id=name, marks=pytest.mark.slow) for name in SLOW),
        *(pytest.param(MODELS / name / "model.xml", id=name, marks=pytest.mark.slow) for name in GALLERY),
    ],
)
def test_a_fixed_file_is_what_it_says(source, tmp_path):
    """Contacts, limits and friction act. The target is held, or a sentence says why not."""
    if source.parent == CHECKED:
        shutil.copy(source, tmp_path)
    else:
        shutil.copytree(source.parent, tmp_path, dirs_exist_ok=True)
    source, out = tmp_path / source.name, tmp_path / "fixed.xml"
    fix, _ = fixed(source, out)
    assert fix.after.drift <= fix.target or fix.reason
    assert not fix.before.drift < fix.after.drift
    for path in fix.written:
        before = source if path == out else tmp_path / path.name.removeprefix("fixed-")
        assert_only_fixes(before, path, [one.name for one in fix.written])
    model = mujoco.MjModel.from_xml_path(str(out))
    if not model.nu:
        key = 0 if model.nkey else None
        assert drift(out, 2.0, key) == pytest.approx(fix.after.drift, rel=AGAIN, abs=1e-15)
    # Its own check, as a user would run it.
    again = oarlock.check(out, budget=0, **({"keyframe": "closed"} if "'closed'" in fix.begins else {}))
    found = {one.code for one in again.verdict if one.severity != "note"}
    assert not found & set(fix.mended)
    assert fix.reason or not found & {"S1", "C4", "D1", "D2", "D3", "D4", "D6"}
    assert (
        max((one.largest for one in again.examination.drifts if one.level == "position"), default=0.0)
        <= max(fix.after.drift, fix.target)
        or fix.elsewhere_reason
    )


def test_a_limit_that_is_pushed_in_is_not_mended(tmp_path):
    """Stiff rows close the coupling by driving the jaw beyond its range, which plain MuJoCo shows."""
    out = tmp_path / "pushed.xml"
    made = oarlock.check(FIXTURES / "check" / "short_range.xml").fix(out)
    model = mujoco.MjModel.from_xml_path(str(out))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < 2.0:
        mujoco.mj_step(model, data)
    assert data.joint("jaw").qpos[0] > model.joint("jaw").range[1] + 3e-3
    assert "C5" not in made.mended
    (one,) = (one for one in made.left if one.code == "C5")
    assert "widen the range of 'jaw' to 0.02" in one.line


# Limits.

STRUCK = """
<mujoco>
  <compiler autolimits="true" angle="radian"/>
  <option timestep="0.001"/>
  <default><joint axis="0 1 0" damping="0.005"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="flywheel"/><geom fromto="0 0 0 0.2 0 0" mass="2"/></body>
    <body pos="0 0.2 0"><joint name="flap" range="-0.5 0.5"/><geom fromto="0 0 0 0.2 0 0" mass="0.1"/></body>
  </worldbody>
  <equality><joint name="belt" joint1="flap" joint2="flywheel" solref="0.05 1"/></equality>
</mujoco>
"""


def overrun(path: Path, joint: str, duration_s: float, key: int | None = None) -> float:
    """How far a joint is beyond its range at most."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, (low, high) = mujoco.MjData(model), model.joint(joint).range
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, key)
    most = 0.0
    for _ in range(round(duration_s / model.opt.timestep)):
        place = data.joint(joint).qpos[0]
        most = max(most, low - place, place - high)
        mujoco.mj_step(model, data)
    return most


@pytest.mark.parametrize("given", ["struck", "short_range"])
def test_a_limit_that_settings_overrun_further_is_told_with_both_figures(tmp_path, given):
    source, out = tmp_path / "model.xml", tmp_path / "fixed.xml"
    source.write_text(STRUCK if given == "struck" else (CHECKED / "short_range.xml").read_text())
    joint, unit, key = ("flap", "rad", None) if given == "struck" else ("jaw", "m", 0)
    checked = oarlock.check(source, duration=0.6, target=1e-5)
    fix = checked.fix(out)
    before, after = overrun(source, joint, 0.6, key), overrun(out, joint, 0.6, key)
    assert after > 1.2 * before
    told = f"the limit of joint '{joint}' is overrun by {after:.2g} {unit} in place of {before:.2g} {unit}"
    (settings,) = (str(one) for one in fix.changes if "solref" in one.what)
    assert settings.endswith(told)
    assert sum(told in line for line in fix.told()) >= 2
    assert fix.document()["overrun"] == {
        "limit": f"limit of joint '{joint}'",
        "before": pytest.approx(before, rel=AGAIN),
        "after": pytest.approx(after, rel=AGAIN),
        "unit": unit,
    }
    checked.report(tmp_path / "page")
    row = f"limit of joint '{joint}' | the user's controls | {figure(before, unit)} | {figure(after, unit)}"
    assert row in (tmp_path / "page" / "README.md").read_text()


def test_a_limit_that_settings_leave_alone_is_not_told(tmp_path):
    source = tmp_path / "model.xml"
    source.write_text(STRUCK.replace("-0.5 0.5", "-5 5"))
    fix = oarlock.check(source, duration=0.3, target=1e-5).fix(tmp_path / "fixed.xml")
    assert fix.changes
    assert not any("overrun" in line for line in fix.told())
    assert fix.document()["overrun"] is None
