"""A video of both motions side by side: drawn without a graphics card, or by MuJoCo's own renderer where there is one.

Pictures are SVG, which is made pixels here. A GIF is written by Pillow, an MP4 by ffmpeg.
"""

import base64
import html
import io
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import vl_convert
from PIL import Image

from oarlock.base.errors import InputError
from oarlock.base.files import replacing
from oarlock.base.numbers import figure
from oarlock.base.progress import Progress
from oarlock.base.shapes import coarse
from oarlock.render.solids import Outline, outlines
from oarlock.viewer.film import Side
from oarlock.viewer.rendering import Rendering
from oarlock.viewer.show import Show

ENDINGS = (".gif", ".mp4")
"""Of the files that a video may be in."""

RATE = 25
"""Frames a second."""

SHORTEST, LONGEST = 3.0, 20.0
"""s. A run is shown as fast as it is, but no shorter and no longer than that."""

WIDE, HIGH, HEAD = 480, 400, 30
"""Pixels of a motion, and of the line of words above both."""

AROUND = 1.15
"""Of what is shown, the part of it that a picture has room for."""

SAMPLED = 8
"""Frames that the colours of a GIF are chosen from."""

RENDERER = "MUJOCO_GL"
"""Where the environment has this variable MuJoCo's own renderer draws: it says which graphics library is there."""

RED, GREY = "#d7301f", "#e8e8ec"


def require_video(path: Path) -> None:
    """Refuses what cannot be written.

    Raises:
        InputError: the name ends in neither .gif nor .mp4, or there is no ffmpeg for the latter.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"'{path}', expected the name of a video, FILE.gif or FILE.mp4")
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        raise InputError(f"no ffmpeg for '{path}', expected one on the PATH, or FILE.gif, which needs none")


def write_video(shown: Show, path: Path, progress: Progress | None = None) -> int:
    """Writes a video; gives its size in bytes.

    Args:
        shown: both motions.
        path: FILE.gif or FILE.mp4; what is there is replaced.
        progress: listens: ``advance`` gets every frame.

    Raises:
        InputError: as ``require_video``, MuJoCo's renderer does not draw, or the file cannot be written.
    """
    require_video(path)
    video = Video(shown)
    listens = progress or Progress()
    listens.begin("drawing", len(video.frames))
    write = _gif if path.suffix.lower() == ".gif" else _mp4
    with replacing(path, named=True) as temporary:
        write(video, temporary, listens.advance)
        return temporary.stat().st_size


class Video:
    """The pictures of a video.

    Attributes:
        frames: which frames of the film are shown, one after another.
        speed: how many seconds of the run are shown in a second.
    """

    def __init__(self, shown: Show):
        self._shown, film = shown, shown.film
        lasts = float(film.times[-1] - film.times[0])
        seconds = min(max(lasts, SHORTEST), LONGEST)
        self.speed = lasts / seconds if lasts > 0.0 else 1.0
        wanted = film.times[0] + np.linspace(0.0, lasts, max(2, round(seconds * RATE)))
        self.frames = np.abs(film.times[:, None] - wanted).argmin(axis=0).tolist()
        towards = shown.towards
        right = np.cross([0.0, 0.0, 1.0], towards)
        right /= np.linalg.norm(right)
        self._axes = np.array([right, np.cross(towards, right), towards])
        self._scale = min(WIDE / (AROUND * (shown.frame[0] or 1.0)), HIGH / (AROUND * (shown.frame[1] or 1.0)))
        self._middle = self._axes @ shown.centre
        self._meshes = coarse(shown.scene.meshes)
        self._rendering = Rendering(shown, WIDE, HIGH, HIGH / self._scale) if os.environ.get(RENDERER) else None

    def pictures(self) -> Iterator[bytes]:
        """All frames as PNG."""
        drawn: dict[int, bytes] = {}
        for frame in self.frames:
            if frame not in drawn:
                drawn = {frame: vl_convert.svg_to_png(self.picture(frame))}
            yield drawn[frame]

    def picture(self, frame: int) -> str:
        """A frame of the film as SVG."""
        shown = self._shown
        sides = shown.film.sides
        width, height = WIDE * len(sides), HIGH + HEAD
        parts = []
        for number, side in enumerate(sides):
            at = min(frame, len(side.poses) - 1)
            ends = "" if at == frame else f", ended at t = {shown.film.times[at]:.3g} s"
            parts.append(
                f'<svg x="{WIDE * number}" y="{HEAD}" width="{WIDE}" height="{HIGH}">{self._side(side, at)}</svg>'
            )
            parts.append(self._words(WIDE * number + 10, f"{side.title}{ends}"))
        speed = f"speed × {figure(self.speed)}" if abs(self.speed - 1.0) > 1e-9 else ""
        gaps = f"gaps × {figure(int(shown.factor))}" if shown.film.joining and shown.factor > 1.0 else ""
        told = " · ".join(filter(None, [gaps, speed, f"t = {shown.film.times[frame]:.3f} s"]))
        parts.append(self._words(width - 10, told, "end"))
        parts += [f'<path d="M{WIDE * n} 0V{height}" stroke="#bbb"/>' for n in range(1, len(sides))]
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" '
            f'font-size="15"><rect width="{width}" height="{height}" fill="#fff"/>{"".join(parts)}</svg>'
        )

    @staticmethod
    def _words(x: int, words: str, anchor: str = "start") -> str:
        return f'<text x="{x}" y="20" fill="#222" text-anchor="{anchor}">{html.escape(words)}</text>'

    def _side(self, side: Side, frame: int) -> str:
        poses = side.poses[frame]
        if self._rendering is not None:
            picture = base64.b64encode(_png(self._rendering.picture(poses))).decode("ascii")
            drawn = f'<image width="{WIDE}" height="{HIGH}" href="data:image/png;base64,{picture}"/>'
        else:
            shown = self._shown
            found = outlines(shown.scene.shapes, self._meshes, poses, self._axes, 1.2 * shown.extent)
            drawn = "".join(self._outline(one) for one in found)
        ways = "".join(self._line(way, "#555", 2) for way in side.tendons[frame])
        return drawn + ways + self._gaps(side, frame)

    def _outline(self, one: Outline) -> str:
        fill = GREY if one.floor else one.colour
        edge = "none" if one.floor else "#00000055"
        d = self._path(one.points) + "Z"
        return f'<path d="{d}" fill="{fill}" fill-opacity="{one.opacity:.3g}" stroke="{edge}" stroke-linejoin="round"/>'

    def _gaps(self, side: Side, frame: int) -> str:
        """The two points of every equality that joins points, moved apart by the factor."""
        parts = []
        for middle, gap in zip(side.middles[frame], side.gaps[frame], strict=True):
            if np.isfinite(gap).all() and np.isfinite(middle).all():
                half = 0.5 * self._shown.factor * gap
                parts.append(self._line(np.array([middle - half, middle + half]), RED, 3))
                x, y = self._placed((self._axes @ middle)[None, :2])[0]
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{RED}"/>')
        return "".join(parts)

    def _line(self, points: np.ndarray, colour: str, width: int) -> str:
        """A line through points (n, 3), world."""
        d = self._path((points @ self._axes.T)[:, :2])
        return f'<path d="{d}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-linecap="round"/>'

    def _placed(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 2), right and up, in pixels; far beyond the picture they stay there."""
        flat = (points - self._middle[:2]) * self._scale * np.array([1.0, -1.0]) + np.array([WIDE, HIGH]) / 2
        return np.clip(np.nan_to_num(flat), -20 * WIDE, 20 * WIDE)

    def _path(self, points: np.ndarray) -> str:
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in self._placed(points))


