"""The page and the document of an examination."""
