"""``oarlock view``: MuJoCo's own motion in a browser, the exact one as a ghost, on one page that needs no net."""
