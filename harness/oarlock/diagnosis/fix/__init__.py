"""One file with everything that helps a model, tried and verified."""
