"""The page of ``oarlock view``: what is in it is MuJoCo's motion and the exact one, and a browser draws it."""

import dataclasses
import json
import re
from typing import Any

import mujoco
import numpy as np
import pytest
from browser import WEBGL
from oarlock.base.errors import InputError
from oarlock.base.shapes import rotated, thinned
from oarlock.diagnosis.checked import begun, parts
from oarlock.diagnosis.loops.wrenches import wrenches
from oarlock.diagnosis.options import CheckOptions
from oarlock.mechanics import shapes as looks
from oarlock.mechanics.names import element_name
from oarlock.viewer import film as filming
from oarlock.viewer import scene as scenery
from oarlock.viewer.packing import packed, unpacked
from oarlock.viewer.page import html, write
from oarlock.viewer.show import shown
from places import FIXTURES

CHECK = FIXTURES / "check"

SINGLE = 1e-5
"""m, and of a part of a turn. The page has single precision, seven digits of what is some metres large."""

SINGLE_PARTS = 1e-6
"""The same of a number itself, such as a force: half a unit of the last of 24 bits, 6e-8, with room."""

SHORT = {"gripping_gripper": 0.2, "standing_leg": 0.2, "boat": 0.3}
"""Models and the seconds of them that are shown."""

DRIVER = "GL Driver Message"
"""In what a graphics driver says of its own speed, such as that reading pixels makes it wait: nothing of the page's."""


def examined(model, **options) -> Any:
    """A check as far as its runs; what may be missing is there, or a test fails."""
    exam = begun(model, CheckOptions(budget=0.0, **options))
    for part in parts(exam):
        if part == "run":
            break
    return exam


@pytest.fixture(scope="module")
def exams():
    found = {}

    def get(name):
        if name not in found:
            found[name] = examined(name, duration=SHORT[name])
        return found[name]

    return get


