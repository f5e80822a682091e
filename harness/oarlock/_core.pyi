"""The compiled core of oarlock: systems, solvers, laws of time, step loops."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, Self, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Vector = NDArray[np.float64]
_Matrix = NDArray[np.float64]
_Indices = NDArray[np.int32]
_Numbers = ArrayLike
"""Real numbers: float64 arrays in C order are read in place, anything else is copied into one."""

BUILD_PROFILE: str
VERSION: str

class InputError(ValueError):
    """Bad input: the message names the value and what was expected."""

@final
class Info:
    """The figures of one solve; a figure that the solver cannot know is None."""

    @property
    def status(self) -> str:
        """converged, iteration-limit, breakdown or inaccurate."""
    @property
    def iterations(self) -> int:
        """Iterations, in the solver's own count; 0 for a direct solver."""
    @property
    def products(self) -> int:
        """Products with A or with the carried inverse."""
    @property
    def residual_rel(self) -> float:
        """‖A x − b‖ / ‖b‖, in the least-squares sense where the solver knows range(A)."""
    @property
    def inconsistency(self) -> float | None:
        """‖Nᵀ b‖, N a basis of null(A)."""
    @property
    def rank(self) -> int | None:
        """Rank of A."""
    @property
    def null_residual(self) -> float | None:
        """‖A N‖ / ‖A‖."""
    @property
    def margin(self) -> float | None:
        """How many times the eigenvalue nearest to the rank cut is larger or smaller than that."""
    @property
    def tolerance(self) -> float:
        """Residual that a test looser than the default may leave, relative to b."""
    @property
    def risen(self) -> bool:
        """Whether a rank that was held rose."""
    @property
    def refreshed(self) -> bool:
        """Whether the carried pseudo-inverse was recomputed."""
    @property
    def fallbacks(self) -> int:
        """Updates skipped or replaced."""
    @property
    def folded(self) -> int:
        """Rows that folding took out: zero rows and all but one of proportional ones."""
    @property
    def refolded(self) -> bool:
        """Whether the fold of earlier steps did not hold any more and was found anew."""
    @property
    def elapsed_ns(self) -> int:
        """Wall time of the solve alone, in ns."""

