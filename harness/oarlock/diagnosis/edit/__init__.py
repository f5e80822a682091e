"""Copies of the file with changes, in which all else of the author's text stays as it is, byte for byte."""
