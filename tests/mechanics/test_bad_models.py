"""Broken models and cases: one line that names the value and what was expected, exit status 2, no traceback.

A model that diverges, on whichever side, is a result and no mistake.
"""

import re

import pytest
from mechanisms import four_bar, only, write_model
from oarlock import run

GOOD = four_bar()
FLEX = """<mujoco><worldbody><body name="a"><joint/><geom size="1" contype="0"/></body>
<flexcomp name="f" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" mass="1"><edge equality="true"/></flexcomp>
</worldbody></mujoco>"""
BALL = """<mujoco><worldbody><body name="bob"><joint name="ball" type="ball"/><geom size="0.1" pos="0 0 1"/>
</body></worldbody><equality><connect body1="bob" anchor="0 0 1"/></equality></mujoco>"""
WALL = (
    """<worldbody><geom name="wall" type="sphere" size="0.1" pos="0 0 0.3" contype="1" conaffinity="1"/></worldbody>"""
)
HAND = '<geom name="hand" type="sphere" size="0.1" contype="1" conaffinity="1"/>'


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def rest(text: str) -> str:
    return four_bar(rest=text)


def complaint(finished) -> str:
    """The one line of a user's mistake."""
    assert finished.returncode == 2, finished.stderr
    assert finished.stdout == ""
    lines = finished.stderr.splitlines()
    assert len(lines) == 1, finished.stderr
    assert lines[0].startswith("oarlock: ")
    return lines[0]


MUJOCO_REFUSES = "model.xml: MuJoCo refuses it: "
NO_XML = "model.xml: XML that cannot be read: "

