"""Consistent states of a mechanism, spread over all that it can reach: for resets, data sets and identification.

What examines a model is imported where one is sampled.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from oarlock.base.answer import Answer, html_table
from oarlock.base.arguments import require_count, require_number
from oarlock.base.cores import one_thread
from oarlock.base.errors import InputError
from oarlock.base.files import replacing
from oarlock.mechanics.fatal import mujoco_ends_in_a_line

if TYPE_CHECKING:
    from oarlock.mechanics.given import Model

BINS = 32
"""Parts of what a coordinate reaches, by which it is said how evenly samples fill it."""


@dataclass(frozen=True)
class Samples(Answer):
    """Consistent states of a model.

    Attributes:
        file: what was sampled, as it was given.
        seed: of the random numbers; the same gives the same bits.
        qpos: positions (n, nq): every row closed, inside of all ranges.
        qvel: velocities (n, nv) that the rows admit.
        branch: of each sample (n). From one sample of a branch to another steps lead along closed poses, inside of
            ranges, without passing a singular one; 0 is the start's own.
        singular: how near each is to a singular pose (n): the smallest singular value of the rows that counts, over its
            median in all samples; 0 is singular, 1 is usual. Of several independent mechanisms the least.
        open: largest deviation of a row that is left (n), m or rad.
        depth: how deep bodies are in one another (n), m; 0 where nothing touches.
        coordinates: names of the entries of ``qpos``.
        speeds: names of the entries of ``qvel``.
        energy: mean kinetic energy of a degree of freedom, J.
        turning: which entries of ``qpos`` are angles that turn on and on.
    """

    file: str
    seed: int
    qpos: np.ndarray
    qvel: np.ndarray
    branch: np.ndarray
    singular: np.ndarray
    open: np.ndarray
    depth: np.ndarray
    coordinates: tuple[str, ...]
    speeds: tuple[str, ...]
    energy: float
    turning: tuple[bool, ...] = ()

    FRAMES = ("states", "branches", "coverage")

    def __len__(self) -> int:
        return len(self.qpos)

    @property
    def states(self) -> pl.DataFrame:
        """A row a sample: branch, how near to singular, what is left open, depth, every coordinate."""
        columns: dict[str, Any] = {name: getattr(self, name) for name in ("branch", "singular", "open", "depth")}
        return pl.DataFrame(columns | dict(zip(self.coordinates, self.qpos.T, strict=True)))

    @property
    def branches(self) -> pl.DataFrame:
        """A row a branch: its samples, whether it is the start's own, the nearest to a singular pose."""
        return pl.DataFrame(
            [
                {
                    "branch": label,
                    "samples": int((self.branch == label).sum()),
                    "of_start": label == 0,
                    "singular_least": float(self.singular[self.branch == label].min()),
                }
                for label in np.unique(self.branch).tolist()
            ],
            schema={"branch": pl.Int64, "samples": pl.Int64, "of_start": pl.Boolean, "singular_least": pl.Float64},
        )

    @property
    def coverage(self) -> pl.DataFrame:
        """A row a coordinate: least and largest value, and the share of ``BINS`` equal parts between with a sample.

        An angle that turns on and on is told from the far side of the widest gap on its circle, beyond half a turn if
        that lies inside of it.
        """
        rows = []
        turning = self.turning or (False,) * len(self.coordinates)
        for name, values, turns in zip(self.coordinates, self.qpos.T, turning, strict=True):
            if turns:
                values = unrolled(values)
            least, most = float(values.min()), float(values.max())
            filled = (
                len(np.unique(np.floor((values - least) / (most - least) * BINS * (1 - 1e-12))))
                if most > least
                else BINS
            )
            rows.append({"coordinate": name, "least": least, "largest": most, "filled": filled / BINS})
        return pl.DataFrame(rows)

    def document(self) -> dict[str, Any]:
        """As ``oarlock sample --json``: what was sampled, without the samples themselves."""
        return {
            "file": self.file,
            "samples": len(self),
            "seed": self.seed,
            "open_max": float(self.open.max()),
            "touching": int((self.depth > 0.0).sum()),
            "energy_J": self.energy,
            "branches": self.branches.to_dicts(),
            "coverage": self.coverage.to_dicts(),
        }

    def save(self, path: str | Path) -> Path:
        """Writes all arrays as ``.npz``, under the names of the attributes; ``file`` as ``model``.

        Raises:
            InputError: the file cannot be written.
        """
        target = Path(path)
        names = ("qpos", "qvel", "branch", "singular", "open", "depth")
        arrays = {name: getattr(self, name) for name in names}
        texts = {
            "coordinates": np.array(self.coordinates),
            "speeds": np.array(self.speeds),
            "model": np.array(self.file),
        }
        with replacing(target, named=True) as temporary, temporary.open("wb") as stream:
            np.savez(
                stream, allow_pickle=False, **arrays, **texts, seed=np.array(self.seed), energy=np.array(self.energy)
            )
        return target

    def report(self, folder: str | Path) -> Path:
        """Writes a page with the tables to a folder: README.md and index.html."""
        from oarlock.base.files import write_text
        from oarlock.render.folder import require_report, write_whole
        from oarlock.render.page import page
        from oarlock.render.template import render

        target = Path(folder)
        require_report(target, ("README.md", "index.html"))
        text = render(
            "sample.md.j2", head=self.said(), branches=self.branches.to_dicts(), coverage=self.coverage.to_dicts()
        )

        def write(new: Path) -> None:
            write_text(new / "README.md", text)
            write_text(new / "index.html", page("Consistent states", text, [], {}))

        return write_whole(target, write)

    def said(self) -> str:
        """The whole in a sentence or two."""
        own = int((self.branch == 0).sum())
        count = len(np.unique(self.branch))
        said = (
            f"{len(self)} consistent states of {self.file}, seed {self.seed}: open by {self.open.max():.1e} m or rad "
        )
        said += f"at most; {own} on the branch of the start"
        said += f", the others on {count - 1} more" if count > 1 else ", the only one that was found"
        touching = int((self.depth > 0.0).sum())
        return said + (f"; in {touching} of them bodies are in one another" if touching else "") + "."

    def _repr_html_(self) -> str:
        table = self.coverage
        return html_table(self.said(), table.columns, table.rows())

    def __repr__(self) -> str:
        return self.said()


