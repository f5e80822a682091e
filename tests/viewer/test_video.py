"""Videos of both motions: what their pictures show is what the page shows, with no graphics library and with one."""

import io
import re
import stat
import subprocess
import sys

import numpy as np
import pytest
from oarlock.base.errors import InputError
from oarlock.base.numbers import figure
from oarlock.viewer import video as videos
from oarlock.viewer.session import view
from oarlock.viewer.video import HEAD, HIGH, RATE, RED, WIDE, Video, require_video, write_video
from PIL import Image

COLOUR = 24
"""Of 256: how far one of the 256 colours of a GIF is from what it stands for, but on edges, which have many."""

EDGES = 0.01
"""Part of the pixels."""

PIXEL = 0.11
"""Pixels are written with one digit."""


def pixels_of(picture):
    return np.asarray(Image.open(io.BytesIO(picture)))


@pytest.fixture(scope="module")
def boat():
    return view("boat", duration=0.3).shown


@pytest.fixture(scope="module")
def alone():
    """MuJoCo's motion has no exact one beside it."""
    return view("four_bar", duration=0.1).shown


@pytest.fixture(autouse=True)
def _no_library(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)


def lines(picture, colour):
    """Ends (n, 2, 2) of the lines of a colour."""
    found = re.findall(rf'<path d="M([-\d. L]+)" fill="none" stroke="{colour}"', picture)
    return np.array([[list(map(float, point.split())) for point in text.split("L")] for text in found])


def test_a_picture_has_both_motions_and_their_gaps(boat):
    video = Video(boat)
    frame = int(boat.film.sides[0].drift.argmax())
    picture = video.picture(frame)
    assert re.findall(r">(MuJoCo|exact)<", picture) == ["MuJoCo", "exact"]
    assert f"t = {boat.film.times[frame]:.3f} s" in picture
    found = lines(picture, RED)
    assert len(found) == 2 * len(boat.film.joining) == 4
    pixels = HIGH / (videos.AROUND * boat.frame[1]), WIDE / (videos.AROUND * boat.frame[0])
    axes = np.eye(3) - np.outer(boat.towards, boat.towards)
    for side, drawn in zip(boat.film.sides, (found[:2], found[2:]), strict=True):
        gaps = boat.factor * side.gaps[frame] @ axes
        lengths = np.linalg.norm(drawn[:, 1] - drawn[:, 0], axis=1)
        assert lengths == pytest.approx(min(pixels) * np.linalg.norm(gaps, axis=1), abs=2 * PIXEL)


def test_all_that_moves_is_in_the_picture(boat):
    video = Video(boat)
    for frame in (0, len(boat.film.times) - 1):
        pixels = pixels_of(videos.vl_convert.svg_to_png(video.picture(frame)))[HEAD:]
        rim = np.concatenate([pixels[0, :, :3], pixels[-1, :, :3]]).astype(int)
        assert np.ptp(rim[np.r_[: WIDE - 1, WIDE + 2 : 2 * WIDE]]) == 0  # but for the line between the two
        assert (np.ptp(pixels[..., :3], axis=2) > 30).mean() > 0.005


def test_it_lasts_as_long_as_it_says(boat):
    video = Video(boat)
    lasts = boat.film.times[-1] - boat.film.times[0]
    assert len(video.frames) == videos.SHORTEST * RATE
    assert video.speed == pytest.approx(lasts / videos.SHORTEST)
    assert f"speed × {figure(video.speed)}" in video.picture(0)
    assert video.frames == sorted(video.frames)
    assert (video.frames[0], video.frames[-1]) == (0, len(boat.film.times) - 1)


def test_a_gif_has_all_its_frames(boat, tmp_path, monkeypatch):
    monkeypatch.setattr(videos, "SHORTEST", 0.4)
    path = tmp_path / "boat.gif"
    assert write_video(boat, path) == path.stat().st_size
    video = Video(boat)
    with Image.open(path) as found:
        assert (found.n_frames, found.size) == (len(video.frames), (2 * WIDE, HIGH + HEAD))
        for number, frame in enumerate(video.frames):
            found.seek(number)
            assert found.info["duration"] == 1000 // RATE
            drawn = pixels_of(videos.vl_convert.svg_to_png(video.picture(frame)))[..., :3].astype(int)
            off = np.abs(np.asarray(found.convert("RGB")).astype(int) - drawn).max(axis=2)
            assert (off > COLOUR).mean() < EDGES


READ = """(async () => {
  const bytes = Uint8Array.from(atob("%s"), one => one.charCodeAt(0));
  const reader = new ImageDecoder({ data: bytes, type: "image/gif" });
  await reader.tracks.ready;
  await reader.completed;
  const { image } = await reader.decode({ frameIndex: reader.tracks.selectedTrack.frameCount - 1 });
  return [reader.tracks.selectedTrack.frameCount, image.displayWidth, image.displayHeight, image.duration];
})()"""


