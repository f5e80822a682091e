"""What a folder of results holds besides the runs that are about to be written to it: nothing of that may be lost."""

from collections.abc import Collection, Iterator
from itertools import count
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError, few
from oarlock.tables.folder import ResultFolder
from oarlock.tables.ledger import NAME as LEDGER


def others(
    folder: Path,
    case: str,
    runs: Collection[str],
    timestep_s: float,
    steps: int,
    ignored: str | None,
    motion: str | None = None,
) -> str:
    """Says what a folder holds that the runs of a case would not write anew.

    Args:
        folder: folder of results, which need not exist.
        case: name of the case.
        runs: names of the runs.
        timestep_s: their timestep, s.
        steps: number of their steps.
        ignored: what of the model they ignore; None for nothing.
        motion: where they start and what drives them, in words; None: as the case says.

    Returns:
        What it is, in words; empty if nothing there would be lost.
    """
    if (folder / LEDGER).exists():
        return "the results of a suite"
    tables = [path.stem for path in sorted((folder / "steps").glob("*.parquet"))]
    rows, provenance = _summary(folder)
    if rows and provenance.get("case", case) != case:
        return f"runs of case '{provenance['case']}'"
    if missing := [name for name in (*(str(row.get("run")) for row in rows), *tables) if name not in runs]:
        return f"other runs, {few(list(dict.fromkeys(missing)), most=1)}"
    for row in rows:
        if row.get("timestep_s") != timestep_s or row.get("steps") != steps:
            return f"runs of {row.get('steps')} steps of {row.get('timestep_s')} s"
    if rows and provenance.get("inequalities_ignored") != ignored:
        return "runs with" + ("" if ignored else "out") + " contacts, limits and friction"
    if rows and provenance.get("motion") != motion:
        return "runs from another start or with other controls"
    return ""


def _summary(folder: Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The rows and the provenance of a summary; none where it cannot be read."""
    try:
        document = ResultFolder(folder).read_json("summary.json")
        rows, provenance = document["runs"], document["provenance"]
        if all(isinstance(row, dict) for row in rows) and isinstance(provenance, dict):
            return rows, provenance
    except (InputError, KeyError, TypeError):
        pass
    return [], {}


def beside(folder: Path) -> Iterator[Path]:
    """Yields a folder and those that may stand in for it: ``boat``, ``boat-2``, ``boat-3`` and so on."""
    yield folder
    for number in count(2):
        yield folder.with_name(f"{folder.name}-{number}")
