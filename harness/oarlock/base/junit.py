"""JUnit XML for continuous integration: suites of test cases, of which some failed."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from xml.etree import ElementTree

_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


@dataclass(frozen=True)
class Failure:
    """Why a test case failed.

    Attributes:
        kind: what sort of failure.
        message: in one line.
        text: at length.
        error: whether it could not be looked at, rather than failed.
    """

    kind: str
    message: str
    text: str = ""
    error: bool = False


@dataclass(frozen=True)
class TestCase:
    """A test case.

    Attributes:
        name: its name; the class it goes by is that of its suite.
        failure: None: it passed, or was skipped.
        skipped: why it was not judged; empty: it was.
        said: what is worth knowing of it.
    """

    __test__ = False  # for pytest

    name: str
    failure: Failure | None = None
    skipped: str = ""
    said: str = ""


@dataclass(frozen=True)
class TestSuite:
    """A suite of test cases."""

    __test__ = False

    name: str
    cases: list[TestCase] = field(default_factory=list)


def junit(name: str, suites: Iterable[TestSuite]) -> str:
    """Renders a document of suites in the order given."""
    root = ElementTree.Element("testsuites", name=_text(name))
    for one in suites:
        suite = ElementTree.SubElement(root, "testsuite", name=_text(one.name))
        for case in one.cases:
            _add(suite, one.name, case)
        for key, found in (("tests", "testcase"), ("failures", "testcase/failure"), ("errors", "testcase/error")):
            suite.set(key, str(len(suite.findall(found))))
        suite.set("skipped", str(len(suite.findall("testcase/skipped"))))
    for key in ("tests", "failures", "errors", "skipped"):
        root.set(key, str(sum(int(suite.get(key, "0")) for suite in root)))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(suite: ElementTree.Element, classname: str, case: TestCase) -> None:
    test = ElementTree.SubElement(suite, "testcase", classname=_text(classname), name=_text(case.name))
    if case.failure:
        tag = "error" if case.failure.error else "failure"
        why = ElementTree.SubElement(test, tag, type=case.failure.kind, message=_text(case.failure.message))
        why.text = _text(case.failure.text)
    elif case.skipped:
        ElementTree.SubElement(test, "skipped", message=_text(case.skipped))
    if case.said:
        ElementTree.SubElement(test, "system-out").text = _text(case.said)


def _text(text: str) -> str:
    return _FORBIDDEN.sub("\ufffd", text)
