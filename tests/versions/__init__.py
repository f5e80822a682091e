"""Whether oarlock does with other versions of MuJoCo what it does with the newest: ``python -m versions`` in tests/."""
