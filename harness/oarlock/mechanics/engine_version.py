"""What differs between the versions of MuJoCo, 3.3 to 4.0. Nobody else asks which version it is.

Where a version has another name or place for the same thing, what it has is looked at, not its number. Numbers are only
for what cannot be seen: what MuJoCo computes otherwise.
"""

import mujoco
import numpy as np

from oarlock.base.text import version_numbers
from oarlock.cases.equality_kinds import EqualityKind

VERSION = version_numbers(mujoco.__version__)
"""Such as (3, 3, 7)."""

SPARSE_NEWTON_ERRS = VERSION == (4, 0, 0)
"""Whether Newton may use a wrong factor where the Jacobian is sparse (google-deepmind/mujoco#3767).

The error came with 4.0.0 and went with 4.0.1."""

NEWEST = (4, 0, 0)
"""The newest version that oarlock was tested with."""

SLEEP = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0))
"""The enable flag by which trees fall asleep; 0 in a version that knows no sleep."""


def lacks_curvature(kind: EqualityKind) -> bool:
    """Whether MuJoCo's reference acceleration lacks a J̇v of an equality of a kind that is known."""
    return kind.lacks_curvature(VERSION)


def too_old(said: str) -> str:
    """What to add to MuJoCo's refusal of a model where a newer version might take it; empty where not."""
    unknown = any(word in said for word in ("unrecognized", "invalid keyword", "too much data"))
    return f"; this is MuJoCo {mujoco.__version__}, a newer one may know it" if unknown and VERSION < NEWEST else ""


_M_IS_ASKED_OF_DATA = "d: mujoco" in (mujoco.mj_fullM.__doc__ or "").partition("\n")[0]  # since 3.10


def full_mass(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Returns the mass matrix M (nv, nv) of a state whose position stage is done."""
    mass = np.zeros((model.nv, model.nv))
    if _M_IS_ASKED_OF_DATA:
        mujoco.mj_fullM(model, data, mass)
    else:
        mujoco.mj_fullM(model, mass, data.qM)
    return mass


Tree = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def mass_tree(model: mujoco.MjModel, data: mujoco.MjData) -> Tree:
    """Returns M in compressed rows of its lower triangle, with its factor, at a state whose position stage is done.

    Returns:
        Lengths (nv), starts (nv) and columns (nC) of the rows, M (nC), its factor (nC), and 1/D (nv).
    """
    if _M_HAS_ROWS:
        return model.M_rownnz, model.M_rowadr, model.M_colind, data.M, data.qLD, data.qLDiagInv
    return _tree_of_old(model, data)


_M_HAS_ROWS = hasattr(mujoco.MjModel, "M_rownnz")  # since 3.3.3


def _tree_of_old(model: mujoco.MjModel, data: mujoco.MjData) -> Tree:
    """The same where M lies from the diagonal backwards, along the tree of velocities, and only its factor in rows."""
    lengths, starts, columns = data.C_rownnz, data.C_rowadr, data.C_colind
    mass = np.empty(model.nC)
    for length, start, place in zip(lengths.tolist(), starts.tolist(), model.dof_Madr.tolist(), strict=True):
        mass[start : start + length] = data.qM[place : place + length][::-1]
    return lengths, starts, columns, mass, data.qLD, data.qLDiagInv


def dampings(model: mujoco.MjModel) -> list[np.ndarray]:
    """Returns the dampings of velocities and tendons; those of higher powers of the speed are new in 3.7."""
    names = ("dof_damping", "dof_dampingpoly", "tendon_damping", "tendon_dampingpoly")
    return [getattr(model, name) for name in names if hasattr(model, name)]


def springs_yield(model: mujoco.MjModel) -> bool:
    """Whether a spring of a joint or tendon gives way beyond a force, which is new in 4.0."""
    names = ("jnt_springyield", "tendon_springyield")
    return any(getattr(model, name).any() for name in names if hasattr(model, name))


_ISLAND_DISABLED = int(getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", 0))
_ISLAND_ENABLED = int(getattr(mujoco.mjtEnableBit, "mjENBL_ISLAND", 0))  # until 3.3.0


def set_islands(model: mujoco.MjModel, wanted: bool) -> None:
    """Sets whether MuJoCo solves islands apart, in place."""
    option = model.opt
    option.disableflags = option.disableflags & ~_ISLAND_DISABLED | (0 if wanted else _ISLAND_DISABLED)
    option.enableflags = option.enableflags & ~_ISLAND_ENABLED | (_ISLAND_ENABLED if wanted else 0)


_DIAGONAL = "efc_diagA" if hasattr(mujoco.MjData, "efc_diagA") else "efc_diagApprox"  # renamed in 3.10


def diagonal_approx(data: mujoco.MjData) -> np.ndarray:
    """Returns MuJoCo's estimate of the diagonal of A, of every constraint row, (nefc)."""
    return getattr(data, _DIAGONAL)


_TENDONS_HAVE_ROWS = hasattr(mujoco.MjModel, "ten_J_rowadr")  # since 3.6


def tendon_dofs(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Returns the degrees of freedom that can move a tendon."""
    if not _TENDONS_HAVE_ROWS:
        return _dofs_along(model, tendon)
    start = int(model.ten_J_rowadr[tendon])
    return model.ten_J_colind[start : start + int(model.ten_J_rownnz[tendon])].tolist()


def tendon_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Returns the gradients of all tendons' lengths, (ntendon, nv); the position stage of ``data`` is done."""
    rows = np.zeros((model.ntendon, model.nv))
    if not model.ntendon:
        return rows
    holder = model if _TENDONS_HAVE_ROWS else data
    if not _TENDONS_HAVE_ROWS and not mujoco.mj_isSparse(model):
        return np.array(data.ten_J, dtype=float).reshape(rows.shape)
    values = np.array(data.ten_J, dtype=float).ravel()
    mujoco.mju_sparse2dense(rows, values, holder.ten_J_rownnz, holder.ten_J_rowadr, np.ravel(holder.ten_J_colind))
    return rows


def _dofs_along(model: mujoco.MjModel, tendon: int) -> list[int]:
    """The same from the path: what moves one end of a piece of it, and not the other."""
    first = int(model.tendon_adr[tendon])
    path = range(first, first + int(model.tendon_num[tendon]))
    kinds, items = model.wrap_type, model.wrap_objid
    if kinds[first] == mujoco.mjtWrap.mjWRAP_JOINT:
        return sorted({int(model.jnt_dofadr[items[at]]) for at in path})
    found: set[int] = set()
    before: set[int] | None = None
    for at in path:
        if kinds[at] == mujoco.mjtWrap.mjWRAP_PULLEY:
            before = None
            continue
        site = kinds[at] == mujoco.mjtWrap.mjWRAP_SITE
        own = _dofs_of(model, int((model.site_bodyid if site else model.geom_bodyid)[items[at]]))
        if before is not None:
            found |= own ^ before
        before = own
    return sorted(found)


def _dofs_of(model: mujoco.MjModel, body: int) -> set[int]:
    """The degrees of freedom that move a body."""
    found: set[int] = set()
    while body:
        first = int(model.body_dofadr[body])
        found |= set(range(first, first + int(model.body_dofnum[body])))
        body = int(model.body_parentid[body])
    return found
