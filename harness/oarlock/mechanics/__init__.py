"""A MuJoCo model and one state of it: loading, rows, names, inertia, curvature, drives, reactions."""
