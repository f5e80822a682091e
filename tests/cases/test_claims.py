"""Claims of a paper: the file is what its script makes, its formulas are the boat's, and no other file passes."""

import importlib.util
import json
import shutil
import subprocess
import sys

import boat_paper as paper
import numpy as np
import pytest
from mechanisms import BOAT, boat_copy, boat_with, relative
from oarlock import InputError, load_case, run
from oarlock.cases.case import MODELS
from oarlock.cases.claims import load_claims
from tolerances import CLAIM, CLAIM_ROUNDING, SAME_FORMULA

KEPT = BOAT / "claims.json"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("claims of the boat", BOAT / "claims.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [*sys.path])
        spec.loader.exec_module(module)
    return module


def test_the_file_is_what_the_script_makes(tmp_path):
    """In another place; figures that are rounding differ between machines, and are rounding on both."""
    shutil.copy(MODELS / "_truth.py", tmp_path)
    (tmp_path / "boat").mkdir()
    for name in ("claims.py", "reference.py"):
        shutil.copy(BOAT / name, tmp_path / "boat")
    subprocess.run([sys.executable, tmp_path / "boat" / "claims.py"], check=True, timeout=120)
    kept, made = (json.loads(path.read_text(encoding="utf-8")) for path in (KEPT, tmp_path / "boat" / "claims.json"))
    figures = [[one for claim in claims for one in claim.pop("figures")] for claims in (kept, made)]
    assert kept == made
    for one, other in zip(*figures, strict=True):
        assert one["what"] == other["what"]
        assert other["value"] == pytest.approx(one["value"], rel=CLAIM, abs=CLAIM_ROUNDING)


def test_its_formulas_are_those_of_the_boat(script):
    states = np.random.default_rng(3).uniform(-1, 1, (20, 5))
    for state, rows, matrix, mass in zip(
        states, script.constraints(states), script.jacobian(states), script.mass(states), strict=True
    ):
        assert relative(rows, paper.constraints(state)) <= SAME_FORMULA
        assert relative(matrix, paper.jacobian(state)) <= SAME_FORMULA
        assert relative(np.diag(mass), paper.mass(state)) <= SAME_FORMULA
    moved = script.motion()
    assert moved.shape == (12_001, 5)
    np.testing.assert_allclose(moved[0], paper.START, atol=SAME_FORMULA)
    assert np.abs(script.constraints(moved)).max() <= SAME_FORMULA


def test_what_is_unique_is_so_and_what_is_not_is_not(script):
    """λ may change along the oars, and along nothing else, without a change of Gᵀλ."""
    (unique, misprint, *_) = load_claims(load_case("boat"))
    assert [claim.holds for claim in (unique, misprint)] == [False, False]
    moved = script.motion()[::100]
    axes, g = script.along_oars(moved), script.jacobian(moved)
    np.testing.assert_allclose(
        np.swapaxes(axes, 1, 2) @ axes, np.broadcast_to(np.eye(2), (len(moved), 2, 2)), atol=1e-15
    )
    assert np.abs(np.swapaxes(g, 1, 2) @ axes).max() <= SAME_FORMULA
    values = np.linalg.svd(g, compute_uv=False)
    assert (values[:, 3] > 0.1 * values[:, 0]).all()  # what ZERO of the script tells apart
    assert (values[:, 4] < SAME_FORMULA).all()
    assert unique.figures[0].value == 2
    printed, right, others = (one.value for one in misprint.figures)
    assert printed > 0.4  # of cos θ₂ − cos θ₃ with angles up to 1
    assert max(right, others) <= script.ZERO


def test_a_case_without_claims_has_none():
    assert load_claims(load_case("four_bar")) == []
    assert load_claims(boat_with(paper={"source": "nobody"})) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "claims.json' cannot be read: "),
        ("[", "the file: Invalid JSON"),
        ("{}", "the file: Input should be a valid array"),
        ('[{"claim": "x", "holds": true, "instead": "", "figures": []}]', "0.figures: List should have at least 1"),
        ('[{"claim": "x", "holds": 1, "instead": "", "figures": []}]', "0.holds: Input should be a valid boolean"),
        ('[{"claim": "x", "instead": "", "figures": []}]', "0.holds: Field required"),
    ],
)
def test_other_files_are_named(tmp_path, text, message):
    folder = boat_copy(tmp_path / "boat", duration_s=0.002, experiments="[[experiments]]\nmode = 'calibration'\n")
    if text is None:
        (folder / "claims.json").unlink()
    else:
        (folder / "claims.json").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_claims(load_case(folder))
    with pytest.raises(InputError, match=message):
        run(folder, out=tmp_path / "results")