def unrolled(angles: np.ndarray) -> np.ndarray:
    """Angles (n), rad, each by whole turns away, without the widest gap on the circle between least and largest."""
    around = np.sort(np.mod(angles, 2.0 * np.pi))
    gaps = np.diff(around, append=around[0] + 2.0 * np.pi)
    first = around[(int(gaps.argmax()) + 1) % len(around)]
    found = first + np.mod(angles - first, 2.0 * np.pi)
    return found - 2.0 * np.pi * np.round(found.mean() / (2.0 * np.pi))


def sample(
    model: "Model",
    n: int = 1000,
    seed: int = 0,
    *,
    speed: float = 1.0,
    branches: str = "all",
    keyframe: str | None = None,
) -> Samples:
    """Draws consistent states of a mechanism: positions that close every row inside of all ranges, velocities to match.

    Positions are those of random walks along the closed poses, half of them on the branch of the start, the rest spread
    evenly over the other branches that random poses lead to. A joint without a range stays within half a turn of the
    start, a slide or free joint without one within an arm. Contacts are not looked at: ``Samples.depth`` tells.

    Velocities are drawn from the null space of the rows in the metric of M, v = (1 − M⁻¹Jᵀ(JM⁻¹Jᵀ)⁺J) M^(−1/2) w with
    normal w, as of a mechanism in equilibrium: every degree of freedom has the same mean kinetic energy.

    Args:
        model: an ``MjModel``, an ``MjSpec``, MJCF as text or a file, or the name of a model that comes along. The
            start is that of the case, of its first keyframe where it has one, or its own pose; an open one is closed in
            the nearest pose.
        n: how many.
        seed: of all random numbers.
        speed: root mean square of the velocities at the start, rad/s, lengths over the mechanism's arm; it sets the
            mean kinetic energy of a degree of freedom, which is the same in all samples. 0: at rest.
        branches: ``all``, or ``start`` for the start's own only.
        keyframe: name or number of the keyframe to start from; ``none``: the model's own pose.

    Raises:
        InputError: no such file or model, no closed start, a number out of range, or no degree of freedom.
    """
    require_count("n", n)
    require_number("speed", speed)
    require_number("seed", seed)
    if not isinstance(seed, int):
        raise InputError(f"seed = {seed!r}, expected a whole number ≥ 0")
    if branches not in ("all", "start"):
        raise InputError(f"branches = {branches!r}, expected 'all' or 'start'")
    from oarlock.diagnosis.loops.states import draw, start_of

    with one_thread(), mujoco_ends_in_a_line():
        name, own, start = start_of(model, keyframe)
        others = 0 if branches == "start" else n - (n + 1) // 2
        drawn = draw(own, start, n - others, others, seed, speed)
    return Samples(name, seed, *drawn)
