"""The ground floor: errors, files, hashing, arrays, options and the compiled core. Knows neither MuJoCo nor cases."""
