"""``oarlock export``: a plain MJCF that readers of other engines get right."""
