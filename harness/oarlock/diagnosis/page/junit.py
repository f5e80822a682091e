"""The findings of a model as a suite of JUnit's test cases: errors fail, warnings and notes are told."""

from collections.abc import Sequence

from oarlock.base.junit import Failure, TestCase, TestSuite
from oarlock.diagnosis.verdict.findings import Finding


def suite_of(file: str, findings: Sequence[Finding]) -> TestSuite:
    """A test case that the model was checked, and one a finding."""
    return TestSuite(file, [TestCase("checked"), *map(_case, findings)])


def suite_of_refused(file: str, why: str) -> TestSuite:
    """One of a file that could not be checked."""
    return TestSuite(file, [TestCase("checked", Failure("refused", why, why, error=True))])


def _case(finding: Finding) -> TestCase:
    name = f"{finding.code} {finding.name}" + (f": {finding.element}" if finding.element else "")
    if finding.severity == "error":
        return TestCase(name, Failure(finding.severity, finding.line, str(finding)))
    return TestCase(name, said=str(finding))
