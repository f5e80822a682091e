"""What would hold a loop: settings in closed form for a wanted drift, each verified by a run.

Deadbeat, solref "2h 0.5" with solimp "0.9999 0.9999 0.001 0.5 2", is h²K = hB = 1: under Euler a deviation is gone two
steps later, and what is left is what one or two steps add, which falls with h². So a drift r₂ at h becomes the wanted
one at h' = h √(0.7 target / r₂). Under Runge–Kutta nothing ends in two steps, and "4h 1" is often the better one: both
are tried. The cheapest setting that holds is taken, then tried from disturbed starts as well. Costs are counted, in
evaluations of the model: nothing that is chosen or reported depends on a clock.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from oarlock.base.errors import InputError, few
from oarlock.base.text import quoted
from oarlock.cases.integrators import INTEGRATORS
from oarlock.diagnosis.options import BUDGET_S
from oarlock.diagnosis.runs.budget import Budget, CutShortError
from oarlock.diagnosis.runs.solving import Solving
from oarlock.diagnosis.runs.stability import RowSettings, stability
from oarlock.diagnosis.runs.trials import Made, Setting, Start, Trial, disturbed
from oarlock.diagnosis.runs.without import explicit
from oarlock.mechanics.curvature import bends
from oarlock.mechanics.engine_version import lacks_curvature
from oarlock.mechanics.prepare import integrator_of
from oarlock.poses.layout import Layout

STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)
"""MuJoCo's smallest softness, the same at every deviation."""

MARGIN = 0.7
"""A timestep is chosen for so much of the target."""

CORRECTIONS = 4
"""So often a timestep is corrected that was expected to do and did not."""

HALVINGS = 6
"""So often a timestep is halved where a run diverges and gives no drift to compute with."""

TWICE = 2
"""So often where it is a disturbed start from which it diverges: what whips then does so at any timestep."""

SEEDS = (1, 2)
"""Disturbed starts that a recipe is verified from."""

MAX_STEPS = 400_000
"""Steps of a trial at most."""

FLOOR = 0.5
"""A solver with enough iterations that leaves less than this of a drift was what it wanted."""

LEAP, PROBE = 8.0, 4.0
"""Before a timestep is made smaller by more than the first, it is by the second: to see whether that helps at all."""

WASTED = 0.2
"""A timestep that leaves less of the target is finer than it needs to be."""

LOST = 0.01
"""Of the largest kinetic energy: beyond it Runge–Kutta is tried for the energy's sake."""

ALIKE = 1.25
"""Costs within this factor count as the same: evaluations tell a time no better. Of such runs the own integrator's goes
first, then the one that opens least."""

CONSERVING = INTEGRATORS["rk4"].name
"""The integrator that is tried for the energy's sake, and where no other holds a loop at the model's own timestep."""

EASY = INTEGRATORS["implicitfast"].name
"""The integrator that is tried where the own one takes some damping as it was at the start of a step (actuators',
tendons', a fluid's, under Runge–Kutta also joints') and does not hold the loop at the model's own timestep."""

Outcome = Literal["holds", "reached", "not-reached", "undecided"]


@dataclass(frozen=True)
class Recipe:
    """What was tried, and what holds.

    Attributes:
        target: wanted drift, m or rad.
        outcome: ``holds``: as authored already; ``reached``: with ``chosen``; ``not-reached``: ``chosen`` is the best;
            ``undecided``: the budget ended the search before that, and ``chosen`` is the best so far.
        reason: in words: what was needed, or what stands in the way.
        untried: of settings that hold, what was not tried, in words; empty where all was.
        authored: the run as authored.
        chosen: the run with the settings that are recommended, from the user's start.
        verified: runs with the same settings from disturbed starts.
        conserving: a run by Runge–Kutta that holds too, and whose energy error is a tenth of the chosen one's or less;
            None where the chosen one loses less than ``LOST``, or there is no such run.
        trials: every run that was made, in order.
        starved: what a solver with enough iterations and tolerance makes of it, where that is much less.
    """

    target: float
    outcome: Outcome
    reason: str
    authored: Trial
    chosen: Trial
    verified: list[Trial]
    conserving: Trial | None
    trials: list[Trial]
    starved: "Starved | None" = None
    untried: str = ""

    @property
    def reached(self) -> bool:
        """Whether the drift stays within the target, also from the disturbed starts."""
        return self.outcome in ("holds", "reached")

    @property
    def mjcf(self) -> str:
        """The recommended settings as MJCF to paste; empty where nothing has to change."""
        return "" if self.chosen.setting == self.authored.setting else self.chosen.setting.mjcf

    @property
    def pareto(self) -> list[Trial]:
        """Of the runs from the user's start those that no other one beats in both drift and cost, by cost."""
        own = [trial for trial in self.trials if trial.start == self.authored.start and math.isfinite(trial.drift)]
        front: list[Trial] = []
        for trial in sorted(own, key=lambda trial: (trial.evaluations, trial.drift)):
            if not front or trial.drift < front[-1].drift:
                front.append(trial)
        return front


