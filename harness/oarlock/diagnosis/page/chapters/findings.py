"""The findings, the worst first, with what their codes mean."""

from collections.abc import Sequence

from oarlock.base.text import one_line as plain
from oarlock.diagnosis.page.blocks import Chapter, Code, Explanation, Findings, Item, Section, Text
from oarlock.diagnosis.page.chapters.words import counted
from oarlock.diagnosis.verdict.findings import FORMULA, SEVERITIES, Entry, Finding, catalogue, worst_first


def findings(found: Sequence[Finding]) -> Chapter:
    """The findings, in any order, as a chapter."""
    chapter, ordered = Chapter("findings", "Findings"), worst_first(found)
    chapter.say(f"{counts(ordered) or 'None'}.")
    if ordered:
        entries = catalogue()
        known = {code: _explanation(entries[code]) for code in dict.fromkeys(one.code for one in ordered)}
        items = tuple(_item(one, known[one.code]) for one in ordered)
        chapter.blocks.append(Findings(items, tuple(known.values())))
    return chapter


def counts(found: Sequence[Finding]) -> str:
    """How many there are of every severity, in words; empty where there are none."""
    by_severity = {severity: sum(one.severity == severity for one in found) for severity in SEVERITIES}
    return ", ".join(counted(count, severity) for severity, count in by_severity.items() if count)


def _item(one: Finding, explanation: Explanation) -> Item:
    name, element, place, line = map(plain, (one.name, one.element, one.place, one.line))
    return Item(one.severity, one.code, name, element, place, line, explanation)


def _explanation(entry: Entry) -> Explanation:
    parts = {"": entry.meaning, "How it is measured": entry.measured, "What to do": entry.remedy}
    sections = tuple(Section(heading, _blocks(prose)) for heading, prose in parts.items())
    return Explanation(entry.code, plain(entry.name), plain(entry.title), sections)


def _blocks(prose: str) -> tuple[Text | Code, ...]:
    """Paragraphs and formulas of an entry; lines of formulas that follow one another stand together."""
    blocks: list[Text | Code] = []
    for line in filter(str.strip, prose.splitlines()):
        if not line.startswith(FORMULA):
            blocks.append(Text(plain(line)))
        elif blocks and isinstance(blocks[-1], Code):
            blocks[-1] = Code(f"{blocks[-1].text}\n{line.strip()}", "text")
        else:
            blocks.append(Code(line.strip(), "text"))
    return tuple(blocks)
