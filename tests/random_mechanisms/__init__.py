"""Random closed-chain mechanisms whose rank is known, an oracle of many digits, and a judge of solvers on them."""