@dataclass(frozen=True)
class Starved:
    """A solver that stops too early for stiff equalities: the same run with it and with one that does not."""

    given: Trial
    fed: Trial


def deadbeat(timestep_s: float, integrator: str) -> Setting:
    """h²K = hB = 1 at the smallest softness."""
    return Setting(timestep_s, integrator, (2.0 * timestep_s, 0.5), STIFF_SOLIMP)


def critical(timestep_s: float, integrator: str) -> Setting:
    """A time constant of four timesteps, critically damped, at the smallest softness: for Runge–Kutta."""
    return Setting(timestep_s, integrator, (4.0 * timestep_s, 1.0), STIFF_SOLIMP)


def recipe(
    model: mujoco.MjModel,
    start: Start,
    laws: dict[str, str],
    target: float,
    duration_s: float,
    *,
    seeds: tuple[int, ...] = SEEDS,
    max_steps: int = MAX_STEPS,
    budget_s: float = BUDGET_S,
    made: Made | None = None,
) -> Recipe:
    """Finds settings that keep every equality within a target, by runs of MuJoCo alone.

    Args:
        model: the user's; it is left alone.
        start: closed, with velocities along the constraints.
        laws: the controls, as of ``controls.laws``.
        target: wanted drift, m or rad.
        duration_s: of every run.
        seeds: of the disturbed starts that the outcome is verified from.
        max_steps: of a run.
        budget_s: for all runs, as of ``Budget``; one that does not fit into what is left is not begun.
        made: runs of before; one of them is charged as if it were made anew, so that what is chosen is the same.

    Raises:
        InputError: the target or the duration is not a finite number above 0.
    """
    for what, value in (("target", target), ("duration_s", duration_s)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{what} = {value:g}, expected a finite number > 0")
    return _Search(model, start, laws, target, duration_s, max_steps, Budget(budget_s), made or Made()).run(seeds)


_Family = tuple[str, str]
"""A way to set equalities (deadbeat or critical), and an integrator."""

_WAYS = {"deadbeat": deadbeat, "critical": critical}


class _Search:
    def __init__(
        self,
        model: mujoco.MjModel,
        start: Start,
        laws: dict[str, str],
        target: float,
        duration_s: float,
        max_steps: int,
        budget: Budget,
        made: Made,
    ):
        self._model, self._start, self._laws = model, start, laws
        self._target, self._duration_s, self._max_steps = target, duration_s, max_steps
        self._size = Layout.of(model).rows + model.nv
        self._budget, self._made = budget, made
        self._refused = self._short = ""
        self._floored = False
        self._solving: Solving | None = None
        self._asked = False
        self._starved: Starved | None = None
        self._trials: list[Trial] = []

    def run(self, seeds: tuple[int, ...]) -> Recipe:
        authored = self._make("as authored", Setting.authored(self._model), self._start)
        starts = [found for seed in seeds if (found := disturbed(self._model, self._start, seed)) is not None]
        untried = ["not tried from a disturbed start"] if seeds and not starts else []
        try:
            outcome, reason, chosen = self._decide(authored, starts)
        except CutShortError as error:
            outcome, chosen = "undecided", self._best_so_far()
            reason = f"{error}; {self._so_far(chosen, starts)}"
        conserving = None
        if outcome in ("holds", "reached"):
            try:
                conserving = self._conserving(chosen)
            except CutShortError as error:
                untried.append(f"{error}, before a run that loses less was looked for")
        else:
            untried = []
        verified, every = self._tried(chosen.setting, starts), self._trials
        found = self._target, outcome, reason, authored, chosen, verified, conserving, every, self._starved
        return Recipe(*found, untried="; ".join(untried))

    def _decide(self, authored: Trial, starts: list[Start]) -> tuple[Outcome, str, Trial]:
        """The outcome, the reason, and the trial that is chosen."""
        if authored.drift <= self._target:
            verified = self._verify(authored, starts)
            if self._holds(authored, verified, starts):
                return "holds", "it holds as it stands", authored
            if all(trial.drift <= self._target for trial in verified):
                return "undecided", f"{self._short}; {self._so_far(authored, starts)}", authored
        if authored.opening > self._target:
            reason = f"the start itself is open by {authored.opening:.2g}, more than the target: close it first"
            return "not-reached", reason, authored
        best = self._best(integrator_of(self._model).name, float(self._model.opt.timestep)) or authored
        verified = self._verify(best, starts) if best.drift <= self._target else []
        first = best, verified
        for _ in range(CORRECTIONS):
            worst = max((trial.drift for trial in verified), default=0.0)
            if worst <= self._target:
                break
            way, now = self._way(best), best.setting.timestep_s
            if not math.isfinite(worst) and now < first[0].setting.timestep_s / 2 ** (TWICE - 0.5):
                break
            shorter = self._shorter(now, worst) if math.isfinite(worst) else 0.5 * now
            again = self._try(f"{way}, for disturbed starts", self._set(way, shorter, best.setting.integrator))
            if again is None:
                break
            best, verified = again, self._verify(again, starts)
        if self._holds(best, verified, starts):
            return "reached", self._success(best), best
        if self._short:
            best = self._best_so_far()
            return "undecided", f"{self._short}; {self._so_far(best, starts)}", best
        if not all(math.isfinite(trial.drift) for trial in verified):  # shorter steps were of no use
            best, verified = first
        return "not-reached", self._failure(best, verified), best

    def _holds(self, trial: Trial, verified: list[Trial], starts: list[Start]) -> bool:
        """Whether a trial stays within the target, and from every disturbed start as well."""
        within = all(one.drift <= self._target for one in (trial, *verified))
        return within and len(verified) == len(starts)

    def _conserving(self, chosen: Trial) -> Trial | None:
        if chosen.setting.integrator == CONSERVING or not chosen.energy_error > LOST * chosen.kinetic_energy:
            return None
        timestep = float(self._model.opt.timestep)
        if not any(trial.setting.integrator == CONSERVING for trial in self._own_trials()):
            self._try(f"critical, {CONSERVING}", self._set("critical", timestep, CONSERVING))
        found = [
            trial
            for trial in self._own_trials()
            if trial.setting.integrator == CONSERVING
            and trial.drift <= self._target
            and trial.energy_error <= 0.1 * chosen.energy_error
        ]
        return min(found, key=lambda trial: trial.evaluations, default=None)

    # The search.

    def _best(self, own: str, timestep: float) -> Trial | None:
        """The cheapest trial that holds, or the one that opens least."""
        families: list[_Family] = [("deadbeat", own)] + ([("critical", own)] if own == CONSERVING else [])
        if own == CONSERVING and not math.isfinite(self._trials[0].drift):  # Euler bears joints' damping, and it not
            families.insert(0, ("deadbeat", "euler"))
        first = {family: self._first(family, timestep) for family in families}
        held = [trial.setting.timestep_s for trial in first.values() if trial and trial.drift <= self._target]
        if explicit(self._model, own) and timestep not in held:
            first["deadbeat", EASY] = self._first(("deadbeat", EASY), timestep, max(held, default=0.0))
        # Runge–Kutta takes four evaluations a step: worth it where Euler would need more steps than that.
        if own != CONSERVING and not any(trial and trial.drift <= self._target for trial in first.values()):
            if own != "euler":
                first["deadbeat", "euler"] = self._first(("deadbeat", "euler"), timestep)
            least = min((trial.drift for trial in first.values() if trial), default=math.inf)
            if not math.isfinite(least) or least / (MARGIN * self._target) > 2.0:
                extra: list[_Family] = [("critical", CONSERVING), ("deadbeat", CONSERVING)]
                first |= {family: self._first(family, timestep) for family in extra}
        for family, trial in sorted(first.items(), key=lambda item: self._expected(item[1])):
            held = [one for one in self._own_trials() if one.drift <= self._target]
            if trial and (not held or ALIKE * self._expected(trial) < min(one.evaluations for one in held)):
                self._refine(family, trial)
        return self._cheapest(self._own_trials())

    def _own_trials(self) -> list[Trial]:
        return [trial for trial in self._trials[1:] if trial.start == self._start.name]

    def _cheapest(self, trials: list[Trial]) -> Trial | None:
        held = [trial for trial in trials if trial.drift <= self._target]
        if held:
            least, own = min(trial.evaluations for trial in held), integrator_of(self._model).name
            alike = [trial for trial in held if trial.evaluations <= ALIKE * least]
            return min(alike, key=lambda trial: (trial.setting.integrator != own, trial.drift))
        return min(trials, key=lambda trial: trial.drift, default=None)

    def _expected(self, trial: Trial | None) -> float:
        """Evaluations that a run will take with a timestep at which this way should hold."""
        if trial is None or not math.isfinite(trial.drift):
            return math.inf
        return trial.evaluations * max(1.0, math.sqrt(trial.drift / (MARGIN * self._target)))

    def _first(self, family: _Family, timestep: float, least: float = 0.0) -> Trial | None:
        """At the model's own timestep, or at half of it and so on where the run diverges, but not below the least."""
        way, integrator = family
        trial = None
        for halving in range(HALVINGS + 1):
            trial = self._try(f"{way}, {integrator}", self._set(way, timestep / 2**halving, integrator))
            if halving == 0:
                trial = self._fed(trial)
            if trial is None or math.isfinite(trial.drift) or timestep / 2 ** (halving + 1) < least:
                break
        return trial

    def _set(self, way: str, timestep: float, integrator: str) -> Setting:
        return replace(_WAYS[way](timestep, integrator), solving=self._solving)

    def _fed(self, trial: Trial | None) -> Trial | None:
        """The same with a solver that has enough, where that opens much less; the search is then made with it."""
        given = Solving.of(self._model)
        if trial is None or self._asked or trial.drift <= self._target or not given.short:
            return trial
        self._asked = True
        setting = replace(trial.setting, solving=given.enough)
        fed = self._try(f"{trial.label}, {given.enough.solver}", setting)
        if fed is None or not fed.drift < FLOOR * trial.drift:
            return trial
        self._solving, self._starved = given.enough, Starved(trial, fed)
        return fed

    def _refine(self, family: _Family, trial: Trial) -> None:
        way, integrator = family
        for _ in range(CORRECTIONS):
            if trial.drift <= self._target or not math.isfinite(trial.drift):
                return
            now = trial.setting.timestep_s
            timestep, expected = self._shorter(now, trial.drift), MARGIN * self._target
            if now / timestep > LEAP:
                timestep, expected = now / PROBE, trial.drift / PROBE**2
            setting = self._set(way, timestep, integrator)
            after = self._try(f"{way}, {integrator}, smaller step", setting, expected)
            if after is None:
                return
            if after.drift > math.sqrt(timestep / now) * trial.drift:
                self._floored = True
                return
            trial = after
            if trial.drift < WASTED * self._target:  # h² did not hold on the way: a coarser one may do
                self._coarser(family, trial)
                return

    def _coarser(self, family: _Family, trial: Trial) -> None:
        way, integrator = family
        timestep = self._shorter(trial.setting.timestep_s, trial.drift)
        if timestep < float(self._model.opt.timestep):
            self._try(
                f"{way}, {integrator}, coarser again", self._set(way, timestep, integrator), MARGIN * self._target
            )

    def _shorter(self, timestep: float, drift: float) -> float:
        """Timestep h' = h √(0.7 target/r), down to two digits."""
        wanted = timestep * math.sqrt(MARGIN * self._target / drift)
        unit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
        return float(f"{math.floor(wanted / unit) * unit:.1e}")

    def _try(
        self, label: str, setting: Setting, predicted: float | None = None, start: Start | None = None
    ) -> Trial | None:
        """A run, unless it takes too many steps or does not fit into what is left of the budget."""
        steps = setting.steps(self._duration_s)
        if steps > self._max_steps:
            self._refused = (
                f"a timestep of {setting.timestep_s:.2g} s would be needed, {steps:.3g} steps for "
                f"{self._duration_s:g} s, and at most {self._max_steps:,} are run"
            )
            return None
        if not self._budget.affords(steps, steps * setting.evaluations, self._size):
            self._short = self._short or (
                f"cut short by the budget of {self._budget.seconds:g} s, which has no room for '{label}' at "
                f"{setting.timestep_s:g} s"
            )
            return None
        self._budget.tick()
        return self._make(label, setting, start or self._start, predicted, self._budget.tick)

    def _make(
        self,
        label: str,
        setting: Setting,
        start: Start,
        predicted: float | None = None,
        tick: Callable[[], None] | None = None,
    ) -> Trial:
        trial = self._made.run(self._model, setting, start, self._laws, self._duration_s, label, predicted, tick)
        self._budget.spend(trial.taken, trial.taken * setting.evaluations, self._size)
        self._trials.append(trial.against(self._trials[0] if self._trials else trial))
        return self._trials[-1]

    def _verify(self, trial: Trial, starts: list[Start]) -> list[Trial]:
        """Runs with the same settings from disturbed starts, without those that do not fit into the budget."""
        known = {one.start: one for one in self._tried(trial.setting, starts)}
        runs = [known.get(start.name) or self._try(trial.label, trial.setting, None, start) for start in starts]
        return [run for run in runs if run]

    def _tried(self, setting: Setting, starts: list[Start]) -> list[Trial]:
        """The runs that were made with a setting from some of the starts."""
        names = {start.name for start in starts}
        return [trial for trial in self._trials if trial.setting == setting and trial.start in names]

    def _best_so_far(self) -> Trial:
        """Of the runs from the user's start; those whose settings opened from a disturbed one come last."""
        authored = self._trials[0]
        own = [trial for trial in (authored, *self._own_trials()) if math.isfinite(trial.drift)]
        beyond = [trial for trial in self._trials if trial.drift > self._target]
        opened = {trial.setting for trial in beyond if trial.start != authored.start}
        return self._cheapest([trial for trial in own if trial.setting not in opened] or own) or authored

    def _way(self, trial: Trial) -> str:
        made = _WAYS["critical"](trial.setting.timestep_s, trial.setting.integrator)
        return "critical" if trial.setting.solref == made.solref else "deadbeat"

    # In words.

    def _success(self, trial: Trial) -> str:
        authored, setting = Setting.authored(self._model), trial.setting
        changed = [str(setting.solving)] if setting.solving is not None else []
        changed += [self._rows(setting)] if setting.solref is not None else []
        same = setting.timestep_s == authored.timestep_s
        if setting.integrator != authored.integrator:
            said = _listed([*changed, f"{setting.integrator} in place of {authored.integrator}"])
            return said + (", at the same timestep" if same else f", at {setting.timestep_s:g} s")
        if same:
            return f"{_listed(changed)} at the same timestep"
        return _listed([*changed, f"a timestep of {setting.timestep_s:g} s in place of {authored.timestep_s:g} s"])

    def _rows(self, setting: Setting) -> str:
        """What becomes of the equalities: direct numbers that were stiffer than those that hold are named."""
        assert setting.solref is not None
        assert setting.solimp is not None
        new = RowSettings.of(np.array(setting.solref), np.array(setting.solimp), setting.timestep_s)
        every = [one.settings for one in stability(self._model)]
        softer = {one.given for one in every if one.given[0] <= 0.0 and one.spring > new.spring}
        if not softer:
            return "stiffer equalities"
        given = few([f'"{first:g} {second:g}"' for first, second in sorted(softer)])
        return f'solref "{setting.solref[0]:g} {setting.solref[1]:g}" in place of {given}'

    def _so_far(self, best: Trial, starts: list[Start]) -> str:
        """What is known where the search was cut short."""
        if not math.isfinite(best.drift):
            return f"no run so far stays finite: {best.end.message}"
        if best.drift > self._target:
            return f"{quoted(best.equality.name)} opens by {best.drift:.2g} {best.unit} at best so far"
        own = self._own_of(best)
        tried = self._tried(best.setting, starts)
        worst = max(tried, key=lambda trial: trial.drift, default=best)
        if worst.drift > self._target:
            return f"{own}, but from a disturbed one {self._opened(worst)}"
        return f"{own}, and {len(tried)} of {len(starts)} disturbed ones were tried"

    def _own_of(self, best: Trial) -> str:
        return f"'{best.label}' at {best.setting.timestep_s:g} s holds from the user's own start"

    def _opened(self, trial: Trial) -> str:
        if not math.isfinite(trial.drift):
            return "the run diverges"
        return f"{quoted(trial.equality.name)} opens by {trial.drift:.2g} {trial.unit}"

    def _failure(self, best: Trial, verified: list[Trial]) -> str:
        said = []
        worst = max((trial for trial in verified), key=lambda trial: trial.drift, default=best)
        if not math.isfinite(best.drift):
            said.append(f"no run stays finite: {best.end.message}")
        elif best.drift <= self._target:
            said.append(f"{self._own_of(best)}, but from a disturbed one {self._opened(worst)}")
        else:
            said.append(f"{quoted(best.equality.name)} opens by {best.drift:.2g} {best.unit} at best")
        if self._refused:
            said.append(self._refused)
        elif math.isfinite(best.drift) and best.drift > self._target:
            said.append(
                "a smaller timestep does not help: it stands on something else than softness and timestep"
                if self._floored
                else f"smaller timesteps help, and no more than {CORRECTIONS} one after another are tried"
            )
        kind = worst.equality.kind
        if lacks_curvature(kind) and bends(self._model, worst.equality):
            said.append(f"MuJoCo leaves J̇v out on rows of a {kind} equality, and no softness makes up for it")
        return "; ".join(said)


def _listed(parts: list[str]) -> str:
    """One, two and three."""
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))
