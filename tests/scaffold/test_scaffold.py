"""``oarlock new``: models that nobody here wrote become cases that run, and the copy is the same model."""

import re
import shutil
import tomllib
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import four_bar, frames_of, only, setup_of, write_model
from oarlock import InputError, load_case, model_names, run
from oarlock.cases import case as cases
from oarlock.cases.motion import Motion
from oarlock.diagnosis.edit.keyframe import write_keyframe
from oarlock.diagnosis.loops.poses import nearest_closed
from oarlock.mechanics.controls import laws
from oarlock.mechanics.mjcf import copy_model, differences
from oarlock.scaffold import scaffold, survey
from oarlock.scaffold.scaffold import new_model
from oarlock.stepping.beginning import beginning_of_file
from oarlock.stepping.start import consistent_start
from places import FIXTURES
from strange import FILES, TETRAHEDRON
from tolerances import NEAREST_POSE, NEWTON_STOPS
from whole import require_matched, require_start, require_whole


@dataclass(frozen=True)
class New:
    source: Path
    folder: Path
    scaffold: scaffold.Scaffold


@pytest.fixture(scope="session", params=list(FILES))
def new(request, strange, tmp_path_factory) -> New:
    """One of the fixtures made a case; with few steps, which only the durations and the bounds see."""
    source = strange / FILES[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(survey, "STEPS", 100)
        folder, found = new_model(request.param, source, tmp_path_factory.mktemp("new"), outside=True)
    return New(source, folder, found)


# The copy.


def test_copy_is_the_same_model(new, tmp_path):
    """Compiled alone, in another place, with nothing else there."""
    alone = tmp_path / "alone"
    shutil.copytree(new.folder, alone)
    first = mujoco.MjModel.from_xml_path(str(new.source))
    second = mujoco.MjModel.from_xml_path(str(alone / "model.xml"))
    assert differences(first, second) == []
    data = mujoco.MjData(first), mujoco.MjData(second)
    for _ in range(20):
        for model, one in zip((first, second), data, strict=True):
            mujoco.mj_step(model, one)
    np.testing.assert_array_equal(data[0].qpos, data[1].qpos)


def test_names_of_the_author_are_kept(new):
    first = mujoco.MjModel.from_xml_path(str(new.source))
    second = mujoco.MjModel.from_xml_path(str(new.folder / "model.xml"))
    for kind, count in (
        ("mjOBJ_JOINT", first.njnt),
        ("mjOBJ_EQUALITY", first.neq),
        ("mjOBJ_BODY", first.nbody),
        ("mjOBJ_ACTUATOR", first.nu),
        ("mjOBJ_MESH", first.nmesh),
        ("mjOBJ_TEXTURE", first.ntex),
    ):
        what = getattr(mujoco.mjtObj, kind)
        names = [mujoco.mj_id2name(second, what, index) for index in range(count)]
        for index, name in enumerate(names):
            assert mujoco.mj_id2name(first, what, index) in (None, name)
        if kind in ("mjOBJ_JOINT", "mjOBJ_EQUALITY", "mjOBJ_ACTUATOR") and new.folder.name != "pair":
            assert all(names)
            assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("body_mass", 'mass="3"'),
        ("opt.timestep", 'timestep="0.005"'),
        ("eq_data", 'anchor="-0.2 0 0"'),
        ("jnt_range", 'range="-60 60"'),
        ("qpos0", 'pos="0 0 0.6"'),
    ],
)
def test_differences_see_the_last_bit(field, change):
    text = (FIXTURES / "hopper.xml").read_text()
    assert change in text
    number = re.findall(r"[0-9.]+", change)[-1]
    nudged = change.replace(number, repr(float(np.nextafter(float(number), 1e9))))
    if float(number) == 0:
        nudged = change.replace('0"', '1e-300"')
    first, second = (mujoco.MjModel.from_xml_string(t) for t in (text, text.replace(change, nudged)))
    assert field in differences(first, second)
    assert differences(first, first) == []


