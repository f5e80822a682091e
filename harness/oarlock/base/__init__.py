"""Ground that knows neither MuJoCo nor cases: errors, files, hashing, arrays, options, and the compiled core."""
