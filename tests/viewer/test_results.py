"""A folder of results in the viewer: what is shown is what its tables have, and nothing is run anew."""

import json
import shutil

import mujoco
import numpy as np
import oarlock
import pytest
from browser import WEBGL
from mechanisms import four_bar, write_model
from oarlock.base.errors import InputError
from oarlock.cases.case import load_case
from oarlock.experiments.session import run
from oarlock.mechanics.load import load_model
from oarlock.tables.folder import ResultFolder
from oarlock.viewer import film
from oarlock.viewer.page import html
from oarlock.viewer.session import view

BROWSER_FLAGS = WEBGL

SINGLE = 1e-5
"""m. The page has single precision, seven digits of what is some metres large."""

ROUNDING = 1e-12
"""m or rad. What the tables have is computed once more, from the same positions."""

ASKED = {
    "boat": {"mode": "free", "duration": 0.3},
    "n_four_bar:N=3": {"duration": 0.1},
    "gripping_gripper": {"mode": "lockstep", "duration": 0.05},
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Model → the folder of its results."""
    home = tmp_path_factory.mktemp("results")
    return {name: run(name, out=home / load_case(name).slug, **asked).folder for name, asked in ASKED.items()}


@pytest.fixture
def own(tmp_path):
    """A model of one's own, and its results."""
    model = write_model(tmp_path / "models" / "mine", four_bar()).rename(tmp_path / "models" / "bar.xml")
    return model, run(model, duration=0.05, out=tmp_path / "kept").folder


def table(folder, note):
    """The steps of the run that a note names."""
    (name,) = (row["run"] for row in ResultFolder(folder).read_json("summary.json")["runs"] if f" {row['run']}" in note)
    return ResultFolder(folder).read_steps(name)


@pytest.mark.parametrize("name", ASKED)
def test_what_is_shown_is_what_the_tables_have(folders, name):
    viewed = view(folders[name])
    shown, model = viewed.shown, load_model(load_case(name).model_path, load_case(name).parameters)
    data = mujoco.MjData(model)
    notes = [note for note in viewed.notes if " motion is that of run" in note]
    assert len(notes) == len(shown.film.sides) == (1 if name == "gripping_gripper" else 2)
    for note, side in zip(notes, shown.film.sides, strict=True):
        rows = table(folders[name], note)
        assert len(side.poses) == min(len(rows), film.FRAMES)
        for frame in (0, len(side.poses) // 2, len(side.poses) - 1):
            row = rows.row(int(shown.film.steps[frame]), named=True)
            data.qpos[:] = row["qpos"]
            mujoco.mj_forward(model, data)
            assert side.poses[frame, :, :3] == pytest.approx(data.xpos, abs=ROUNDING)
            assert side.drift[frame] == pytest.approx(row["drift_pos"], abs=ROUNDING)
            if row["multipliers"] is not None:
                first = np.linalg.norm(row["multipliers"][:3])
                assert side.pulls[frame, 0] == pytest.approx(first, rel=1e-9)
            else:
                assert np.isnan(side.pulls[frame]).all()


def test_the_step_that_drifts_most_is_shown(folders, monkeypatch):
    monkeypatch.setattr("oarlock.viewer.results.FRAMES", 7)
    viewed = view(folders["n_four_bar:N=3"])
    (note,) = (note for note in viewed.notes if note.startswith("MuJoCo's motion is that of"))
    rows = table(folders["n_four_bar:N=3"], note)
    assert len(viewed.drift) in (7, 8)
    assert viewed.drift["MuJoCo"].max() == pytest.approx(rows["drift_pos"].max(), abs=ROUNDING)
    assert any(f"{len(viewed.drift)} of {len(rows)} steps are shown" in note for note in viewed.notes)


def test_nothing_is_run(folders, monkeypatch):
    def no(*_given, **_named):
        raise AssertionError("a run")

    for name in ("mj_step", "mj_step2", "mj_Euler", "mj_RungeKutta", "mj_implicit"):
        monkeypatch.setattr(mujoco, name, no)
    monkeypatch.setattr("oarlock.viewer.session.show", no)
    assert len(view(folders["boat"]).shown.film.sides) == 2


def test_the_command_shows_a_folder_and_says_what_it_takes(folders, oarlock_here, tmp_path):
    done = oarlock_here("view", folders["boat"], "-o", "own.html")
    assert (done.returncode, done.stdout.startswith("own.html (")) == (0, True)
    assert "MuJoCo's motion is that of run calibration-mujoco-rk4" in done.stderr
    assert "The exact motion is that of run free-hard-" in done.stderr
    assert (tmp_path / "own.html").stat().st_size > 500_000
    assert oarlock_here("view", folders["boat"], "-q", "-o", "own.html").stderr == ""


def test_a_model_of_ones_own_is_found_from_anywhere(own, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert len(view("../kept").shown.film.sides) == 2


def test_a_model_that_went_is_asked_for(own, tmp_path, oarlock_here):
    model, kept = own
    moved = shutil.move(model, tmp_path / "moved.xml")
    done = oarlock_here("view", kept, "-o", "own.html")
    assert (done.returncode, done.stdout) == (2, "")
    assert f"no model file '{model}' (--model)" in done.stderr
    assert oarlock_here("view", kept, "--model", moved, "-o", "own.html").returncode == 0


def test_another_model_is_refused(own, tmp_path):
    model, kept = own
    model.write_text(four_bar(pivot="0.71 0 0"))
    with pytest.raises(InputError, match=r"bar\.xml' is not the model that the runs of '.*kept' had \(checksum\)"):
        view(kept)
    with pytest.raises(InputError, match="is not the model that"):
        view(kept, model_file="boat")


def test_a_run_that_diverged_is_shown_to_its_end(tmp_path):
    model = write_model(tmp_path / "wild", four_bar(joint='stiffness="1e9"')).rename(tmp_path / "wild.xml")
    results = run(model, control={}, timestep=0.05, duration=2.0, out=tmp_path / "kept")
    assert any(row["status"] == "diverged" for row in results.rows)
    viewed = view(tmp_path / "kept")
    assert any("ends early" in note for note in viewed.notes)
    assert np.isfinite(viewed.shown.newton)


def test_where_the_exact_run_is_missing_the_note_says_so(folders):
    viewed = view(folders["gripping_gripper"])
    assert any("no free run in the hard form" in note for note in viewed.notes)
    assert any("for MuJoCo's own softness" in note for note in viewed.notes)


MOCAP = """<mujoco><worldbody>
<body name="cart" mocap="true" pos="0 0 1"><geom size=".02" contype="0" conaffinity="0"/></body>
<body name="bob" pos="0 0 .7"><freejoint/><geom size=".05" mass="1" contype="0" conaffinity="0"/></body>
</worldbody><equality><connect name="pin" body1="bob" body2="cart" anchor="0 0 .3"/></equality></mujoco>"""


def test_mocap_bodies_stand_where_they_stood_or_are_refused(tmp_path):
    model = tmp_path / "pendulum.xml"
    model.write_text(MOCAP)
    run(model, duration=0.02, out=tmp_path / "stood")
    assert view(tmp_path / "stood").shown.film.sides[0].drift.max() < 1e-2
    run(model, duration=0.02, control={"mocap:cart.x": "t"}, out=tmp_path / "moved")
    with pytest.raises(InputError, match=r"mocap:cart\.x = t.*results keep no poses of mocap bodies"):
        view(tmp_path / "moved")


def changed(folder, name, change):
    document = ResultFolder(folder).read_json(name)
    change(document)
    ResultFolder(folder).write_json(name, document)


def test_bad_folders_are_one_line(own, tmp_path, oarlock_here):
    _, kept = own
    (tmp_path / "empty").mkdir()
    wrong = shutil.copytree(kept, tmp_path / "wrong")
    changed(wrong, "summary.json", lambda document: document.pop("provenance"))
    alone = shutil.copytree(kept, tmp_path / "alone")
    changed(alone, "summary.json", lambda document: document["runs"].clear())
    damaged = shutil.copytree(kept, tmp_path / "damaged")
    path = next((damaged / "steps").glob("free-mujoco*.parquet"))
    path.write_bytes(path.read_bytes()[:-1])
    (tmp_path / "several").mkdir()
    shutil.copytree(kept, tmp_path / "several" / "one")
    for arguments, said in (
        (("empty",), "folder 'empty' holds no case.toml"),
        (("wrong",), "'wrong' does not hold what 'oarlock run --out'"),
        (("alone",), "'alone' has no run that MuJoCo walks"),
        (("damaged",), "is not what was written with 'summary.json' (checksum)"),
        (("several",), "'several' holds results of several cases, expected one of several/one"),
        (("kept", "--duration", "1"), "duration beside 'kept', which is shown as it was run"),
        (("kept", "--keyframe", "a", "--seed", "1"), "keyframe beside 'kept'"),
        (("kept", "-o", "own.txt"), "'own.txt', expected the name of a page, OUT.html"),
        (("four_bar", "--model", "x.xml", "-o", "own.html"), "beside a model, expected a folder of results"),
    ):
        done = oarlock_here("view", *arguments)
        assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done.stderr
        assert said in done.stderr


def test_two_folders_differ_by_no_path(own, tmp_path):
    """Where a model was is no condition of its runs."""
    model, kept = own
    other = tmp_path / "other"
    other.mkdir()
    run(shutil.copy(model, other), duration=0.05, out=tmp_path / "again")
    paths = [json.loads((folder / "case.json").read_text())["model_file"] for folder in (kept, tmp_path / "again")]
    assert paths == [str(model), str(other / "bar.xml")]
    assert not [origin for origin in oarlock.diff(kept, tmp_path / "again").origins if "model_file" in origin.key]


def test_a_browser_draws_it(browser, folders, tmp_path):
    page = tmp_path / "page.html"
    page.write_text(html(view(folders["boat"]).shown), encoding="utf-8")
    browser.open(page)
    browser.wait("document.documentElement.dataset.drawn !== undefined")
    assert browser.ask("viewer.sides.length") == 2
    place = np.array(browser.ask("viewer.sides[1].groups.map(group => group.position.toArray())"))
    shown = view(folders["boat"]).shown
    frame = browser.ask("viewer.frame")
    assert place == pytest.approx(shown.film.sides[1].poses[frame, shown.film.moving, :3], abs=SINGLE)
    assert [line for line in browser.said if "GL Driver Message" not in line] == []
