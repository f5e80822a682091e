"""The questions that a state asks, the solvers that answer them, and both paths that step: native and Python."""
