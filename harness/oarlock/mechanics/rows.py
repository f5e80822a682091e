"""The constraint Jacobian J of a state."""

import mujoco
import numpy as np


def jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Returns J (nefc, nv) of all constraint rows, at a state whose position stage is done.

    Where the model's Jacobian is dense, it is a view of MuJoCo's memory and holds until the next stage. MuJoCo's own
    array may be longer, because it has room for rows that are left out because they are zero.
    """
    if mujoco.mj_isSparse(model):
        nefc = data.nefc
        dense = np.zeros((nefc, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.efc_J, data.efc_J_rownnz[:nefc], data.efc_J_rowadr[:nefc], data.efc_J_colind
        )
        return dense
    return data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)


def compressed(data: mujoco.MjData, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns the first rows of J where MuJoCo compresses it: lengths (rows), starts (rows), columns and values."""
    return data.efc_J_rownnz[:rows], data.efc_J_rowadr[:rows], data.efc_J_colind, data.efc_J


def closing_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Returns J (ne, nv) of the equality rows, which come before those of limits and contacts (see ``jacobian``)."""
    return jacobian(model, data)[: data.ne]