def document_of(page: str):
    (text,) = re.findall(r'<script type="application/json" id="document">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def steps_of(exam, document):
    return np.rint(unpacked(document["times"]) / exam.timestep_s).astype(int)


def posed(document, side):
    """Poses (n, nbody, 7) of all bodies, as the page has them."""
    moving = unpacked(document["sides"][side]["poses"])
    found = np.zeros((len(moving), len(document["scene"]["names"]), 7))
    found[:, document["moving"]] = moving
    found[:, document["still"]] = unpacked(document["standing"])
    return found


# What is in the page.


@pytest.mark.parametrize("name", SHORT)
def test_geoms_are_where_mujoco_has_them(exams, name):
    exam = exams(name)
    document = document_of(html(shown(exam)))
    model, data = exam.model, mujoco.MjData(exam.model)
    steps, made = steps_of(exam, document), shown(exam).scene.shapes
    assert len(document["sides"]) == 2
    assert len(made) == len(document["scene"]["shapes"])
    assert {shape.geom for shape in made} >= {
        geom for geom in range(model.ngeom) if model.geom_group[geom] < 3 and model.geom_rgba[geom, 3] > 0.02
    }
    for side, run in enumerate((exam.recording, exam.exact)):
        poses = posed(document, side)
        for frame in (0, len(poses) // 2, len(poses) - 1):
            data.qpos[:] = run.qpos[steps[frame]]
            mujoco.mj_kinematics(model, data)
            for shape, written in zip(made, document["scene"]["shapes"], strict=True):
                pose = poses[frame, written["body"]]
                at = pose[:3] + rotated(pose[3:], np.array(written["pos"]))
                assert at == pytest.approx(data.geom_xpos[shape.geom], abs=SINGLE)
                turn = data.geom_xmat[shape.geom].reshape(3, 3)
                for axis in np.eye(3):
                    turned = rotated(pose[3:], rotated(np.array(written["quat"]), axis))
                    assert turned == pytest.approx(turn @ axis, abs=SINGLE)


@pytest.mark.parametrize("name", SHORT)
def test_gaps_and_forces_are_those_of_the_tables(exams, name):
    exam = exams(name)
    document = document_of(html(shown(exam)))
    steps, layout = steps_of(exam, document), exam.recording.layout
    joining = [place for place, one in enumerate(layout.equalities) if one.kind.joins_points]
    assert joining
    assert [one["name"] for one in document["equalities"]] == [one.name for one in layout.equalities]
    for side, run in zip(document["sides"], (exam.recording, exam.exact), strict=True):
        found = wrenches(exam.model, run.qpos[steps], run.force[steps])
        forces, gaps, off, pulls = (unpacked(side[key]) for key in ("forces", "gaps", "off", "pulls"))
        assert unpacked(side["drift"]) == pytest.approx(np.abs(run.position[steps]).max(axis=1), rel=SINGLE_PARTS)
        for column, place in enumerate(joining):
            first = layout.starts[place]
            force, gap = found[place].total.force, run.position[steps, first : first + 3]
            assert force is not None
            assert np.abs(forces[:, column] - force).max() <= SINGLE_PARTS * np.abs(force).max()
            assert np.abs(gaps[:, column] - gap).max() <= SINGLE_PARTS * max(np.abs(gap).max(), 1e-9)
            assert pulls[:, place] == pytest.approx(np.linalg.norm(force, axis=1), rel=SINGLE_PARTS)
        for place in range(len(layout.equalities)):
            rows = np.abs(run.position[steps][:, layout.of_equality(place)]).max(axis=1)
            assert off[:, place] == pytest.approx(rows, rel=SINGLE_PARTS)


def test_couplings_have_their_multipliers_and_units(exams):
    exam = exams("gripping_gripper")
    document = document_of(html(shown(exam)))
    place = next(at for at, one in enumerate(document["equalities"]) if one["name"] == "gears")
    assert (document["equalities"][place]["unit"], document["equalities"][place]["effort"]) == ("rad", "N m")
    row = exam.recording.layout.starts[place]
    pulls = unpacked(document["sides"][0]["pulls"])[:, place]
    assert pulls == pytest.approx(np.abs(exam.recording.force[steps_of(exam, document), row]), rel=SINGLE_PARTS)
    assert document["unit"] == "m or rad"


def test_tendons_are_as_long_as_mujoco_has_them():
    exam = examined("tensegrity", duration=0.05)
    document = document_of(html(shown(exam)))
    ways = unpacked(document["sides"][0]["tendons"]).astype(float)
    data = mujoco.MjData(exam.model)
    assert ways.shape[1] == exam.model.ntendon > 0
    for frame, step in enumerate(steps_of(exam, document)):
        data.qpos[:] = exam.recording.qpos[step]
        mujoco.mj_fwdPosition(exam.model, data)
        lengths = np.linalg.norm(np.diff(ways[frame], axis=1), axis=2).sum(axis=1)
        assert lengths == pytest.approx(data.ten_length, abs=SINGLE)


def test_what_is_off_is_not_there():
    """An equality that is switched off has no gap and no force from then on."""
    exam = examined("four_bar", duration=0.1)
    recording = exam.recording
    half = recording.steps // 2
    present = recording.present.copy()
    present[half:] = False
    exam = dataclasses.replace(exam, recording=dataclasses.replace(recording, present=present))
    document = document_of(html(shown(exam)))
    late = steps_of(exam, document) >= half
    for key in ("gaps", "forces", "off"):
        values = unpacked(document["sides"][0][key])
        assert np.isnan(values[late]).all()
        assert np.isfinite(values[~late]).all()


def test_a_long_run_is_thinned_and_keeps_its_worst_step(exams):
    exam = exams("gripping_gripper")
    show = shown(exam)
    assert exam.recording.steps == 400
    assert len(show.film.steps) == 400
    assert not any("steps are shown" in note for note in show.notes)
    longer = examined("gripping_gripper", duration=0.5)
    show = shown(longer)
    assert len(show.film.steps) <= filming.FRAMES + 1
    assert any(f"{len(show.film.steps)} of 1000 steps are shown" in note for note in show.notes)
    gap = np.linalg.norm(longer.recording.position[:, :3], axis=1)
    others = np.linalg.norm(longer.recording.position[:, 3:6], axis=1)
    assert show.film.gap == pytest.approx(max(gap.max(), others.max()), rel=SINGLE_PARTS)


def test_a_large_model_has_fewer_frames(exams, monkeypatch):
    monkeypatch.setattr(filming, "NUMBERS", 5_000)
    frames = len(shown(exams("boat")).film.steps)
    assert filming.FEWEST <= frames < 100


def test_too_many_geoms_are_refused(exams, monkeypatch):
    monkeypatch.setattr(looks, "MOST_GEOMS", 2)
    with pytest.raises(InputError, match=r"\d+ geoms to draw, expected at most 2"):
        shown(exams("boat"))


def test_without_a_closed_start_mujoco_is_alone_and_the_page_says_why():
    show = shown(examined(str(CHECK / "unreachable.xml"), duration=0.1))
    assert [side.title for side in show.film.sides] == ["MuJoCo"]
    page = html(show)
    assert "there is no closed start to run it from" in page.partition("<script>")[0]
    assert len(document_of(page)["sides"]) == 1


def test_a_run_that_diverges_ends_and_the_view_stays():
    show = shown(examined(str(CHECK / "diverges.xml")))
    assert any("MuJoCo's run ends at t =" in note for note in show.notes)
    assert show.extent < 10.0  # the links are shorter than a metre, MuJoCo's are thrown about
    assert np.isfinite(show.newton)


def test_no_run_is_one_line():
    exam = examined("four_bar", duration=0.01)
    exam.recording, exam.missing["run"] = None, "it was not to be"
    with pytest.raises(InputError, match="nothing to show: it was not to be"):
        shown(exam)


# Shapes.


BARE = """<mujoco><worldbody>
<body name="crank"><joint name="j" axis="0 1 0"/><inertial pos=".05 0 0" mass=".1" diaginertia="1e-4 1e-4 1e-4"/>
 <body name="rod" pos=".1 0 0"><joint axis="0 1 0"/><geom type="mesh" mesh="ball" group="3"/>
  <geom type="box" size=".01 .01 .01" rgba="1 0 0 0"/></body></body>
<body name="rocker" pos=".3 0 .1"><joint axis="0 1 0"/><geom material="green" type="capsule" size=".01 .1"/></body>
</worldbody>
<asset><mesh name="ball" builtin="sphere" params="4" scale=".04 .04 .04"/>
<material name="green" rgba="0 1 0 1"/></asset>
<contact><exclude body1="rod" body2="rocker"/></contact>
<equality><connect name="loop" body1="rod" body2="rocker" anchor=".2 0 .1"/></equality></mujoco>"""


def test_what_is_seen_of_a_body(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text(BARE)
    exam = examined(str(path), duration=0.05)
    made = shown(exam).scene
    kinds = {name: [shape for shape in made.shapes if made.names[shape.body] == name] for name in made.names}
    assert {shape.kind for shape in kinds["crank"]} == {"stick"}
    assert [shape.kind for shape in kinds["rod"]] == ["mesh"]  # of a hidden group, but all there is; the box is clear
    assert [shape.rgba for shape in kinds["rocker"]] == [(0.0, 1.0, 0.0, 1.0)]
    joint = next(shape for shape in kinds["crank"])
    assert np.array(joint.pos) == pytest.approx(np.zeros(3), abs=SINGLE)
    assert any(np.array(shape.size[:3]) == pytest.approx([0.1, 0.0, 0.0], abs=SINGLE) for shape in kinds["crank"])
    vertices, faces = made.meshes[kinds["rod"][0].mesh]
    assert len(faces) == exam.model.mesh_facenum[0]
    assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(0.04, rel=1e-3)


def test_fine_meshes_are_made_coarser_and_it_is_said(tmp_path, monkeypatch):
    path = tmp_path / "bare.xml"
    path.write_text(BARE)
    exam = examined(str(path), duration=0.05)
    monkeypatch.setattr(scenery, "TRIANGLES", 300)
    monkeypatch.setattr(scenery, "FEWEST", 50)
    made = shown(exam).scene
    (vertices, faces), before = made.meshes[0], int(exam.model.mesh_facenum[0])
    assert before > 300 >= len(faces) > 100
    assert any(f"{len(faces)} triangles in place of" in note for note in made.notes)
    radii = np.linalg.norm(vertices, axis=1)
    assert radii.max() <= 0.04 * (1.0 + 1e-3)
    assert radii.min() > 0.03  # still a ball


def test_thinning_leaves_what_is_coarse_alone():
    vertices, faces = np.eye(3), np.array([[0, 1, 2]])
    same, also = thinned(vertices, faces, 10)
    assert same is vertices
    assert also is faces


@pytest.mark.parametrize("kind", ["<f4", "<u4"])
def test_arrays_come_back_as_they_were(kind):
    values = np.arange(24).reshape(2, 3, 4)
    again = unpacked(json.loads(json.dumps(packed(values, kind))))
    assert again.dtype == kind
    assert np.array_equal(again, values)


# The file.


def test_the_page_asks_for_nothing_and_has_the_licence(exams):
    page = html(shown(exams("boat")))
    assert "default-src 'none'" in page
    assert "The MIT License" in page
    assert "three.js authors" in page
    head = page.partition("<script>")[0]
    assert not re.search(r"(src|href)=\"(?!data:,)", head)


def test_the_command_writes_opens_and_says(oarlock_here, tmp_path, monkeypatch):
    import webbrowser

    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda uri: opened.append(uri) or len(opened) > 1)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    done = oarlock_here("view", "four_bar", "--duration", "0.05", "-o", "own.html")
    assert (done.returncode, opened) == (0, [])
    assert done.stdout.startswith("own.html (")
    assert (tmp_path / "own.html").stat().st_size > 500_000
    done = oarlock_here("view", "four_bar", "--duration", "0.05", "--no-open")
    assert (done.returncode, opened) == (0, [])
    path = done.stdout.partition(" (")[0]
    assert path.startswith(str(tmp_path / "oarlock-four_bar-"))
    assert "no browser was found" in oarlock_here("view", "four_bar", "--duration", "0.05").stderr
    assert "no browser" not in oarlock_here("view", "four_bar", "--duration", "0.05").stderr
    assert len(opened) == 2
    assert all(uri.startswith("file://") for uri in opened)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere.xml",), "no model file 'nowhere.xml'"),
        ((CHECK / "none.xml",), "no <equality> element"),
        (("four_bar", "--duration", "-1"), "duration"),
        (("four_bar", "--duration", "0.01", "-o", "."), "'.', expected the name of a page, OUT.html"),
        (("four_bar", "--duration", "0.01", "-o", "/dev/null/x.html"), "cannot write"),
    ],
)
def test_bad_input_is_one_line(oarlock_here, arguments, said):
    done = oarlock_here("view", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()[-1:]) == 1
    assert "Traceback" not in done.stderr


