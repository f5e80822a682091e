"""Runs of a model with some of the changes of a fix, before any of it is written."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import mujoco

from oarlock.base.errors import InputError, one_line
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.edit.changes import Armature, Change, Constants, Exclusion, Keyframe, Settings, Switched
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.loops.poses import ClosedPose, nearest_closed
from oarlock.diagnosis.runs.recipe import Recipe, recipe
from oarlock.diagnosis.runs.trials import Setting, Start, Trial
from oarlock.mechanics.flexes import flex_equalities
from oarlock.mechanics.load import as_asked, collected_warnings, load_model
from oarlock.poses.layout import Layout

SEEDS = (11, 12)
"""Of the random controls that a fix is tried under besides the user's."""


@dataclass
class Bench:
    """Runs a model with changes from where the file then starts.

    Attributes:
        exam: the examination whose file is to be fixed.
        base: the file as it begins by itself: not as a case has it.
    """

    exam: Examination
    base: Examination
    _models: dict[tuple[Change, ...], mujoco.MjModel] = field(default_factory=dict)
    _poses: dict[tuple[Change, ...], ClosedPose | None] = field(default_factory=dict)
    _laws: dict[int, dict[str, str]] = field(default_factory=dict)

    @classmethod
    def of(cls, exam: Examination) -> "Bench":
        """Loads the file anew where the examination is one of a case."""
        return cls(exam, exam if exam.own_s is None else begin(str(exam.path), exam.options))

    @property
    def target(self) -> float:
        """Wanted drift, m or rad."""
        return self.exam.target

    @property
    def own(self) -> Setting:
        """The settings of the file, as the user has them run."""
        return Setting.authored(self.base.model)

    @cached_property
    def authored(self) -> Setting:
        """The settings of the file as they are written."""
        return Setting.authored(load_model(self.base.path))

    def model(self, changes: Sequence[Change]) -> mujoco.MjModel:
        """The model with the exclusions, constants and what else its arrays have room for among changes."""
        pairs = tuple(change for change in changes if isinstance(change, Exclusion))
        laws = _constants(changes)
        if (*pairs, *laws) not in self._models:
            model = self._excluding(pairs) if pairs else self.base.model
            model = copy.copy(model) if laws else model
            for change in laws:
                change.apply(model)
            self._models[*pairs, *laws] = model
        return self._models[*pairs, *laws]

    def pose(self, changes: Sequence[Change]) -> ClosedPose | None:
        """The closed pose nearest to the start with the constants among changes."""
        exam, laws = self.exam, _constants(changes)
        if not laws:
            return exam.pose
        if laws not in self._poses:
            model = self.model(laws)
            found = nearest_closed(model, exam.qpos, exam.qvel, self.data(model), hold=exam.options.hold)
            self._poses[laws] = found
        return self._poses[laws]

    def data(self, model: mujoco.MjModel) -> mujoco.MjData:
        """Data of a model at the examination's start, with flexes let go: their rows are not looked at."""
        data = mujoco.MjData(model)
        data.eq_active[flex_equalities(model)] = 0
        data.qpos[:], data.qvel[:] = self.exam.qpos, self.exam.qvel
        return data

    def _excluding(self, pairs: Sequence[Exclusion]) -> mujoco.MjModel:
        path, like = self.base.path, self.base.model
        try:
            with collected_warnings():
                spec = mujoco.MjSpec.from_file(str(path))
                for pair in pairs:
                    spec.add_exclude(bodyname1=_named(spec, pair.body1), bodyname2=_named(spec, pair.body2))
                model = spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            raise InputError(f"{path}: MuJoCo refuses to exclude contacts: {one_line(error)}") from None
        as_asked(model, like)
        return model

    def start(self, changes: Sequence[Change]) -> Start:
        """Where the file starts with these changes."""
        act = self.exam.act
        for change in changes:
            if isinstance(change, Keyframe):
                return Start(change.qpos, change.qvel, act, "closed")
        return Start(self.base.qpos, self.base.qvel, act, "own")

    def setting(self, changes: Sequence[Change]) -> Setting:
        """The settings with these changes."""
        return next((change.setting for change in changes if isinstance(change, Settings)), self.own)

    def run(self, changes: Sequence[Change], seed: int | None = None) -> Trial:
        """A run under the user's controls, or under random ones of a seed; each is made once."""
        return self.run_model(self.model(changes), self.setting(changes), self.start(changes), seed)

    def run_model(self, model: mujoco.MjModel, setting: Setting, start: Start, seed: int | None = None) -> Trial:
        """The same of any model."""
        label = "the user's controls" if seed is None else f"random controls, seed {seed}"
        return self.exam.made.run(model, setting, start, self.laws(seed), self.exam.duration_s, label)

    def recipe(self, changes: Sequence[Change], seed: int | None = None) -> Recipe:
        """Settings that hold the model with changes; under random controls not from disturbed starts."""
        budget_s = self.exam.options.budget
        search = partial(recipe, self.model(changes), self.start(changes), self.laws(seed), self.target)
        search = partial(search, self.exam.duration_s, made=self.exam.made)
        if seed is None:
            return search(budget_s=budget_s)
        return search(budget_s=budget_s / len(self.seeds), seeds=())

    def laws(self, seed: int | None) -> dict[str, str]:
        """The user's controls, or random ones of all actuators."""
        if seed is None:
            return self.exam.laws
        if seed not in self._laws:
            asked = replace(self.exam.options, controls="random", control={}, seed=seed, keyframe=None)
            self._laws[seed] = begin(str(self.base.path), asked).laws
        return self._laws[seed]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Of other controls; none where there are no actuators, or nothing counts that they could open."""
        return SEEDS if self.base.model.nu and self.counts else ()

    @property
    def counts(self) -> bool:
        """Whether an equality of the file is active."""
        return bool(Layout.of(self.base.model).equalities)


def _constants(changes: Sequence[Change]) -> tuple[Constants | Armature | Switched, ...]:
    return tuple(change for change in changes if isinstance(change, Constants | Armature | Switched))


def _named(spec: mujoco.MjSpec, body: int) -> str:
    one = spec.bodies[body]
    if not one.name:
        one.name = f"oarlock body {body}"
    return one.name
