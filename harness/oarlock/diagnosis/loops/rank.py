"""The rank of rows, decided at the largest gap of their singular values, and what their dependence looks like.

Singular values are those of J in the metric of M, with each block of rows (a point, a rotation, a single row) scaled to
a largest row of length 1: a rank then depends neither on units nor on masses. A fixed cut cannot tell a singular value
of a mechanism near a singular pose from that of a redundant row in a file of six digits; the largest gap can, and says
by how much it did.
"""

from dataclasses import dataclass

import numpy as np

from oarlock.mechanics.folding import Folded

ZERO_ROW = 1e-10
"""Relative to the largest entry of J: such a row holds nothing. Rounding of long chains is 1e-13."""

FLOOR = 1e-10
"""Relative to the largest singular value: those below are alike. What a closed redundant row has is 1e-14, what six
digits of a file make of it is 1e-6; with this floor the second counts as redundant beside true ones of 0.1."""

NEAR_SINGULAR = 1e-3
"""A smallest kept singular value below this, or a gap of less than its inverse, makes a rank doubtful."""

CUT = 1e-5
"""What the solvers of the exact solution take for zero: its square is their cut on the eigenvalues of A."""

NEAR = 100.0
"""Within this factor of the cut it is the cut that decides: 1e4 in eigenvalues."""


@dataclass(frozen=True)
class Spectrum:
    """Singular values of a set of rows, relative to the largest, and the rank they give.

    Attributes:
        rank: how many are kept.
        kept: the smallest kept one, 1 at most; 0 if there is none.
        dropped: the largest one that is not kept; 0 if there is none.
    """

    rank: int
    kept: float
    dropped: float

    @property
    def gap(self) -> float:
        """Ratio of the two at which the rank was decided."""
        return self.kept / max(self.dropped, FLOOR)

    @property
    def near_singular(self) -> bool:
        """Whether a small change of the pose or of a length may change the rank."""
        return self.rank > 0 and (self.kept < NEAR_SINGULAR or self.gap < 1.0 / NEAR_SINGULAR)

    @property
    def doubtful(self) -> bool:
        """Whether a singular value lies within ``NEAR`` of the cut, so that the cut decides whether its row counts."""
        return self.rank > 0 and (self.kept < NEAR * CUT or self.dropped > CUT / NEAR)


def ranks(sigma: np.ndarray) -> np.ndarray:
    """Ranks (…) at the largest gap of singular values (…, k), descending; 0 where all are zero."""
    if not sigma.shape[-1]:
        return np.zeros(sigma.shape[:-1], dtype=int)
    top = sigma[..., :1]
    relative = np.maximum(sigma / np.where(top > 0, top, 1.0), FLOOR)
    ratios = relative / np.concatenate([relative[..., 1:], np.full_like(top, FLOOR)], axis=-1)
    return np.where(top[..., 0] > 0, ratios.argmax(axis=-1) + 1, 0)


def spectrum(sigma: np.ndarray) -> Spectrum:
    """The rank of one set of singular values (k), descending."""
    rank = int(ranks(sigma))
    if rank == 0:
        return Spectrum(0, 0.0, 0.0)
    dropped = float(sigma[rank] / sigma[0]) if rank < len(sigma) else 0.0
    return Spectrum(rank, float(sigma[rank - 1] / sigma[0]), dropped)


def zero_rows(jacobian: np.ndarray) -> np.ndarray:
    """Which rows of J (…, n, nv) hold nothing (…, n)."""
    sizes = np.abs(jacobian).max(axis=-1, initial=0.0)
    return sizes <= ZERO_ROW * sizes.max(axis=-1, initial=0.0, keepdims=True)


def block_scales(lengths: np.ndarray, blocks: list[slice]) -> np.ndarray:
    """Factors (n) that make the longest row of every block 1 long, from the lengths (n) of J H^T; 0 of zero rows."""
    scales = np.zeros(len(lengths))
    for block in blocks:
        longest = lengths[block].max(initial=0.0)
        scales[block] = np.where(lengths[block] > 0.0, 1.0 / longest if longest > 0.0 else 0.0, 0.0)
    return scales


def null_basis(folded: Folded, rank: int, scales: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, n − rank) of the multipliers that do nothing, null(Jᵀ), from scaled rows, folded.

    A row that was scaled by s has the multiplier s times that of the scaled one; rows scaled by 0 hold nothing, so that
    any multiplier of theirs does nothing. Multipliers of proportional rows that cancel one another come first, class by
    class; what is dependent beyond them is there only where more classes are left than the rank.
    """
    factors, count = np.where(scales > 0, scales, 1.0), len(folded.rows)
    zero = np.flatnonzero(folded.owner < 0)
    members = folded.members()
    found = np.zeros((len(scales), len(scales) - count))
    found[zero, np.arange(len(zero))] = 1.0
    at = len(zero)
    for one in members:
        others = np.linalg.qr(folded.weights[one, None], mode="complete")[0][:, 1:]
        found[one, at : at + len(one) - 1] = np.linalg.qr(factors[one, None] * others)[0]
        at += len(one) - 1
    if count <= rank:
        return found
    directions = np.linalg.svd(folded.rows, full_matrices=count > folded.rows.shape[1])[0][:, rank:]
    spread = factors[:, None] * folded.spread(directions)
    if not members:  # zero rows have no part in what is dependent
        return np.hstack([found, np.linalg.qr(spread)[0]])
    return np.linalg.qr(np.hstack([found, spread]))[0]


PART = 1e-6
"""A null vector's part in a row, of its largest: below it, rounding over the gap."""

_PIVOT = 0.3
"""Of the largest entry: a pivot may be smaller than the best one, for the sake of the order, but not small."""


def circuits(null: np.ndarray, order: np.ndarray) -> np.ndarray:
    """A basis (n, k) of null vectors with few entries each: minimal sets of dependent rows.

    Gauss–Jordan elimination of a basis (n, k) with pivots in ``order`` of the rows. What a pivot's vector has left are
    the rows that are not pivots, which are independent: the one way to write the pivot's row by them.
    """
    left, pivots = null.copy(), []
    for step in range(null.shape[1]):
        rows = np.linalg.norm(left[:, step:], axis=1)
        row = int(order[np.argmax(rows[order] >= _PIVOT * rows.max())])
        # A reflection of what is left brings the row's whole length into one column: stable.
        mirror = left[row, step:] / rows[row]
        mirror[0] += 1.0 if mirror[0] >= 0 else -1.0
        left[:, step:] -= np.outer(left[:, step:] @ mirror, 2.0 / (mirror @ mirror) * mirror)
        left[:, step] /= left[row, step]
        others = np.arange(null.shape[1]) != step
        left[:, others] -= np.outer(left[:, step], left[row, others])
        pivots.append(row)
    left = left / np.abs(left).max(axis=0, initial=0.0)
    left[np.abs(left) < PART] = 0.0
    return left