# A real browser.


BROWSER_FLAGS = WEBGL

COLOURS = """(() => {
  const gl = viewer.renderer.getContext(), [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
  const pixels = new Uint8Array(4 * w * h), seen = new Map();
  viewer.draw();
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  for (let n = 0; n < pixels.length; n += 4) {
    const key = pixels[n] << 16 | pixels[n + 1] << 8 | pixels[n + 2];
    seen.set(key, (seen.get(key) || 0) + 1);
  }
  return [seen.size, 1 - Math.max(...seen.values()) / (w * h)];
})()"""
"""Colours on the canvas, and the part of it that is not of the commonest one, the background."""


def heard(browser):
    return [line for line in browser.said if DRIVER not in line]


def opened(browser, exam, tmp_path, **media):
    path = tmp_path / "view.html"
    assert write(shown(exam), path) == path.stat().st_size
    browser.open(path, **media)
    browser.wait("document.documentElement.dataset.drawn !== undefined")
    return path


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", SHORT)
def test_a_browser_draws_and_plays(browser, exams, tmp_path, name, scheme):
    exam = exams(name)
    path = opened(browser, exam, tmp_path, prefers_color_scheme=scheme)
    colours, drawn = browser.ask(COLOURS)
    assert colours > 20
    assert drawn > 0.02
    before = browser.ask("viewer.frame")
    browser.wait(f"viewer.frame !== {before}")
    assert heard(browser) == []
    assert browser.asked == [path.resolve().as_uri()]
    assert browser.ask("document.querySelectorAll('#rows tr').length") == len(exam.recording.layout.equalities)


