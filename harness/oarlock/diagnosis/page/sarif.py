"""The findings of several models as SARIF 2.1.0, which code hosts show beside the lines of a file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from oarlock.base.core import VERSION
from oarlock.base.errors import InputError
from oarlock.diagnosis.edit.document import Document
from oarlock.diagnosis.edit.places import line_of, place_of
from oarlock.diagnosis.examined import Examination
from oarlock.diagnosis.verdict.findings import Entry, Finding, catalogue

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def sarif(results: Sequence[dict[str, Any]], refused: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """The document of a run.

    Args:
        results: of ``sarif_results``, of all models.
        refused: files that could not be checked, and why.
    """
    rules = list(dict.fromkeys(result["ruleId"] for result in results))
    entries = catalogue()
    notifications = [
        {"level": "error", "message": {"text": why}, "locations": [_location(Path(file))]} for file, why in refused
    ]
    return {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {"name": "oarlock", "version": VERSION, "rules": [_rule(entries[code]) for code in rules]}
                },
                "columnKind": "utf16CodeUnits",
                "invocations": [{"executionSuccessful": not refused, "toolExecutionNotifications": notifications}],
                "results": [{**result, "ruleIndex": rules.index(result["ruleId"])} for result in results],
            }
        ],
    }


def sarif_results(exam: Examination, findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """A result a finding, with the line of its element where the element stands in a file."""
    try:
        document = None if exam.path.suffix == ".py" else Document(exam.path)
    except InputError:
        document = None
    results = []
    for finding in findings:
        place = place_of(document, exam.model, finding.element) if document and finding.element else None
        location = _location(place.file.path, line_of(place)) if place else _location(exam.path)
        if finding.element:
            location["logicalLocations"] = [{"name": finding.element, "kind": "element"}]
        said = f"{finding.name}: {finding.element + ': ' if finding.element else ''}{finding.line}"
        results.append(
            {
                "ruleId": finding.code,
                "level": finding.severity,
                "message": {"text": said},
                "locations": [location],
                "partialFingerprints": {"codeAndElement/v1": f"{finding.code} {finding.element}".strip()},
            }
        )
    return results


def _rule(entry: Entry) -> dict[str, Any]:
    return {
        "id": entry.code,
        "name": entry.name,
        "shortDescription": {"text": entry.title},
        "fullDescription": {"text": entry.meaning},
        "help": {"text": entry.remedy},
        "defaultConfiguration": {"level": entry.severity},
    }


def _location(path: Path, line: int | None = None) -> dict[str, Any]:
    """A line of a file, named from the working folder where it lies in that."""
    absolute = path.resolve()
    here = Path.cwd().resolve()
    within = absolute.is_relative_to(here)
    artifact = _relative(absolute.relative_to(here)) if within else {"uri": absolute.as_uri()}
    region = {"region": {"startLine": line}} if line is not None else {}
    return {"physicalLocation": {"artifactLocation": artifact, **region}}


def _relative(path: Path) -> dict[str, str]:
    return {"uri": quote(path.as_posix()), "uriBaseId": "%SRCROOT%"}
