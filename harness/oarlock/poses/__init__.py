"""A model reduced to its loops, and the closed pose nearest to a given one."""
