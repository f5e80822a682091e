"""``oarlock check``: why a loop comes apart, and what would hold it."""