def test_a_browser_reads_a_gif(browser, boat, tmp_path, monkeypatch):
    import base64

    monkeypatch.setattr(videos, "SHORTEST", 0.4)
    path = tmp_path / "boat.gif"
    write_video(boat, path)
    page = tmp_path / "page.html"
    page.write_text("<!doctype html>")
    browser.open(page)
    read = browser.ask(READ % base64.b64encode(path.read_bytes()).decode())
    assert read == [10, 2 * WIDE, HIGH + HEAD, 1_000_000 // RATE]


def test_one_motion_alone_has_one_picture(boat):
    import dataclasses

    film = dataclasses.replace(boat.film, sides=boat.film.sides[:1])
    picture = Video(dataclasses.replace(boat, film=film)).picture(0)
    assert f'width="{WIDE}" height="{HIGH + HEAD}"' in picture
    assert "exact" not in picture


def test_names_are_text(boat):
    import dataclasses

    side = dataclasses.replace(boat.film.sides[0], title="<b>&")
    film = dataclasses.replace(boat.film, sides=[side])
    picture = Video(dataclasses.replace(boat, film=film)).picture(0)
    assert "&lt;b&gt;&amp;" in picture
    assert "<b>" not in picture


# MP4.


@pytest.fixture
def ffmpeg(tmp_path, monkeypatch):
    """Puts a program of the tests in place of ffmpeg, and no other beside it."""

    def put(script):
        (tmp_path / "programs").mkdir(exist_ok=True)
        path = tmp_path / "programs" / "ffmpeg"
        path.write_text(f"#!{sys.executable}\n{script}")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setenv("PATH", str(tmp_path / "programs"))

    return put


def test_ffmpeg_gets_every_picture(boat, tmp_path, ffmpeg, monkeypatch):
    monkeypatch.setattr(videos, "SHORTEST", 0.4)
    ffmpeg("import sys; open(sys.argv[-1], 'wb').write(sys.stdin.buffer.read() + ' '.join(sys.argv).encode())")
    path = tmp_path / "boat.mp4"
    assert write_video(boat, path) == path.stat().st_size
    content = path.read_bytes()
    assert content.count(b"\x89PNG\r\n\x1a\n") == 10
    assert b"-framerate 25" in content
    assert b"-f mp4" in content


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("import sys; sys.exit('no such codec')", "ffmpeg wrote no video: no such codec"),
        ("import sys; sys.stdin.buffer.read(); sys.exit(3)", "ffmpeg wrote no video: status 3"),
    ],
)
def test_what_ffmpeg_says_is_one_line(alone, tmp_path, ffmpeg, script, said):
    ffmpeg(script)
    (tmp_path / "old.mp4").write_text("old")
    with pytest.raises(InputError, match=said):
        write_video(alone, tmp_path / "old.mp4")
    assert (tmp_path / "old.mp4").read_text() == "old"


def test_bad_input_is_one_line(tmp_path, monkeypatch, oarlock_here):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match=r"no ffmpeg for 'a\.mp4', expected one on the PATH, or FILE\.gif"):
        require_video(tmp_path.__class__("a.mp4"))
    done = oarlock_here("view", "four_bar", "--duration", "0.1", "--video", "a.avi")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "oarlock: 'a.avi', expected the name of a video, FILE.gif or FILE.mp4\n"
    (tmp_path / "a.gif").mkdir()
    done = oarlock_here("view", "four_bar", "--duration", "0.1", "-q", "--video", "a.gif")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "a.gif" in done.stderr


def test_the_command_writes_a_video_and_no_page(tmp_path, oarlock_here, monkeypatch):
    monkeypatch.setattr(videos, "SHORTEST", 0.1)
    done = oarlock_here("view", "four_bar", "--duration", "0.1", "--video", "own.gif")
    assert (done.returncode, done.stdout.startswith("own.gif (")) == (0, True)
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["own.gif"]
    done = oarlock_here("view", "four_bar", "--duration", "0.1", "--video", "own.gif", "-o", "own.html")
    assert len(done.stdout.splitlines()) == 2
    assert (tmp_path / "own.html").is_file()


# MuJoCo's own renderer.


RENDERED = """
import io, os
import numpy as np
import vl_convert
from PIL import Image
from oarlock.viewer.session import view
from oarlock.viewer.video import Video
def decoded(picture): return np.asarray(Image.open(io.BytesIO(picture)))
shown = view("gripping_gripper", duration=0.02).shown
theirs = decoded(vl_convert.svg_to_png(Video(shown).picture(0)))[30:, :480, :3].astype(int)
del os.environ["MUJOCO_GL"]
own = decoded(vl_convert.svg_to_png(Video(shown).picture(0)))[30:, :480, :3].astype(int)
coloured = [np.ptp(picture, axis=2) > least for picture, least in ((theirs, 5), (own, 12))]  # theirs is dark
print((coloured[0] & coloured[1]).sum() / (coloured[0] | coloured[1]).sum())
"""

ALIKE = 0.85
"""Of all pixels that have a colour in one of two pictures: edges differ by a pixel, and rods are ten pixels wide."""


def test_mujocos_renderer_draws_the_same_where_there_is_one(tmp_path):
    import os

    done = subprocess.run(
        [sys.executable, "-c", RENDERED],
        env={**os.environ, "MUJOCO_GL": "egl"},
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    if "MUJOCO_GL) does not draw" in done.stderr or "import mujoco" in done.stderr or "OpenGL" in done.stderr:
        pytest.skip("there is no EGL")
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > ALIKE
