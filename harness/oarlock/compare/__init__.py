"""``oarlock diff``: what changed between two folders of results."""