def test_files_of_one_name_stay_apart(tmp_path):
    """Two meshes of one file name and two folders; one of them is reached through ``..``, as strippath leaves it."""
    for place, scale in (("a", 1), ("b", 2)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "link.obj").write_text(TETRAHEDRON.replace("1 0 0", f"{scale} 0 0"))
    (tmp_path / "m").mkdir()
    meshes = '<mesh name="one" file="../a/link.obj"/><mesh name="two" file="../b/link.obj"/>'
    geoms = "".join(f'<geom type="mesh" mesh="{name}" contype="0"/>' for name in ("one", "two"))
    path = write_model(tmp_path / "m", four_bar(body=geoms, rest=f"<asset>{meshes}</asset>"))
    (tmp_path / "out").mkdir()
    copied = copy_model(path, tmp_path / "out", outside=True)
    assert sorted(copied.files) == ["link-2.obj", "link.obj"]
    shutil.rmtree(tmp_path / "a")
    shutil.rmtree(tmp_path / "b")
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))


@pytest.mark.parametrize("place", ["beside", "nested"])
def test_includes_are_found_where_mujoco_finds_them(tmp_path, place):
    """Beside the model first, then beside the file that includes."""
    (tmp_path / "sub").mkdir()
    write_model(tmp_path, four_bar(rest='<include file="sub/outer.xml"/>'))
    (tmp_path / "sub" / "outer.xml").write_text('<mujoco><include file="inner.xml"/></mujoco>')
    (tmp_path / "sub" / "inner.xml").write_text('<mujoco><option gravity="0 0 -2"/></mujoco>')
    if place == "beside":
        (tmp_path / "inner.xml").write_text('<mujoco><option gravity="0 0 -3"/></mujoco>')
    (tmp_path / "out").mkdir()
    copy_model(tmp_path / "model.xml", tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))
    assert model.opt.gravity[2] == (-3 if place == "beside" else -2)


@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("both", [False, True])
def test_files_of_an_included_file_are_found_where_mujoco_finds_them(tmp_path, nested, both):
    """Beside the model first, in its meshdir, then beside the file that names them, whatever its meshdir."""
    inner = tmp_path / "m" / "sub" / "parts"
    inner.mkdir(parents=True)
    asset = '<mujoco><asset><mesh name="link" file="../link.obj"/></asset></mujoco>'
    (inner / "assets.xml").write_text(asset)
    (tmp_path / "m" / "outer.xml").write_text('<mujoco><include file="sub/parts/assets.xml"/></mujoco>')
    (tmp_path / "m" / "sub" / "link.obj").write_text(TETRAHEDRON)
    if both:
        (tmp_path / "m" / "link.obj").write_text(TETRAHEDRON.replace("1 0 0", "3 0 0"))
    include = f'<include file="{"outer" if nested else "sub/parts/assets"}.xml"/>'
    geom = '<geom type="mesh" mesh="link" contype="0"/>'
    path = write_model(tmp_path / "m", four_bar(body=geom, rest=f'<compiler meshdir="geo"/>{include}'))
    first = mujoco.MjModel.from_xml_path(str(path))
    (tmp_path / "out").mkdir()
    copy_model(path, tmp_path / "out")
    assert differences(first, mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model.xml"))) == []
    closed = consistent_start(first, load_case(path)).qpos
    write_keyframe(path, tmp_path / "closed.xml", closed)
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "closed.xml"))
    np.testing.assert_array_equal(again.mesh_vert, first.mesh_vert)


def test_comments_and_licence_are_kept(tmp_path):
    text = "<!-- licence -->\n" + four_bar(rest="<!-- why -->")
    (tmp_path / "out").mkdir()
    copy_model(write_model(tmp_path, text), tmp_path / "out")
    copy = (tmp_path / "out" / "model.xml").read_text()
    assert copy.startswith("<!-- licence -->")
    assert "<!-- why -->" in copy


# The case.


def test_case_runs_and_its_gates_hold(new):
    results = run(new.folder)
    assert results.failures == []
    assert {verdict.held for verdict in results.verdicts} == {True}
    assert {row["mode"] for row in results.rows} == {"calibration", "lockstep", "free"}
    matched = only(results.rows, mode="lockstep", form="matched", solver="pinv")
    assert matched["qacc_rel_diff_max"] <= NEWTON_STOPS


@pytest.mark.parametrize(
    ("name", "expected", "reactions"),
    [
        ("gripper", (3, 3, 2, 1), "unique"),
        ("hopper", (9, 6, 2, 7), "not unique"),  # two connects on one hinge; friction, and a floor
        ("crane", (7, 7, 4, 3), "unique"),  # the lengths of the weld are zero rows: the joint holds them
        ("pair", (6, 3, 2, 4), "unique"),
    ],
)
def test_what_is_expected_was_computed(strange, tmp_path, monkeypatch, name, expected, reactions):
    monkeypatch.setattr(survey, "STEPS", 20)
    folder, _ = new_model(name, strange / FILES[name], tmp_path, outside=True)
    file = load_case(folder).file
    assert (file.expect.nv, file.expect.rows, file.expect.rank, file.expect.dof) == expected
    assert file.expect.reactions == reactions
    assert not file.run.ignore_inequalities


