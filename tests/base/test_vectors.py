"""The order of sums is what it says, whatever the machine; the algebra is MuJoCo's."""

import mujoco
import numpy as np
import pytest
from oarlock.base.vectors import cross, horner, norm, times
from tolerances import SAME_POINT


@pytest.mark.parametrize("columns", [0, 1, 2, 3, 7, 64, 121])
def test_rows_are_summed_from_left_to_right(columns):
    rng = np.random.default_rng(columns)
    whole, vector = rng.normal(size=(5, columns)), rng.normal(size=columns)
    for matrix in (whole, whole[::2], np.asfortranarray(whole)):
        found = times(matrix, vector)
        assert found.shape == (len(matrix),)
        for row, entry in zip(matrix.tolist(), found.tolist(), strict=True):
            total = 0.0
            for a, b in zip(row, vector.tolist(), strict=True):
                total += a * b
            assert entry == total
    assert norm(vector) == np.sqrt(times(vector[None], vector)[0])
    assert norm(np.array([3.0, 4.0])) == 5.0


def test_algebra_is_mujocos():
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(2, 3))
    theirs = np.zeros(3)
    mujoco.mju_cross(theirs, p, q)
    np.testing.assert_allclose(cross(p.tolist(), q.tolist()), theirs, rtol=0, atol=SAME_POINT)
    assert horner([1.0, 2.0, 3.0], 2.0) == 17.0
