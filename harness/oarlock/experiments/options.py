"""What a user may ask of a run."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from oarlock.base.arguments import require_count, require_number
from oarlock.base.errors import InputError, choose
from oarlock.cases.case_file import Form, Stabilisation
from oarlock.cases.conditions import Conditions
from oarlock.cases.integrators import RUNNING
from oarlock.cases.motion import Control, Motion
from oarlock.experiments.modes import ASKABLE
from oarlock.stepping.solvers import SolverSpec

FORMS: dict[str, list[Form]] = {"matched": ["matched"], "hard": ["hard"], "both": ["matched", "hard"]}
"""What may be asked for → the forms that it means."""

Stepping = Literal["auto", "native", "python"]
"""Which path steps; ``auto`` is the native one where it can be taken."""


@dataclass(frozen=True)
class RunOptions:
    """What is asked of a run. What is left out comes from the case of the model.

    Attributes:
        solver: solver specifications, such as ``"sr1:eps_abs=1e-7"``, one or several.
        form: ``matched`` (MuJoCo's own softness), ``hard`` (exact constraints) or ``both``.
        mode: ``lockstep``, ``one-step``, ``free`` or ``all``.
        walker: who walks in lockstep: ``mujoco`` or a solver, which then walks in the hard form.
        integrator: ``euler``, ``implicit``, ``implicitfast`` or ``rk4``.
        stabilisation: what keeps exact constraints from drifting: ``baumgarte``, ``projection`` or ``both``. Left out,
            and where the case says nothing: projection, wherever a solver walks.
        keyframe: of a file without a case, where it starts: name or number of a keyframe, ``none`` for the model's own
            pose; left out: the first keyframe, or the model's own pose where there is none.
        controls: ``keyframe``, ``constant``, ``random``, or a log ``FILE.csv`` or ``FILE.npz``, in place of the case's
            drive; left out, of a file without a case: the keyframe's where the run starts from one, else random.
        control: actuator → control, a number or a law of the time t in s; or a controller, called with model and data
            before every step of MuJoCo's own run to write ``data.ctrl``: everybody is given what it commands there.
        seed: of random controls.
        states: log of states ``FILE.csv`` or ``FILE.npz``, as of ``mechanics.state_log``, in place of MuJoCo's own
            run: what a program really did. It has the start and the controls. Solvers answer at its states, and walk
            from its first one, closed. Stepped in Python.
        timestep: timestep, s.
        duration: duration, s.
        rtol: relative tolerance of the solvers that have one.
        ignore_inequalities: run without the model's contacts, limits and friction, MuJoCo too; the provenance says
            what was left out.
        stepping: ``native`` (the compiled step loops), ``python`` (the same, readable and slow) or ``auto``: native if
            MuJoCo is of the version that they were built against.
        threads: native runs at once; as many as there are cores if left out. Times of solves are best taken with one.

    Raises:
        InputError: an unknown name, or a number out of range.
    """

    solver: Sequence[str] | str = ()
    form: str | None = None
    mode: str | None = None
    walker: str | None = None
    integrator: str | None = None
    stabilisation: str | None = None
    keyframe: str | None = None
    controls: str | None = None
    control: Control = field(default_factory=dict)
    seed: int = 0
    states: str | Path | None = None
    timestep: float | None = None
    duration: float | None = None
    rtol: float | None = None
    ignore_inequalities: bool = False
    stepping: str = "auto"
    threads: int | None = None

    def __post_init__(self):
        for name, unit in (("timestep", "s"), ("duration", "s"), ("rtol", "")):
            require_number(name, getattr(self, name), unit=unit, positive=True)
        if not isinstance(self.solver, str | Sequence):
            raise InputError(f"solver = {self.solver!r}, expected a name or a list of names")
        require_count("threads", self.threads)
        choices = (
            ("mode", self.mode, list(ASKABLE)),
            ("form", self.form, list(FORMS)),
            ("integrator", self.integrator, RUNNING),
            ("stabilisation", self.stabilisation, get_args(Stabilisation)),
            ("stepping", self.stepping, get_args(Stepping)),
        )
        for what, name, valid in choices:
            if name is not None:
                choose(what, name, valid)
        _ = self.motion
        for text in (*self.solvers, *filter(None, [self.walker])):
            SolverSpec.parse(text)

    @property
    def solvers(self) -> tuple[str, ...]:
        """The specifications of the solvers."""
        return (self.solver,) if isinstance(self.solver, str) else tuple(self.solver)

    @property
    def whole_case(self) -> bool:
        """Whether the case's own experiments are asked for."""
        return not (self.solvers or self.form or self.mode or self.walker or self.integrator or self.stabilisation)

    @property
    def conditions(self) -> Conditions:
        """What of them differs from the conditions of the case."""
        return Conditions(self.timestep, self.duration, self.ignore_inequalities, motion=self.motion)

    @property
    def motion(self) -> Motion:
        """Where the runs start and what drives them."""
        return Motion(self.keyframe, self.controls, self.control, self.seed, self.states)
