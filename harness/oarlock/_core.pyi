"""The compiled core of oarlock: systems, solvers, laws of time."""

from typing import Any, final

import numpy as np
from numpy.typing import NDArray

_Vector = NDArray[np.float64]
_Matrix = NDArray[np.float64]

BUILD_PROFILE: str
VERSION: str

class InputError(ValueError):
    """Bad input: the message names the value and what was expected."""

@final
class Info:
    """The figures of one solve; a figure that the solver cannot know is None."""

    @property
    def status(self) -> str:
        """converged, iteration-limit or breakdown."""
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
    """A λ = b of one step: A = J M⁻¹ Jᵀ (+ R), b = aref − J M⁻¹ f. Make one and assemble it anew every step."""

    def __new__(cls) -> ConstrainedSystem: ...
    def assemble(
        self,
        mass: _Matrix,
        jacobian: _Matrix,
        force: _Vector,
        aref: _Vector,
        regularisation: _Vector | None = None,
    ) -> None:
        """Forms A and b from M (nv×nv), J (n×nv), f (nv), aref (n) and, for soft rows, R (n).

        Raises:
            InputError: shapes, values that are not finite, M not positive definite, R negative.
        """
    @property
    def matrix(self) -> _Matrix:
        """A, n×n, before folding."""
    @property
    def rhs(self) -> _Vector:
        """b, n, before folding."""
    def acceleration(self, multipliers: _Vector) -> tuple[_Vector, _Vector]:
        """From λ (n) to (qacc, qfrc), both nv: a₀ + M⁻¹ Jᵀ λ and Jᵀ λ."""

@final
class MultiplierSolver:
    """Solves A λ = b one step after another, carrying what it learns. Made by ``make_solver``."""

    @property
    def name(self) -> str:
        """Name in the registry."""
    def solve(self, A: _Matrix, b: _Vector) -> tuple[_Vector, Info]:
        """(x, info) of a dense A (n×n, symmetric positive semidefinite) and b (n).

        Raises:
            InputError: shapes, values that are not finite, A not symmetric or not positive semidefinite.
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

@final
class TimeLaw:
    """A scalar law of time, parsed once: arithmetic, functions, PI, the time t and named constants."""

    def __new__(cls, source: str, constants: dict[str, float] = ...) -> TimeLaw: ...
    @property
    def is_constant(self) -> bool:
        """Whether it does not depend on t."""
    def at(self, t: float) -> float:
        """The value at time t in seconds; NaN outside the law's domain."""

def make_solver(name: str, **options: float) -> MultiplierSolver:
    """Makes a solver by its name, with options as numbers: ``make_solver("sr1", eps_abs=1e-7)``.

    Raises:
        InputError: unknown name or option, or a value out of range.
    """

def solvers() -> dict[str, tuple[str, dict[str, float]]]:
    """Every solver: {name: (summary, {option: default})}."""

def bench_sizes() -> list[int]:
    """Sizes of the published table of solvers side by side."""
    ...

def bench_solvers(n: int, rounds: int) -> list[dict[str, Any]]:
    """Times every solver and every library's pseudo-inverse at n rows.

    Raises:
        InputError: n is not a multiple of 6.
    """
    ...
