"""MuJoCo's own steps, with all that belongs to a state looked at before each of them."""

import copy
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError
from oarlock.base.text import called
from oarlock.mechanics.bounds import HUGE, bounded
from oarlock.mechanics.drive import Drive
from oarlock.mechanics.names import coordinates, element_name
from oarlock.stepping import walkers
from oarlock.stepping.walkers import MujocoWalker

How = Literal["finished", "diverged", "refused"]

_BITS = mujoco.mjtDisableBit


@dataclass(frozen=True)
class End:
    """How a run ended: at a time (s), with a message unless it finished."""

    how: How
    time_s: float
    message: str = ""


def energy_error(energy: np.ndarray, other_power: np.ndarray, timestep_s: float) -> np.ndarray:
    """As ``Recording.energy_error``, from energies (steps, 2) and powers (steps)."""
    work = np.zeros(len(energy))
    work[1:] = np.cumsum(0.5 * timestep_s * (other_power[1:] + other_power[:-1]))
    total = energy.sum(axis=1)
    return total - total[:1] - work


def own_copy(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy for a run: MuJoCo computes energies, and a state that diverged stays as it is instead of starting anew.

    Neither changes a motion. Raises InputError for a timestep that is not a positive number.
    """
    if not (np.isfinite(model.opt.timestep) and model.opt.timestep > 0):
        raise InputError(f"timestep of the model = {model.opt.timestep:g} s, expected a finite number > 0")
    own = copy.deepcopy(model)
    own.opt.disableflags |= _BITS.mjDSBL_AUTORESET
    own.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    return own


def walk(model: mujoco.MjModel, data: mujoco.MjData, drive: Drive | None, steps: int) -> Iterator[int]:
    """MuJoCo's own steps; at every number that it gives, all that belongs to the start of that step is valid.

    It ends early where a number is not finite or beyond ``HUGE``, which stays in the data. The drive must have been
    made for this very model: for its hook a copy is another one.
    """
    constant = drive is None or all(law.is_constant for _, law in (*drive.laws, *drive.switches))
    if drive is not None:
        drive.apply(data)
    with nullcontext() if drive is None or constant else drive.installed():
        for step in walkers.walk(MujocoWalker(model, data, drive), steps):
            if step == 0 and not bounded(data.qvel, data.qpos):  # of all that follows, the walk itself looks at it
                return
            yield step


def diverged(model: mujoco.MjModel, data: mujoco.MjData) -> End:
    """Names the worst number of a state that is beyond ``HUGE`` or not finite."""
    names = [entry["name"] for entry in coordinates(model)]
    dofs = [element_name(model, mujoco.mjtObj.mjOBJ_JOINT, int(joint)) for joint in model.dof_jntid]
    for what, values, owners in (
        ("position", data.qpos, names),
        ("velocity", data.qvel, dofs),
        ("acceleration", data.qacc, dofs),
    ):
        bad = ~(np.abs(values) < HUGE)
        if bad.any():
            worst = int(np.where(np.isfinite(values), np.abs(values), np.inf).argmax())
            message = f"{what} of {called('joint', owners[worst])} is {values[worst]:.3g} at t = {data.time:.6g} s"
            return End("diverged", float(data.time), message)
    return End("diverged", float(data.time), f"the state is no longer finite at t = {data.time:.6g} s")


def warnings_of(data: mujoco.MjData) -> dict[str, int]:
    """MuJoCo's warnings on a data, by name, with how often they came."""
    kinds = [(kind, mujoco.mjtWarning(kind).name) for kind in range(int(mujoco.mjtWarning.mjNWARNING))]
    return {name.removeprefix("mjWARN_").lower(): n for kind, name in kinds if (n := int(data.warning[kind].number))}


def other_power(data: mujoco.MjData, skipped: tuple[int, ...] = ()) -> float:
    """Power (W) of everything but loops, gravity and springs at a state that mj_forward was called for.

    Equalities with the numbers ``skipped`` are no loops.
    """
    ne = data.ne
    power = data.qvel @ (data.qfrc_smooth + data.qfrc_bias - data.qfrc_spring)
    if data.nefc > ne:
        power += data.efc_force[ne : data.nefc] @ data.efc_vel[ne : data.nefc]
    if skipped:
        others = np.isin(data.efc_id[:ne], skipped)
        power += data.efc_force[:ne][others] @ data.efc_vel[:ne][others]
    return float(power)