@final
class ConstrainedSystem:
    """A λ = b of one step: A = J M⁻¹ Jᵀ (+ R), b = aref − J M⁻¹ f. Make one and assemble it anew every step.

    One thread at a time may use it; another one gets an InputError.
    """

    def __new__(cls) -> ConstrainedSystem: ...
    def assemble(
        self,
        mass: _Numbers,
        jacobian: _Numbers,
        force: _Numbers,
        aref: _Numbers,
        regularisation: _Numbers | None = None,
    ) -> None:
        """Forms A and b from M (nv×nv), J (n×nv), f (nv), aref (n) and, for soft rows, R (n).

        Raises:
            InputError: shapes, what is no finite real number, M not positive definite, R negative.
        """
    def assemble_factored(
        self,
        whitened: _Numbers,
        jacobian: _Numbers,
        unconstrained: _Numbers,
        aref: _Numbers,
        regularisation: _Numbers | None = None,
    ) -> None:
        """Forms A and b where M⁻¹ = Hᵀ H is factored elsewhere; the way back from multipliers ends at ``force``.

        Of the rows H Jᵀ (n×nv), J (n×nv), a₀ = M⁻¹ f (nv), aref (n) and, for soft rows, R (n).

        Raises:
            InputError: shapes, what is no finite real number, R negative.
        """
    def assemble_sparse(
        self,
        jacobian: _Numbers | tuple[_Indices, _Indices, _Indices, _Numbers],
        inertia: tuple[_Indices, _Indices, _Indices, _Numbers, _Numbers, _Numbers],
        unconstrained: _Numbers,
        aref: _Numbers,
        regularisation: _Numbers | None = None,
    ) -> None:
        """Forms A and b of a mechanism whose inertia lies along a kinematic tree, as MuJoCo keeps it.

        Of J (n×nv), or its lengths, starts, columns and values as MuJoCo compresses it, a₀ = M⁻¹ f (nv), aref (n) and,
        for soft rows, R (n). ``inertia`` has the model's ``M_rownnz``,
        ``M_rowadr`` and ``M_colind`` and the data's ``M``, ``qLD`` and ``qLDiagInv``.

        Raises:
            InputError: shapes, rows that do not fit together, what is no finite real number, R negative.
        """
    def hold_rank(self, gaps: _Numbers, constraints: list[int]) -> None:
        """Says how far the rows of the next step stand open, and asks to hold the rank along the path.

        Args:
            gaps: deviation of each row, as a part of the length that it turns on, (n).
            constraints: number of the constraint that each row belongs to, (n).
        """
    def renew(self, unconstrained: _Numbers, aref: _Numbers) -> None:
        """Asks the same rows again from another a₀ (nv), as other smooth forces give it: b = aref − J a₀.

        Raises:
            InputError: nothing was assembled, shapes, what is no finite real number.
        """
    def reference(self, solver: MultiplierSolver) -> tuple[_Vector, Info]:
        """(λ, info) of the step by the direct solver that judges ``solver``.

        Raises:
            InputError: nothing was assembled, or it has no answer.
        """
    def confirm(self, info: Info, qacc: _Numbers, reference: _Numbers) -> Info:
        """The figures of an inaccurate solve, as converged where each entry of its acceleration (nv) keeps the promise.

        ``reference`` is the acceleration (nv) of the reference's multipliers.
        """
    def doubt(self, info: Info) -> Info:
        """The figures of a solve that converged, as inaccurate: what goes with it is not proved."""
    def force(self, multipliers: _Numbers) -> _Vector:
        """Jᵀ λ (nv) of λ (n)."""
    @property
    def matrix(self) -> _Matrix:
        """A, n×n, before folding."""
    @property
    def rhs(self) -> _Vector:
        """b, n, before folding."""
    def acceleration(self, multipliers: _Numbers) -> tuple[_Vector, _Vector]:
        """From λ (n) to (qacc, qfrc), both nv: a₀ + M⁻¹ Jᵀ λ and Jᵀ λ."""
    def __copy__(self) -> Self: ...
    def __deepcopy__(self, _memo: dict[int, Any]) -> Self: ...

@final
class InequalityReport:
    """The figures of one solve of the inequality rows."""

    @property
    def status(self) -> str:
        """converged, iteration-limit or breakdown."""
    @property
    def iterations(self) -> int:
        """Newton steps; 0 where the start was the answer."""
    @property
    def evaluations(self) -> int:
        """Evaluations of all rows in the line searches."""
    @property
    def gradient(self) -> float:
        """Norm of the gradient that is left, relative to the forces that it is the difference of."""
    @property
    def active(self) -> int:
        """Number of rows that push, all friction loss among them."""
    @property
    def changed(self) -> bool:
        """Whether rows that push are others than in the solve before, or lie on other pieces."""
    @property
    def blocked(self) -> int:
        """Number of rows that push against equality rows alone."""
    @property
    def coordinates(self) -> int:
        """Number of coordinates that equality rows leave."""
    @property
    def warm(self) -> bool:
        """Whether the acceleration given led nearer than none."""
    @property
    def elapsed_ns(self) -> int:
        """Wall time of the solve alone, in ns."""

@final
class Certificate:
    """What proves an answer; every figure is relative."""

    @property
    def holds(self) -> bool:
        """Whether it is proved."""
    @property
    def gradient(self) -> float:
        """How far forces are from those of the accelerations, in the norm of M⁻¹."""
    @property
    def rounding(self) -> float:
        """The part of the same that rounding explains."""
    @property
    def complementarity(self) -> float:
        """Largest product of a force and its slack beside the energies of all rows."""
    @property
    def gap(self) -> float:
        """Duality gap beside the same."""
    @property
    def infeasibility(self) -> float:
        """How far forces lie outside of what their rows can give."""

