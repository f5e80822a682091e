"""A case: one folder of ``mjcf/`` with a model, its start, its drive, what is expected of it, and its gates.

``case.toml`` is data. Every mistake in it is named with file, key, value and what was expected.
"""

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from oarlock._core import TimeLaw
from oarlock.errors import InputError, one_line

MODELS = Path(__file__).parent / "models"
"""The models that come with oarlock (``mjcf/`` of the repository, carried in the wheel)."""

Integrator = Literal["euler", "implicit", "implicitfast", "rk4"]
Form = Literal["matched", "hard"]
Mode = Literal["calibration", "lockstep", "one-step", "free"]
Stabilisation = Literal["baumgarte", "projection", "both"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Count = Annotated[int, Field(ge=0, strict=True)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class RunDefaults(_Table):
    """How long, how fine, with which integrator, and how exact constraints are kept from drifting.

    ``stabilisation``: ``baumgarte`` (terms in the accelerations), ``projection`` (no such terms; positions and
    velocities are projected after every step) or ``both``.
    """

    duration_s: Positive = 10.0
    timestep_s: Positive | None = None  # None: the model's own
    integrator: Integrator = "rk4"
    stabilisation: Stabilisation = "baumgarte"


class Start(_Table):
    """Joint name → position (rad, m; a list for ball and free joints) and → velocity; the rest as in the model."""

    qpos: dict[str, Finite | list[Finite]] = {}
    qvel: dict[str, Finite | list[Finite]] = {}


class Drive(_Table):
    """Actuator name → law of time for its control, with named constants (numbers, or expressions of earlier ones)."""

    constants: dict[str, Finite | str] = {}
    ctrl: dict[str, str] = {}

    def values(self) -> dict[str, float]:
        """The constants as numbers.

        Raises:
            InputError: an expression does not parse or names something unknown.
        """
        known: dict[str, float] = {}
        for name, value in self.constants.items():
            if isinstance(value, str):
                law = TimeLaw(value, known)
                if not law.is_constant:
                    raise InputError(f"constant {name} = '{value}' depends on t, expected a constant")
                value = law.at(0.0)
            known[name] = value
        return known

    def laws(self) -> dict[str, TimeLaw]:
        """Actuator name → parsed law.

        Raises:
            InputError: a law does not parse or names something unknown.
        """
        constants = self.values()
        return {actuator: TimeLaw(source, constants) for actuator, source in self.ctrl.items()}

    @model_validator(mode="after")
    def _parse(self) -> "Drive":
        self.laws()  # an InputError is a ValueError, which pydantic reports with the key
        return self


class Expect(_Table):
    """What the model must turn out to be at its start: checked, not believed."""

    nv: Count | None = None
    rows: Count | None = None
    rank: Count | None = None
    dof: Count | None = None


class Baumgarte(_Table):
    """The hard form asks for J a = −J̇v − 2β Jv − k r, unless only projection stabilises it. β in 1/s, k in 1/s²."""

    beta: NonNegative = 0.0
    k: NonNegative = 0.0


class Settings(_Table):
    """A way of running MuJoCo itself; what is left out stays as in the model. Applied to every equality."""

    solver: Literal["newton", "cg", "pgs"] | None = None
    solref: tuple[Finite, Finite] | None = None
    solimp: tuple[Finite, Finite, Finite, Finite, Finite] | None = None


class Truth(_Table):
    """Outside truth: a CSV with columns time, position, velocity, acceleration of one joint."""

    file: str
    joint: str
    source: str


class Paper(_Table):
    """Figures printed by others, for the report."""

    source: str
    iterations_mean: Positive | None = None


class Experiment(_Table):
    """A group of runs: every integrator × setting × form × solver it names."""

    mode: Mode
    walker: str = "mujoco"
    forms: list[Form] = ["hard"]
    solvers: list[str] = ["pinv"]
    integrators: list[Integrator] | None = None  # None: the case's
    stabilisation: Stabilisation | None = None  # None: the case's
    settings: list[str] = ["default"]


class Gate(_Table):
    """A bound on a figure of the summary, on every run that ``where`` picks. ``cause`` says why this bound."""

    figure: str
    where: dict[str, str] = {}
    min: Finite | None = None
    max: Finite | None = None
    cause: str

    @model_validator(mode="after")
    def _bounded(self) -> "Gate":
        if self.min is None and self.max is None:
            raise ValueError("expected min or max: a gate without a bound cannot fail")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} above max = {self.max:g}: a gate that cannot hold")
        return self


DEFAULT_EXPERIMENTS = [
    Experiment(mode="calibration"),
    Experiment(mode="lockstep", forms=["matched", "hard"], solvers=["pinv", "sr1"]),
    Experiment(mode="free", forms=["matched", "hard"], solvers=["mujoco", "pinv"]),
]
"""What a case that names no experiments runs."""


class CaseFile(_Table):
    """The contents of ``case.toml``."""

    title: str
    summary: str = ""
    source: str = ""
    tags: list[str] = []
    rank_cut: Annotated[float, Field(gt=0, lt=1, strict=True)] | None = None
    run: RunDefaults = RunDefaults()
    start: Start = Start()
    drive: Drive = Drive()
    expect: Expect = Expect()
    baumgarte: Baumgarte = Baumgarte()
    settings: dict[str, Settings] = {}
    truth: Truth | None = None
    paper: Paper | None = None
    experiments: list[Experiment] = Field(default=DEFAULT_EXPERIMENTS, min_length=1)
    gates: list[Gate] = []

    def setting(self, name: str) -> Settings:
        """The named way of running MuJoCo; ``default`` is the model as it stands.

        Raises:
            InputError: there is none of that name.
        """
        known = {"default": Settings(), **self.settings}
        if name not in known:
            raise InputError(f"unknown settings '{name}', expected one of: {', '.join(known)}")
        return known[name]


class Case:
    """A case file with its name and its folder."""

    def __init__(self, name: str, model_path: Path, file: CaseFile):
        self.name = name
        self.model_path = model_path
        self.file = file

    @property
    def folder(self) -> Path:
        """Where the model and its companions lie."""
        return self.model_path.parent


def model_names() -> list[str]:
    """Names of the models that come with oarlock, sorted."""
    return sorted(path.parent.name for path in MODELS.glob("*/case.toml"))


def load_case(model: str | Path) -> Case:
    """Loads a case by the name of its model, the path of its folder, or the path of any MJCF file.

    An MJCF file next to a ``case.toml`` takes it; one without runs with defaults.

    Raises:
        InputError: no such model, or a mistake in its ``case.toml``.
    """
    path = Path(model)
    if path.suffix == ".xml":
        if not path.is_file():
            raise InputError(f"no model file '{path}'")
        case_path = path.parent / "case.toml"
        if path.name == "model.xml" and case_path.is_file():
            return Case(path.resolve().parent.name, path, read_case_file(case_path))
        return Case(path.stem, path, CaseFile(title=path.stem))
    folder = MODELS / model if str(model) in model_names() else path
    if not (folder / "case.toml").is_file():
        raise InputError(
            f"unknown model '{model}', expected one of: {', '.join(model_names())}; or a path to an MJCF file"
        )
    return Case(folder.resolve().name, folder / "model.xml", read_case_file(folder / "case.toml"))


def read_case_file(path: Path) -> CaseFile:
    """Reads and checks a ``case.toml``.

    Raises:
        InputError: not readable, not TOML, or a value that is not as expected.
    """
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid TOML: {one_line(error)}") from None
    try:
        return CaseFile.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        got = one_line(repr(first["input"]))
        got = got if len(got) <= 80 else got[:77] + "..."
        raise InputError(f"{path}: {key} = {got}: {one_line(first['msg'])}") from None
