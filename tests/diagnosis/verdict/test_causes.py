"""The words for causes: of every cause that the row law tells apart, in its order, with codes that there are."""

from oarlock.diagnosis.runs.row_law import CAUSES
from oarlock.diagnosis.verdict.causes import CAUSE, IMPLICIT
from oarlock.diagnosis.verdict.findings import catalogue


def test_every_cause_has_its_words():
    assert tuple(CAUSE) == CAUSES
    titles = [cause.title for cause in CAUSE.values()]
    assert len(set(titles)) == len(titles)
    codes = [cause.code for cause in (*CAUSE.values(), IMPLICIT)]
    assert len(set(codes)) == len(codes)
    assert set(codes) <= set(catalogue())
