"""A short attack stands: what ``make test-attack`` does for a quarter of an hour, for a minute."""

import sys

import pytest
from attack import endings


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_suites_that_are_ended_and_pairs_in_one_folder(capsys):
    assert endings.main(["--tries", "8", "--pairs", "4", "--seconds", "120"]) == 0, capsys.readouterr().out
