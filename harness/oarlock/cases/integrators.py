"""MuJoCo's integrators: what is known of each before there is a model. One entry of the table an integrator."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal


@dataclass(frozen=True)
class Integrator:
    """One of MuJoCo's integrators.

    Attributes:
        name: in case files, flags, tables and JSON; in capitals, after ``mjINT_``, that of MuJoCo's number.
        mjcf: as MJCF writes it.
        order: with which a step's error goes to zero.
        function: of MuJoCo, which takes a step from a state with all its forces; ``mj_step`` computes these again.
        stages: how often a step asks for the constraint force.
        divisors: of z⁰, z¹, … in what a step makes of ẏ = z y, if it asks anew at every stage; empty: the force is held
            as it was at the start of the step.
        takes_activations: whether exact runs with it may have actuator activations.
        runs: whether ``oarlock run`` and exact runs step with it; of another ``oarlock check`` knows MuJoCo's own runs.
    """

    name: str
    mjcf: str
    order: int
    function: str
    stages: int = 1
    divisors: tuple[float, ...] = ()
    takes_activations: bool = True
    runs: bool = True

    def __str__(self) -> str:
        return self.name

    @property
    def mjt(self) -> str:
        """Member of mjtIntegrator."""
        return f"mjINT_{self.name.upper()}"

    @property
    def holds_force(self) -> bool:
        """Whether a step takes the constraint force as it was at its start."""
        return not self.divisors


_TABLE = (
    Integrator("euler", "Euler", 1, "mj_Euler"),
    Integrator("implicit", "implicit", 1, "mj_implicit"),
    Integrator("implicitfast", "implicitfast", 1, "mj_implicit"),
    Integrator(
        "rk4",
        "RK4",
        4,
        "mj_RungeKutta",
        stages=4,
        divisors=(1.0, 1.0, 2.0, 6.0, 24.0),
        takes_activations=False,
    ),
    Integrator("discrete", "discrete", 1, "mj_step", runs=False),
)

INTEGRATORS = {integrator.name: integrator for integrator in _TABLE}
"""Name → integrator."""

RUNNING = tuple(integrator.name for integrator in _TABLE if integrator.runs)
"""Names of those that can be asked for."""

RUNNING_IN_WORDS = f"{', '.join(RUNNING[:-1])} or {RUNNING[-1]}"

SUBSTITUTE = INTEGRATORS["implicitfast"]
"""Steps the exact solution beside a run whose own integrator cannot."""

if TYPE_CHECKING:
    IntegratorName = str
else:  # a type that case files are checked with
    IntegratorName = Literal[RUNNING]
