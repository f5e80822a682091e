"""What the model of a case turned out to be, and what the case expects of it."""

from typing import Any

from oarlock.cases.case import MODELS, Case
from oarlock.cases.claims import load_claims
from oarlock.cases.judging import Gate
from oarlock.mechanics.given import as_given
from oarlock.mechanics.names import coordinates, equalities
from oarlock.mechanics.reactions import verdict
from oarlock.stepping.prepared import PreparedCase
from oarlock.tables.aggregate import Verdict


def describe(setup: PreparedCase) -> dict[str, Any]:
    """What the model turns out to be at its consistent start."""
    start = setup.start
    told = {} if setup.told is None else {"motion": setup.told}
    return {
        **told,
        "nq": int(setup.model.nq),
        "nv": int(setup.model.nv),
        "rows": start.rows,
        "rank": start.rank,
        "dof": start.dof,
        "closing_moved": start.moved,
        "unique_reactions": start.unique,
        "coordinates": coordinates(setup.model),
        "equalities": [equality.document() for equality in equalities(setup.model)],
    }


def case_document(case: Case, model: dict[str, Any]) -> dict[str, Any]:
    """The contents of ``case.json``: the case with the description of its model and the claims of its paper.

    ``model_file`` is where its model was; None of one that comes with oarlock, which its name
    finds, and of one that a program held.

    Raises:
        InputError: the file of the claims is missing or malformed.
    """
    contents = {**case.file.model_dump(), "expect": case.expected(), "parameters": case.parameters}
    if contents["paper"]:
        contents["paper"]["claims"] = [claim.model_dump() for claim in load_claims(case)]
    path = case.model_path.resolve()
    gone = path.is_relative_to(MODELS.resolve()) or as_given(str(path)) != str(path)
    place = None if gone else str(path)
    return {"name": case.name, "model_file": place, "model": model, **contents}


def expectations(case: Case, model: dict[str, Any]) -> list[Verdict]:
    """What the case expects of its model, held against the model's description."""
    found = {**model, "reactions": verdict(model["unique_reactions"])}
    verdicts = []
    for name, expected in case.expected().items():
        bounds = {"equal": expected} if isinstance(expected, str) else {"min": expected, "max": expected}
        gate = Gate.model_validate({"figure": name, **bounds, "cause": "[expect] of the case"})
        verdicts.append(Verdict(gate, "start", found[name], gate.holds(found[name])))
    return verdicts
