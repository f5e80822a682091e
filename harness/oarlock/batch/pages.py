"""The reports of a suite: one page per case, made in parallel, and the summary. Unchanged pages are not made again."""

import re
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import write_text
from oarlock.base.hashing import of_document, of_file
from oarlock.base.progress import Progress
from oarlock.batch import digest
from oarlock.batch.workers import Workers, dispatch
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import NAME, Ledger

_BOOK = "pages.json"
_SOURCES = ("case.json", "summary.json", "sketch.json")
_DIRECT = ("README.md", "summary.json", "index.html")


@dataclass(frozen=True)
class Page:
    """Folders of results and the folder of their report.

    Its kind is the page of one ``case``, the ``summary`` of several cases, or the page of a ``sweep``.
    """

    name: str
    sources: tuple[Path, ...]
    target: Path
    kind: Literal["case", "summary", "sweep"] = "case"

    def inputs(self) -> str:
        """Computes the digest of what the page is made from."""
        made = [[*(of_file(path / name) for name in _SOURCES), _tables(path), path.name] for path in self.sources]
        return of_document([digest.presentation(), made, self.kind])

    def outputs(self) -> str:
        """Computes the digest of the files of the page."""
        files = [self.target / name for name in _DIRECT] + sorted((self.target / "figures").glob("*.svg"))
        return of_document([[path.name, of_file(path)] for path in files if path.is_file()])


def _tables(path: Path) -> Any:
    """Returns the fingerprints of a case's tables, its failures and the rows of its sweep."""
    ledger = Ledger.read(path)
    files = {name: mark for entry in ledger.entries.values() for name, mark in entry["files"].items()}
    failures = {name: str(failure) for name, failure in ledger.failures().items()}
    return [files, ledger.refused, failures, ledger.rows(sweep=True)]


def write_page(page: Page) -> str:
    """Makes a page; returns why it could not be made, or an empty text."""
    try:
        if page.kind == "summary":
            from oarlock.report.summary import write_summary

            write_summary(page.sources, page.target)
        elif page.kind == "sweep":
            from oarlock.report.sweep_report import write_sweep_report

            write_sweep_report(page.sources[0], page.target)
        else:
            from oarlock.report.case_report import write_report

            write_report(page.sources[0], page.target)
    except InputError as error:
        return one_line(error)
    except Exception as error:
        return one_line(f"{type(error).__name__}: {error}")
    return ""


def write_pages(
    out: Path, cases: Sequence[Path], report: Path, workers: Workers, progress: Progress, *, every: bool
) -> list[str]:
    """Writes the pages of some cases and the summary, as far as they would change.

    Args:
        out: folder of all results.
        cases: folders of results of the cases.
        report: folder of the summary, which gets one folder per page.
        workers: workers that make the pages.
        progress: is told of the progress.
        every: whether these are all cases; if not, the summary includes the other cases in ``out``.

    Returns:
        One line for every page that could not be written, with the reason.
    """
    singles = [Page(path.name, (path,), report / path.name) for path in cases if (path / "sketch.json").is_file()]
    others = [] if every else [path.parent for path in out.glob(f"*/{NAME}")]
    known = sorted({path for path in (*cases, *others) if (path / NAME).is_file()}, key=_order)
    failures = _make(out, singles, workers, progress)
    whole = [Page("summary", tuple(known), report, "summary")] if known else []
    return failures + _make(out, whole, workers, progress)


def write_sweep_pages(
    out: Path, sweeps: Sequence[Path], report: Path, workers: Workers, progress: Progress
) -> list[str]:
    """Writes the pages of sweeps beside those of their cases, as far as they would change. Other pages stay.

    Returns:
        One line for every page that could not be written, with the reason.
    """
    named = {f"{path.parent.name}-{path.name}": path for path in sweeps if (path / "summary.json").is_file()}
    return _make(out, [Page(name, (path,), report / name, "sweep") for name, path in named.items()], workers, progress)


def write_sweep_index(sweeps: Sequence[Path], report: Path) -> None:
    """Writes the page that leads to those of the sweeps beside it, README.md and index.html.

    Raises:
        InputError: it cannot be written, or the summary of a suite is there.
    """
    from oarlock.render.folder import require_same_page
    from oarlock.render.page import page
    from oarlock.render.template import render

    if (report / "summary.json").exists():
        raise InputError(f"'{report}' holds the report of a suite, expected a folder of its own for that of a sweep")
    documents = {f"{path.parent.name}-{path.name}": _summary(path) for path in sweeps}
    text = render("sweeps.md.j2", sweeps={name: one for name, one in documents.items() if one})
    require_same_page(report / "README.md", text)
    write_text(report / "README.md", text)
    write_text(report / "index.html", page("Sweeps", text, [], {}))


def _summary(sweep: Path) -> dict[str, Any] | None:
    try:
        return ResultFolder(sweep).read_json("summary.json")
    except InputError:
        return None


def _order(path: Path) -> tuple[str, list[tuple[str, float]]]:
    """Returns a sort key that puts variants after their model, by their parameters as numbers."""
    parameters = re.findall(r"-(\w+)=(-?[0-9.]+(?:e[-+]?[0-9]+)?)", path.name)
    return path.name.partition("-")[0], [(name, float(value)) for name, value in parameters]


def _make(out: Path, pages: list[Page], workers: Workers, progress: Progress) -> list[str]:
    book = _read_book(out)
    due = [page for page in pages if book.get(str(page.target.resolve())) != [page.inputs(), page.outputs()]]
    if not due:
        return []
    progress.begin("reporting", len(pages), len(pages) - len(due))
    failures = []
    make: Callable[[Page], str] = write_page
    with closing(dispatch(make, due, workers)) as all_done:
        for done in all_done:
            message = done.result if done.error is None else one_line(str(done.error))
            key = str(done.item.target.resolve())
            if message:
                failures.append(f"{done.item.name}: {message}")
                book.pop(key, None)
            else:
                book[key] = [done.item.inputs(), done.item.outputs()]
            ResultFolder(out).write_json(_BOOK, book)
            progress.advance(1)
            progress.finished(f"{done.item.target / 'README.md'}", None, message)
    return failures


def _read_book(out: Path) -> dict[str, Any]:
    try:
        return ResultFolder(out).read_json(_BOOK)
    except InputError:
        return {}
