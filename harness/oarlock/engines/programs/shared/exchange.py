"""What programs share that are fed a compiled model's arrays: an answer that grows row by row, and the main loop."""

import pathlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from shared.family import Ask, end, progress, questions, write_answer

_LINES = 50
"""Lines of progress of a whole answer, at most."""


@dataclass
class Answer:
    """What is answered.

    Attributes:
        engine: name of the engine.
        versions: package → version.
        expressed: kinds of equalities that the engine has.
        missing: elements that it has no words for, each with why; where there are any, nothing else is answered.
        facts: what lets the cause of a difference be told.
        rows: columns of a row a state, or a recorded step.
    """

    engine: str
    versions: dict[str, str] = field(default_factory=dict)
    precision: str = "float64"
    expressed: list[str] = field(default_factory=list)
    missing: list[dict[str, str]] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    rows: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, **values: Any) -> None:
        """Adds a row: numbers, or arrays (k)."""
        for name, value in values.items():
            self.rows.setdefault(name, []).append(np.asarray(value, dtype=float))

    def write(self, folder: pathlib.Path) -> bool:
        """Writes the folder; returns whether the question could not be expressed.

        Raises:
            ArithmeticError: a number is not finite.
        """
        for name, values in self.rows.items():
            if not np.isfinite(np.array(values)).all():
                raise ArithmeticError(f"{name} is not finite")
        document = {
            "engine": self.engine,
            "versions": self.versions,
            "precision": self.precision,
            "expressed": self.expressed,
            "not_expressible": self.missing,
            "facts": self.facts,
        }
        write_answer(folder, document, None if self.missing else self.rows)
        return bool(self.missing)


class NotExpressible(Exception):  # noqa: N818 (it says what it is)
    """Something that an engine has no words for shows only on the way.

    Args:
        element: which; why: it is so.
    """

    def __init__(self, element: str, why: str):
        super().__init__(f"{element}: {why}")
        self.element, self.why = element, why


def tell(done: int, of: int) -> None:
    """Says now and then how far the program has come."""
    if done == of or done % max(1, of // _LINES) == 0:
        progress(done, of)


def answer_all(answered: Callable[[Ask, Answer], None], engine: str) -> None:
    """Answers every question of the arguments and ends the program."""
    refused = False
    for ask, folder in questions():
        answer = Answer(engine)
        try:
            answered(ask, answer)
        except NotExpressible as error:
            answer.missing.append({"element": error.element, "why": error.why})
        refused |= answer.write(folder)
    end(refused)
