"""The work of a matrix, in units that any process can do: states of a model, answers of an engine, a row of figures.

Each has the digest of all that it hangs on, so that a matrix resumes where it stopped: an engine answers again when the
question, its program or its environment changed, not when the comparison did.
"""

import functools
import re
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError, one_line
from oarlock.base.hashing import of_document
from oarlock.base.scratch import scratch_folder
from oarlock.batch import digest
from oarlock.conformance.figures import measure
from oarlock.conformance.laws import Laws
from oarlock.conformance.states import Plan, own_model, prepare
from oarlock.engines import running
from oarlock.engines.answers import Answer, read
from oarlock.engines.asking import ACCURATE, Files, States, ask, write
from oarlock.engines.environments import Environment
from oarlock.engines.registry import Engine
from oarlock.experiments.opening import open_case
from oarlock.mechanics.fatal import mujoco_ends_in_a_line
from oarlock.tables.ledger import Failure, Outcome

STATES = "states"
"""Name of the unit that draws the states of a model."""

ASK, ANSWERS = "ask", "answers"
"""Folders of the questions and of the answers among the results of a model."""


_DRAWING = ("engines/asking", "conformance/laws", "conformance/states", "diagnosis/sampling")
_COMPARING = ("engines/asking", "engines/answers", "conformance/states", "conformance/laws", "conformance/precision")
_COMPARING += ("conformance/causes", "conformance/contradictions", "conformance/figures", "conformance/units")
"""Sources on which states, and figures, depend besides the rooms of all runs."""


@functools.cache
def _drawing() -> str:
    rooms = digest.code_of(("poses", "diagnosis/loops"))
    return of_document([digest.program(), rooms, _chosen(_DRAWING)])


@functools.cache
def _comparing() -> str:
    return of_document([digest.program(), _chosen(_COMPARING)])


def _chosen(names: tuple[str, ...]) -> dict[str, str]:
    codes = digest.code_of(("engines", "conformance", "diagnosis"))
    return {name: codes[name] for name in names}


def slug(text: str) -> str:
    """A name with characters that suit files and folders."""
    return re.sub(r"[^\w.@+=-]", "-", text)


@dataclass(frozen=True)
class Work:
    """A unit.

    Attributes:
        name: unique within its model; label: for the reader of a log.
        digest: of all that it hangs on.
        cost: guess of its duration, for the order only.
    """

    name: str
    label: str
    digest: str
    cost: float = 1.0

    def outcome(self) -> Outcome:
        """Does the work.

        Raises:
            InputError: it cannot be done as asked.
        """
        raise NotImplementedError


def do(work: Work) -> Outcome:
    """Does a unit. A mistake or an error ends in its outcome, never in an exception."""
    began = time.perf_counter()
    try:
        with mujoco_ends_in_a_line():
            outcome = work.outcome()
    except running.EngineError as error:
        outcome = Outcome(Failure("failed", one_line(error)), files=_complaints(work, error))
    except InputError as error:
        outcome = Outcome(Failure("refused", one_line(error)))
    except Exception as error:
        outcome = Outcome(Failure("failed", one_line(f"{type(error).__name__}: {error}")))
    return replace(outcome, seconds=time.perf_counter() - began)


def _complaints(work: Work, error: running.EngineError) -> dict[str, bytes]:
    return {f"{ANSWERS}/{slug(work.name)}/stderr.txt": error.tail} if error.tail else {}


@dataclass(frozen=True)
class DrawStates(Work):
    """Draws the states of a model and writes what every question has."""

    case: str = ""
    count: int = 0
    seed: int = 0

    @classmethod
    def of(cls, asked: str, label: str, count: int, seed: int) -> "DrawStates":
        """The unit of a model, as ``load_case`` takes it."""
        mark = of_document([digest.of_case(open_case(asked)), count, seed, _drawing()])
        return cls(STATES, f"{label} {STATES}", mark, 1.0, asked, count, seed)

    def outcome(self) -> Outcome:
        """As ``Work``: files of the question, and the plan."""
        files, plan = prepare(self.case, self.count, self.seed)
        return Outcome(files={f"{ASK}/{name}": content for name, content in files.items()}, model=plan.document())


