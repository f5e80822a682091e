"""What the rows of a measured growth say: who is quickest where, and by how much. Pure functions of the rows."""

from typing import Any, NamedTuple

from oarlock.bench.growth import SOLVERS

PAPER = ("sr1-tracked", "sr1")
"""The paper's method, with null spaces tracked and as it was published."""

TIE = 1.15
"""Factor below which two costs count as the same: what interleaved medians of a machine with other work differ by."""

ANSWERED = 0.01
"""A method of which a larger part of the solves did not converge does not count as an answer."""

WINS, TIES, LOSES, NONE = "wins", "ties", "loses", "none"


class Standing(NamedTuple):
    """The paper's method against all others at one size.

    Attributes:
        size: of the family.
        verdict: wins, ties, loses, or none: it was not walked or did not converge.
        mine: the quicker form of the method; empty without one.
        other: the quickest of the others.
        factor: the cost of the first over that of the second; 0 without one.
    """

    size: int
    verdict: str
    mine: str
    other: str
    factor: float


def of_family(rows: list[dict[str, Any]], family: str) -> list[dict[str, Any]]:
    """The rows of a family."""
    return [row for row in rows if row["family"] == family]


def by_size(rows: list[dict[str, Any]]) -> dict[int, dict[str, dict[str, Any]]]:
    """Size → name → row, of the rows of one family."""
    sizes = dict.fromkeys(row["size"] for row in rows)
    return {size: {row["name"]: row for row in rows if row["size"] == size} for size in sizes}


def standings(rows: list[dict[str, Any]]) -> list[Standing]:
    """The standing at each size of one family."""
    found = []
    for size, own in by_size(rows).items():
        costs = {
            name: own[name]["ratio"]
            for name in SOLVERS
            if name in own and not own[name]["left_out"] and own[name]["unconverged"] <= ANSWERED
        }
        mine = min((name for name in PAPER if name in costs), key=lambda name: costs[name], default="")
        other = min((name for name in costs if name not in PAPER), key=lambda name: costs[name], default="")
        if not mine or not other:
            found.append(Standing(size, NONE if not mine else WINS, mine, other, 0.0))
            continue
        factor = costs[mine] / costs[other]
        verdict = WINS if factor * TIE <= 1 else LOSES if factor > TIE else TIES
        found.append(Standing(size, verdict, mine, other, factor))
    return found


def shares(row: dict[str, Any]) -> dict[str, float]:
    """Part → its share of the sum, the largest first; of those that take time."""
    costs = {part: cost for part, cost in row["parts_us"].items() if cost > 0}
    return {part: costs[part] / sum(costs.values()) for part in sorted(costs, key=lambda part: -costs[part])}


def in_words(power: float | None) -> str:
    """An exponent as one says it: a power is called N or N² within 0.15 and 0.25 of it."""
    if power is None:
        return "not at all"
    bounds = {0.15: "hardly at all", 0.85: "slower than N", 1.15: "like N"}
    bounds |= {1.75: "faster than N, slower than N²", 2.25: "like N²"}
    return next((words for bound, words in bounds.items() if power <= bound), "faster than N²")
