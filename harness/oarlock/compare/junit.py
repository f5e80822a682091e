"""A comparison as JUnit XML for continuous integration: one test case per run and group of figures."""

import re
from pathlib import Path
from xml.etree import ElementTree

from oarlock.base.files import write_text
from oarlock.compare.compare import Difference
from oarlock.compare.figures import Comparison

_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped."""


def junit(difference: Difference) -> str:
    """Renders the document: one test suite per case. Worse figures are failures, allowed disappearances are skipped."""
    groups: dict[str, dict[tuple[str, str], list[Comparison]]] = {}
    for one in difference.comparisons:
        if one.verdict != "not judged":
            groups.setdefault(one.case, {}).setdefault((one.run, one.group), []).append(one)
    root = ElementTree.Element("testsuites", name=_text(f"oarlock diff {difference.before} {difference.after}"))
    bad = {id(one) for one in difference.worse}
    for case in sorted(groups):
        suite = ElementTree.SubElement(root, "testsuite", name=_text(case))
        for (run, group), members in sorted(groups[case].items()):
            _add(suite, case, run, group, members, bad)
        _count(suite)
    for key in ("tests", "failures", "skipped"):
        root.set(key, str(sum(int(suite.get(key, "0")) for suite in root)))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _add(suite: ElementTree.Element, case: str, run: str, group: str, members: list[Comparison], bad: set[int]) -> None:
    name = f"{run or 'case'}: {group}"
    test = ElementTree.SubElement(suite, "testcase", classname=_text(case), name=_text(name))
    worse = [one for one in members if id(one) in bad]
    changed = [one for one in members if one.verdict != "same" and id(one) not in bad]
    if worse:
        more = f" and {len(worse) - 1} more" if len(worse) > 1 else ""
        failure = ElementTree.SubElement(test, "failure", type=worse[0].verdict, message=_text(worse[0].line() + more))
        failure.text = _text("\n".join(f"{one.verdict}: {one.line()}" for one in worse))
    elif changed and all(one.verdict == "disappeared" for one in members):
        ElementTree.SubElement(test, "skipped", message="disappeared")
    if changed:
        said = ElementTree.SubElement(test, "system-out")
        said.text = _text("\n".join(f"{one.verdict}: {one.line()}" for one in changed))


def _count(suite: ElementTree.Element) -> None:
    suite.set("tests", str(len(suite)))
    suite.set("failures", str(len(suite.findall("testcase/failure"))))
    suite.set("skipped", str(len(suite.findall("testcase/skipped"))))


def _text(text: str) -> str:
    return _FORBIDDEN.sub("\ufffd", text)


def write_junit(difference: Difference, path: Path) -> None:
    """Writes a comparison as JUnit XML.

    Raises:
        InputError: the file cannot be written.
    """
    write_text(path, junit(difference), named=True)
