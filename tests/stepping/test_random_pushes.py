"""Random closed chains among limits, friction loss and contacts: every answer is proved, and nothing breaks."""

import numpy as np
import pytest
from random_mechanisms.generator import mechanism
from random_mechanisms.pushes import Proof, prove

pytestmark = pytest.mark.xdist_group("random mechanisms")

FEW, MANY = 60, 2000
"""Mechanisms."""

FORMS = ("hard", "matched")


def proofs(count: int) -> list[Proof]:
    return [prove(mechanism(seed), form) for seed in range(count) for form in FORMS]


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_every_step_is_proved(count):
    found = proofs(count)
    acting = [one for one in found if one.active]
    assert len(acting) > 0.9 * len(found)
    assert max(one.rows for one in found) > 50
    # One in four thousand walks has steps that are not, which their status says: forty contacts against loops alone.
    unproved = {one.seed: one.unproved for one in found if one.unproved}
    assert len(unproved) <= len(found) // 2000, unproved
    # Bodies that are thrown about by what they stood in lose their loops, which is said.
    ended = [one.ended for one in found if one.ended]
    assert all("can no longer be closed together" in reason or "no longer finite" in reason for reason in ended)
    assert len(ended) < 0.05 * len(found)
    assert np.mean([one.newton for one in acting]) < 1.7
    assert any(one.blocked for one in found)
