"""Questions of a state, the solvers that answer them, and both paths that step: native and Python."""
