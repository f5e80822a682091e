"""``oarlock bench``: what solvers and steps cost."""
