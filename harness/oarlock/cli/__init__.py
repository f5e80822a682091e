"""The command ``oarlock``: flags, terminal, exit status. Nobody imports it."""
