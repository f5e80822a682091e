"""One program per engine. Each is a script of its own, which ``launch.py`` runs; oarlock imports none of them."""
