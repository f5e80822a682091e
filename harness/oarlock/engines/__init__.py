"""Other engines behind one file format: each answers the same question in a process and an environment of its own."""