@final
class Inequalities:
    """Solves the inequality rows of one step after another, and remembers which of them pushed.

    One thread at a time may use it; another one gets an InputError.
    """

    def __new__(cls) -> Inequalities: ...
    def solve(
        self,
        system: ConstrainedSystem,
        whitened: _Numbers,
        jacobian: _Numbers,
        aref: _Numbers,
        stiffness: _Numbers,
        friction_loss: _Numbers,
        dims: Sequence[int],
        mu: _Numbers,
        friction: _Numbers,
        near: _Numbers | None = None,
    ) -> InequalityReport:
        """Finds the forces of inequality rows beside the equality rows of ``system``, which is assembled.

        Args:
            system: equality rows, hard or soft.
            whitened: H Jᵀ of the inequality rows, a row each, (m, nv), with M⁻¹ = Hᵀ H; of a sparse system it is not
                read, which has a factor of its own.
            jacobian: J (m, nv).
            aref: accelerations that the rows ask for, (m).
            stiffness: D = 1/R (m).
            friction_loss: largest force of a row of friction loss (m); of other rows it is not read.
            dims: what the rows are, in their order: 0 a row of friction loss, 1 a unilateral row, 2 to 6 the rows of an
                elliptic cone.
            mu: coefficient of the regularised cone, one for each of ``dims``.
            friction: friction coefficients of a cone, five for each of ``dims``.
            near: an acceleration (nv) near the answer: that of the step before.

        Raises:
            InputError: shapes, what is no finite real number, numbers out of range.
        """
    @property
    def forces(self) -> _Vector:
        """Forces f (m) of the last solve."""
    @property
    def generalised_force(self) -> _Vector:
        """Jᵀ f (nv) of the last solve."""
    @property
    def pieces(self) -> NDArray[np.uint8]:
        """The piece that each row lies on, (m).

        0 free, 1 a unilateral row that pushes, 2 sticking, 3 and 4 a friction loss that slips with x < 0 and x > 0, 5 a
        sliding contact.
        """
    @property
    def blocked(self) -> list[int]:
        """Rows that are violated and push, though no motion that the equality rows admit moves them."""
    def certify(self, acceleration: _Numbers, forces: _Numbers) -> Certificate:
        """What proves the forces f (m) at the acceleration (nv) of the whole answer of the last step.

        Raises:
            InputError: shapes, what is no finite real number.
        """
    def reset(self) -> None:
        """Forgets all earlier steps."""

@final
class MultiplierSolver:
    """Solves A λ = b one step after another, carrying what it learns. Made by ``make_solver``.

    Its copies, and what pickle makes of it, go on from where it is, to the last bit. One thread at a time may use it;
    another one gets an InputError.
    """

    @property
    def name(self) -> str:
        """Name in the registry."""
    def solve(self, A: _Numbers, b: _Numbers) -> tuple[_Vector, Info]:
        """(x, info) of a dense A (n×n, symmetric positive semidefinite) and b (n).

        Raises:
            InputError: shapes, what is no finite real number, A not symmetric or not positive semidefinite.
        """
    def solve_system(self, system: ConstrainedSystem, wanted: str = "multipliers") -> tuple[_Vector, Info]:
        """(x, info) of the system of one step; wanted is "multipliers" (minimum norm) or "acceleration"."""
    def clone(self) -> MultiplierSolver:
        """A copy with everything it carries."""
    def state(self) -> dict[str, Any]:
        """What it carries between steps: {"solver": name, "size": n, "fields": {name: [numbers]}}."""
    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from a saved state. Raises InputError if it is another solver's or not whole."""
    def reset(self) -> None:
        """Forgets all earlier steps."""
    def __copy__(self) -> Self: ...
    def __deepcopy__(self, _memo: dict[int, Any]) -> Self: ...
    def __reduce__(self) -> tuple[Callable[[], MultiplierSolver], tuple[()], tuple[dict[str, Any], _Matrix]]: ...
    def __setstate__(self, state: tuple[dict[str, Any], _Matrix]) -> None: ...

@final
class TimeLaw:
    """A scalar law of time, parsed once: arithmetic, functions, PI, the time t and named constants; or a log's."""

    def __new__(cls, source: str, constants: dict[str, float] = ...) -> TimeLaw: ...
    @staticmethod
    def sampled(name: str, times: _Numbers, values: _Numbers) -> TimeLaw:
        """The law of a log, called by a name: a value holds from its time (s) until the next; the first also before."""
    @property
    def is_constant(self) -> bool:
        """Whether it does not depend on t."""
    def at(self, t: float) -> float:
        """The value at time t in seconds; NaN outside the law's domain."""

