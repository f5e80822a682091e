"""Rows that are multiples of one another, taken together: what repeats costs nothing then.

With a row a_c for every class of proportional rows, and t_i what row i is of it, R = T A with a column of T for every
class, of length 1 where a_c is as long as the whole class: R Rᵀ = T (A Aᵀ) Tᵀ. So R has the singular values of A, and
zeros; its left singular vectors are T times those of A; and null(Rᵀ) is what Tᵀ takes to null(Aᵀ). It is exact.
"""

from dataclasses import dataclass

import numpy as np

ALIKE = 1e-12
"""Part of a row, at most, that is not along the one that it is taken for a multiple of. Rows that say the same come out
of the same operations and differ by some roundings."""


_MIXED = 1e3 * ALIKE
"""Numbers that multiples share differ by no more, each the rounding of a sum over a row."""


@dataclass(frozen=True)
class Folded:
    """Rows (n, m) by their classes.

    Attributes:
        rows: one for every class of proportional rows, as long as all of them together, (k, m).
        owner: class of every row, (n); −1 of one that is zero.
        weights: what a row is of that of its class, (n); those of a class have the length 1, those of zero rows are 0.
    """

    rows: np.ndarray
    owner: np.ndarray
    weights: np.ndarray

    @property
    def alone(self) -> np.ndarray:
        """Which rows have a class for themselves, (n)."""
        sizes = np.bincount(self.owner[self.owner >= 0], minlength=len(self.rows))
        return (self.owner >= 0) & (sizes[self.owner] == 1) if len(sizes) else np.zeros(len(self.owner), dtype=bool)

    def members(self) -> list[np.ndarray]:
        """Numbers of the rows of every class that has several, ascending."""
        several = np.flatnonzero((self.owner >= 0) & ~self.alone)
        order = several[np.argsort(self.owner[several], kind="stable")]
        return np.split(order, np.flatnonzero(np.diff(self.owner[order])) + 1) if len(order) else []

    def spread(self, vectors: np.ndarray) -> np.ndarray:
        """T times vectors (k, …), (n, …): a left vector of the folded rows as one of all rows."""
        if not len(vectors):
            return np.zeros((len(self.owner), *vectors.shape[1:]))
        return vectors[self.owner] * self.weights.reshape(-1, *[1] * (vectors.ndim - 1))

    def gather(self, vectors: np.ndarray) -> np.ndarray:
        """Tᵀ times vectors (n, …), (k, …)."""
        found = np.zeros((len(self.rows), *vectors.shape[1:]))
        live = self.owner >= 0
        weights = self.weights.reshape(-1, *[1] * (vectors.ndim - 1))
        np.add.at(found, self.owner[live], (weights * vectors)[live])
        return found


def fold(rows: np.ndarray, zero: np.ndarray | None = None) -> Folded:
    """Finds the classes of proportional rows (n, m).

    Args:
        rows: the rows.
        zero: which of them count as zero, (n); None: those that are.
    """
    lengths = np.linalg.norm(rows, axis=1)
    live = np.flatnonzero(lengths > 0.0 if zero is None else ~zero & (lengths > 0.0))
    owner, weights = np.full(len(rows), -1), np.zeros(len(rows))
    if not len(live):
        return Folded(rows[:0].copy(), owner, weights)
    unit = rows[live] / lengths[live, None]
    first = _first_alike(unit)
    kept = np.flatnonzero(first == np.arange(len(live)))
    owner[live] = np.searchsorted(kept, first)
    signs = np.sign(np.einsum("ij,ij->i", unit, unit[first]))
    weights[live] = signs * lengths[live]
    sizes = np.sqrt(np.bincount(owner[live], lengths[live] ** 2, len(kept)))
    weights[live] /= sizes[owner[live]]
    return Folded(sizes[:, None] * unit[kept], owner, weights)


def _first_alike(unit: np.ndarray) -> np.ndarray:
    """For every unit row the first one that is a multiple of it, (n)."""
    # A number that multiples share, up to rounding: only neighbours in its order can be alike.
    mixed = np.abs(unit @ np.random.default_rng(0).normal(size=unit.shape[1]))
    order = np.argsort(mixed, kind="stable")
    first = np.arange(len(unit))
    near = np.diff(mixed[order]) <= _MIXED
    if not near.any():
        return first
    before, after = order[:-1][near], order[1:][near]
    alike = np.zeros(len(near), dtype=bool)
    alike[near] = _multiples(unit[before], unit[after])
    starts = np.append(0, np.flatnonzero(~near) + 1)
    ends = np.append(starts[1:], len(order))
    first[order] = np.repeat(np.minimum.reduceat(order, starts), ends - starts)
    several = np.add.reduceat(np.append(near & ~alike, False).astype(int), starts) > 0
    for start, end in zip(starts[several], ends[several], strict=True):
        members = np.sort(order[start:end])
        first[members] = members
        for at, one in enumerate(members):  # several classes of one number
            others = members[at + 1 :][first[members[at + 1 :]] == members[at + 1 :]]
            if first[one] == one:
                first[others[_multiples(unit[others], unit[one])]] = one
    return first


def _multiples(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which unit rows (n, m) are multiples of others, (n)."""
    along = (rows * others).sum(axis=-1)
    return np.linalg.norm(rows - along[:, None] * others, axis=-1) <= ALIKE