FILES = {
    # Not a model at all.
    "empty": ("", MUJOCO_REFUSES + "ParseXML: empty file"),
    "blank": (" \n", NO_XML),
    "malformed": ("<mujoco><worldbody><body>", NO_XML),
    "text": ("hello world", NO_XML),
    "html": ("<html><body>404</body></html>", MUJOCO_REFUSES + "XML Error: Unrecognized XML model type: 'html'"),
    "binary": (bytes(range(256)) * 9, NO_XML),
    "zeros": (b"\0" * 99, NO_XML),
    "utf-16": (GOOD.encode("utf-16"), NO_XML),
    "latin-1": (GOOD.replace("pin", "pín").encode("latin-1"), "a name holds the byte 0xed, expected UTF-8"),
    "urdf": ('<robot name="a"><link name="b"/></robot>', "no <equality> element, expected at least one"),
    # MuJoCo would leave constraints out, with a warning to nobody.
    "memory": (
        rest('<size memory="500"/>'),
        "the model's memory of 500 bytes does not hold its constraints, expected a larger <size memory",
    ),
    # Nothing to close.
    "open chain": (
        '<mujoco><worldbody><body><joint/><geom size="1"/></body></worldbody></mujoco>',
        "no <equality> element, expected at least one that closes a loop",
    ),
    "no joint": (
        '<mujoco><worldbody><body name="a"/></worldbody>'
        '<equality><connect body1="a" anchor="0 0 0"/></equality></mujoco>',
        "no joint, expected a mechanism that can move",
    ),
    "inactive": (
        changed('name="pin"', 'name="pin" active="false"'),
        "no active equality rows at the start (equalities: 'pin'), expected a closed loop",
    ),
    "disabled": (rest('<option><flag equality="disable"/></option>'), "no active equality rows at the start"),
    "no constraints": (rest('<option><flag constraint="disable"/></option>'), "no active equality rows at the start"),
    "flex": (FLEX, "equality '#0' is a flex, expected connect, weld, joint or tendon"),
    # Files that are missing.
    "mesh": (rest('<asset><mesh name="m" file="gone.stl"/></asset>'), "Error opening file 'gone.stl'"),
    "bad mesh": (rest('<asset><mesh name="m" file="model.xml"/></asset>'), "no decoder found for mesh file"),
    "include": (rest('<include file="gone.xml"/>'), "Error opening file 'gone.xml' Element 'include'"),
    "itself": (rest('<include file="model.xml"/>'), "'model.xml' already included"),
    # Names.
    "unknown element": (rest("<gearbox/>"), "unrecognized element Element 'gearbox'"),
    "unknown attribute": (changed('name="pin"', 'name="pin" colour="red"'), "unrecognized attribute: 'colour'"),
    "unknown site": (changed('site2="tip2"', 'site2="tip3"'), "unknown element 'tip3' in equality constraint"),
    "same site": (changed('site2="tip2"', 'site2="tip1"'), "element 'tip1' is repeated in equality constraint"),
    "two joints": (changed('joint name="rocker"', 'joint name="crank"'), "repeated name 'crank' in joint"),
    "two sites": (changed('site name="tip2"', 'site name="tip1"'), "repeated name 'tip1' in site"),
    # Numbers.
    "word": (changed("0.7 0 0", "far"), "bad format in attribute 'pos'"),
    "too few": (changed('pos="0.7 0 0"', 'pos="0.7 0"'), "attribute 'pos' does not have enough data"),
    "no mass": (
        changed("contype", 'mass="0" contype'),
        "mass and inertia of moving bodies must be larger than mjMINVAL",
    ),
    "negative mass": (changed("contype", 'mass="-1" contype'), "mass, inertia or density are negative"),
    "tiny mass": (changed("contype", 'density="1e-30" contype'), "mass and inertia of moving bodies must be larger"),
    "NaN mass": (
        changed("contype", 'mass="nan" contype'),
        'mass="nan" of a geom is not a number, expected finite numbers only',
    ),
    "NaN place": (changed("0.7 0 0", "NaN 0 0"), 'pos="NaN 0 0" of'),
    "NaN beside names of it": (
        changed('name="pin"', 'name="nan" solref="nan 1"').replace("<mujoco>", '<mujoco model="left as nan">'),
        "solref=\"nan 1\" of connect 'nan' is not a number",
    ),
    "NaN gravity": (rest('<option gravity="0 0 nan"/>'), 'gravity="0 0 nan" of option is not a number'),
    "NaN softness": (
        changed('name="pin"', 'name="pin" solref="nan 1"'),
        "solref=\"nan 1\" of connect 'pin' is not a number",
    ),
    "NaN key": (rest('<keyframe><key qpos="nan 0 0"/></keyframe>'), 'qpos="nan 0 0" of a key is not a number'),
    "inf place": (changed("0.7 0 0", "inf 0 0"), "body_pos holds inf, expected finite numbers"),
    "inf stiffness": (four_bar(joint='stiffness="inf"'), "jnt_stiffness holds inf, expected finite numbers"),
    "inf gravity": (rest('<option gravity="0 0 -inf"/>'), "option gravity holds inf, expected finite numbers"),
    "overflow": (
        rest('<equality><joint joint1="crank" joint2="rocker" polycoef="1e308 1e308 1e308 0 0"/></equality>'),
        "has rows that are not finite at the start, expected finite numbers",
    ),
    "no quaternion": (rest('<worldbody><body quat="0 0 0 0"/></worldbody>'), "zero quaternion is not allowed"),
    "timestep 0": (changed("0.002", "0"), "timestep of the model = 0 s, expected a finite number > 0"),
    "timestep < 0": (changed("0.002", "-0.001"), "timestep of the model = -0.001 s, expected a finite number > 0"),
    "timestep inf": (changed("0.002", "inf"), "timestep of the model = inf s, expected a finite number > 0"),
    "timestep NaN": (changed("0.002", "nan"), 'timestep="nan" of option is not a number'),
    "timestep huge": (changed("0.002", "1e6"), "timestep = 1e+06 s is longer than the duration of 10 s"),
    # Loops that do not close.
    "far": (four_bar(pivot="5 0 0"), "cannot be closed: equality 'pin' stays open by 3.6"),
    "farther": (four_bar(pivot="1e300 0 0"), "cannot be closed: equality 'pin' stays open by 1e+300"),
}


