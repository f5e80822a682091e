"""The catalogue of findings: whole, unique, explained; and what a finding looks like."""

import json
import re
import tomllib

import pytest
from oarlock.base.errors import InputError
from oarlock.diagnosis.verdict.findings import CATALOGUE, SEVERITIES, Entry, catalogue, found, look_up, worst_first

NAMES = {
    "D1": "compliance",
    "D2": "curvature-missing",
    "D3": "timestep",
    "D4": "implicit-damping",
    "D5": "scale",
    "D6": "solver",
    "D8": "motion",
    "D7": "above-limit",
    "T1": "recipe",
    "T2": "unstable",
    "T3": "floor",
    "T4": "refsafe",
    "T5": "undecided",
    "E1": "energy",
    "U1": "not-unique",
    "U2": "near-singular",
    "L1": "no-equality",
    "L2": "all-redundant",
    "L3": "zero-row",
    "L4": "duplicate-row",
    "L5": "rank-change",
    "L6": "inactive",
    "L7": "redundant",
    "L8": "doubtful-rank",
    "S1": "inconsistent-start",
    "S2": "cannot-close",
    "S4": "lasting",
    "S3": "locked",
    "R1": "diverged",
    "R2": "inequalities-active",
    "R3": "log-not-reproduced",
    "R4": "still",
    "U4": "dead-point",
    "U5": "branch",
    "U3": "shared-with-contacts",
    "C1": "fights-loop",
    "C2": "friction-lag",
    "C3": "locked-by-limits",
    "C4": "collision",
    "C5": "stopped",
    "C6": "slips",
    "L9": "contradictory",
    "L10": "pin",
    "L11": "doubled",
    "L12": "idle",
    "L13": "swapped",
    "L14": "rank-flips",
    "L15": "unused-tendon",
    "S5": "drawn",
    "S6": "by-definition",
    "S7": "relpose",
    "A1": "servo",
    "A2": "unit",
    "A3": "jump",
    "A4": "stiff-damping",
    "A5": "overdriven",
    "A6": "stuck",
    "A7": "feeding",
    "A8": "undriven",
    "A9": "missed",
    "A10": "clipped",
    "A11": "leverless",
    "S8": "target",
    "T6": "under-damped",
    "V1": "version",
    "V2": "sparse-newton",
}
"""Codes are stable: a change of this table breaks somebody's script."""


def test_codes_are_stable():
    assert {code: entry.name for code, entry in catalogue().items()} == NAMES
    assert len(set(NAMES.values())) == len(NAMES)


@pytest.mark.parametrize("code", NAMES)
def test_every_code_has_all_parts(code):
    entry = catalogue()[code]
    assert re.fullmatch(r"[A-Z][1-9][0-9]?", code)
    assert re.fullmatch(r"[a-z]+(-[a-z]+)*", entry.name)
    assert entry.severity in SEVERITIES
    assert entry.title.endswith(".")
    assert entry.title.count("\n") == 0
    for part in (entry.meaning, entry.measured, entry.remedy):
        assert len(part) > 30
        assert part == part.strip("\n")
        assert "\\" not in part
    assert any(line.startswith("    ") for line in entry.measured.splitlines()), "no formula"


def test_the_file_holds_nothing_else():
    """A key that is spelt wrongly would be a part that nobody sees."""
    contents = tomllib.loads(CATALOGUE.read_text(encoding="utf-8"))
    parts = set(Entry.__dataclass_fields__) - {"code"}
    assert all(set(entry) == parts for entry in contents.values())


@pytest.mark.parametrize("named", ["D1", "d1", "compliance", "Compliance"])
def test_look_up(named):
    assert look_up(named).code == "D1"


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ("complience", "unknown finding 'complience', expected one of: compliance"),
        ("D12", "D1"),
        ("zzzz", "expected one of: A1, A2, A3, A4, "),
        ("foo", "unknown finding 'foo', expected one of: A1, A2, "),
        ("T99", "unknown finding 'T99', expected one of: A1, "),
        ("a\nb", "unknown finding 'a b'"),
        ("", "unknown finding ''"),
    ],
)
def test_unknown_codes(asked, named):
    names = set(NAMES) | set(NAMES.values())
    with pytest.raises(InputError) as raised:
        look_up(asked)
    text = str(raised.value)
    assert "\n" not in text
    listed = text.partition("expected one of: ")[2].split(", ")
    assert set(listed) <= names
    assert named in text


def test_a_finding():
    one = found("D1", "boat.xml", "pin drifts 1.9e-4 m at t = 1.6 s", element="pin", drift_m=1.9e-4)
    assert str(one) == "boat.xml: pin: warning D1 compliance: pin drifts 1.9e-4 m at t = 1.6 s"
    document = json.loads(json.dumps(one.document()))
    assert document["figures"] == {"drift_m": 1.9e-4}
    assert (document["code"], document["name"], document["element"]) == ("D1", "compliance", "pin")


def test_names_of_elements_do_not_break_the_line():
    one = found("S2", "a.xml", "pin\nis open", element="pin\n\n<script>")
    assert str(one).splitlines() == ["a.xml: pin <script>: error S2 cannot-close: pin is open"]
    assert one.element == "pin\n\n<script>"


def test_a_finding_of_the_whole_model_and_with_its_own_severity():
    assert str(found("R2", "a.xml", "x", severity="note")) == "a.xml: note R2 inequalities-active: x"


def test_a_code_that_is_not_in_the_catalogue():
    with pytest.raises(InputError, match="unknown code of a finding 'D99'"):
        found("D99", "a.xml", "x")


def test_worst_first_keeps_the_order_of_equals():
    findings = [found(code, "a.xml", code) for code in ("T1", "D3", "S2", "D1", "U1", "R1")]
    assert [one.code for one in worst_first(findings)] == ["S2", "R1", "D3", "D1", "T1", "U1"]


# oarlock explain.


def test_explain_all(oarlock_here):
    plain, machine = oarlock_here("explain"), oarlock_here("explain", "--json")
    assert (plain.returncode, machine.returncode) == (0, 0)
    document = json.loads(machine.stdout)
    assert [entry["code"] for entry in document] == list(catalogue())
    lines = plain.stdout.splitlines()[1:]
    assert [line.split()[0] for line in lines] == [entry["code"] for entry in document]
    assert all(entry["title"] in line for entry, line in zip(document, lines, strict=True))


def test_explain_each(oarlock_here):
    for code, entry in catalogue().items():
        said = oarlock_here("explain", code)
        assert (said.returncode, said.stderr) == (0, "")
        head, *_ = said.stdout.splitlines()
        assert head.startswith(f"{code} {entry.name} ({entry.severity}): ")
        assert max(map(len, (line for line in said.stdout.splitlines() if line[:4].strip()))) <= 100
        assert " ".join(entry.meaning.split()) in " ".join(said.stdout.split())
        for formula in (line for line in entry.measured.splitlines() if line.startswith("    ")):
            assert formula in said.stdout, "a formula was wrapped"
        assert json.loads(oarlock_here("explain", code, "--json").stdout) == entry.document()


def test_explain_in_a_narrow_terminal():
    text = catalogue()["D1"].text(40)
    assert max(len(line) for line in text.splitlines() if not line.startswith("        ")) <= 40


def test_explain_of_nothing_known(oarlock_here):
    said = oarlock_here("explain", "compilance")
    assert (said.returncode, said.stdout) == (2, "")
    assert said.stderr == "oarlock: unknown finding 'compilance', expected one of: compliance\n"
