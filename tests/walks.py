"""Walks of both paths, and that they are the same."""

import polars as pl
from oarlock.cases.case import Case
from oarlock.cases.conditions import Conditions
from oarlock.cases.motion import RULE, Motion
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.options import Stepping
from oarlock.experiments.task import Task

TIMES = ("step_us", "solve_ns")
"""What no two runs agree in."""


def walked(
    case: Case, task: Task, steps: int, stepping: Stepping, motion: Motion = RULE
) -> list[tuple[str, str, pl.DataFrame]]:
    timestep_s = case.file.run.timestep_s or 2e-3
    laboratory = Laboratory(case, Conditions(timestep_s, steps * timestep_s, motion=motion), stepping=stepping)
    return [(result.status, result.message, result.steps.frame().drop(TIMES)) for result in laboratory.run(task)]


def require_equal(case: Case, task: Task, steps: int, motion: Motion = RULE) -> list[tuple[str, str, pl.DataFrame]]:
    native, python = (walked(case, task, steps, stepping, motion) for stepping in ("native", "python"))
    assert len(native) == len(python)
    for (status, message, ours), (expected_status, expected_message, expected) in zip(native, python, strict=True):
        assert (status, message) == (expected_status, expected_message)
        differing = [name for name in ours.columns if not ours[name].equals(expected[name])]
        assert not differing, f"{task.mode}: {differing}"
    return native
