"""Prints who is right on random mechanisms: python -m random_mechanisms [--seeds 300] [--first 0] [--details].

From the folder of tests, with the package on the path. With --details, every answer that is wrong without a word.
"""

import argparse
from collections.abc import Iterable

import numpy as np

from random_mechanisms.generator import mechanism
from random_mechanisms.judge import RIGHT, Verdict, judge


def table(verdicts: list[Verdict]) -> str:
    """Walk and solver × answers, converged, wrong among those, mechanisms with such, worst error; then the ranks."""
    judgements = [judgement for verdict in verdicts for judgement in verdict.judgements]
    head = (
        "walk",
        "solver",
        "answers",
        "converged",
        "wrong",
        "mechanisms",
        "worst",
        "cond there",
        "median unconverged",
    )
    lines = [_line(head), _line(["---"] * len(head))]
    for key in dict.fromkeys((judgement.walk, judgement.solver) for judgement in judgements):
        mine = [judgement for judgement in judgements if (judgement.walk, judgement.solver) == key]
        said, silent = [one for one in mine if one.converged], [one for one in mine if one.silent]
        worst = max(said, key=lambda one: one.error, default=None)
        others = [one.error for one in mine if not one.converged]
        figures = [len(mine), len(said), len(silent), len({one.seed for one in silent})]
        said_of_worst = [f"{worst.error:.1e}", f"{worst.condition:.0e}"] if worst else ["", ""]
        lines.append(_line([*key, *map(str, figures), *said_of_worst, f"{np.median(others):.1e}" if others else ""]))
    lines += ["", _line(("walk", "mechanisms", "rank too high", "rank too low", "ended early", "largest drift"))]
    lines.append(_line(["---"] * 6))
    for walk in dict.fromkeys(walk for verdict in verdicts for walk in verdict.ranks):
        ranks = [verdict.ranks[walk] for verdict in verdicts if walk in verdict.ranks]
        ended = sum(walk in verdict.ended for verdict in verdicts)
        drift = max(verdict.drifts[walk] for verdict in verdicts if walk in verdict.drifts)
        counts = [len(ranks), sum(bool((off > 0).any()) for off in ranks), sum(bool((off < 0).any()) for off in ranks)]
        lines.append(_line([walk, *map(str, counts), str(ended), f"{drift:.1e}"]))
    undecided = sum(verdict.undecided for verdict in verdicts)
    lines += [
        "",
        f"wrong: converged and off by more than {RIGHT:g}; {undecided} states of groups too far open to judge",
    ]
    return "\n".join(lines)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m random_mechanisms")
    parser.add_argument("--seeds", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--details", action="store_true")
    options = parser.parse_args()
    verdicts = [judge(mechanism(seed)) for seed in range(options.first, options.first + options.seeds)]
    print(table(verdicts))
    for verdict in verdicts if options.details else ():
        found = {**verdict.wrong_ranks, **verdict.ended}
        print(f"\nseed {verdict.mechanism.seed} ({verdict.mechanism.kind}): {found}")
        for one in verdict.silent:
            print(f"  {one.walk} {one.solver} step {one.step} {one.kind}: {one.error:.1e}", end=" ")
            print(f"condition {one.condition:.0e} gap {one.gap:.0e}")


if __name__ == "__main__":
    main()
