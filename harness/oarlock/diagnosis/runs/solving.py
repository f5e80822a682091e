"""How MuJoCo solves for its forces: which solver, how many iterations, down to which tolerance; and what is enough."""

from dataclasses import dataclass

import mujoco

from oarlock.base.numbers import exact

SOLVERS = {
    mujoco.mjtSolver.mjSOL_PGS: "PGS",
    mujoco.mjtSolver.mjSOL_CG: "CG",
    mujoco.mjtSolver.mjSOL_NEWTON: "Newton",
}
"""MuJoCo's solvers as MJCF spells them."""


@dataclass(frozen=True)
class Solving:
    """A solver of MuJoCo's with its bounds, as of ``<option>``."""

    solver: str
    iterations: int
    ls_iterations: int
    tolerance: float

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Solving":
        """What the model has."""
        opt = model.opt
        kind = SOLVERS[mujoco.mjtSolver(opt.solver)]
        return cls(kind, int(opt.iterations), int(opt.ls_iterations), float(opt.tolerance))

    @property
    def enough(self) -> "Solving":
        """The same with all that ``ENOUGH`` has and this lacks."""
        return Solving(
            ENOUGH.solver,
            max(self.iterations, ENOUGH.iterations),
            max(self.ls_iterations, ENOUGH.ls_iterations),
            min(self.tolerance, ENOUGH.tolerance),
        )

    @property
    def short(self) -> bool:
        """Whether the solver may stop before it has solved its question."""
        fewer = self.iterations < ENOUGH.iterations or self.ls_iterations < ENOUGH.ls_iterations
        return self.solver != ENOUGH.solver or fewer or self.tolerance > USUAL

    def apply(self, model: mujoco.MjModel) -> None:
        """Sets it, in place."""
        model.opt.solver = next(kind for kind, name in SOLVERS.items() if name == self.solver)
        model.opt.iterations, model.opt.ls_iterations = self.iterations, self.ls_iterations
        model.opt.tolerance = self.tolerance

    def attributes(self) -> dict[str, str]:
        """Attributes of ``<option>``."""
        return {
            "solver": self.solver,
            "iterations": str(self.iterations),
            "ls_iterations": str(self.ls_iterations),
            "tolerance": exact(self.tolerance),
        }

    def __str__(self) -> str:
        return f"{self.solver}, {self.iterations} iterations, tolerance {self.tolerance:g}"


ENOUGH = Solving("Newton", 100, 50, 1e-10)
"""Newton solves loops alone in one iteration, exactly; 100 and 50 are MuJoCo's own numbers, and its tolerance of 1e-8
is made smaller, for it is relative to the weight of the whole model."""

USUAL = 1e-8
"""MuJoCo's own tolerance: a larger one was asked for."""
