"""Reports of results: pure functions from folders of results to pages."""
