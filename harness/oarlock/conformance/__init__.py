"""``oarlock conform`` and ``oarlock versions``: whether a loop means the same to other engines, and if not, why."""
