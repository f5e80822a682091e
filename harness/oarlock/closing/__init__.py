"""``oarlock close``: loops closed in an open tree, by equalities between two of its points."""