@pytest.mark.parametrize("what", FILES)
@pytest.mark.parametrize("command", ["run", "new"])
def test_files(oarlock_here, tmp_path, what, command):
    content, message = FILES[what]
    (tmp_path / "model.xml").write_bytes(content if isinstance(content, bytes) else content.encode())
    arguments = ["run", "model.xml"] if command == "run" else ["new", "x", "model.xml", "--to", "."]
    assert message in complaint(oarlock_here(*arguments))
    assert [path.name for path in tmp_path.iterdir()] == ["model.xml"]  # no MUJOCO_LOG.TXT either


def test_mujoco_itself_is_kept_from_the_terminal(oarlock_command, tmp_path):
    """It warns from its own library, past Python's streams: only a process of its own shows that."""
    (tmp_path / "model.xml").write_text(rest('<option gravity="0 0 nan"/>'))
    assert "is not a number" in complaint(oarlock_command("run", "model.xml"))


@pytest.mark.parametrize("command", ["run {}", "new x {}"])
@pytest.mark.parametrize(
    ("path", "run_message", "new_message"),
    [
        ("gone.xml", "no model file 'gone.xml'", "no model file 'gone.xml'"),
        ("folder.xml", "no model file 'folder.xml'", "no model file 'folder.xml'"),
        ("folder", "folder 'folder' holds no case.toml", "'folder', expected an MJCF file whose name ends in .xml"),
        ("notes.txt", "'notes.txt', expected a model's name, its folder, or an MJCF file", "'notes.txt', expected"),
        ("gone.mjcf", "unknown model 'gone.mjcf', expected one of: ", "'gone.mjcf', expected an MJCF file"),
    ],
)
def test_paths(oarlock_here, tmp_path, command, path, run_message, new_message):
    (tmp_path / "folder.xml").mkdir()
    (tmp_path / "folder").mkdir()
    (tmp_path / "notes.txt").write_text("mine")
    line = complaint(oarlock_here(*command.format(path).split()))
    assert (run_message if command.startswith("run") else new_message) in line


TRUTH = "truth = {file = 't.csv', joint = 'crank', source = 's'}"
GATE = "[[gates]]\nfigure = '{}'\ncause = 'c'\n{}\n"
SHORT = "run.duration_s = 0.01\n"
MOTOR = rest('<actuator><motor name="motor" joint="crank"/></actuator>')

