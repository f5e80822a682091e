"""The chapters: what they consist of, what a terminal gets of them, and that each is there with its part."""

import dataclasses

import numpy as np
import pytest
from oarlock.base.numbers import figure
from oarlock.diagnosis.beginning import begin
from oarlock.diagnosis.examination import PARTS, examine
from oarlock.diagnosis.options import CheckOptions
from oarlock.diagnosis.page.blocks import Chapter, Code, Findings, Picture, Table, Text
from oarlock.diagnosis.page.chapters.contents import CHAPTERS, chapters
from oarlock.diagnosis.page.chapters.findings import findings
from oarlock.diagnosis.page.chapters.forces import forces
from oarlock.diagnosis.page.chapters.remedy import remedy
from oarlock.diagnosis.page.document import document, largest
from oarlock.diagnosis.runs.walking import End
from oarlock.diagnosis.verdict.findings import catalogue
from oarlock.diagnosis.verdict.findings import found as finding
from places import FIXTURES

GRIPPER = FIXTURES / "check" / "gripper_2f" / "gripper_2f.xml"


@pytest.fixture(scope="module")
def gripper():
    """An examination whose exact run ends early, and the chapters that were made on the way."""
    exam = begin(str(GRIPPER), CheckOptions(budget=1.0, controls="random"))
    early = {part: CHAPTERS[part](exam) for part in examine(exam)}
    return exam, early


def texts(chapter, *, detail):
    return [block.text for block in chapter.blocks if isinstance(block, Text) and block.detail == detail]


def tables(chapter):
    return {block.name: block for block in chapter.blocks if isinstance(block, Table)}


def columns(table):
    """Column → its cells."""
    return {name: [row[place] for row in table.rows] for place, name in enumerate(table.head)}


# Blocks.


def test_what_comes_into_a_chapter_is_plain():
    chapter = Chapter("x", "X")
    chapter.say("a\nb")
    chapter.explain("c\u202ed")
    chapter.table("t", ("name", "value"), [("e\x1b[1m", "1")], short=Table("t", ("name",), [("f\x07",)]))
    said, explained, table = chapter.blocks
    assert (said, explained) == (Text("a b"), Text("c\\u202ed", detail=True))
    assert isinstance(table, Table)
    assert table.short is not None
    assert (table.rows, table.short.rows) == ([("e\\x1b[1m", "1")], [("f\\x07",)])


def test_a_short_table_may_be_some_of_the_columns():
    chapter = Chapter("x", "X")
    chapter.table("t", ("a", "b", "c"), [("1", "2", "3"), ("4", "5", "6")], words=2, short=("c", "a"))
    chapter.table("none", ("a",), [])
    (table,) = chapter.blocks
    assert isinstance(table, Table)
    assert table.short == Table("t", ("c", "a"), [("3", "1"), ("6", "4")], 2)


def test_figures_stand_before_the_first_table():
    chapter, drawing = Chapter("x", "X"), Picture(None)  # pyright: ignore[reportArgumentType]
    chapter.say("first")
    chapter.table("t", ("a",), [("1",)])
    chapter.table("u", ("a",), [("1",)])
    chapter.illustrate([drawing])
    assert [block.kind for block in chapter.blocks] == ["text", "picture", "table", "table"]
    bare = Chapter("y", "Y")
    bare.say("only")
    bare.illustrate([drawing])
    assert [block.kind for block in bare.blocks] == ["text", "picture"]


# All of them.


def test_every_part_has_its_chapter_in_order(gripper):
    exam, early = gripper
    assert tuple(CHAPTERS) == PARTS == tuple(early)
    every = chapters(exam)
    assert [chapter.number for chapter in every] == [1, 2, 3, 4, 5, 6]
    assert [chapter.heading for chapter in every][2] == "3. Drift"
    for chapter in every:
        assert texts(chapter, detail=False)
        for table in tables(chapter).values():
            for one in (table, table.short):
                assert one is None or {len(row) for row in one.rows} == {len(one.head)}


def test_a_terminal_gets_the_same_as_soon_as_a_part_is_there(gripper):
    """What is not known yet when a chapter is printed is nothing that a terminal prints."""
    exam, early = gripper
    for late in chapters(exam):
        soon = next(chapter for chapter in early.values() if chapter.name == late.name)
        assert texts(soon, detail=False) == texts(late, detail=False)
        shorts = [
            {name: table.short for name, table in tables(chapter).items() if table.short} for chapter in (soon, late)
        ]
        assert shorts[0] == shorts[1]
        assert shorts[0] or late.name == "start"  # a consistent start has nothing to list