def test_closed_start_is_written_in_every_digit(tmp_path, monkeypatch):
    monkeypatch.setattr(survey, "STEPS", 20)
    path = write_model(tmp_path / "m", four_bar(pivot="0.72 0 0.01"))
    folder, found = new_model("bar", path, tmp_path)
    assert found.found.start.moved > 1e-3
    again = load_case(folder)
    setup = setup_of(again, again.file.run.integrator)
    assert setup.start.moved == 0.0
    np.testing.assert_array_equal(setup.start.qpos, list(again.file.start.qpos.values()))


PIVOT = "0.72 0 0.01"
KEYS = '<keyframe><key name="far" qpos="0.3 0 0"/><key name="{}" qpos="0.02 -0.05 -0.01" ctrl="0.5"/></keyframe>'
MOTOR = '<actuator><motor joint="crank"/></actuator>'


@pytest.mark.parametrize(
    ("asked", "origin", "ctrl"),
    [
        ({}, "keyframe 'far'", {}),
        ({"keyframe": "home"}, "keyframe 'home'", {"crank_motor": "0.5"}),
        ({"keyframe": "1", "control": {"crank_motor": "0.1*t"}}, "keyframe 'home'", {"crank_motor": "0.1*t"}),
        (
            {"keyframe": "none", "control": {"crank_motor": 0.2}},
            "the model's own pose, at rest",
            {"crank_motor": "0.2"},
        ),
    ],
)
def test_a_case_begins_where_check_begins(tmp_path, monkeypatch, asked, origin, ctrl):
    """The first keyframe, unless another is asked for, with its controls, also where they are zero."""
    monkeypatch.setattr(survey, "STEPS", 20)
    path = write_model(tmp_path / "m", four_bar(pivot=PIVOT, rest=MOTOR + KEYS.format("home")))
    folder, found = new_model("bar", path, tmp_path, asked=Motion(**asked))
    assert found.found.origin == origin
    assert load_case(folder).file.drive.ctrl == ctrl
    setup = setup_of(load_case(folder), "euler")
    model = mujoco.MjModel.from_xml_path(str(path))
    unnamed = dict(zip(["#0"], asked.get("control", {}).values(), strict=False))
    motion = Motion(**{**asked, "control": unnamed})
    begins = beginning_of_file(model, motion)
    np.testing.assert_array_equal(setup.begins.qvel, begins.qvel)
    np.testing.assert_allclose(setup.start.qpos, nearest_closed(model, begins.qpos, hold=None).qpos, atol=NEAREST_POSE)
    assert list(setup.begins.laws.values()) == list(begins.laws.values())


def test_a_case_without_a_keyframe_is_driven_as_check_drives_it(tmp_path, monkeypatch):
    """By random controls that are held over a step; a timestep, activations and mocap poses come from a keyframe."""
    monkeypatch.setattr(survey, "STEPS", 20)
    path = write_model(tmp_path / "m", four_bar(rest=MOTOR))
    folder, _ = new_model("bar", path, tmp_path)
    drive = load_case(folder).file.drive
    assert drive.held
    assert list(drive.ctrl.values()) == list(laws(mujoco.MjModel.from_xml_path(str(path)), "random").values())


def test_limits_controls_and_keyframe_are_kept(tmp_path, monkeypatch):
    """Of a leg that begins inside a range which its own pose is outside of, with a filtered servo that is charged."""
    monkeypatch.setattr(survey, "STEPS", 20)
    rest = (
        '<actuator><general joint="crank" dyntype="filter" dynprm="0.1" biastype="affine" biasprm="0 -1 0"/></actuator>'
        '<keyframe><key name="bent" qpos="{} {} {}" act="0.4" ctrl="0.25"/></keyframe>'
    )
    model = mujoco.MjModel.from_xml_string(four_bar())
    bent = consistent_start(model, load_case(write_model(tmp_path / "o", four_bar())), seed=3).qpos
    text = four_bar(rocker='limited="true" range="-0.2 1.2"', rest=rest.format(*bent.tolist()))
    folder, found = new_model("bar", write_model(tmp_path / "m", text), tmp_path)
    file = load_case(folder).file
    assert found.ignored is None
    assert not file.run.ignore_inequalities
    assert (file.start.keyframe, file.drive.ctrl) == ("bent", {"crank_general": "0.25"})
    setup = setup_of(load_case(folder), file.run.integrator)
    assert setup.data().act.tolist() == [0.4]
    assert setup.model.jnt_limited.any()
    assert not setup.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_LIMIT


