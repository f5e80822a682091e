"""A matrix as a whole: units that resume, engines that crash or hang, the commands with their page, JSON and badge."""

import json
import xml.etree.ElementTree as ET

import pytest
from fake_engines import program
from mechanisms import four_bar, write_model
from oarlock.base.errors import InputError
from oarlock.conformance.badge import badge
from oarlock.conformance.page import write_page
from oarlock.conformance.session import conform
from oarlock.conformance.versions import changes, table
from oarlock.engines import environments
from oarlock.engines.registry import parse_engine, programs
from suites import TINY

STATES = 3

SILENCE_S = 10.0
"""More than it takes to start an interpreter on a machine with other things to do, s."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """A small case."""
    return str(write_model(tmp_path_factory.mktemp("case") / "tiny", four_bar(), TINY).parent)


@pytest.fixture(scope="module")
def compared(model, tmp_path_factory):
    """A matrix of two made-up engines, one without J̇v."""
    folder = tmp_path_factory.mktemp("compared")
    engines = [str(program(folder, name)) for name in ("without_jdotv", "true")]
    return conform([model], engines, states=STATES, out=folder / "out", jobs=1)


def names(rows):
    return {row["engine"]: row["cause"] for row in rows}


def test_an_engine_that_fails_costs_its_unit_only(model, tmp_path, monkeypatch):
    monkeypatch.setenv("OARLOCK_TEST_NOTES", str(tmp_path / "notes"))
    engines = [str(program(tmp_path, name)) for name in ("true", "crashes", "hangs", "nan", "half")]
    found = conform([model], engines, states=STATES, out=tmp_path / "out", jobs=1, engine_timeout=SILENCE_S)
    assert names(found.rows) == {"true": "agrees"}
    said = {name: why.message for (_, name), why in found.failures.items()}
    assert set(said) == {"crashes", "hangs", "nan", "half"}
    assert said["crashes"] == "crashes ended with status 7: it is broken"
    assert f"was silent for {SILENCE_S:g} s" in said["hangs"]
    assert "is not finite" in said["nan"]
    assert "rows, expected" in said["half"]
    assert found.status == 1
    assert (tmp_path / "out" / "tiny" / "answers" / "answers-crashes" / "stderr.txt").read_text().startswith("a word")

    # Again, with one of them mended: what was finished is kept, of the mended one both units are done.
    program(tmp_path, "true").rename(tmp_path / "crashes.py")
    engines = [str(program(tmp_path, "true")), str(tmp_path / "crashes.py")]
    again = conform([model], engines, states=STATES, out=tmp_path / "out", jobs=1)
    assert names(again.rows) == {"true": "agrees", "crashes": "agrees"}
    assert again.repeated == 2
    assert again.status == 0
    third = conform([model], engines, states=STATES, out=tmp_path / "out", jobs=1)
    assert third.repeated == 0
    assert names(third.rows) == names(again.rows)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("softer", "unexplained: "),
        ("narrower", "unexplained: "),
        ("other_forces", "unexplained: as MuJoCo at every state, but its constraint forces are off by 4"),
        ("longer_step", "unexplained: as MuJoCo at every state, but its step changes velocities by 4"),
        ("torn_run", "unexplained: as MuJoCo at every state, but its run opens the loops by "),
    ],
)
def test_what_closed_states_do_not_show(model, name, said, tmp_path):
    """Softness, damping and impedance hang on the gap; forces, a step and a run may be another engine's still."""
    found = conform([model], [str(program(tmp_path, name))], states=STATES, out=tmp_path / "out", jobs=1)
    (row,) = found.rows
    assert row["verdict"].startswith(said)
    assert row["difference"] < 1e-9
    assert row["qacc_rest"] < 1e-9
    assert found.status == 1
    found.tolerance = 10.0
    assert found.status == int(row["contradicted"])


