"""Every folder of mjcf/: whole, loadable, as its case expects, and matched with MuJoCo. A new model needs no code."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import only, setup_of
from oarlock import load_case, model_names, run
from oarlock.cases import MODELS
from oarlock.truth import load_truth
from tolerances import CLOSED, LOCKSTEP_PARITY

FOLDERS = sorted(path for path in MODELS.iterdir() if path.is_dir() and path.name != "__pycache__")
STEPS = 50


@pytest.fixture(params=FOLDERS, ids=lambda path: path.name)
def folder(request) -> Path:
    return request.param


def test_there_are_models():
    assert len(FOLDERS) >= 1
    assert [path.name for path in FOLDERS] == model_names()
    repository = Path(__file__).parent.parent / "mjcf"
    assert repository.resolve() == MODELS.resolve()


def test_folder_is_whole(folder):
    for name in ("model.xml", "case.toml", "README.md"):
        assert (folder / name).stat().st_size > 0
    case = load_case(folder.name)
    assert case.folder == folder
    assert case.file.title
    assert case.file.summary
    assert case.file.source
    assert case.file.gates


def test_model_loads_without_a_warning(folder, tmp_path, monkeypatch):
    """MuJoCo writes its warnings to MUJOCO_LOG.TXT in the working folder."""
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_path(str((folder / "model.xml").resolve()))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert [w.number for w in data.warning] == [0] * len(data.warning)
    assert list(tmp_path.iterdir()) == []


def test_start_is_as_the_case_expects(folder):
    case = load_case(folder.name)
    setup = setup_of(case, case.file.run.integrator)
    start, expect = setup.start, case.file.expect
    assert start.rows >= 1
    found = {"nv": setup.model.nv, "rows": start.rows, "rank": start.rank, "dof": start.dof}
    assert found == expect.model_dump()
    data = setup.data()
    mujoco.mj_forward(setup.model, data)
    assert data.nefc == data.ne == start.rows
    assert np.abs(data.efc_pos).max() <= 100 * CLOSED  # long mechanisms cannot do better
    names = [setup.model.equality(index).name for index in range(setup.model.neq)]
    assert all(names)
    assert len(set(names)) == len(names)


def test_matched_with_mujoco(folder):
    case = load_case(folder.name)
    timestep = case.file.run.timestep_s or mujoco.MjModel.from_xml_path(str(case.model_path)).opt.timestep
    results = run(folder.name, mode="lockstep", form="matched", solver="pinv", duration_s=STEPS * timestep)
    row = only(results.rows, mode="lockstep")
    assert (row["status"], row["steps_done"]) == ("done", STEPS)
    assert row["qacc_rel_diff_max"] <= LOCKSTEP_PARITY
    assert row["qfrc_constraint_rel_diff_max"] <= LOCKSTEP_PARITY


def test_declared_truth_is_there(folder):
    case = load_case(folder.name)
    truth = load_truth(case)
    if case.file.truth is None:
        assert truth is None
        return
    assert truth is not None
    assert truth.end >= case.file.run.duration_s
    assert case.file.truth.joint in (folder / "model.xml").read_text(encoding="utf-8")


def test_published_report_shows_every_gate(folder):
    page = Path(__file__).parent.parent / "reports" / folder.name / "README.md"
    if not page.exists():
        pytest.fail(f"no report of {folder.name}: make run MODEL={folder.name}")
    text = page.read_text(encoding="utf-8")
    for gate in load_case(folder.name).file.gates:
        assert f"| {gate.figure} |" in text
    assert "**NO**" not in text