def test_a_model_at_rest_gets_no_bound_that_means_nothing(tmp_path, monkeypatch):
    """A bar that hangs: where nothing accelerates, relative differences compare rounding with rounding."""
    monkeypatch.setattr(survey, "STEPS", 50)
    path = write_model(tmp_path / "m", four_bar(rest=MOTOR).replace("<option", '<option gravity="0 0 0"'))
    folder, found = new_model("bar", path, tmp_path, asked=Motion(controls="constant"))
    gates = load_case(folder).file.gates
    assert gates
    assert all(gate.max is not None and gate.max < 1e-3 for gate in gates)
    assert any("nothing moves" in note for note in found.found.notes)


SWINGING = '<keyframe><key name="start" qvel="{} 0 0"/></keyframe>'


@pytest.mark.parametrize(("speed", "halvings"), [(5, 0), (20, 1)])
def test_timestep_follows_the_motion(tmp_path, monkeypatch, speed, halvings):
    """At 20 rad/s the exact run at half the model's 2 ms goes elsewhere; at half of that it no longer does."""
    monkeypatch.setattr(survey, "STEPS", 20)
    path = write_model(tmp_path / "m", four_bar(joint='damping="0"', rest=SWINGING.format(speed)))
    path.write_text(path.read_text().replace("<option", '<option integrator="RK4"'))
    folder, found = new_model("bar", path, tmp_path)
    case = load_case(folder)
    assert case.file.run.timestep_s == (0.001 if halvings else None)
    assert found.found.own_timestep is not bool(halvings)
    paths = []
    for timestep in (0.002, 0.001, 0.0005):
        results = run(folder, mode="free", form="hard", solver="pinv", timestep=timestep, duration=0.2)
        frame = frames_of(results)[-1]
        paths.append(np.array(frame["qpos"].to_list())[:: round(0.002 / timestep)])
    changes = [float(np.abs(paths[k] - paths[k + 1]).max()) for k in range(2)]
    assert [change <= survey.AGREES for change in changes] == ([False, True] if halvings else [True, True])


def test_integrator_that_no_case_can_ask_for_is_named_in_a_comment(tmp_path, monkeypatch):
    monkeypatch.setattr(survey, "STEPS", 20)
    path = write_model(tmp_path / "m", four_bar().replace("<option", '<option integrator="discrete"'))
    folder, _ = new_model("bar", path, tmp_path)
    assert 'integrator = "implicitfast" # the model\'s own is discrete' in (folder / "case.toml").read_text(
        encoding="utf-8"
    )
    assert load_case(folder).file.run.integrator == "implicitfast"


FLAIL = '<body pos="0 0 0.1"><joint name="flail"/><geom fromto="0 0 0 0 0 -0.4" size="0.03"/></body>'
THROWN = '<keyframe><key name="start" qvel="0 0 25 0"/></keyframe>'


def test_motion_that_magnifies_rounding_is_cut(tmp_path, monkeypatch):
    """A flail on the coupler makes 6e-10 of a rounding error within 5 s; 1e-11 are allowed it here."""
    monkeypatch.setattr(scaffold, "ROUNDING", 1e-11)
    path = write_model(tmp_path / "m", four_bar(body=FLAIL, rest=THROWN))
    folder, found = new_model("flail", path, tmp_path)
    calibration = next(bound for bound in found.bounds if bound.figure == "trajectory_diff_max")
    assert calibration.measured <= 1e-11
    assert load_case(folder).file.run.duration_s < survey.longest(0.002, survey.STEPS)
    assert [note for note in found.found.notes if note.startswith("rounding errors pass 1e-11 at t = ")]


def test_mujocos_own_test_model(tmp_path, monkeypatch):
    """43 velocities, a weld, contacts, activations, a keyframe; it comes with MuJoCo's wheel."""
    source = Path(mujoco.__file__).parent / "testdata" / "model.xml"
    if not source.is_file() or "<equality>" not in source.read_text(encoding="utf-8"):
        pytest.skip("this version of MuJoCo brings no test model with an equality")
    monkeypatch.setattr(survey, "STEPS_LARGE", 20)
    folder, found = new_model("theirs", source, tmp_path)
    assert differences(mujoco.MjModel.from_xml_path(str(source)), found.found.model) == []
    assert not load_case(folder).file.run.ignore_inequalities
    assert run(folder).failures == []


