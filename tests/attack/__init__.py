"""Attacks: scripts that try to break oarlock, in a bounded time and with a seed, so that what fell can be had again.

No tests: what an attack finds becomes one, in the room that it is about. ``make test-attack`` runs all of them.
"""
