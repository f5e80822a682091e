"""Folding of proportional rows: what singular values, left vectors and null spaces make of it."""

import numpy as np
import pytest
from oarlock.mechanics.folding import fold
from tolerances import SAME_FORMULA


def rows_with_repeats(seed, classes=6, repeats=4, zeros=2, width=9):
    """Rows in a random order, some of them multiples of others (also negative), some zero."""
    random = np.random.default_rng(seed)
    own = random.normal(size=(classes, width))
    again = own[random.integers(classes, size=repeats)] * random.uniform(-3, 3, size=(repeats, 1))
    rows = np.vstack([own, again, np.zeros((zeros, width))])
    return rows[random.permutation(len(rows))]


@pytest.mark.parametrize("seed", range(20))
def test_folded_rows_stand_for_all(seed):
    rows = rows_with_repeats(seed)
    folded = fold(rows)
    assert len(folded.rows) == 6
    np.testing.assert_array_equal(folded.owner < 0, ~rows.any(axis=1))
    scale = np.abs(rows).max()
    np.testing.assert_allclose(folded.spread(folded.rows), rows, rtol=0, atol=SAME_FORMULA * scale)
    whole, short = (np.linalg.svd(one, compute_uv=False) for one in (rows, folded.rows))
    np.testing.assert_allclose(short, whole[:6], rtol=SAME_FORMULA * 10)
    vectors = np.random.default_rng(seed).normal(size=(6, 3))
    np.testing.assert_allclose(folded.gather(folded.spread(vectors)), vectors, rtol=0, atol=SAME_FORMULA * 10)


def test_nearly_proportional_rows_are_not_alike():
    """A redundant row that is off by six digits must stay a row: it has a singular value of its own."""
    rows = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0 + 1e-6], [-1.0, -2.0, -3.0]])
    folded = fold(rows)
    assert folded.owner.tolist() == [0, 1, 0]
    assert folded.alone.tolist() == [False, True, False]


def test_rows_that_count_as_zero_and_none_at_all():
    rows = np.array([[1.0, 0.0], [1e-15, 1e-15], [0.0, 2.0]])
    assert fold(rows, np.array([False, True, False])).owner.tolist() == [0, -1, 1]
    nothing = fold(np.zeros((2, 3)))
    assert nothing.rows.shape == (0, 3)
    assert nothing.spread(np.zeros((0, 2))).shape == (2, 2)
    assert not nothing.alone.any()


def test_many_rows_with_one_mixed_number_are_still_told_apart():
    """Unit rows of a plane that a random direction cannot tell apart would be taken for alike by that number alone."""
    direction = np.abs(np.random.default_rng(0).normal(size=2))
    mirrored = np.array([[direction[0], direction[1]], [direction[0], direction[1]]]) / np.linalg.norm(direction)
    turned = mirrored @ np.array([[np.cos(1e-7), -np.sin(1e-7)], [np.sin(1e-7), np.cos(1e-7)]])
    assert fold(np.vstack([mirrored, turned])).owner.tolist() == [0, 0, 1, 1]