def test_a_browser_shows_the_frame_that_is_asked_for(browser, exams, tmp_path):
    exam = exams("gripping_gripper")
    opened(browser, exam, tmp_path, prefers_reduced_motion="reduce")
    assert browser.ask("viewer.frame") == 0
    frame = 150
    browser.ask(
        f"(t => {{ t.value = {frame}; t.dispatchEvent(new Event('input')); }})(document.getElementById('time'))"
    )
    assert browser.ask("viewer.frame") == frame
    show = shown(exam)
    assert browser.ask("document.getElementById('clock').textContent") == f"t = {show.film.times[frame]:.3f} s"
    mine = "viewer.sides[%d].groups.map(group => group.getWorldPosition(group.position.clone()).toArray())"
    for number, side in enumerate(show.film.sides):
        there = np.array(browser.ask(f"viewer.draw(), {mine % number}"))
        assert there == pytest.approx(side.poses[frame, show.film.moving, :3], abs=SINGLE)
    browser.ask("document.getElementById('worst').click()")
    assert browser.ask("viewer.frame") == int(show.film.sides[0].drift.argmax())
    browser.ask("(f => { f.value = 1; f.dispatchEvent(new Event('input')); })(document.getElementById('factor'))")
    assert browser.ask("viewer.factor") == 10
    assert browser.ask("document.getElementById('factor-said').textContent") == "× 10"
    assert heard(browser) == []


