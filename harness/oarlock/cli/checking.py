"""One file of ``oarlock check``: what is printed and written of it, and what is kept for the documents of all."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oarlock.base.errors import InputError, one_line
from oarlock.cli.console import BAD_INPUT, GATE_FAILED, say
from oarlock.diagnosis.checked import begun, judged, parts
from oarlock.diagnosis.options import CheckOptions

if TYPE_CHECKING:
    from oarlock.base.junit import TestSuite
    from oarlock.diagnosis.checked import Checked
    from oarlock.diagnosis.examined import Examination


@dataclass(frozen=True)
class Asked:
    """What is asked for of every file.

    Attributes:
        options: of the examination.
        copies: flag → the copy that it asks for, of ``--write-keyframe``, ``--write-tuned`` and ``--fix``.
        printing: whether standard output is for people.
        quiet: whether progress is left out.
        documents: which documents of all files are wanted: ``json``, ``sarif``, ``junit``.
    """

    options: CheckOptions
    copies: Mapping[str, Path]
    printing: bool
    quiet: bool
    documents: frozenset[str]


@dataclass(frozen=True)
class Outcome:
    """What became of a file.

    Attributes:
        file: as it was given.
        status: exit status of it alone.
        verdict: in a line.
        refused: why it could not be checked; empty: it was.
        json, sarif, suite: its parts of the documents, as far as they are wanted.
    """

    file: str
    status: int
    verdict: str
    refused: str = ""
    json: dict[str, Any] | None = None
    sarif: tuple[dict[str, Any], ...] = ()
    suite: "TestSuite | None" = None


def refused(file: str, why: InputError | OSError) -> Outcome:
    """The outcome of a file that cannot be checked."""
    from oarlock.diagnosis.page.junit import suite_of_refused

    said = one_line(why)
    document = {"file": file, "refused": said}
    return Outcome(
        file,
        BAD_INPUT,
        f"{file}: refused: {said.removeprefix(f'{file}: ')}",
        said,
        document,
        suite=suite_of_refused(file, said),
    )


def checked_file(file: str, asked: Asked, report: Path | None) -> Outcome:
    """Checks a file; prints what it is about, and writes its copies and its report.

    Raises:
        InputError: as ``oarlock.check``, or a place cannot be written to.
    """
    exam = begun(file, asked.options)
    _require_places(exam, list(asked.copies.values()))
    checked = _examined(exam, asked.quiet)
    if asked.printing:
        _print(checked)
    writers: dict[str, Callable[[Path], bool]] = {
        "--write-keyframe": lambda path: _write_keyframe(exam, path),
        "--write-tuned": lambda path: _write_tuned(exam, path),
        "--fix": lambda path: _fix(checked, path, asked.printing),
    }
    kept = [_written(path, writers[flag]) for flag, path in asked.copies.items()]
    if report:
        say(f"oarlock: written: {checked.report(report)}")
    wrong = asked.options.lint and any(finding.severity == "error" for finding in checked.verdict)
    above = [finding for finding in checked.verdict if finding.code == "D7"]
    if above:
        say(f"oarlock: {above[0]}")
    status = GATE_FAILED if wrong or above or not all(kept) else 0
    return Outcome(file, status, _verdict(file, checked), **_documents(checked, asked.documents))


def _documents(checked: "Checked", wanted: frozenset[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if "json" in wanted:
        found["json"] = checked.document()
    if "sarif" in wanted:
        from oarlock.diagnosis.page.sarif import sarif_results

        found["sarif"] = tuple(sarif_results(checked.examination, checked.verdict))
    if "junit" in wanted:
        from oarlock.diagnosis.page.junit import suite_of

        found["suite"] = suite_of(checked.examination.file, checked.verdict)
    return found


def _verdict(file: str, checked: "Checked") -> str:
    from oarlock.diagnosis.page.chapters.findings import counts

    return f"{file}: {counts(checked.verdict) or 'nothing found'}; {checked.answer}"


def _examined(exam: "Examination", quiet: bool) -> "Checked":
    from oarlock.cli.bar import bar
    from oarlock.diagnosis.examination import PARTS

    with bar(quiet=quiet) as progress:
        progress.begin("checking", len(PARTS))
        for _ in parts(exam):
            progress.advance(1)
        return judged(exam)


def _print(checked: "Checked") -> None:
    """The answer first; what it rests on after it."""
    from oarlock.cli.blocks import print_chapter, print_line
    from oarlock.diagnosis.page.chapters.contents import chapters
    from oarlock.diagnosis.page.chapters.findings import findings
    from oarlock.diagnosis.page.chapters.head import head

    exam = checked.examination
    print_line(checked.answer)
    print_line(head(exam))
    print_chapter(findings(checked.verdict))
    if not exam.options.lint:
        for chapter in chapters(exam):
            print_chapter(chapter)


def _require_places(exam: "Examination", paths: Sequence[Path]) -> None:
    """Refuses files that cannot be written before anything takes time."""
    if paths:
        from oarlock.diagnosis.edit.place import require_place

        for path in paths:
            require_place(exam.path, path)


def _written(target: Path, write: Callable[[Path], bool]) -> bool:
    """Says whether a copy holds what it should; the report and the JSON are had without it, too."""
    try:
        return write(target)
    except InputError as error:
        say(f"oarlock: '{target}' is not written: {error}")
        return False


def _write_keyframe(exam: "Examination", target: Path) -> bool:
    from oarlock.diagnosis.edit.keyframe import source_key, write_keyframe

    pose = exam.pose
    if pose is None or not pose.closed:
        raise InputError("no pose near the start closes the loops")
    name = write_keyframe(exam.path, target, pose.qpos, pose.qvel, like=source_key(exam.model, exam.options.keyframe))
    say(f"oarlock: written: {target}: keyframe '{name}'")
    return True


def _write_tuned(exam: "Examination", target: Path) -> bool:
    """Says whether the settings hold the target; the best ones are written anyway."""
    from oarlock.diagnosis.edit.tuned import write_tuned

    recipe = exam.recipe
    if recipe is None:
        raise InputError(exam.missing.get("remedy", "no settings were looked for"))
    for path in write_tuned(exam.path, target, recipe.chosen.setting):
        say(f"oarlock: written: {path}")
    if not recipe.reached:
        say(f"oarlock: warning: {target} does not hold {recipe.target:g}: {recipe.reason}")
    return recipe.reached


def _fix(checked: "Checked", target: Path, printing: bool) -> bool:
    """Says whether the fixed file holds what it should."""
    from oarlock.cli.blocks import print_line

    fixed = checked.fix(target)
    if printing:
        print_line(f"Fixed: {target}" if fixed.reached else f"Not fixed: {target}")
        for line in fixed.told():
            print_line(line)
    else:
        say(f"oarlock: written: {target}")
    if not fixed.reached:
        say(f"oarlock: warning: {target}: {fixed.reason}")
    return fixed.reached
