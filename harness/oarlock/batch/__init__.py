"""Many cases at once: units, workers, digests, resumption, and the pages of suites and sweeps."""
