"""A short comparison of the boat on the native path, for a run under a memory checker."""

from oarlock import run
from oarlock.stepping import native_path

refusal = native_path.refusal()
assert not refusal, refusal
for mode in ("lockstep", "one-step", "free"):
    results = run(
        "boat",
        mode=mode,
        form="both",
        solver=["auto", "sr1-tracked"],
        stabilisation="both",
        duration=0.02,
        stepping="native",
    )
    assert all(row["steps_done"] == 20 for row in results.rows)
