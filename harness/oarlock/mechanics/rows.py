"""J of a state."""

import mujoco
import numpy as np


def jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """J of all constraint rows, (nefc, nv); a view of MuJoCo's arena where the model's Jacobian is dense.

    MuJoCo makes room for rows that it then leaves out because they are zero: the array may be longer than J.
    """
    if mujoco.mj_isSparse(model):
        nefc = data.nefc
        dense = np.zeros((nefc, model.nv))
        mujoco.mju_sparse2dense(
            dense, data.efc_J, data.efc_J_rownnz[:nefc], data.efc_J_rowadr[:nefc], data.efc_J_colind
        )
        return dense
    return data.efc_J[: data.nefc * model.nv].reshape(data.nefc, model.nv)


def closing_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """J of the equality rows, (ne, nv); those of limits and contacts come after them. As ``jacobian``."""
    return jacobian(model, data)[: data.ne]
