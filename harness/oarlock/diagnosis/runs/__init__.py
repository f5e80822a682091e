"""What short runs show: recordings, the exact solution, trials, and the settings that hold a loop."""
