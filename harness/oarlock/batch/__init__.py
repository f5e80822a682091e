"""Many cases at once: units, workers, digests, resumption, and pages of suites and sweeps."""