CASES = {
    "joint": (GOOD, "start.qpos.crnk = 0.1", "joint in [start] qpos of case 'bar' 'crnk', expected one of: crank"),
    "rate": (GOOD, "start.qvel.crnk = 0.1", "joint in [start] qvel of case 'bar' 'crnk', expected one of: crank"),
    "size": (GOOD, "start.qpos.crank = [0.1, 0.2]", "qpos of joint 'crank' in case 'bar' has 2 numbers, expected 1"),
    "NaN": (GOOD, "start.qpos.crank = nan", "start.qpos.crank"),
    "norm": (BALL, "start.qpos.ball = [2, 0, 0, 0]", "qpos of joint 'ball' in case 'bar' has a quaternion of norm 2"),
    "zero": (BALL, "start.qpos.ball = [0, 0, 0, 0]", "has a quaternion of norm 0, expected 1"),
    "actuator": (MOTOR, "drive.ctrl.moter = '1'", "actuator in [drive] of case 'bar' 'moter', expected one of: motor"),
    "no actuator": (GOOD, "drive.ctrl.motor = '1'", "'motor', expected one of: (there are none)"),
    "law": (MOTOR, "drive.ctrl.motor = 'sin('", "time law 'sin('"),
    "law of x": (MOTOR, "drive.ctrl.motor = '2*x'", "unknown name 'x'"),
    "law at 0": (MOTOR, "drive.ctrl.motor = '1/t'", "is inf at t = 0 s, expected a finite control"),
    "gate": (GOOD, GATE.format("drift_pos_max", ""), "gates.0"),
    "figure": (GOOD, SHORT + GATE.format("drift", "max = 1.0"), "names 'drift', expected one of: run, case,"),
    "where": (GOOD, SHORT + GATE.format("drift_pos_max", "max = 1.0\nwhere = {sover = 'pinv'}"), "names 'sover'"),
    "variant": (GOOD, "parameters.N = 1\nvariants = [{parameters = {M = 2}}]", "unknown parameter 'M', expected one"),
    "timestep": (GOOD, "run.timestep_s = 0", "run.timestep_s = 0: Input should be greater than 0"),
    "negative": (GOOD, "run.timestep_s = -1e-3", "run.timestep_s = -0.001: Input should be greater than 0"),
    "duration": (GOOD, "run.duration_s = 0", "run.duration_s = 0: Input should be greater than 0"),
    "no step": (GOOD, "run.duration_s = 1e-3", "timestep = 0.002 s is longer than the duration of 0.001 s"),
    "too many": (GOOD, "run.timestep_s = 1e-9", "10 s at a timestep of 1e-09 s are 1e+10 steps, expected at most"),
    "yes": (GOOD, "run.ignore_inequalities = 'yes'", "run.ignore_inequalities = 'yes'"),
    "settings": (GOOD, "[[experiments]]\nmode = 'free'\nsettings = ['soggy']", "unknown settings 'soggy'"),
    "solver": (GOOD, "[[experiments]]\nmode = 'free'\nsolvers = ['gauss']", "unknown solver 'gauss', expected one of"),
    "truth": (GOOD, TRUTH.replace("t.csv", "gone.csv"), "gone.csv: cannot read the truth"),
    "short truth": (GOOD, TRUTH, "t.csv: expected at least two rows"),
}


@pytest.mark.parametrize("what", CASES)
def test_cases(oarlock_here, tmp_path, what):
    xml, toml, message = CASES[what]
    write_model(tmp_path / "bar", xml, f"title = 'x'\n{toml}")
    (tmp_path / "bar" / "t.csv").write_text("time,position,velocity,acceleration\n0,0,0,0\n")
    assert message in complaint(oarlock_here("run", "bar"))


def test_ignored_inequalities_of_a_case(oarlock_here, tmp_path):
    """They are left out where the case says so, and the command says what it left out."""
    xml = four_bar(rocker='range="0.1 1"')
    write_model(tmp_path / "bar", xml, "title = 'x'\nrun = {duration_s = 0.01, ignore_inequalities = true}")
    finished = oarlock_here("run", "bar")
    assert finished.returncode == 0
    assert "oarlock: inequalities ignored: limits of joints rocker" in finished.stderr


# Starts that cannot be closed: who is in the way.

ROD = """<body name="rod{0}" pos="0 {0} 0"><joint name="j{0}" axis="0 1 0"/>
  <geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" contype="0" conaffinity="0"/></body>"""


def rods(*equalities: str) -> str:
    """Three rods that turn about the y axis through x = z = 0, and equalities of them."""
    bodies = "".join(ROD.format(index) for index in range(3))
    return f"<mujoco><worldbody>{bodies}</worldbody><equality>{''.join(equalities)}</equality></mujoco>"


def angle(name: str, joint: int, value: float) -> str:
    return f'<joint name="{name}" joint1="j{joint}" polycoef="{value} 0 0 0 0"/>'


@pytest.mark.parametrize(
    ("equalities", "message"),
    [
        (
            ['<connect name="reach" body1="rod0" body2="world" anchor="0.5 0 0"/>', angle("turn", 0, 1.0)],
            "each closes alone, but not all together; the rest closes without 'reach' or without 'turn'",
        ),
        (
            [angle("up", 0, 1.0), angle("down", 0, -1.0), angle("other", 1, 0.3)],
            "each closes alone, but not all together; the rest closes without 'up' or without 'down'",
        ),
        (
            [angle("a", 0, 1.0), angle("b", 0, -1.0), angle("c", 0, 0.2)],
            "each closes alone, but not all together, and leaving out any single one does not help",
        ),
    ],
)
def test_who_is_in_the_way(oarlock_here, tmp_path, equalities, message):
    write_model(tmp_path, rods(*equalities))
    assert message in complaint(oarlock_here("run", "model.xml"))


