"""What models there are, and what their constraints are at the start."""

from typing import Any

from oarlock.cases.case import load_case, model_names
from oarlock.mechanics.inequalities import ignore_inequalities
from oarlock.mechanics.prepare import load_mechanism
from oarlock.stepping.start import consistent_start


def catalogue() -> list[dict[str, Any]]:
    """A dictionary a model: name, title, nq, nv, rows, rank, redundancy, dof, reference, tags."""
    entries = []
    for name in model_names():
        case = load_case(name)
        model = load_mechanism(case, integrator=case.file.run.integrator)
        if case.file.run.ignore_inequalities:
            ignore_inequalities(model)
        start = consistent_start(model, case)
        entries.append(
            {
                "name": name,
                "title": case.file.title,
                "nq": int(model.nq),
                "nv": int(model.nv),
                "rows": start.rows,
                "rank": start.rank,
                "redundancy": start.rows - start.rank,
                "dof": start.dof,
                "reference": case.file.truth.source if case.file.truth else None,
                "tags": case.file.tags,
            }
        )
    return entries