def test_gaps_are_as_long_as_the_factor_says(browser, exams, tmp_path):
    exam = exams("boat")
    opened(browser, exam, tmp_path, prefers_reduced_motion="reduce")
    show = shown(exam)
    browser.ask("document.getElementById('worst').click()")
    frame = browser.ask("viewer.frame")
    # The rods of gaps are the cylinders whose colour is that of gaps.
    lengths = browser.ask(
        "viewer.scene.children.filter(one => one.renderOrder === 12 && one.geometry.type === 'CylinderGeometry')"
        ".map(one => one.scale.z)"
    )
    wanted = np.linalg.norm(show.film.sides[0].gaps[frame], axis=1) * show.factor
    assert browser.ask("viewer.factor") == show.factor
    assert lengths == pytest.approx(wanted.tolist(), rel=SINGLE_PARTS * 10)


def test_a_phone_shows_it_without_scrolling_sideways(browser, exams, tmp_path):
    path = tmp_path / "view.html"
    write(shown(exams("standing_leg")), path)
    browser.open(path, width=390, height=844)
    browser.wait("document.documentElement.dataset.drawn !== undefined")
    assert browser.ask("document.documentElement.scrollWidth <= innerWidth")
    width = "document.querySelector('#stage canvas').getBoundingClientRect().width"
    assert browser.ask(f"{width} > 300 && {width} <= innerWidth")
    assert browser.ask(COLOURS)[1] > 0.02


def test_a_film_is_recorded(browser, exams, tmp_path):
    opened(browser, exams("boat"), tmp_path, prefers_reduced_motion="reduce")
    if browser.ask("document.getElementById('record').hidden"):
        pytest.skip("this browser records nothing")
    browser.ask("document.getElementById('speed').value = '0.1', document.getElementById('record').click()")
    assert int(browser.wait("document.documentElement.dataset.recorded")) > 1000
    assert heard(browser) == []


HOSTILE = "</script><img src=x onerror=alert(1)><b>bold"


def test_names_are_text(browser, tmp_path):
    def written(text):
        return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")

    path = tmp_path / "hostile.xml"
    text = BARE.replace('name="rod"', f'name="{written(HOSTILE)}"').replace('"rod"', f'"{written(HOSTILE)}"')
    path.write_text(text.replace('name="loop"', f'name="{written(HOSTILE)}"'))
    exam = examined(str(path), duration=0.05)
    assert element_name(exam.model, mujoco.mjtObj.mjOBJ_EQUALITY, 0) == HOSTILE
    opened(browser, exam, tmp_path)
    assert browser.ask("document.querySelector('#rows td').textContent") == HOSTILE
    assert browser.ask("document.querySelectorAll('img, #rows b').length") == 0
    assert browser.ask(f"viewer.shown.scene.names.includes({json.dumps(HOSTILE)})")
    assert heard(browser) == []
