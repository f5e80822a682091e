"""A comparison as JUnit XML for continuous integration: one test case per run and group of figures."""

from oarlock.base.junit import Failure, TestCase, TestSuite
from oarlock.base.junit import junit as render
from oarlock.compare.compare import Difference
from oarlock.compare.figures import Comparison


def junit(difference: Difference) -> str:
    """Renders the document: one test suite per case. Worse figures are failures, allowed disappearances are skipped."""
    groups: dict[str, dict[tuple[str, str], list[Comparison]]] = {}
    for one in difference.comparisons:
        if one.verdict != "not judged":
            groups.setdefault(one.case, {}).setdefault((one.run, one.group), []).append(one)
    bad = {id(one) for one in difference.worse}
    suites = [
        TestSuite(case, [_test(run, group, members, bad) for (run, group), members in sorted(groups[case].items())])
        for case in sorted(groups)
    ]
    return render(f"oarlock diff {difference.before} {difference.after}", suites)


def _test(run: str, group: str, members: list[Comparison], bad: set[int]) -> TestCase:
    worse = [one for one in members if id(one) in bad]
    changed = [one for one in members if one.verdict != "same" and id(one) not in bad]
    failure, skipped = None, ""
    if worse:
        more = f" and {len(worse) - 1} more" if len(worse) > 1 else ""
        failure = Failure(worse[0].verdict, worse[0].line() + more, _lines(worse))
    elif changed and all(one.verdict == "disappeared" for one in members):
        skipped = "disappeared"
    return TestCase(f"{run or 'case'}: {group}", failure, skipped, _lines(changed))


def _lines(members: list[Comparison]) -> str:
    return "\n".join(f"{one.verdict}: {one.line()}" for one in members)