def test_who_cannot_be_closed_even_alone(oarlock_here, tmp_path):
    """A rod of 0.5 m whose end is to be 0.6 m from its hinge: short by 0.1 m, whatever the other equality does."""
    sites = '<worldbody><site name="there" pos="0.6 0 0"/></worldbody>'
    xml = rods('<connect name="stretch" site1="end" site2="there"/>', angle("turn", 1, 1.0))
    xml = xml.replace(
        '<body name="rod0" pos="0 0 0">', '<body name="rod0" pos="0 0 0"><site name="end" pos="0.5 0 0"/>'
    )
    write_model(tmp_path, xml.replace("<equality>", sites + "<equality>"))
    assert "even alone 'stretch' stays open by 0.1 m" in complaint(oarlock_here("run", "model.xml"))


# What diverges is a result, with its reason.

BEGIN = "title = 'x'\nstart.qpos.crank = 1.0\n"
FREE = "[[experiments]]\nmode = 'free'\nsolvers = ['mujoco', 'pinv']\nintegrators = ['euler']\nsettings = ['{}']\n"
REASON = r"step \d+, t = [0-9.e+-]+ s: \S+"


def walked(tmp_path, toml):
    """The free runs of MuJoCo and of the exact constraints."""
    results = run(write_model(tmp_path / "bar", GOOD, BEGIN + toml).parent, out=tmp_path / "out")
    return [only(results.rows, mode="free", solver=solver) for solver in ("mujoco", "pinv")]


def test_mujoco_diverges_and_we_do_not(tmp_path):
    """Direct stiffness is not guarded: h² K + 2 h B = 4e-6·1e6 + 4e-3·2e3 = 12, and Euler is stable below 4."""
    settings = "[settings.explosive]\nsolref = [-1e6, -2e3]\n"
    mujoco, ours = walked(tmp_path, "run.duration_s = 1.0\n" + settings + FREE.format("explosive"))
    assert mujoco["status"] == "diverged"
    assert re.match(REASON, mujoco["message"])
    assert mujoco["steps_done"] < mujoco["steps"]
    assert (ours["status"], ours["message"], ours["steps_done"]) == ("done", "", 500)


def test_we_diverge_and_mujoco_does_not(tmp_path):
    """Baumgarte's terms far beyond the stability of any explicit method: h² k = 100."""
    terms = "run.stabilisation = 'baumgarte'\nbaumgarte = {beta = 1000.0, k = 2.5e7}\n"
    mujoco, ours = walked(tmp_path, terms + "run.duration_s = 1.0\n" + FREE.format("default"))
    assert (mujoco["status"], mujoco["message"], mujoco["steps_done"]) == ("done", "", 500)
    assert ours["status"] == "diverged"
    assert re.match(REASON, ours["message"])
    assert ours["steps_done"] < ours["steps"]


@pytest.mark.parametrize(
    "toml", ["[settings.explosive]\nsolref = [-1e6, -2e3]\n", "baumgarte = {beta = 1e3, k = 2.5e7}\n"]
)
def test_divergence_is_reported_and_no_mistake(oarlock_here, tmp_path, toml):
    setting = "explosive" if "explosive" in toml else "default"
    write_model(
        tmp_path / "bar",
        GOOD,
        BEGIN + toml + "[run]\nstabilisation = 'baumgarte'\nduration_s = 1.0\n" + FREE.format(setting),
    )
    finished = oarlock_here("run", "bar", "--out", "r")
    assert finished.returncode == 1
    (line,) = finished.stderr.splitlines()
    assert re.match(r"oarlock: run free-\S+ diverged: " + REASON, line)
    assert oarlock_here("report", "r").returncode == 0
    assert "diverged" in (tmp_path / "r" / "report" / "README.md").read_text(encoding="utf-8")