def test_a_run_that_diverges_costs_the_figures_of_the_run_only(model, tmp_path):
    found = conform([model], [str(program(tmp_path, "wild_run"))], states=STATES, out=tmp_path / "out", jobs=1)
    (row,) = found.rows
    assert row["cause"] == "agrees"
    assert row["verdict"].startswith("as MuJoCo; its run does not stay finite to t = ")
    assert row["drift_max"] is None
    assert row["qacc_mujoco"] < 1e-12


def test_engines_that_are_not_asked_keep_what_they_answered(model, tmp_path):
    one, other = (str(program(tmp_path, name)) for name in ("true", "without_jdotv"))
    asked = {"states": STATES, "out": tmp_path / "out", "jobs": 1}
    assert conform([model], [one], **asked).repeated == 3
    assert conform([model], [other], **asked).repeated == 2
    again = conform([model], [one, other], **asked)
    assert again.repeated == 0
    assert names(again.rows) == {"true": "agrees", "without_jdotv": "jdotv"}


def test_a_program_is_asked_again_when_what_it_imports_changes(model, tmp_path):
    """A module beside it, by either kind of import."""
    path = program(tmp_path, "true")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("import mujoco\n", "import mujoco\nfrom helper import FACTOR\n", 1), encoding="utf-8")
    (tmp_path / "helper.py").write_text("FACTOR = 1.0\n", encoding="utf-8")
    (tmp_path / "bystander.py").write_text("pass\n", encoding="utf-8")
    asked = {"states": STATES, "out": tmp_path / "out", "jobs": 1}
    assert conform([model], [str(path)], **asked).repeated == 3
    (tmp_path / "bystander.py").write_text("raise SystemExit\n", encoding="utf-8")
    assert conform([model], [str(path)], **asked).repeated == 0
    (tmp_path / "helper.py").write_text("FACTOR = 2.0\n", encoding="utf-8")
    assert conform([model], [str(path)], **asked).repeated >= 1


@pytest.mark.parametrize("setting", ["gravity=0", "solver=PGS", "precison=float32"])
def test_a_setting_that_an_engine_does_not_have_is_refused(model, setting, tmp_path):
    with pytest.raises(InputError, match=f"'{setting.partition('=')[0]}', expected one of: "):
        conform([model], [f"mujoco:{setting}"], out=tmp_path / "out")
    with pytest.raises(InputError, match="'true' has no settings"):
        conform([model], [f"{program(tmp_path, 'true')}:gravity=0"], out=tmp_path / "out")


def test_the_gate_does_not_pass_what_was_not_compared(model, tmp_path):
    found = conform([model], [str(program(tmp_path, "true"))], states=STATES, out=tmp_path / "out", jobs=1)
    (row,) = found.rows
    found.rows = [{**row, "difference": None, "cause": "not expressible", "verdict": "not expressible: joint 'a'"}]
    assert found.status == 0
    found.tolerance = 1e-6
    assert found.status == 1
    assert "1 of 1" not in badge(found.document())
    found.rows = [{**row, "difference": None, "cause": "reader+mass", "verdict": "on import: mass"}]
    assert found.status == 1
    found.rows = [{**row, "difference": None, "cause": "reader", "verdict": "its reader keeps masses and rows"}]
    assert found.status == 0


def test_other_engines_are_asked_without_those_before(model, tmp_path):
    out = tmp_path / "out"
    first = conform([model], [str(program(tmp_path, "true"))], states=STATES, out=out, jobs=1)
    assert first.repeated == 3  # states, answer, figures
    both = [str(program(tmp_path, name)) for name in ("true", "without_jdotv")]
    assert conform([model], both, states=STATES, out=out, jobs=1).repeated == 2
    assert conform([model], both, states=STATES, out=out, jobs=1, fresh=True).repeated == 5
    assert conform([model], both, states=STATES, seed=1, out=out, jobs=1).repeated == 5