def test_short_tables_have_the_figures_of_the_whole_ones(gripper):
    exam, _ = gripper
    by_name = {name: table for chapter in chapters(exam) for name, table in tables(chapter).items()}
    whole, short = columns(by_name["drift"]), columns(by_name["drift"].short)
    shown = dict(zip(short["equality"], short["m"], strict=True))
    for name, level, value in zip(whole["equality"], whole["level"], whole["MuJoCo"], strict=True):
        if level == "position" and value != "–":
            assert value == f"{shown[name]} m"
    assert columns(by_name["causes"])["off by"] == columns(by_name["causes"].short)["worst row"]
    whole, short = columns(by_name["forces"]), columns(by_name["forces"].short)
    assert all(whole[name] == short[name] for name in ("equality", "what", "MuJoCo", "exact"))
    trials = by_name["trials"].short
    assert trials is not None
    assert len(trials.rows) == len(exam.recipe.trials)


# Single ones.


def test_forces_are_compared_until_the_exact_run_ends(gripper):
    exam, _ = gripper
    steps = exam.recording.steps // 3
    cut = dataclasses.replace(
        exam.exact, time=exam.exact.time[:steps], end=End("refused", exam.exact.time[steps], "cut")
    )
    exam = dataclasses.replace(exam, exact=cut)
    table = columns(tables(forces(exam))["forces"])
    for name, what, whole, until in zip(
        table["equality"], table["what"], table["MuJoCo"], table["MuJoCo until then"], strict=True
    ):
        if what == "|force|":
            (given,) = [one for one in exam.given if one.equality == name]
            assert whole == figure(largest(given.total.force), "N")
            assert until == figure(largest(given.total.force[:steps]), "N")
    finished = dataclasses.replace(exam, exact=None)
    assert "MuJoCo until then" not in columns(tables(forces(finished))["forces"])


def test_forces_of_the_page_are_those_of_the_document(gripper):
    exam, _ = gripper
    rows = document(exam, [])["forces"]
    table = columns(tables(forces(exam))["forces"])
    for engine, column in (("mujoco", "MuJoCo"), ("exact", "exact")):
        told = {row["equality"]: figure(row["force_max_n"], "N") for row in rows if row["engine"] == engine}
        shown = {
            name: cell
            for name, what, cell in zip(table["equality"], table["what"], table[column], strict=True)
            if what == "|force|"
        }
        assert len(shown) == 2
        assert shown.items() <= told.items()


@pytest.mark.parametrize(
    ("outcome", "words"),
    [("holds", "It holds the wanted"), ("reached", "with"), ("not-reached", "Nothing that was tried holds")],
)
def test_the_outcome_of_a_recipe_is_said_with_its_reason(gripper, outcome, words):
    exam, _ = gripper
    recipe = dataclasses.replace(exam.recipe, outcome=outcome, reason="because of this")
    chapter = remedy(dataclasses.replace(exam, recipe=recipe))
    first = texts(chapter, detail=False)[0]
    assert words in first
    assert "because of this" in first
    diverged = dataclasses.replace(recipe.chosen, drift=np.inf)
    chapter = remedy(dataclasses.replace(exam, recipe=dataclasses.replace(recipe, chosen=diverged)))
    assert "diverges" in texts(chapter, detail=False)[0]


def test_findings_explain_each_code_once():
    assert [block.text for block in findings([]).blocks if isinstance(block, Text)] == ["None."]
    every = [
        finding("D1", "m.xml", "one", element="a", severity="note"),
        finding("T2", "m.xml", "two", severity="error"),
        finding("D1", "m.xml", "three", element="b", severity="note"),
    ]
    chapter = findings(every)
    said, block = chapter.blocks
    assert said == Text("1 error, 2 notes.")
    assert isinstance(block, Findings)
    assert [item.line for item in block.items] == ["two", "one", "three"]
    assert [one.code for one in block.explanations] == ["T2", "D1"]
    assert block.items[1].place == "m.xml: a"


@pytest.mark.parametrize("code", list(catalogue()))
def test_formulas_of_an_explanation_are_code(code):
    (_, block) = findings([finding(code, "m.xml", "x")]).blocks
    assert isinstance(block, Findings)
    sections = block.explanations[0].sections
    assert [section.heading for section in sections] == ["", "How it is measured", "What to do"]
    entry = catalogue()[code]
    for section, prose in zip(sections, (entry.meaning, entry.measured, entry.remedy), strict=True):
        lines = [line for part in section.blocks for line in part.text.splitlines()]
        assert [" ".join(line.split()) for line in lines] == [
            " ".join(line.split()) for line in prose.splitlines() if line.strip()
        ]
        kinds = {isinstance(part, Code) for part in section.blocks}
        assert (True in kinds) == any(line.startswith("    ") for line in prose.splitlines())