def _gif(video: Video, path: Path, done: Callable[[int], None]) -> None:
    every = video.frames
    spread = sorted({every[int(at)] for at in np.linspace(0, len(every) - 1, SAMPLED)})
    some = [np.asarray(_pixels(vl_convert.svg_to_png(video.picture(frame)))) for frame in spread]
    # One palette for all: colours of its own for every frame would flicker.
    palette = Image.fromarray(np.concatenate(some)).quantize(256)

    def frames() -> Iterator[Image.Image]:
        for picture in video.pictures():
            yield _pixels(picture).quantize(palette=palette, dither=Image.Dither.NONE)
            done(1)

    drawn = frames()
    next(drawn).save(path, format="GIF", save_all=True, append_images=drawn, duration=1000 // RATE, loop=0)


def _pixels(picture: bytes) -> Image.Image:
    return Image.open(io.BytesIO(picture)).convert("RGB")


def _png(pixels: np.ndarray) -> bytes:
    written = io.BytesIO()
    Image.fromarray(pixels).save(written, format="PNG")
    return written.getvalue()


def _mp4(video: Video, path: Path, done: Callable[[int], None]) -> None:
    command = [
        "ffmpeg",
        "-loglevel",
        "error",
        "-y",
        "-f",
        "image2pipe",
        "-c:v",
        "png",
        "-framerate",
        str(RATE),
        "-i",
        "-",
    ]
    command += ["-pix_fmt", "yuv420p", "-f", "mp4", str(path)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    assert process.stdin is not None
    try:
        for picture in video.pictures():
            process.stdin.write(picture)
            done(1)
    except BrokenPipeError:
        pass  # it has ended, and says why
    except BaseException:
        process.kill()
        process.wait()
        raise
    _, said = process.communicate()
    if process.returncode:
        words = said.decode(errors="replace").strip().splitlines() or [f"status {process.returncode}"]
        raise InputError(f"ffmpeg wrote no video: {words[-1][:120]}")
