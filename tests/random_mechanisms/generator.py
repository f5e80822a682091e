"""Random mechanisms by number: one to three groups in a file, closed, moving along their constraints, rank known."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from oarlock.mechanics.rows import closing_jacobian

from random_mechanisms.couplings import COUPLINGS
from random_mechanisms.loops import LOOPS
from random_mechanisms.parts import Group

TIMESTEP_S = 1e-3

REDUNDANT, TRUE = 1e-11, 1e-3
"""Singular values of a group's J, each equality scaled to 1, relative to the largest: what a redundant row has at most
at the closed start, where it is rounding, and a true one at least. Between them nothing is drawn: rank is no matter of
opinion, and no group is near a singular pose."""

FASTEST = 3.0
"""rad/s or m/s: largest speed of a coordinate at the start, at most."""

MOST_ROWS = 26


@dataclass(frozen=True)
class Part:
    """A group of a mechanism: equalities, and the coordinates that they hold and nothing else does.

    Attributes:
        kind: what it is.
        equalities: their numbers.
        dofs: its velocities.
        rank: of its rows at the closed start, and of their true part ever after.
    """

    kind: str
    equalities: frozenset[int]
    dofs: np.ndarray
    rank: int


@dataclass(frozen=True)
class Mechanism:
    """A random mechanism.

    Attributes:
        seed: its number.
        xml: its model, closed in the reference pose.
        qvel: velocities along the constraints, (nv).
        parts: its groups.
    """

    seed: int
    xml: str
    qvel: np.ndarray
    parts: tuple[Part, ...]

    @property
    def kind(self) -> str:
        """What its groups are."""
        return ", ".join(part.kind for part in self.parts)

    @property
    def rank(self) -> int:
        """Rank of all rows."""
        return sum(part.rank for part in self.parts)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Its model, as ``mechanics.prepare`` leaves one: a dense Jacobian, no reset after a NaN."""
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        return model


class _BadDrawError(Exception):
    """A pose that is nearly singular, or too many rows."""


def mechanism(seed: int) -> Mechanism:
    """The random mechanism of a number."""
    rng = np.random.default_rng(seed)
    while True:
        try:
            return _draw(seed, rng)
        except _BadDrawError:
            continue


def _draw(seed: int, rng: np.random.Generator) -> Mechanism:
    groups = [_group(f"g{number}", rng) for number in range(rng.choice([1, 2, 3], p=[0.4, 0.4, 0.2]))]
    integrator = rng.choice(["RK4", "Euler", "implicitfast"], p=[0.5, 0.25, 0.25])
    bodies = "".join(root.xml(np.zeros(3)) for group in groups for root in group.roots)
    equalities = "".join(equality for group in groups for equality in group.equalities)
    xml = (
        f'<mujoco model="random {seed}">\n<compiler angle="radian"/>\n'
        f'<option timestep="{TIMESTEP_S}" integrator="{integrator}"/>\n'
        f"<worldbody>\n{bodies}</worldbody>\n<equality>\n{equalities}</equality>\n</mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(xml)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    if model.nv == 0 or data.ne > MOST_ROWS:
        raise _BadDrawError
    owners = [model.joint(model.dof_jntid[dof]).name.partition("_")[0] for dof in range(model.nv)]
    still = rng.random() < 0.25
    qvel, parts = np.zeros(model.nv), []
    for group in groups:
        dofs = np.array([dof for dof, owner in enumerate(owners) if owner == group.name])
        numbers = [e for e in range(model.neq) if model.equality(e).name.removeprefix("again_").startswith(group.name)]
        rank, motions = _examine(closing_jacobian(model, data), data.efc_id[: data.ne], numbers, dofs)
        if group.known_rank is not None and group.known_rank != rank:
            raise AssertionError(f"seed {seed}: {group.kind} has rank {rank}, expected {group.known_rank}")
        velocity = motions.T @ (motions @ rng.normal(size=len(dofs)))
        speed = np.abs(velocity).max(initial=0.0)
        if speed > 0 and not still:
            qvel[dofs] = velocity * (rng.uniform(0, FASTEST) / speed)
        parts.append(Part(group.kind, frozenset(numbers), dofs, rank))
    return Mechanism(seed, xml, qvel, tuple(parts))


def _group(name: str, rng: np.random.Generator) -> Group:
    makers = {**{make: 0.6 * share for make, share in LOOPS.items()}, **{m: 0.4 * s for m, s in COUPLINGS.items()}}
    group = Group(name, rng)
    list(makers)[rng.choice(len(makers), p=list(makers.values()))](group)
    if rng.random() < 0.1:
        group.double()
        group.kind += " again"
    return group


def _examine(
    jacobian: np.ndarray, owner: np.ndarray, equalities: list[int], dofs: np.ndarray
) -> tuple[int, np.ndarray]:
    """Rank of a group's rows at its closed start, and an orthonormal basis of the velocities that they admit."""
    blocks = [jacobian[owner == equality][:, dofs] for equality in equalities]
    rows = np.concatenate([block / np.abs(block).max(initial=1e-300) for block in blocks])
    _, values, directions = np.linalg.svd(rows)
    relative = values / values[0]
    rank = int((relative > TRUE).sum())
    if (relative[rank:] > REDUNDANT).any():
        raise _BadDrawError
    return rank, directions[rank:]
