"""The progress bar of every command that has one."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from oarlock.base.progress import Progress
from oarlock.base.text import visible
from oarlock.cli.console import console, say, text_only


class _Bar(Progress):
    """One bar, and a line for everything that is finished."""

    def __init__(self, bars: Bars):
        self._bars = bars
        self._task = bars.add_task("")

    def begin(self, what: str, total: int, kept: int = 0) -> None:
        self._bars.reset(self._task, description=what, total=total, completed=kept)
        if kept:
            self._print(f"{what}: {kept} of {total} kept from before")

    def advance(self, count: int) -> None:
        self._bars.advance(self._task, count)

    def finished(self, label: str, seconds: float | None = None, message: str = "") -> None:
        took = "" if seconds is None else f"  {seconds:.1f} s"
        self._print(f"  {label}{took}" + (f"  [{message}]" if message else ""))

    def note(self, text: str) -> None:
        self._print(f"oarlock: {text}")

    def _print(self, text: str) -> None:
        self._bars.console.print(visible(text), highlight=False, markup=False, soft_wrap=True)


class _Notes(Progress):
    """What is worth knowing, and nothing else."""

    def note(self, text: str) -> None:
        say(f"oarlock: {text}")


@contextmanager
def bar(*, always: bool = False, quiet: bool = False) -> Iterator[Progress]:
    """A progress bar on standard error, where somebody looks at one; elsewhere its lines if ``always``, or notes.

    Nothing of that if ``quiet``.
    """
    if quiet:
        yield Progress()
        return
    stream = console(error=True)
    watched = stream.is_terminal and not text_only()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    times = (TimeElapsedColumn(), TimeRemainingColumn())
    with Bars(*columns, *times, console=stream, transient=True, disable=not watched) as bars:
        yield _Bar(bars) if always or watched else _Notes()
