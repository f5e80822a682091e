"""The results of a folder, as reports ask for them."""

from typing import Any

import polars as pl

from oarlock.base.errors import InputError
from oarlock.base.text import version_numbers
from oarlock.cases.equality_kinds import KINDS
from oarlock.report import figures
from oarlock.tables.folder import ResultFolder


class Tables:
    """The results of a folder, as the template and the figures need them."""

    def __init__(self, folder: ResultFolder):
        self.folder = folder
        self.case = folder.read_json("case.json")
        self.sketch = folder.read_json("sketch.json")
        summary = folder.read_json("summary.json")
        missing = [key for key in ("runs", "gates", "provenance") if key not in summary]
        if missing:
            raise InputError(
                f"'{folder.path / 'summary.json'}' has no '{missing[0]}', expected what 'oarlock run' wrote"
            )
        self.rows: list[dict[str, Any]] = summary["runs"]
        self.gates: list[dict[str, Any]] = summary["gates"]
        self.provenance: dict[str, Any] = summary["provenance"]
        if not self.rows:
            raise InputError(f"'{folder.path}' holds no finished run, expected at least one")

    def pick(self, **where: str) -> dict[str, Any] | None:
        """Returns the first run with these values, or None. Of several integrators the case's own comes first."""
        own = self.case["run"]["integrator"]
        return min(self.all(**where), key=lambda row: row["integrator"] != own, default=None)

    def all(self, **where: str) -> list[dict[str, Any]]:
        """Returns all runs with these values but those that diverged: what they showed before proves nothing."""
        kept = [row for row in self.rows if row["status"] != "diverged"]
        return [row for row in kept if all(row[key] == value for key, value in where.items())]

    @property
    def unit(self) -> str:
        """Unit of the loops' deviations."""
        units = {equality["unit"] for equality in self.case["model"]["equalities"]}
        return units.pop() if len(units) == 1 else "m or rad"

    @property
    def rate_unit(self) -> str:
        """Unit of the rates of the loops' deviations."""
        return {"m": "m/s", "rad": "rad/s"}.get(self.unit, "m/s or rad/s")

    @property
    def without_curvature(self) -> list[str]:
        """Names of the equalities for which MuJoCo's reference acceleration leaves J̇v out."""
        version = self.provenance.get("mujoco", "4.0.0")  # a folder that does not tell is of oarlock's first
        lacking = {kind.name for kind in KINDS if kind.lacks_curvature(version_numbers(version))}
        return [equality["name"] for equality in self.case["model"]["equalities"] if equality["kind"] in lacking]

    def free_runs(self) -> dict[str, dict[str, Any]]:
        """The free runs that figures compare, as far as there are any: MuJoCo default, MuJoCo stiff, exact."""
        candidates = {
            "MuJoCo default": self.pick(mode="free", solver="mujoco", settings="default"),
            "MuJoCo stiff": self.pick(mode="free", solver="mujoco", settings="stiff"),
            "exact (pinv)": self.pick(mode="free", solver="pinv", form="hard"),
        }
        return {who: row for who, row in candidates.items() if row is not None}

    @property
    def knows_truth(self) -> bool:
        """Whether any run was compared with an outside truth."""
        return any(row["truth_error_max"] is not None for row in self.rows)

    @property
    def truth_unit(self) -> str:
        """Unit of the distance from the truth, which is about a joint or about the place of a site."""
        joint = self.case["truth"]["joint"] if self.case["truth"] else None
        return next((c["unit"] for c in self.case["model"]["coordinates"] if c["name"] == joint), "m")

    def steps(self, row: dict[str, Any], *columns: str) -> pl.DataFrame:
        """Returns columns of the steps of a run, condensed if it is long."""
        with self.folder.scanning(row["run"]) as table:
            return figures.condensed(table.select("step", *columns), row["steps_done"])

    def counted(self, row: dict[str, Any], column: str) -> pl.DataFrame:
        """Counts the steps with each value of a column, in the column ``len``."""
        with self.folder.scanning(row["run"]) as table:
            return table.group_by(column).len().collect(engine="streaming")
