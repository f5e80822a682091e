"""Folders that tests read."""

from pathlib import Path

TESTS = Path(__file__).parent
REPOSITORY = TESTS.parent
FIXTURES = TESTS / "fixtures"
