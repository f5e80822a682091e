"""Tables of measured figures for pages, from the published reports: no number is typed by hand."""

import json

from text import REPOSITORY, table

_SUMMARY = REPOSITORY / "reports" / "summary.json"

BOAT = (
    ("MuJoCo, default softness", "free-mujoco-rk4"),
    ("MuJoCo, stiff settings", "free-mujoco-stiff-rk4"),
    ("exact constraints, oarlock", "free-hard-pinv-rk4"),
    ("exact constraints, projected after every step", "free-hard-sr1-tracked-projection-rk4"),
)
"""What it is called here → the run."""


def _runs() -> dict[tuple[str, str], dict]:
    return {(row["case"], row["run"]): row for row in json.loads(_SUMMARY.read_text(encoding="utf-8"))["runs"]}


def boat() -> str:
    """How far the loops of the boat stand open in each run, and how far each is from the truth."""
    runs = _runs()
    rows = [(name, runs["boat", run]) for name, run in BOAT]
    cells = [[name, f"{row['drift_pos_max']:.2e} m", f"{row['truth_error_max']:.2e} rad"] for name, row in rows]
    titles = [
        "a rowing boat, 12 s, timestep 1 ms, Runge–Kutta",
        "loops stand open by",
        "crank's distance from the truth",
    ]
    return table(titles, cells)


TABLES = {"boat": boat}
"""Mark in a page → what writes the table."""
