"""What every reference.py does: integrates an equation of motion, and writes the table. No MuJoCo, no oarlock."""

import csv
import hashlib
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

RTOL, ATOL = 1e-13, 1e-14

JOINT = ["time", "position", "velocity", "acceleration"]
SITE = ["time", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"]

SUMS = "reference.sha256"
"""Beside the tables: sums of the script, of this file and of the tables they made. ``sha256sum --check`` takes it."""


def grid(duration, interval):
    """Times (s) from 0 to a duration, at equal intervals."""
    return np.arange(round(duration / interval) + 1) * interval


def integrate(rates, start, times, rtol=RTOL, atol=ATOL):
    """States (n, times) of ẏ = rates(t, y) at the times (s), from a start (n) at 0, by DOP853."""
    return solve_ivp(rates, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=rtol, atol=atol).y


def integrate_second(acceleration, start, times, rtol=RTOL, atol=ATOL):
    """Place and rate, (2, times), of ẍ = acceleration(t, x, ẋ) at the times (s), as ``integrate``."""
    return integrate(lambda t, y: (y[1], acceleration(t, y[0], y[1])), start, times, rtol, atol)


def write(script, what, decimals, times, rows, name="reference.csv", atol=ATOL):
    """Writes a table beside the script that makes it, and then the sums.

    Args:
        script: path of the script.
        what: of which equations, for the first line.
        decimals: of the times.
        times: of the rows, s.
        rows: place, velocity and acceleration at each time: three numbers of a joint, or nine of a site.
        name: of the table.
        atol: absolute tolerance of the integration, for the first line.
    """
    script, rows = Path(script), [list(row) for row in rows]
    with script.with_name(name).open("w", encoding="utf-8", newline="") as file:
        file.write(f"# {what}, DOP853, rtol {RTOL:g}, atol {atol:g}; made by reference.py\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(JOINT if len(rows[0]) == 3 else SITE)
        for time, row in zip(times, rows, strict=True):
            writer.writerow([f"{time:.{decimals}f}", *(f"{value:.16g}" for value in row)])
    sums = "".join(f"{digest}  {path}\n" for path, digest in sums_of(script).items())
    script.with_name(SUMS).write_text(sums, encoding="utf-8")


def sums_of(script):
    """Path from the script's folder → SHA-256: the script, this file, and the tables beside the script."""
    folder = script.parent
    tables = sorted(path.name for path in folder.glob("reference*.csv"))
    names = [script.name, f"../{Path(__file__).name}", *tables]
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}