@dataclass(frozen=True)
class Question(Work):
    """Asks an engine about the states of a model, and for a run."""

    engine: Engine | None = None
    environment: Environment | None = None
    plan: Plan | None = None
    files: tuple[tuple[str, bytes], ...] = ()
    silence_s: float = running.SILENCE_S
    case: str = ""

    @classmethod
    def of(
        cls,
        asked: str,
        engine: Engine,
        environment: Environment,
        plan: Plan,
        files: Files,
        marks: dict[str, str],
        silence_s: float,
    ) -> "Question":
        """The unit of a model and an engine. ``marks`` are checksums of the files of the question."""
        asking = [engine.precision, sorted(engine.settings.items()), plan.asked, sorted(marks.items()), ACCURATE]
        mark = of_document([engine.program.digest, environment.identity, engine.requirements, asking])
        name = f"{ANSWERS} {engine.name}"
        label = f"{plan.name} {engine.name}"
        return cls(name, label, mark, 10.0, engine, environment, plan, tuple(files.items()), silence_s, asked)

    def outcome(self) -> Outcome:
        """As ``Work``: the files of the answers."""
        engine, plan = self.engine, self.plan
        assert engine is not None
        assert plan is not None
        kept: dict[str, bytes] = {}
        for questions in _rounds(engine):
            answers = self._ask(engine, plan, questions)
            for question, files in answers.items():
                kept |= {f"{ANSWERS}/{slug(self.name)}/{question}/{name}": content for name, content in files.items()}
            if any("answer.parquet" in files for question, files in answers.items() if question != "run"):
                continue
            if "step" in questions and engine.asks("forward"):
                for question, files in self._ask(engine, plan, ["forward"]).items():
                    kept |= {f"{ANSWERS}/{slug(self.name)}/{question}/{n}": content for n, content in files.items()}
        return Outcome(files=kept)

    def _ask(self, engine: Engine, plan: Plan, questions: list[str]) -> dict[str, Files]:
        """Has the engine answer some questions in one process; what is no answer is an error."""
        assert self.environment is not None
        files = dict(self.files)
        states = States.read(files["states.parquet"])
        asked = states[: plan.closed] if engine.program.closed else states
        with scratch_folder() as folder:
            model = own_model(
                open_case(self.case), {n: c for n, c in files.items() if n not in ("model.npz", "states.parquet")}
            )
            asks = []
            for question in questions:
                own = states[:1] if question == "run" else asked
                settings: dict[str, Any] = {} if question == "run" else dict(ACCURATE)
                if plan.generated:
                    settings["arrays"] = True
                document = ask(
                    plan.name,
                    model,
                    question,
                    precision=engine.precision,
                    steps=plan.steps,
                    every=plan.every,
                    settings={**settings, **engine.settings},
                )
                asks.append(write(folder / question, {**files, "states.parquet": own.table(), "ask.json": document}))
            written = running.run(engine.program, self.environment, asks, self.silence_s)
            for question, answered in zip(questions, written.files, strict=True):
                _read(plan, question, answered, len(asked), written.status)
        return dict(zip(questions, written.files, strict=True))


def _rounds(engine: Engine) -> list[list[str]]:
    """Questions that are asked together."""
    asked = [question for question in ("step", "run") if engine.asks(question)]
    if "step" not in asked:
        asked[:0] = ["forward"]
    return [asked] if engine.program.several else [[question] for question in asked]


def _read(plan: Plan, question: str, files: Files, states: int, status: int) -> Answer:
    run = question == "run"
    return read(files, plan.nq, plan.nv, plan.records if run else states, status, run=run)


@dataclass(frozen=True)
class Compare(Work):
    """Measures what an engine answered about a model."""

    case: str = ""
    engine: str = ""
    plan: Plan | None = None
    files: tuple[tuple[str, bytes], ...] = ()
    answers: tuple[tuple[str, bytes], ...] = ()
    closed: bool = False

    @classmethod
    def of(
        cls, asked: str, engine: Engine, plan: Plan, files: Files, answers: Files, marks: dict[str, str]
    ) -> "Compare":
        """The unit of a model and an engine; ``marks`` are checksums of question and answers."""
        mark = of_document([digest.of_case(open_case(asked)), sorted(marks.items()), _comparing()])
        named = f"figures {engine.name}"
        return cls(
            named,
            f"{plan.name} {named}",
            mark,
            1.0,
            asked,
            engine.name,
            plan,
            tuple(files.items()),
            tuple(answers.items()),
            engine.program.closed,
        )

    def outcome(self) -> Outcome:
        """As ``Work``: one row."""
        plan, files = self.plan, dict(self.files)
        assert plan is not None
        states = States.read(files.pop("states.parquet"))
        states = states[: plan.closed] if self.closed else states
        files.pop("model.npz")
        laws = Laws(own_model(open_case(self.case), files), states)
        answers: dict[str, Answer] = {}
        for question, content in by_question(dict(self.answers)).items():
            answers[question] = _read(plan, question, content, len(states), running.NOT_EXPRESSIBLE)
        return Outcome(rows=[{"engine": self.engine, **measure(laws, plan, answers)}])


def by_question(files: Files) -> dict[str, Files]:
    """Question → files of its answer, from names ``…/QUESTION/answer.json``."""
    found: dict[str, Files] = {}
    for name, content in files.items():
        path = Path(name)
        found.setdefault(path.parent.name, {})[path.name] = content
    return found
