"""Cases as they are written down: their files, parameters, points of a sweep, and outside truths."""
