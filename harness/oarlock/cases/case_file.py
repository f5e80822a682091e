"""``case.toml``: a model's start, its drive, what is expected of it, its experiments and gates.

It is data. Every mistake in it is named with file, key, value and what was expected.
"""

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose, one_line
from oarlock.base.options import Number

Integrator = Literal["euler", "implicit", "implicitfast", "rk4"]
Form = Literal["matched", "hard"]
Mode = Literal["calibration", "lockstep", "one-step", "free"]
Stabilisation = Literal["baumgarte", "projection", "both"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, strict=True)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, strict=True)]
Count = Annotated[int, Field(ge=0, strict=True)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Parameters = dict[str, Finite | Annotated[int, Field(strict=True)]]
Reactions = Literal["unique", "partly unique", "not unique"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)


class RunDefaults(_Table):
    """How long, how fine, with which integrator, and how exact constraints are kept from drifting.

    ``stabilisation``: ``baumgarte`` (terms in the accelerations), ``projection`` (no such terms; positions and
    velocities are projected after every step) or ``both``. ``ignore_inequalities``: without the model's contacts,
    limits and friction, MuJoCo too; where one becomes active otherwise, a run is refused.
    """

    duration_s: Positive = 10.0
    timestep_s: Positive | None = None  # None: the model's own
    integrator: Integrator = "rk4"
    stabilisation: Stabilisation = "baumgarte"
    ignore_inequalities: Annotated[bool, Field(strict=True)] = False


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
    """What the model must turn out to be at its start: checked, not believed.

    A number may be an expression of the parameters, such as ``6*N``. ``reactions``: whose multipliers the rigid model
    determines, all equalities', some or none.
    """

    nv: Count | str | None = None
    rows: Count | str | None = None
    rank: Count | str | None = None
    dof: Count | str | None = None
    reactions: Reactions | None = None

    def values(self, parameters: dict[str, Number]) -> dict[str, int | str]:
        """What is expected, with the expressions evaluated.

        Raises:
            InputError: an expression does not parse, names something unknown, or is not a whole number ≥ 0.
        """
        found: dict[str, int | str] = {}
        for name, value in self.model_dump(exclude_none=True).items():
            if name != "reactions" and isinstance(value, str):
                value = _count(f"expect.{name}", value, parameters)
            found[name] = value
        return found


def _usable(name: str) -> bool:
    """Whether an expression can use a parameter of this name: t, PI, E and the functions are taken."""
    try:
        return re.fullmatch(r"[A-Za-z]\w*", name) is not None and TimeLaw(name, {name: 1.5}).at(0.0) == 1.5
    except InputError:
        return False


def _count(key: str, expression: str, parameters: dict[str, Number]) -> int:
    law = TimeLaw(expression, parameters)
    value = law.at(0.0)
    if not law.is_constant or not value.is_integer() or value < 0:
        raise InputError(f"{key} = '{expression}' is {value:g}, expected a whole number ≥ 0 of the parameters")
    return int(value)


class Baumgarte(_Table):
    """The hard form asks for J a = −J̇v − 2β Jv − k r, unless only projection stabilises it. β in 1/s, k in 1/s²."""

    beta: NonNegative = 0.0
    k: NonNegative = 0.0


class Settings(_Table):
    """A way of running MuJoCo itself; what is left out stays as in the model. Applied to every equality."""

    solver: Literal["newton", "cg", "pgs"] | None = None
    solref: tuple[Finite, Finite] | None = None
    solimp: tuple[Finite, Finite, Finite, Finite, Finite] | None = None


class _Observed(_Table):
    """Of what something is known: one joint's coordinate or one site's place."""

    joint: str | None = None
    site: str | None = None

    @model_validator(mode="after")
    def _one(self) -> "_Observed":
        named = [kind for kind, name in self if kind in ("joint", "site", "equality") and name is not None]
        if len(named) != 1:
            choice = "joint, site or equality" if hasattr(self, "equality") else "joint or site"
            raise ValueError(f"names {' and '.join(named) or 'nothing'}, expected exactly one of {choice}")
        return self


class Truth(_Observed):
    """Outside truth: a CSV.

    Columns time, position, velocity, acceleration of a joint, or time, x, y, z, vx, vy, vz, ax, ay, az of a site.
    ``{N}`` in the file's name stands for the parameter N; a file without it holds for all.
    """

    file: str
    source: str


class Published(_Observed):
    """A value printed by others, at one time.

    Of a joint (rad or m, per s), of a site (m, world frame), or the multipliers of one equality, row by row, in
    MuJoCo's sign.
    """

    time_s: NonNegative
    equality: str | None = None
    position: Finite | list[Finite] | None = None
    velocity: Finite | None = None
    multipliers: Annotated[list[Finite], Field(min_length=1)] | None = None
    source: str

    @model_validator(mode="after")
    def _fitting(self) -> "Published":
        given = {name for name in ("position", "velocity", "multipliers") if getattr(self, name) is not None}
        if self.joint is not None:
            what, fits = "position and/or velocity, a number each", not isinstance(self.position, list)
            fits = fits and bool(given) and given <= {"position", "velocity"}
        elif self.site is not None:
            what, fits = "position = [x, y, z] and nothing else", given == {"position"}
            fits = fits and isinstance(self.position, list) and len(self.position) == 3
        else:
            what, fits = "multipliers = [a number a row] and nothing else", given == {"multipliers"}
        if not fits:
            kind = "joint" if self.joint is not None else "site" if self.site is not None else "equality"
            raise ValueError(f"gives {', '.join(sorted(given)) or 'nothing'}, expected of a {kind} {what}")
        return self


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
    """A bound on a figure of the summary, on every run that ``where`` picks. ``cause`` says why this bound.

    ``equal`` is for figures that are words.
    """

    figure: str
    where: dict[str, str] = {}
    min: Finite | None = None
    max: Finite | None = None
    equal: str | None = None
    cause: str

    @model_validator(mode="after")
    def _bounded(self) -> "Gate":
        numeric = self.min is not None or self.max is not None
        if not numeric and self.equal is None:
            raise ValueError("expected min or max, or equal: a gate without a bound cannot fail")
        if numeric and self.equal is not None:
            raise ValueError("expected min or max, or equal, not both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min = {self.min:g} above max = {self.max:g}: a gate that cannot hold")
        return self

    def holds(self, value: float | str | None) -> bool:
        """Whether a figure is within the bounds; one that was not measured is not."""
        if value is None or isinstance(value, str):
            return value is not None and value == self.equal
        return (
            self.equal is None and (self.min is None or value >= self.min) and (self.max is None or value <= self.max)
        )

    @property
    def limit(self) -> str:
        """The bounds in words."""
        bounds = [
            f"≥ {self.min:g}" if self.min is not None else "",
            f"≤ {self.max:g}" if self.max is not None else "",
            self.equal or "",
        ]
        return " and ".join(bound for bound in bounds if bound)


DEFAULT_EXPERIMENTS = [
    Experiment(mode="calibration"),
    Experiment(mode="lockstep", forms=["matched", "hard"], solvers=["pinv", "auto", "sr1"]),
    Experiment(mode="free", forms=["matched", "hard"], solvers=["mujoco", "pinv"]),
]
"""What a case that names no experiments runs."""


class Sweep(_Table):
    """Free runs at several timesteps, besides the case's own: work against precision, in the suite's summary."""

    timesteps_s: Annotated[list[Positive], Field(min_length=2)]
    integrators: list[Integrator] = ["euler", "rk4"]
    solvers: list[str] = ["cholesky", "sr1-tracked"]
    settings: list[str] = ["default", "stiff"]  # of MuJoCo


class Variant(_Table):
    """Parameters that the suite runs besides the defaults.

    ``run`` and ``expect`` (key by key), ``experiments`` and ``gates`` take the place of the case's; published values
    hold for one set of parameters only, so that a variant has its own or none.
    """

    parameters: Annotated[Parameters, Field(min_length=1)]
    run: RunDefaults = RunDefaults()
    expect: Expect = Expect()
    published: list[Published] = []
    experiments: Annotated[list[Experiment], Field(min_length=1)] | None = None
    gates: list[Gate] | None = None


class CaseFile(_Table):
    """The contents of ``case.toml``."""

    title: str
    summary: str = ""
    source: str = ""
    tags: list[str] = []
    rank_cut: Annotated[float, Field(gt=0, lt=1, strict=True)] | None = None
    parameters: Parameters = {}
    run: RunDefaults = RunDefaults()
    start: Start = Start()
    drive: Drive = Drive()
    expect: Expect = Expect()
    baumgarte: Baumgarte = Baumgarte()
    settings: dict[str, Settings] = {}
    truth: Truth | None = None
    published: list[Published] = []
    paper: Paper | None = None
    experiments: list[Experiment] = Field(default=DEFAULT_EXPERIMENTS, min_length=1)
    gates: list[Gate] = []
    sweep: Sweep | None = None  # of the default parameters
    variants: list[Variant] = []

    @model_validator(mode="after")
    def _consistent(self) -> "CaseFile":
        for name in self.parameters:
            if not _usable(name):
                raise InputError(f"parameters.{name}: not a name that an expression can use, expected another")
        listed = self.listed_parameters()
        for index, parameters in enumerate(listed):
            if parameters in listed[:index]:
                raise InputError(f"variants.{index - 1}.parameters are those of an earlier variant or the defaults")
            file = self.of(parameters)
            file.expect.values(parameters)
            if self.truth:
                fill(self.truth.file, parameters)
            late = [sample.time_s for sample in file.published if sample.time_s > file.run.duration_s]
            if late:
                raise InputError(
                    f"published value at time_s = {late[0]:g}, expected one within run.duration_s = "
                    f"{file.run.duration_s:g}"
                )
        return self

    def listed_parameters(self) -> list[dict[str, Number]]:
        """The defaults, then those of every variant.

        Raises:
            InputError: a variant names an unknown parameter, or gives a fraction where an integer is expected.
        """
        return [self.parameters, *(self.complete(variant.parameters) for variant in self.variants)]

    def complete(self, given: dict[str, Number]) -> dict[str, Number]:
        """The parameters with those that are given, in the order of the defaults; an integer stays one.

        Raises:
            InputError: an unknown parameter, or a fraction where an integer is expected.
        """
        complete = dict(self.parameters)
        for name, value in given.items():
            default = self.parameters[choose("parameter", name, list(self.parameters))]
            if isinstance(default, int) and not isinstance(value, int):
                raise InputError(f"parameter {name} = {value!r}, expected an integer")
            if value - value != 0:  # NaN and infinities alike
                raise InputError(f"parameter {name} = {value!r}, expected a finite number")
            complete[name] = value if isinstance(default, int) else float(value)
        return complete

    def of(self, parameters: dict[str, Number]) -> "CaseFile":
        """The contents that hold for the parameters: what the variant that has them says takes the case's place."""
        if parameters == self.parameters:
            return self
        changes: dict[str, Any] = {"published": []}
        for variant in self.variants:
            if self.complete(variant.parameters) == parameters:
                changes["run"] = self.run.model_copy(update=variant.run.model_dump(exclude_unset=True))
                changes["expect"] = self.expect.model_copy(update=variant.expect.model_dump(exclude_unset=True))
                changes["published"] = variant.published
                changes.update({k: v for k in ("experiments", "gates") if (v := getattr(variant, k)) is not None})
        return self.model_copy(update=changes)

    def setting(self, name: str) -> Settings:
        """The named way of running MuJoCo; ``default`` is the model as it stands.

        Raises:
            InputError: there is none of that name.
        """
        known = {"default": Settings(), **self.settings}
        if name not in known:
            raise InputError(f"unknown settings '{name}', expected one of: {', '.join(known)}")
        return known[name]


def fill(template: str, parameters: dict[str, Number]) -> str:
    """A file name with ``{N}`` replaced by the value of the parameter N.

    Raises:
        InputError: it names something that is no parameter.
    """

    def value(match: re.Match[str]) -> str:
        return repr(parameters[choose(f"parameter in '{template}'", match[1], list(parameters))])

    return re.sub(r"\{(.*?)\}", value, template)


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
        reason = one_line(first["msg"]).removeprefix("Value error, ")
        if not first["loc"]:  # the reason itself names the key
            raise InputError(f"{path}: {reason}") from None
        key = ".".join(str(part) for part in first["loc"])
        got = one_line(repr(first["input"]))
        got = got if len(got) <= 80 else got[:77] + "..."
        raise InputError(f"{path}: {key} = {got}: {reason}") from None
