"""Walks along a log of states: what a program really did, in place of MuJoCo's own run."""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.mechanics.drive import Drive
from oarlock.mechanics.load import quiet_engine
from oarlock.mechanics.state_log import StateLog
from oarlock.stepping.beginning import Beginning
from oarlock.stepping.walkers import MujocoWalker


def beginning_of_log(log: StateLog) -> Beginning:
    """The start and the controls of a log."""
    return Beginning(
        qpos=log.qpos[0].copy(),
        qvel=log.qvel[0].copy(),
        act=log.act[0].copy(),
        key=None,
        begins=f"the {log}",
        laws=log.laws,
        driven=log.driven,
    )


class StatesWalker:
    """States of a log one after another, each with what MuJoCo computes of it.

    Attributes:
        strayed: how far the model's own step from a state is from the next one, rad or m, (steps so far).
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, states: StateLog):
        self.data, self.strayed = data, list[float]()
        self._own, self._states, self._at = MujocoWalker(model, data), states, 0
        data.time = states.start_s
        self._apart = np.zeros(model.nv)
        self._place()

    def look(self) -> None:
        """mj_forward, at the state as it was logged."""
        self._own.look()

    def step(self) -> None:
        """Goes to the next state of the log, by way of the model's own step."""
        model, data, time = self._own.model, self.data, self.data.time
        self._own.step()
        self._at += 1
        if self._at < len(self._states):
            mujoco.mj_differentiatePos(model, self._apart, 1.0, data.qpos, self._states.qpos[self._at])
            self.strayed.append(float(np.abs(self._apart).max(initial=0.0)))
            data.time = time + model.opt.timestep
            self._place()

    def mujoco_answer(self) -> tuple[np.ndarray, np.ndarray]:
        """As ``MujocoWalker``, of the model at the state as it was logged."""
        return self._own.mujoco_answer()

    @property
    def iterations(self) -> int:
        """As ``MujocoWalker``."""
        return self._own.iterations

    def _place(self) -> None:
        data, states, at = self.data, self._states, self._at
        data.qpos[:], data.qvel[:] = states.qpos[at], states.qvel[at]
        data.act[:], data.ctrl[:] = states.act[at], states.ctrl[at]


def walk_states(walker: StatesWalker, steps: int) -> Iterator[int]:
    """The states of a log, as ``walk`` gives those of a run."""
    for step in range(steps):
        walker.look()
        yield step
        walker.step()


def own_walker(
    model: mujoco.MjModel, data: mujoco.MjData, drive: Drive, states: StateLog | None
) -> "MujocoWalker | StatesWalker":
    """Who walks as MuJoCo's own run does: MuJoCo, or the log that takes its place."""
    return MujocoWalker(model, data, drive) if states is None else StatesWalker(model, data, states)


def strays(model: mujoco.MjModel, states: StateLog, steps: int) -> float:
    """How far the model's own step from a row of a log is from the next one at most, rad or m."""
    walker = StatesWalker(model, mujoco.MjData(model), states)
    with quiet_engine(), np.errstate(all="ignore"):
        for _ in walk_states(walker, steps):
            pass
    return max(walker.strayed, default=0.0)
