"""A model made ready for comparison: integrator, solver and softness set, hazards switched off."""

import copy

import mujoco

from oarlock.cases.case import Case
from oarlock.cases.case_file import Settings
from oarlock.cases.integrators import INTEGRATORS, Integrator, IntegratorName
from oarlock.mechanics.engine_version import set_islands
from oarlock.mechanics.inequalities import may_act
from oarlock.mechanics.limits import require_timestep
from oarlock.mechanics.load import load_model
from oarlock.mechanics.newton import is_doubtful

_NUMBERS = {
    name: int(getattr(mujoco.mjtIntegrator, one.mjt))
    for name, one in INTEGRATORS.items()
    if hasattr(mujoco.mjtIntegrator, one.mjt)
}


SOLVERS = {
    "newton": mujoco.mjtSolver.mjSOL_NEWTON,
    "cg": mujoco.mjtSolver.mjSOL_CG,
    "pgs": mujoco.mjtSolver.mjSOL_PGS,
}


def integrator_of(model: mujoco.MjModel) -> Integrator:
    """The integrator that a model asks for."""
    number = int(model.opt.integrator)
    return next(INTEGRATORS[name] for name, known in _NUMBERS.items() if known == number)


def set_integrator(model: mujoco.MjModel, name: str) -> None:
    """Sets a model's integrator, in place, by the name of one that is known."""
    model.opt.integrator = _NUMBERS[name]


def prepare(
    model: mujoco.MjModel,
    *,
    integrator: IntegratorName,
    timestep_s: float | None = None,
    settings: Settings | None = None,
) -> mujoco.MjModel:
    """Sets what a run asks for, in place, and gives the model back.

    Autoreset is switched off: after a NaN it would put the time back to 0. The Jacobian is dense where Newton can use a
    wrong factor of a sparse one and limits, friction or contacts may act: its answer is no minimum to rounding then.

    Raises:
        InputError: the timestep is not a positive number.
    """
    settings = settings or Settings()
    set_integrator(model, integrator)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if timestep_s is not None:
        model.opt.timestep = timestep_s
    require_timestep(model.opt.timestep)
    if settings.solver is not None:
        model.opt.solver = SOLVERS[settings.solver]
    if is_doubtful(model) and may_act(model):
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    if settings.solref is not None:
        model.eq_solref[:] = settings.solref
    if settings.solimp is not None:
        model.eq_solimp[:] = settings.solimp
    return model


def unsolved(model: mujoco.MjModel, timestep_s: float) -> mujoco.MjModel:
    """A copy of a prepared model for walks on which MuJoCo's constraint solver is not asked, with its own timestep.

    Without what only that solver needs: islands, and a Jacobian that is dense whatever its size.
    """
    model = copy.copy(model)
    model.opt.timestep = timestep_s
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO
    set_islands(model, False)
    return model


def load_mechanism(
    case: Case,
    *,
    integrator: IntegratorName,
    timestep_s: float | None = None,
    settings: str = "default",
    solref_s: float | None = None,
) -> mujoco.MjModel:
    """The model of a case, prepared for one run. Raises InputError as ``load_model``.

    ``solref_s`` is the time constant of every equality, with the damping ratio 1, in place of that of the settings.
    """
    chosen = case.file.setting(settings)
    if solref_s is not None:
        chosen = chosen.model_copy(update={"solref": (solref_s, 1.0)})
    return prepare(
        load_model(case.model_path, case.parameters),
        integrator=integrator,
        timestep_s=timestep_s or case.file.run.timestep_s,
        settings=chosen,
    )
