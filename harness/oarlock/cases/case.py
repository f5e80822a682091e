"""A case: one folder of ``mjcf/`` with a model and its ``case.toml``, found by name or path.

A parametrised model is one case with variants, addressed as ``NAME:key=value,…``.
"""

import os
import re
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.options import Number, join_options, split_options
from oarlock.cases.case_file import CaseFile, fill, read_case_file

MODELS = Path(__file__).parents[1] / "models"
"""The models that come with oarlock (``mjcf/`` of the repository, carried in the wheel)."""


class Case:
    """A case file with the name of its model, its folder, and the parameters of a variant.

    Attributes:
        model: name of the model.
        model_path: ``model.xml`` or ``model.py``.
        parameters: complete, in the order of the case file.
        file: the contents that hold for these parameters.
        listed: whether bounds were set for these parameters: the defaults or those of a variant.
    """

    def __init__(self, model: str, model_path: Path, file: CaseFile, given: dict[str, Number] | None = None):
        self.model = model
        self.model_path = model_path
        self.parameters = file.complete(given or {})
        self.listed = self.parameters in file.listed_parameters()
        self.file = file.of(self.parameters)

    @property
    def name(self) -> str:
        """``MODEL``, or ``MODEL:key=value,…`` with the parameters that are not the defaults."""
        defaults = self.file.parameters
        return join_options(self.model, {k: v for k, v in self.parameters.items() if v != defaults[k]})

    @property
    def slug(self) -> str:
        """The name as a name for files and folders."""
        return re.sub(r"[:,]", "-", self.name)

    @property
    def folder(self) -> Path:
        """Where the model and its companions lie."""
        return self.model_path.parent

    @property
    def truth_path(self) -> Path | None:
        """The table of the outside truth; None if there is none for these parameters."""
        if self.file.truth is None:
            return None
        path = self.folder / fill(self.file.truth.file, self.parameters)
        return path if self.listed or path.is_file() else None

    def at(self, parameters: dict[str, Number]) -> "Case":
        """The case with some parameters changed and its run as it is; no published value is known to hold for it.

        Raises:
            InputError: an unknown parameter, or a fraction where an integer is expected.
        """
        other = Case(self.model, self.model_path, self.file, {**self.parameters, **parameters})
        other.file = other.file.model_copy(update={"run": self.file.run, "published": []})
        return other

    def expected(self) -> dict[str, int | str]:
        """What the model must turn out to be at its start. Raises InputError as ``Expect.values``."""
        return self.file.expect.values(self.parameters)


def model_names() -> list[str]:
    """Names of the models that come with oarlock, sorted."""
    return sorted(path.parent.name for path in MODELS.glob("*/case.toml"))


def variant_names(model: str | Path) -> list[str]:
    """What the suite runs of a model: its name, then ``MODEL:key=value,…`` for every variant. For ``load_case``.

    Raises:
        InputError: as ``load_case``.
    """
    variants = load_case(model).file.variants
    return [str(model), *(join_options(str(model), variant.parameters) for variant in variants)]


def load_case(model: str | Path) -> Case:
    """Loads a case by the name of its model, the path of its folder, or the path of any MJCF file.

    A parametrised model takes ``:key=value,…`` after it. An MJCF file next to a ``case.toml`` takes it; one without
    runs with defaults.

    Raises:
        InputError: no such model, a mistake in its ``case.toml``, or a parameter that it does not have.
    """
    text, given = (str(model), {}) if os.path.exists(model) else split_options(str(model), "parameter")
    path = Path(text)
    if path.suffix in (".xml", ".py"):
        if not path.is_file():
            raise InputError(f"no model file '{path}'")
        case_path = path.parent / "case.toml"
        if path.stem == "model" and case_path.is_file():
            return Case(path.resolve().parent.name, path, read_case_file(case_path), given)
        return Case(path.stem, path, CaseFile(title=path.stem), given)
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