def test_what_is_measured(compared):
    rows = {row["engine"]: row for row in compared.rows}
    own, without = rows["true"], rows["without_jdotv"]
    assert own["qacc_mujoco"] < 1e-12
    assert own["apart_mujoco"] == 0.0
    assert without["qacc_mujoco"] > 1e-3
    assert without["qacc_rest"] < 1e-12
    assert 0.0 < own["drift_end"] <= own["drift_max"]
    assert own["expected"]["rows"] == 3


def test_a_model_that_cannot_be_asked_about_costs_itself_only(model, tmp_path):
    broken = write_model(tmp_path / "open", four_bar(pivot="9 0 0"), TINY).parent
    engines = [str(program(tmp_path, "true"))]
    found = conform([model, str(broken)], engines, states=STATES, out=tmp_path / "out", jobs=1)
    assert {member.name: bool(member.refused) for member in found.members} == {"tiny": False, "open": True}
    assert [row["model"] for row in found.rows] == ["tiny"]
    assert found.status == 2


@pytest.mark.parametrize(("tolerance", "status"), [(None, 0), (1e-3, 1), (10.0, 0)])
def test_the_tolerance_decides(compared, tolerance, status):
    compared.tolerance = tolerance
    assert compared.status == status
    document = compared.document()
    assert [row["passed"] for row in document["rows"]] == [status == 0, True]
    compared.tolerance = None


def test_changes_between_versions_are_told_by_cause(compared):
    assert set(table(compared.rows)) == {"without_jdotv", "true"}
    (line,) = changes(compared.rows)
    assert line.startswith("tiny: without_jdotv → true: at the same states no J̇v before, as MuJoCo after")
    assert changes(compared.rows[1:] * 2) == ["nothing changed for tiny in the first 2 s"]


def test_one_version_has_nothing_to_be_compared_with(compared):
    (line,) = changes(compared.rows[1:])
    assert line == "nothing to compare for tiny: true alone answered, expected two or more"
    other = [{**row, "model": "two"} for row in compared.rows[1:] * 2]
    assert changes([*compared.rows[1:], *other]) == ["nothing changed for two in the first 2 s", line]
    assert changes([]) == []


def test_the_page_the_matrix_and_the_badge(compared, tmp_path):
    document = compared.document()
    target = write_page(document, tmp_path / "page")
    text = (target / "README.md").read_text()
    for row in document["rows"]:
        assert (
            f"| tiny | {row['engine'].replace('_', chr(92) + '_')} |" in text or f"| tiny | {row['engine']} |" in text
        )
        assert any(line.startswith("| tiny |") and row["verdict"] in line for line in text.splitlines())
    kept = json.loads((target / "matrix.json").read_text())
    assert kept["rows"] == json.loads(json.dumps(document["rows"]))
    assert "date" not in kept["provenance"]
    drawn = (target / "figures" / "matrix.svg").read_text()
    assert "no J̇v" in drawn
    assert "agrees" in drawn
    assert "chart-matrix" in (target / "index.html").read_text()
    first = (target / "README.md").read_bytes(), (target / "matrix.json").read_bytes()
    write_page(compared.document(), target)
    assert first == ((target / "README.md").read_bytes(), (target / "matrix.json").read_bytes())
    mark = badge(document)
    assert "2 of 2 explained" in "".join(ET.fromstring(mark).itertext())


def test_an_engine_that_is_not_there_is_named_with_what_to_do(model, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    said = r"engine 'mujoco@3\.6' is not installed: 'oarlock conform … --install' makes"
    with pytest.raises(InputError, match=said) as error:
        conform([model], ["mujoco@3.6"], out=tmp_path / "out")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "out").exists()


def test_each_engine_once(model, tmp_path):
    with pytest.raises(InputError, match="expected each once"):
        conform([model], ["mujoco", "mujoco"], out=tmp_path / "out")


