"""The chapters of an examination: each a function from the examination to its sentences and tables."""
