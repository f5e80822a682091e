"""Every folder of mjcf/: whole, loadable, as its case expects, and matched with MuJoCo. A new model needs no code.

The variants of a parametrised model are walked as well. Those with more than ``CHEAP`` velocities are marked slow:
``make test`` leaves them out, ``pytest -m slow tests/experiments/test_models.py`` runs them.
"""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mechanisms import setup_of
from oarlock import load_case, model_names, variant_names
from oarlock.cases.case import MODELS, Case
from oarlock.cases.truth import load_truth
from oarlock.mechanics.load import load_model
from places import REPOSITORY
from whole import require_matched, require_start, require_whole

FOLDERS = sorted(path for path in MODELS.iterdir() if path.is_dir() and path.name != "__pycache__")
CHEAP = 30
"""Velocities. Beyond, a step with the pseudo-inverse takes milliseconds."""


def walked() -> list[Any]:
    """The names of all models and variants."""
    names = [name for folder in FOLDERS for name in variant_names(folder.name)]
    sizes = [load_case(name).expected()["nv"] for name in names]
    slow = [[pytest.mark.slow] if int(size) > CHEAP else [] for size in sizes]
    return [pytest.param(name, marks=marks, id=name) for name, marks in zip(names, slow, strict=True)]


@pytest.fixture(params=FOLDERS, ids=lambda path: path.name)
def folder(request) -> Path:
    return request.param


@pytest.fixture(params=walked())
def case(request) -> Case:
    return load_case(request.param)


def test_there_are_models():
    assert len(FOLDERS) >= 1
    assert [path.name for path in FOLDERS] == model_names()
    repository = REPOSITORY / "mjcf"
    assert repository.resolve() == MODELS.resolve()


def test_folder_is_whole(folder):
    require_whole(folder)


def test_model_loads_without_a_warning(case, tmp_path, monkeypatch):
    """MuJoCo writes its warnings to MUJOCO_LOG.TXT in the working folder."""
    monkeypatch.chdir(tmp_path)
    model = load_model(case.model_path.resolve(), case.parameters)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert [w.number for w in data.warning] == [0] * len(data.warning)
    assert list(tmp_path.iterdir()) == []


def test_start_is_as_the_case_expects(case):
    require_start(case)


def test_matched_with_mujoco(case):
    require_matched(case)


def test_declared_truth_is_there(case):
    truth = load_truth(case)
    if case.file.truth is None:
        assert truth is None
        return
    assert truth is not None
    assert truth.end >= case.file.run.duration_s
    # Refuses a joint, site or equality that is not there.
    setup = setup_of(case, case.file.run.integrator, duration_s=case.file.run.duration_s)
    assert setup.truth is not None
    assert np.isfinite(setup.truth.to_numpy()).all()


def test_published_report_shows_every_gate(folder):
    page = REPOSITORY / "reports" / folder.name / "README.md"
    if not page.exists():
        pytest.fail(f"no report of {folder.name}: make run MODEL={folder.name}")
    text = page.read_text(encoding="utf-8")
    for gate in load_case(folder.name).file.gates:
        assert f"| {gate.figure} |" in text
    assert "**NO**" not in text