def test_the_command_without_any_optional_engine(model, tmp_path, monkeypatch, oarlock_here):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if [name for name in programs() if name != "mujoco" and environments.find(parse_engine(name))]:
        pytest.skip("an optional engine is installed beside the tests")
    done = oarlock_here("conform", model, "--states", STATES, "--jobs", 1, "--json", "-", "--report", "page")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert names(document["rows"]) == {"mujoco": "agrees"}
    offered = [line for line in done.stderr.splitlines() if "--install" in line]
    assert len(offered) == 1
    assert "mjx" in offered[0]


def test_a_suite_asks_engines_as_well(model, tmp_path, oarlock_here):
    """Each as a unit: one that crashes costs itself, and what was finished is kept."""
    asked = [option for name in ("true", "crashes") for option in ("--engine", program(tmp_path, name))]
    done = oarlock_here("suite", model, *asked, "--jobs", 2, "--json", "-", "--out", "out")
    assert done.returncode == 1, done.stderr
    assert "engine failed: tiny crashes: crashes ended with status 7: it is broken" in done.stderr
    document = json.loads(done.stdout)
    assert document["runs"]
    assert document["failures"] == []
    assert names(document["engines"]["rows"]) == {"true": "agrees"}
    assert (tmp_path / "out" / "report" / "conform" / "README.md").is_file()
    assert (tmp_path / "out" / "report" / "tiny" / "README.md").is_file()
    again = oarlock_here("suite", model, *asked, "--jobs", 2, "--json", "-", "--out", "out")
    finished = [line for line in again.stderr.splitlines() if line.startswith("  ") and "README" not in line]
    assert [line.split()[:2] for line in finished] == [["tiny", "crashes"]]
    # The page of the engines outlasts a suite without them, and its document has none.
    alone = oarlock_here("suite", model, "--jobs", 2, "--json", "-", "--out", "out")
    assert alone.returncode == 0, alone.stderr
    assert "engines" not in json.loads(alone.stdout)
    assert (tmp_path / "out" / "report" / "conform" / "README.md").is_file()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--engine", "nothing"), "nothing"),
        (("--engine", "mujoco", "--engine", "mujoco"), "expected each once"),
        (("--engine", "mujoco", "--sweep", "timestep=1e-3:2e-3:2"), "--sweep and --engine"),
    ],
)
def test_a_suite_refuses_engines_before_it_runs(model, options, said, tmp_path, oarlock_here):
    done = oarlock_here("suite", model, *options, "--out", "out")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_command_versions(model, tmp_path, monkeypatch, oarlock_here):
    """Two names for this very MuJoCo: folders of versions that hold nothing."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for version in ("1.0", "2.0"):
        environments.place(parse_engine(f"mujoco@{version}")).mkdir(parents=True)
    done = oarlock_here("versions", model, "--mujoco", "1.0,2.0", "--states", STATES, "--jobs", 1)
    assert done.returncode == 0, done.stderr
    assert "largest |efc_pos|" in done.stdout
    assert "nothing changed for tiny in the first 2 s" in done.stdout
    quiet = oarlock_here("versions", model, "--mujoco", "1.0", "--states", STATES, "--jobs", 1, "-q", "--fresh")
    assert (quiet.returncode, quiet.stderr) == (0, "")
    assert "nothing to compare for tiny" in quiet.stdout
    refused = oarlock_here("versions", model, "--mujoco", "3.x")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1


def test_the_list_of_engines(oarlock_here):
    done = oarlock_here("conform", "--list", "--json", "-")
    rows = {row["engine"]: row for row in json.loads(done.stdout)}
    assert set(rows) == set(programs())
    assert rows["mujoco"]["there"] is True
    assert "flex" in rows["mujoco"]["equalities"]
    assert rows["drake"]["questions"] == []
    shown = oarlock_here("conform", "--list")
    assert all(name in shown.stdout for name in programs())
    refused = oarlock_here("conform")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
