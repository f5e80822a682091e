"""What must hold of every case, whoever wrote it."""

from pathlib import Path

import mujoco
import numpy as np
from mechanisms import only, setup_of
from oarlock import load_case, run
from oarlock.cases.case import Case
from oarlock.mechanics.load import load_model
from oarlock.mechanics.reactions import verdict
from tolerances import CLOSED, LOCKSTEP_PARITY

STEPS = 50
"""Steps in which a case is held against MuJoCo."""


def require_whole(folder: Path) -> None:
    case = load_case(folder.name)
    assert case.model_path.name in ("model.xml", "model.py")
    for path in (case.model_path, folder / "case.toml", folder / "README.md"):
        assert path.stat().st_size > 0
    assert case.folder == folder
    assert case.file.title
    assert case.file.summary
    assert case.file.source
    assert case.file.gates


def require_start(case: Case) -> None:
    setup = setup_of(case, case.file.run.integrator)
    start = setup.start
    assert start.rows >= 1
    found: dict[str, int | str] = {"nv": setup.model.nv, "rows": start.rows, "rank": start.rank, "dof": start.dof}
    expected = case.expected()
    if case.listed:
        found["reactions"] = verdict(start.unique)
    assert found == expected
    data = setup.data()
    mujoco.mj_forward(setup.model, data)
    assert data.ne == start.rows
    assert np.abs(data.efc_pos[: data.ne]).max() <= 100 * CLOSED  # long mechanisms cannot do better
    names = [setup.model.equality(index).name for index in range(setup.model.neq)]
    assert all(names)
    assert len(set(names)) == len(names)


def require_matched(case: Case) -> None:
    timestep = case.file.run.timestep_s or load_model(case.model_path, case.parameters).opt.timestep
    results = run(case.name, mode="lockstep", form="matched", solver="pinv", duration=STEPS * timestep)
    row = only(results.rows, mode="lockstep")
    assert (row["status"], row["steps_done"]) == ("done", STEPS)
    assert row["qacc_rel_diff_max"] <= LOCKSTEP_PARITY
    assert row["qfrc_constraint_rel_diff_max"] <= LOCKSTEP_PARITY
