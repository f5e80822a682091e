"""The mechanical energy of a model, where it is conserved."""

import mujoco

from oarlock.mechanics.engine_version import dampings, springs_yield


class Energy:
    """Computes the mechanical energy of a model that nothing drives or damps.

    Attributes:
        conserved: whether nothing drives or damps the model, and MuJoCo counts all of its potential energy. That of
            springs it counts, of linear and other ones; that of gravity compensation, of springs that yield and of
            plugins it does not.

    Args:
        model: the model.
        moved: whether something is moved besides, as a mocap body.
    """

    def __init__(self, model: mujoco.MjModel, *, moved: bool = False):
        self._model = model
        rubs = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
        friction = (model.dof_frictionloss, model.tendon_frictionloss) if rubs else ()
        damped = any(loss.any() for loss in (*dampings(model), *friction))
        uncounted = model.ngravcomp > 0 or model.nplugin > 0 or springs_yield(model)
        driven = moved or model.nu > 0 or model.opt.density != 0 or model.opt.viscosity != 0
        self._pushed = False
        self.conserved = not (driven or damped or uncounted)

    def of(self, data: mujoco.MjData) -> dict[str, float]:
        """Computes the total and the kinetic energy, J, of a state whose position and velocity stages are done.

        Returns:
            ``energy`` and ``kinetic_energy``; an empty dictionary if energy is not conserved, and from the state on in
            which a limit or contact pushed first.
        """
        self._pushed |= bool(data.efc_force[data.ne : data.nefc].any())
        if not self.conserved or self._pushed:
            return {}
        mujoco.mj_energyPos(self._model, data)
        mujoco.mj_energyVel(self._model, data)
        potential, kinetic = data.energy
        return {"energy": float(potential + kinetic), "kinetic_energy": float(kinetic)}