# The folder.


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """Models as in a checkout: a link to mjcf/."""
    (tmp_path / "mjcf").mkdir()
    (tmp_path / "models").symlink_to("mjcf")
    monkeypatch.setattr(cases, "MODELS", tmp_path / "models")
    monkeypatch.setattr(survey, "STEPS", 100)
    return tmp_path / "mjcf"


def test_new_model_takes_part_in_everything(checkout, oarlock_here, tmp_path, strange):
    finished = oarlock_here("new", "my_crane", strange / "crane.xml")
    assert (finished.returncode, finished.stderr) == (0, "")
    assert "next:    oarlock run my_crane\n" in finished.stdout
    folder = checkout / "my_crane"
    assert model_names() == ["my_crane"]
    listed = oarlock_here("list")
    assert "my_crane" in listed.stdout
    case = load_case("my_crane")
    require_whole(cases.MODELS / "my_crane")
    require_start(case)
    require_matched(case)
    ran = oarlock_here("run", "my_crane", "--out", "r")
    assert ran.returncode == 0
    assert oarlock_here("report", "r", "--to", "reports/my_crane").returncode == 0
    picture = re.search(r"!\[.*\]\((.*)\)", (folder / "README.md").read_text())
    assert picture
    assert (folder / picture[1]).resolve().is_file()


def test_elsewhere_it_is_run_by_path(oarlock_here, tmp_path, strange, monkeypatch):
    monkeypatch.setattr(survey, "STEPS", 100)
    finished = oarlock_here(
        "new", "boat", strange / "gripper" / "gripper.xml", "--to", "mine"
    )  # not the one that comes
    command = re.search(r"next: +oarlock (run \S+)", finished.stdout)
    assert command
    assert oarlock_here(*command[1].split()).returncode == 0
    assert load_case(tmp_path / "mine" / "boat").file.title == "two-finger gripper"
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["boat"]


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "a b", "a:b", "-x", "a.xml", "ä"])
def test_names_that_no_folder_can_have(tmp_path, name):
    with pytest.raises(InputError, match=r"name '.*', expected letters, digits, '_' and '-' only"):
        new_model(name, FIXTURES / "crane.xml", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_folder_that_holds_something_is_left_alone(tmp_path):
    (tmp_path / "crane").mkdir()
    (tmp_path / "crane" / "mine").write_text("mine")
    with pytest.raises(InputError, match=r"crane' is there already, expected a new name or an empty folder"):
        new_model("crane", FIXTURES / "crane.xml", tmp_path)
    assert [path.name for path in (tmp_path / "crane").iterdir()] == ["mine"]


def test_nothing_is_left_of_what_failed(tmp_path):
    path = write_model(tmp_path / "m", four_bar(pivot="5 0 0"))
    with pytest.raises(InputError, match=r"equality 'pin' stays open by 3\.6"):
        new_model("bar", path, tmp_path / "to")
    assert list((tmp_path / "to").iterdir()) == []


def test_an_empty_folder_is_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(survey, "STEPS", 20)
    (tmp_path / "bar").mkdir()
    new_model("bar", write_model(tmp_path / "m", four_bar()), tmp_path)
    assert sorted(path.name for path in (tmp_path / "bar").iterdir()) == ["README.md", "case.toml", "model.xml"]


def test_case_is_plain_toml_whatever_things_are_called(tmp_path, monkeypatch):
    monkeypatch.setattr(survey, "STEPS", 20)
    xml = four_bar(pivot="0.72 0 0.01").replace('"crank"', '"a \\&quot;b&quot;.c = 1 # ü"').replace('"pin"', '"p]&#9;"')
    folder, _ = new_model("odd", write_model(tmp_path / "m", xml), tmp_path)
    data = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    assert 'a \\"b".c = 1 # ü' in data["start"]["qpos"]


@pytest.mark.parametrize(
    ("value", "below", "above"),
    [(1.0, 1.0, 1.0), (0.03, 0.02, 0.05), (5e-9, 5e-9, 5e-9), (7.1e3, 5e3, 1e4), (2.01, 2, 5)],
)
def test_nice_numbers(value, below, above):
    assert (survey.nice(value), survey.nice_above(value)) == (below, above)
