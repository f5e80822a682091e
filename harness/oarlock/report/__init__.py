"""Reports of results: pure functions from a folder of tables to a page."""
