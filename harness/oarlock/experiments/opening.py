"""Opens what is to be run: a case as it is, or a model alone with what its model says of its runs."""

from pathlib import Path

from oarlock.cases.case import Case, load_case
from oarlock.mechanics.load import load_model
from oarlock.stepping.beginning import own_integrator


def open_case(model: str | Path) -> Case:
    """Loads a case as ``load_case`` does; of a model alone its runs have the model's own integrator.

    Raises:
        InputError: as ``load_case``; or the model alone cannot be loaded.
    """
    case = load_case(model)
    if case.bare:
        integrator, case.substituted = own_integrator(load_model(case.model_path, case.parameters))
        run = case.file.run.model_copy(update={"integrator": integrator})
        case.file = case.file.model_copy(update={"run": run})
    return case
