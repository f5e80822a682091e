"""A MuJoCo model and one state of it: loading, names, rows, inertia, curvature, drives and reactions."""