@final
class Stepper:
    """Takes steps of exact constraints on mjData that belong to others. The model is copied as it is."""

    def __new__(
        cls,
        model: Any,
        *,
        given: Any,
        solver: MultiplierSolver,
        projector: MultiplierSolver | None,
        beta: float,
        k: float,
        sensors: bool,
        energy: bool,
        mocaps: bool,
        require: Callable[[Any], None],
    ) -> Self:
        """Of an MjModel: who solves, who projects at the end of a step, and Baumgarte's terms (1/s, 1/s²).

        It is a copy of ``given``, whose options are to stay what they are.

        A step writes sensors and energies as well where it is asked to. ``require`` is called with an MjData to make
        sure that it is one of this model.
        """
    def step(self, data: Any) -> None:
        """Takes a step with an MjData."""
    def rollout(self, addresses: list[int], steps: int, ctrl: NDArray[np.float64] | None = None) -> tuple[Any, Any]:
        """Takes steps with each of the mjData at some addresses, on all cores.

        Gives positions (data × steps × nq) and velocities (data × steps × nv) at the end of each step. ctrl (data ×
        steps × nu) is written before each; None leaves controls.
        """
    def figures(self, lane: int) -> dict[str, Any] | None:
        """What the last step of a lane did; None of one that took none."""
    def reset(self) -> None:
        """Forgets all earlier steps."""

@final
class Setup:
    """A prepared model at a consistent start, with its drive. The model is copied: later changes to it are not seen."""

    def __new__(
        cls,
        model: Any,
        *,
        qpos: _Numbers,
        qvel: _Numbers,
        act: _Numbers,
        laws: list[tuple[int, TimeLaw]],
        switches: list[tuple[int, TimeLaw]],
        step_s: float,
        held: bool,
        beta: float,
        k: float,
        observed: tuple[str, int] | None,
        conserved: bool,
        inequalities: bool,
        snapshots: list[int],
        doubted: bool = False,
    ) -> Setup:
        """Of an ``MjModel``: positions (nq), velocities (nv), laws of actuators by number, Baumgarte's 1/s and 1/s².

        Besides what to note for an outside truth (("qpos", entry) or ("site", number)), whether to note energies,
        the steps whose states are kept whole, and whether MuJoCo's answers are held against the minimum that they
        should be.

        Raises:
            InputError: no model, shapes, or no such actuator, entry or site.
        """
    def calibration(self, steps: int) -> Run:
        """MuJoCo's own force through our stepping, against MuJoCo."""
    def lockstep(
        self,
        steps: int,
        questions: list[tuple[str, list[MultiplierSolver]]],
        leader: MultiplierSolver | None = None,
        projector: MultiplierSolver | None = None,
    ) -> Run:
        """Every question (form, solvers) along the walk of MuJoCo, or of a solver in the hard form."""
    def one_step(self, steps: int, asked: list[tuple[str, MultiplierSolver]]) -> Run:
        """From each of MuJoCo's states, one step of every (form, solver)."""
    def bare(self, steps: int) -> Run:
        """``mj_step`` alone, and nothing written down."""
    def free_mujoco(self, steps: int) -> Run:
        """MuJoCo walks alone."""
    def free_solved(
        self,
        steps: int,
        form_name: str,
        solver: MultiplierSolver,
        projector: MultiplierSolver | None = None,
        beside: MultiplierSolver | None = None,
        judged: bool = True,
    ) -> Run:
        """A solver walks in a form; a projector may end its steps.

        A solver may walk beside it with half the timestep, which tells its error. Where it is judged, MuJoCo as
        configured walks beside it, and another solver says the minimum-norm multipliers.
        """
    def profile(self, steps: int, solver: MultiplierSolver) -> dict[str, Any]:
        """Where the time of a free run on exact constraints goes.

        parts, by the order of a step, {part: (time in ns, looks at the clock in it)}; whole_ns; look_ns, what a look
        costs; solves, unconverged, iterations, products and refreshes of the walk; rows and folded_rows of its last
        step; state, as that of a ``Run``, at its end.

        Raises:
            InputError: what ended the walk.
        """

