"""A case: a folder with a model and its ``case.toml``, found by the name of a model in ``mjcf/`` or by path.

A parametrised model is one case with variants, which are addressed as ``NAME:key=value,…``.
"""

import os
import re
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.options import Number, join_options, split_options
from oarlock.cases.case_file import CaseFile, fill, read_case_file

MODELS = Path(__file__).parents[1] / "models"
"""Folder of the models that come with oarlock: ``mjcf/`` of the repository, which the wheel contains too."""

NO_CODE = "OARLOCK_NO_CODE"
"""Name of the variable of the environment that keeps a ``model.py`` from being run. Processes inherit it."""


class Case:
    """A model and its case file, for one set of parameters.

    Attributes:
        model: name of the model.
        model_path: path of ``model.xml``, ``model.py`` or any other MJCF file.
        parameters: value of every parameter, in the order of the case file.
        file: contents of the case file that hold for these parameters.
        listed: whether the case file states bounds for these parameters, because they are the defaults or a variant's.
        bare: whether there is no case file: a model alone, whose start, controls and integrator a rule decides.
        substituted: of a model alone, why its runs have not its own integrator; empty if they have.
    """

    def __init__(
        self,
        model: str,
        model_path: Path,
        file: CaseFile,
        given: dict[str, Number] | None = None,
        *,
        bare: bool = False,
    ):
        self.model = model
        self.bare, self.substituted = bare, ""
        self.model_path = model_path
        self.parameters = file.complete(given or {})
        self.listed = self.parameters in file.listed_parameters()
        self.file = file.of(self.parameters)

    @property
    def name(self) -> str:
        """Name of the case: ``MODEL``, or ``MODEL:key=value,…`` with the parameters that differ from the defaults."""
        defaults = self.file.parameters
        return join_options(self.model, {k: v for k, v in self.parameters.items() if v != defaults[k]})

    @property
    def slug(self) -> str:
        """The name, with characters that suit files and folders."""
        return re.sub(r"[:,]", "-", self.name)

    @property
    def folder(self) -> Path:
        """Folder of the model, its case file and its truth."""
        return self.model_path.parent

    @property
    def truth_path(self) -> Path | None:
        """Path of the table of the outside truth; None if there is none for these parameters."""
        if self.file.truth is None:
            return None
        path = self.folder / fill(self.file.truth.file, self.parameters)
        return path if self.listed or path.is_file() else None

    def at(self, parameters: dict[str, Number]) -> "Case":
        """Returns the case with some parameters changed, its run as it is, and without published values.

        Raises:
            InputError: a parameter is unknown, or a fraction where an integer is expected.
        """
        other = Case(self.model, self.model_path, self.file, {**self.parameters, **parameters}, bare=self.bare)
        other.substituted = self.substituted
        other.file = other.file.model_copy(update={"run": self.file.run, "published": []})
        return other

    def expected(self) -> dict[str, int | str]:
        """Returns what the model must turn out to be at its start (see ``Expect``).

        Numbers are expressions of the parameters; a word holds for those that the case file lists.

        Raises:
            InputError: an expression of the parameters does not parse, or is not a whole number ≥ 0.
        """
        found = self.file.expect.values(self.parameters)
        return found if self.listed else {name: value for name, value in found.items() if name != "reactions"}


def model_names() -> list[str]:
    """Returns the names of the models that come with oarlock, sorted."""
    return sorted(path.parent.name for path in MODELS.glob("*/case.toml"))


def variant_names(model: str | Path) -> list[str]:
    """Returns the names that the suite runs of a model: its own, then ``MODEL:key=value,…`` for every variant.

    Args:
        model: name of a model, or path of a folder or an MJCF file.

    Raises:
        InputError: there is no such model, or its ``case.toml`` has a mistake.
    """
    variants = load_case(model).file.variants
    return [str(model), *(join_options(str(model), variant.parameters) for variant in variants)]


def load_case(model: str | Path) -> Case:
    """Loads a case.

    Args:
        model: name of a model that comes with oarlock, path of a folder with a ``case.toml``, or path of an MJCF file;
            a parametrised model takes ``:key=value,…`` after it. A file ``model.xml`` or ``model.py`` uses the
            ``case.toml`` beside it; any other file runs with defaults.

    Raises:
        InputError: there is no such model, its ``case.toml`` has a mistake, it lacks one of the parameters, or it is
            code that is not to be run (``refuse_code``).
    """
    case = _found(model)
    refuse_code(case.model_path)
    return case


def refuse_code(path: Path) -> None:
    """Refuses a model that is code where code is not to be run, unless it comes with oarlock.

    Raises:
        InputError: ``path`` is such a model, and the environment sets ``OARLOCK_NO_CODE``.
    """
    asked = os.environ.get(NO_CODE, "") not in ("", "0")
    if asked and path.suffix == ".py" and not path.resolve().is_relative_to(MODELS.resolve()):
        raise InputError(f"'{path}' is code, which --no-code ({NO_CODE}) keeps from running, expected MJCF")


def _found(model: str | Path) -> Case:
    text, given = (str(model), {}) if os.path.exists(model) else split_options(str(model), "parameter")
    path = Path(text)
    if path.suffix in (".xml", ".py", ".mjb"):
        if not path.is_file():
            raise InputError(f"no model file '{path}'")
        case_path = path.parent / "case.toml"
        if path.stem == "model" and case_path.is_file():
            return Case(path.resolve().parent.name, path, read_case_file(case_path), given)
        return Case(path.stem, path, CaseFile(title=path.stem, endings=[]), given, bare=True)
    folder = MODELS / text if text in model_names() else path
    if folder.is_file():
        raise InputError(f"'{path}', expected a model's name, its folder, or an MJCF file whose name ends in .xml")
    if text and folder.is_dir() and not (folder / "case.toml").is_file():
        raise InputError(f"folder '{path}' holds no case.toml, expected a case, or the path of an MJCF file")
    if not (folder / "case.toml").is_file():
        raise InputError(
            f"unknown model '{model}', expected one of: {', '.join(model_names())}; or a path to an MJCF file"
        )
    model_path = folder / "model.xml"
    if (folder / "model.py").is_file():
        if model_path.is_file():
            raise InputError(f"'{folder}' holds model.xml and model.py, expected one of the two")
        model_path = folder / "model.py"
    return Case(folder.resolve().name, model_path, read_case_file(folder / "case.toml"), given)
