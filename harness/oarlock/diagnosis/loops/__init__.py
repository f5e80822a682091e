"""What the mechanism is, at one pose: its loops, rows, ranks, reactions."""