@final
class Column:
    """A column of a run's table."""

    @property
    def kind(self) -> Literal["float", "int", "text", "list"]:
        """What an entry is."""
    @property
    def values(self) -> NDArray[Any]:
        """float, int: a number a row; text: a place among ``words`` a row; list: the numbers of all rows."""
    @property
    def missing(self) -> NDArray[np.bool_] | None:
        """float, int: where a row has nothing, if that may be; else None."""
    @property
    def words(self) -> list[str]:
        """text: the different words; else none."""
    @property
    def lengths(self) -> NDArray[np.uint64] | None:
        """list: how many numbers each row has; else None."""

@final
class Run:
    """A run on its way, made by a ``Setup``. One thread at a time may use it; another one gets an InputError."""

    def advance(self, steps: int) -> int:
        """Goes on by so many steps and gives the number of steps taken; fewer than asked for: it has ended."""
    def walk(self, timers: bool = False) -> None:
        """Takes all steps that are left without writing anything down, MuJoCo's timers standing still or running.

        Raises:
            InputError: what ended the walk.
        """
    @property
    def end(self) -> tuple[int, float, str, str] | None:
        """What ended it before its last step: step, time (s), kind and message; raises what MuJoCo raised."""
    @property
    def state(self) -> tuple[_Vector, _Vector, float]:
        """Positions (nq), velocities (nv) and time (s) of the walker."""
    def tables(self) -> list[dict[str, Column]]:
        """The rows since the last call: {name: column} for each who answers."""
    def snapshots(self) -> list[tuple[int, _Vector, _Vector, _Vector]]:
        """The states kept whole since the last call: (step, qpos, qvel, multipliers)."""

def open_mujoco(path: str) -> None:
    """Resolves the native step loops from MuJoCo's library at ``path``, which 'import mujoco' must have loaded.

    Raises:
        InputError: nothing is known of the layout of its version.
    """

def mujoco_versions() -> list[int]:
    """The versions of MuJoCo whose layouts are known, as ``mj_version()`` has them, oldest first."""

def mujoco_layout(version: int) -> tuple[list[tuple[str, str, str, int]], int, int] | None:
    """The layout of a version of MuJoCo; None where it is not known.

    Returns:
        Struct, field, type in C and offset (bytes) of everything that the step loops read; the bytes of an mjContact;
        and the numbers that an equality has in ``eq_data``.
    """

def advance_all(runs: list[Run], steps: int) -> list[int]:
    """Goes on with many runs by so many steps each, on all cores; gives the number of steps that each took.

    Raises:
        InputError: a run is there twice, or in use by another thread.
    """

def make_solver(name: str, **options: float | int | bool) -> MultiplierSolver:
    """Makes a solver by its name, with options as numbers and switches: ``make_solver("sr1", eps_abs=1e-7)``.

    A whole number may be given as an int or a float, a switch as a bool, 0 or 1.

    Raises:
        InputError: unknown name or option, or a value out of range or of another kind.
    """

def python_solvers() -> list[str]:
    """Names of the solvers that were registered, which are called in Python."""
    ...

def register_solver(name: str, solver: Callable[..., Any], summary: str = ...) -> None:
    """Registers a solver of one's own under a name, for this process; another one by the same name takes its place.

    It is a function of A (n×n, symmetric positive semidefinite) and b (n) that gives x (n), or (x, iterations); or a
    class whose objects have such a method ``solve``, and carry what they like from step to step. What it says is held
    against a direct solver, as of every solver that is none.

    Raises:
        InputError: a name that is taken or no name of a file could have, or nothing that can be called.
    """

def solvers() -> dict[str, tuple[str, dict[str, float | int | bool]]]:
    """Every solver: {name: (summary, {option: default})}; a default is of its option's kind, float, int or bool."""

def bench_sizes() -> list[int]:
    """Sizes of the published table of solvers side by side."""
    ...

def bench_solvers(n: int, rounds: int) -> list[dict[str, Any]]:
    """Times every solver and every library's pseudo-inverse at n rows.

    Raises:
        InputError: n is not a multiple of 6.
    """
    ...
