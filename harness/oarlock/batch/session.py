"""Many cases from planning to pages: what ``oarlock.suite`` and ``oarlock.sweep`` are."""

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from oarlock.base.arguments import require_count, require_number
from oarlock.base.cores import cores
from oarlock.base.errors import InputError, few
from oarlock.base.forks import require_threads
from oarlock.base.lock import locked
from oarlock.base.progress import Progress
from oarlock.base.scratch import sweep_up
from oarlock.batch.suite import Suite, Sweep, carry_out, plan_suite, refuse_others
from oarlock.batch.sweep import Axis, parse_axes
from oarlock.batch.workers import UNIT_TIMEOUT_S, LocalWorkers, Workers

RESULTS = Path("results")
"""Folder of the results unless another is given."""


def suite(
    models: Sequence[str | Path] | str | Path = (),
    *,
    out: str | Path = RESULTS,
    report: str | Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    unit_timeout: float = UNIT_TIMEOUT_S,
    progress: Progress | None = None,
) -> Suite:
    """Runs the experiments of many models, in parallel; resumes where it stopped, and repeats only what changed.

    Runs go to processes of their own, which import the calling script again: call this below
    ``if __name__ == "__main__":`` where it stands in a script.

    Args:
        models: models, variants or MJCF files; every model with its variants if there are none.
        out: folder for the results, a folder a model; what is there is kept.
        report: folder for the report; None: none is written.
        jobs: runs at once; one a core if left out.
        scheduler: address of a dask.distributed scheduler to run on, or ``local`` for a cluster of processes here.
        fresh: do everything anew, also what is finished.
        unit_timeout: time that a run may be in work without a step, s, before its worker is ended and it is done once
            more elsewhere; 0 for ever.
        progress: listens.

    Raises:
        InputError: no such model, two of one name, results that cannot be written, or a folder of them that is in use
            or holds those of another run. A case that is at fault is
            refused by itself.
    """
    return _carried_out(_several(models), (), out, report, jobs, scheduler, fresh, unit_timeout, progress)


def sweep(
    models: Sequence[str | Path] | str | Path,
    axes: Sequence[str] | str,
    *,
    out: str | Path = RESULTS,
    report: str | Path | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    fresh: bool = False,
    unit_timeout: float = UNIT_TIMEOUT_S,
    progress: Progress | None = None,
) -> Sweep:
    """Runs models freely at every point of a sweep instead of their experiments; otherwise as ``suite``.

    Args:
        models: models, variants or MJCF files; every model with its variants if there are none.
        axes: ``KEY=A:B:N``, one or several, which make a grid: N values from A to B of ``timestep`` or ``solref``
            (MuJoCo's time constant of the equalities), in s and spaced geometrically; of a parameter of the model;
            or of ``seed``, which disturbs the start.
        out: folder for the results, a folder a model; what is there is kept.
        report: folder for the report; None: none is written.
        jobs: runs at once; one a core if left out.
        scheduler: address of a dask.distributed scheduler to run on, or ``local`` for a cluster of processes here.
        fresh: do everything anew, also what is finished.
        unit_timeout: time that a run may be in work without a step, s, before its worker is ended and it is done once
            more elsewhere; 0 for ever.
        progress: listens.

    Raises:
        InputError: as ``suite``, or a sweep that none of the models can have.
    """
    parsed = parse_axes([axes] if isinstance(axes, str) else axes)
    if not parsed:
        raise InputError("nothing to sweep, expected KEY=A:B:N")
    found = _carried_out(_several(models), parsed, out, report, jobs, scheduler, fresh, unit_timeout, progress)
    assert isinstance(found, Sweep)
    return found


def _several(models: Sequence[str | Path] | str | Path) -> list[str]:
    return [str(models)] if isinstance(models, str | Path) else [str(model) for model in models]


def _carried_out(
    models: list[str],
    axes: tuple[Axis, ...],
    out: str | Path,
    report: str | Path | None,
    jobs: int | None,
    scheduler: str | None,
    fresh: bool,
    unit_timeout: float,
    progress: Progress | None,
) -> Suite:
    require_threads()
    require_number("unit_timeout", unit_timeout, unit="s")
    limit = unit_timeout or None
    progress = progress or Progress()
    found = plan_suite(models, Path(out), axes)
    if isinstance(found, Sweep):
        for name, lacking in found.skipped.items():
            progress.note(f"skipped: {name} has no parameter {few(lacking)}")
    folders = [Path(out), *(member.folder.path for member in found.members if not member.refused)]
    with (
        locked(folders, "oarlock suite", progress.note),
        workers_of(jobs, scheduler, limit, progress) as (units, pages),
    ):
        refuse_others(found)
        if left := sweep_up([*folders, *_inside(folders), *_pages(report)]):
            progress.note(left)
        carry_out(found, units, fresh=fresh, progress=progress)
        if report is not None:
            found.unwritten = found.write_pages(Path(report), pages, progress)
    return found


def _inside(folders: Sequence[Path]) -> list[Path]:
    return [folder / "steps" for folder in folders]


def _pages(report: str | Path | None) -> list[Path]:
    return [] if report is None else [Path(report).absolute().parent, Path(report)]


@contextmanager
def workers_of(
    jobs: int | None, scheduler: str | None, limit_s: float | None, progress: Progress
) -> Iterator[tuple[Workers, Workers]]:
    """Who does the units and who makes the pages, which are files here.

    Args:
        jobs: units at once; one a core if left out.
        scheduler: address of a dask.distributed scheduler, or ``local``; None for processes of this machine.
        limit_s: time that a unit may be in work without a beat of its pulse, s; None for ever.
        progress: is told of what is worth knowing.
    """
    require_count("jobs", jobs)
    if scheduler is None:
        with closing(LocalWorkers(jobs or cores(), limit_s)) as local:
            yield local, local
        return
    from oarlock.batch.cluster import LOCAL, Cluster

    units = Cluster(scheduler, jobs or (cores() if scheduler == LOCAL else None), progress.note, limit_s)
    with closing(LocalWorkers(cores(), limit_s)) as pages, closing(units):
        yield units, pages
