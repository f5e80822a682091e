"""The contents of ``case.toml``: a model's start, its drive, what is expected of it, its experiments and gates.

A case file is data. An error names the file, the key, the value and what was expected.
"""

import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, model_validator

from oarlock.base.core import TimeLaw
from oarlock.base.errors import InputError, choose, one_line
from oarlock.base.files import read_bytes
from oarlock.base.options import Number
from oarlock.cases.drive import UNUSABLE, Drive, is_usable
from oarlock.cases.integrators import IntegratorName
from oarlock.cases.judging import DEFAULT_ENDINGS, Ending, Gate
from oarlock.cases.published import Paper, Published, Truth
from oarlock.cases.table import STRICT, Finite, NonNegative, Positive

FILE_BYTES = 2**22
"""Of a case file."""

KEY_PARTS = 64
"""Of a dotted key: the time to read one grows with the square of its parts."""

_DEEP_KEY = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{KEY_PARTS},}}""")

LISTED = 1000
"""Experiments, variants or gates of a case."""

Form = Literal["matched", "hard"]
ModeName = Literal["calibration", "lockstep", "one-step", "free"]
Stabilisation = Literal["baumgarte", "projection", "both"]

Count = Annotated[int, Field(ge=0, strict=True)]
Parameters = dict[str, Finite | Annotated[int, Field(strict=True)]]
Element = TypeVar("Element")
Some = Annotated[list[Element], Field(min_length=1, max_length=LISTED)]
Reactions = Literal["unique", "partly unique", "not unique"]


class _Table(BaseModel):
    model_config = STRICT


class RunDefaults(_Table):
    """Duration, timestep (None for the model's own) and integrator of a case's runs, unless they are asked otherwise.

    Attributes:
        duration_s: duration, s.
        timestep_s: timestep, s; None for the model's own.
        integrator: name of the integrator.
        stabilisation: how exact constraints are kept from drifting: ``baumgarte`` (terms in the accelerations),
            ``projection`` (no such terms; positions and velocities are projected after every step) or ``both``. None:
            projection where a solver walks; along other walks, where nothing can be projected, Baumgarte's terms.
        ignore_inequalities: whether to switch off the model's contacts, limits and friction, for MuJoCo as well.
    """

    duration_s: Positive = 10.0
    timestep_s: Positive | None = None  # None: the model's own
    integrator: IntegratorName = "rk4"
    stabilisation: Stabilisation | None = None
    ignore_inequalities: Annotated[bool, Field(strict=True)] = False


class Start(_Table):
    """The start of a case. What it does not name is as in the model.

    Attributes:
        keyframe: name of the keyframe to begin from, with its velocities, activations and poses of mocap bodies;
            ``#2`` for one without a name, ``none`` for the model's own pose; left out: the one called ``start``, if
            there is one. Its controls are not taken: ``[drive]`` says what they are.
        qpos: name of a joint → its position, rad or m; a list for ball and free joints.
        qvel: name of a joint → its velocity, rad/s or m/s; a list for ball and free joints.
    """

    keyframe: str | None = None
    qpos: dict[str, Finite | list[Finite]] = {}
    qvel: dict[str, Finite | list[Finite]] = {}


class Expect(_Table):
    """What the model must turn out to be at its start. The values are compared with the model before it runs.

    A number may be an expression of the parameters, such as ``6*N``.

    Attributes:
        nv: number of velocities.
        rows: number of constraint rows.
        rank: rank of the constraint Jacobian.
        dof: degrees of freedom, nv − rank.
        reactions: whether the rigid model determines the multipliers of all equalities, of some, or of none.
    """

    nv: Count | str | None = None
    rows: Count | str | None = None
    rank: Count | str | None = None
    dof: Count | str | None = None
    reactions: Reactions | None = None

    def values(self, parameters: dict[str, Number]) -> dict[str, int | str]:
        """Evaluates what is expected, for given parameters.

        Raises:
            InputError: an expression does not parse, names something unknown, or is not a whole number ≥ 0.
        """
        found: dict[str, int | str] = {}
        for name, value in self.model_dump(exclude_none=True).items():
            if name != "reactions" and isinstance(value, str):
                value = _count(f"expect.{name}", value, parameters)
            found[name] = value
        return found


def _count(key: str, expression: str, parameters: dict[str, Number]) -> int:
    law = TimeLaw(expression, parameters)
    value = law.at(0.0)
    if not law.is_constant or not value.is_integer() or value < 0:
        raise InputError(f"{key} = '{expression}' is {value:g}, expected a whole number ≥ 0 of the parameters")
    return int(value)


class Baumgarte(_Table):
    """Baumgarte's terms of the hard form, J a = −J̇v − 2β Jv − k r; not used where only projection stabilises.

    Attributes:
        beta: β, 1/s.
        k: k, 1/s².
    """

    beta: NonNegative = 0.0
    k: NonNegative = 0.0


class Settings(_Table):
    """A named way of running MuJoCo itself. What is None stays as in the model.

    Attributes:
        solver: of its constraints.
        solref: of every equality.
        solimp: of every equality.
    """

    solver: Literal["newton", "cg", "pgs"] | None = None
    solref: tuple[Finite, Finite] | None = None
    solimp: tuple[Finite, Finite, Finite, Finite, Finite] | None = None


class Experiment(_Table):
    """A group of runs: every combination of the integrators, settings, forms and solvers that it names.

    Attributes:
        mode: what is compared.
        walker: what advances the state in lockstep: ``mujoco``, or a solver, which does so in the hard form.
        forms: of the question: ``matched``, MuJoCo's own softness, and ``hard``, exact constraints.
        solvers: solvers that answer, as of ``--solver``; in free runs also ``mujoco``.
        integrators: integrators; None for the case's own.
        stabilisation: how exact constraints are kept from drifting; None for the case's own.
        settings: named ways of running MuJoCo.
    """

    mode: ModeName
    walker: str = "mujoco"
    forms: Some[Form] = ["hard"]
    solvers: Some[str] = ["pinv"]
    integrators: Some[IntegratorName] | None = None  # None: the case's
    stabilisation: Stabilisation | None = None  # None: the case's
    settings: Some[str] = ["default"]


DEFAULT_EXPERIMENTS = [
    Experiment(mode="calibration"),
    Experiment(mode="lockstep", forms=["matched", "hard"], solvers=["pinv", "auto", "sr1-tracked"]),
    Experiment(mode="free", forms=["matched", "hard"], solvers=["mujoco", "pinv"]),
]
"""Experiments of a case that names none."""


class Sweep(_Table):
    """Free runs at several timesteps besides the case's own, for work against precision in the suite's summary.

    Attributes:
        timesteps_s: timesteps, s.
        integrators: integrators, each with every timestep.
        solvers: solvers on exact constraints.
        settings: named ways of running MuJoCo beside them.
    """

    timesteps_s: Annotated[list[Positive], Field(min_length=2)]
    integrators: Some[IntegratorName] = ["euler", "rk4"]
    solvers: Some[str] = ["cholesky", "sr1-tracked"]
    settings: Some[str] = ["default", "stiff"]  # of MuJoCo


class Variant(_Table):
    """A set of parameters that the suite runs besides the defaults.

    Attributes:
        parameters: values of the parameters that differ from the defaults.
        run: replaces the case's, key by key.
        expect: replaces the case's, key by key.
        published: published values of this variant; those of the case hold for the defaults only.
        experiments: replace the case's, unless None.
        gates: replace the case's, unless None.
    """

    parameters: Annotated[Parameters, Field(min_length=1)]
    run: RunDefaults = RunDefaults()
    expect: Expect = Expect()
    published: list[Published] = []
    experiments: Annotated[list[Experiment], Field(min_length=1)] | None = None
    gates: list[Gate] | None = None


class Beyond(_Table):
    """What is run of parameters that the case does not list, in a range of them; the last range that fits counts.

    Bounds are set for what is listed alone.

    Attributes:
        where: expression of the parameters; they lie in the range where it is positive.
        run: replaces the case's, key by key.
        experiments: replace the case's.
    """

    where: str
    run: RunDefaults = RunDefaults()
    experiments: Annotated[list[Experiment], Field(min_length=1)]

    def has(self, parameters: dict[str, Number]) -> bool:
        """Tells whether complete parameters lie in the range.

        Raises:
            InputError: the expression does not parse, names something unknown, or depends on t.
        """
        law = TimeLaw(self.where, parameters)
        if not law.is_constant:
            raise InputError(f"beyond.where = '{self.where}' depends on t, expected an expression of the parameters")
        return law.at(0.0) > 0


class CaseFile(_Table):
    """The contents of ``case.toml``.

    Attributes:
        title: what it is, in a few words.
        summary: the same in a sentence.
        source: where the model comes from.
        tags: words to find it by.
        rank_cut: eigenvalues of A below this part of the largest count as zero; None for the default.
        parameters: name → default, of a parametrised model.
        settings: name → way of running MuJoCo.
        published: values that others published, for the default parameters.
        experiments: what is run; left out: calibration, lockstep and free runs with usual solvers.
        gates: bounds on figures of the summary.
        endings: how runs may end other than ``done``.
        sweep: timesteps for work against precision, with the default parameters.
        variants: further sets of parameters.
        beyond: what holds for parameters that are neither the defaults nor a variant's.
    """

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
    experiments: list[Experiment] = Field(default=DEFAULT_EXPERIMENTS, min_length=1, max_length=LISTED)
    gates: list[Gate] = []
    endings: list[Ending] = DEFAULT_ENDINGS
    sweep: Sweep | None = None  # of the default parameters
    variants: list[Variant] = Field(default=[], max_length=LISTED)
    beyond: list[Beyond] = Field(default=[], max_length=LISTED)

    @model_validator(mode="after")
    def _consistent(self) -> "CaseFile":
        for name in self.parameters:
            if not (re.fullmatch(r"[A-Za-z]\w*", name) and is_usable(name)):  # it is in names of folders, too
                raise InputError(f"parameters.{name}: {UNUSABLE}")
        for part in self.beyond:
            part.has(self.parameters)
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
        """Returns the default parameters, then the complete ones of every variant.

        Raises:
            InputError: a variant names an unknown parameter, or gives a fraction where an integer is expected.
        """
        return [self.parameters, *(self.complete(variant.parameters) for variant in self.variants)]

    def complete(self, given: dict[str, Number]) -> dict[str, Number]:
        """Completes given parameters by the defaults, in their order. Parameters with an integer default stay integers.

        Raises:
            InputError: a parameter is unknown or not finite, or a fraction where an integer is expected.
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
        """Returns the contents that hold for complete parameters, with what the variant that has them replaces.

        Parameters that are not listed take the replacements of the last range that they lie in.
        """
        if parameters == self.parameters:
            return self
        changes: dict[str, Any] = {"published": []}
        variants = [variant for variant in self.variants if self.complete(variant.parameters) == parameters]
        for variant in variants:
            changes["expect"] = self.expect.model_copy(update=variant.expect.model_dump(exclude_unset=True))
            changes["published"] = variant.published
        for part in variants or [part for part in self.beyond if part.has(parameters)]:
            changes["run"] = self.run.model_copy(update=part.run.model_dump(exclude_unset=True))
            changes.update({k: v for k in ("experiments", "gates") if (v := getattr(part, k, None)) is not None})
        return self.model_copy(update=changes)

    def setting(self, name: str) -> Settings:
        """Returns a named way of running MuJoCo; ``default`` is the model as it stands.

        Raises:
            InputError: there is none of that name.
        """
        known = {"default": Settings(), **self.settings}
        if name not in known:
            raise InputError(f"unknown settings '{name}', expected one of: {', '.join(known)}")
        return known[name]


def fill(template: str, parameters: dict[str, Number]) -> str:
    """Replaces ``{N}`` in a file name by the value of the parameter N.

    Raises:
        InputError: the braces name something that is not a parameter.
    """

    def value(match: re.Match[str]) -> str:
        return repr(parameters[choose(f"parameter in '{template}'", match[1], list(parameters))])

    return re.sub(r"\{(.*?)\}", value, template)


def read_case_file(path: Path) -> CaseFile:
    """Reads and validates a ``case.toml``.

    Raises:
        InputError: the file is not TOML, or a value in it is not as expected.
    """
    try:
        text = read_bytes(path, FILE_BYTES).decode()
        if _DEEP_KEY.search(text):
            raise InputError(f"{path}: not valid TOML: a key of more than {KEY_PARTS} parts, expected fewer")
        data: dict[str, Any] = tomllib.loads(text)
    except InputError:
        raise
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply, expected what cases have") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or one_line(error)}") from None
    except ValueError as error:  # among them integers of thousands of digits
        raise InputError(f"{path}: not valid TOML: {one_line(error)}") from None
    try:
        return CaseFile.model_validate(data)
    except RecursionError:
        raise InputError(f"{path}: nested too deeply, expected what cases have") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        reason = one_line(first["msg"]).removeprefix("Value error, ")
        if not first["loc"]:  # the reason itself names the key
            raise InputError(f"{path}: {reason}") from None
        key = ".".join(str(part) for part in first["loc"])
        got = one_line(repr(first["input"]))
        got = got if len(got) <= 80 else got[:77] + "..."
        raise InputError(f"{path}: {key} = {got}: {reason}") from None
