"""The layouts of MuJoCo's structs: that of the installed version is right, and a wrong one is seen."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from oarlock.base import core
from oarlock.stepping import layout, native_path
from oarlock.stepping.layout import Layout, disagreement, known_layout

LAYOUTS = Path(__file__).parents[2] / "rust" / "mujoco" / "layouts"


def known() -> Layout:
    found = known_layout()
    if found is None:
        pytest.skip(f"no layout of MuJoCo {mujoco.__version__}")
    return found


def test_the_layout_of_the_installed_version_agrees_with_its_bindings():
    assert disagreement(known()) == ""


@pytest.mark.parametrize("by", [-8, 8, 16])
@pytest.mark.parametrize("whole", ["mjModel", "mjData", "mjContact"])
def test_fields_that_moved_are_seen(whole: str, by: int):
    """As versions do: something was put in or taken out, and all that comes after it lies elsewhere."""
    right = known()
    numbers = [number for number, place in enumerate(right.places) if place[0] == whole]
    assert len(numbers) > 2
    for first in numbers:
        moved = {n: (*right.places[n][:3], right.places[n][3] + by) for n in numbers if n >= first}
        if min(place[3] for place in moved.values()) < 0:
            continue
        places = [moved.get(number, place) for number, place in enumerate(right.places)]
        if not disagreement(replace(right, places=places)):
            pytest.fail(f"nobody sees that {right.places[first]} and what follows moved")


def test_the_row_of_another_version_is_seen():
    right = known()
    for version in core.mujoco_versions():
        row = core.mujoco_layout(version)
        assert row is not None
        if Layout(*row) != right:
            assert disagreement(Layout(*row)), version


@pytest.mark.parametrize("changed", [{"contact_size": 8}, {"eq_data_width": 1}])
def test_a_size_that_is_another_is_seen(changed: dict[str, int]):
    right = known()
    assert disagreement(replace(right, **{name: getattr(right, name) + more for name, more in changed.items()}))


def test_a_row_that_is_shifted_leads_to_the_python_path_and_one_line(monkeypatch: pytest.MonkeyPatch):
    right = known()
    shifted = replace(right, places=[(*place[:3], place[3] + 8) for place in right.places])
    monkeypatch.setattr(native_path, "known_layout", lambda: shifted)
    native_path.refusal.cache_clear()
    try:
        assert (
            native_path.refusal() == f"MuJoCo {mujoco.__version__} keeps mjModel.nq elsewhere than oarlock's table says"
        )
    finally:
        native_path.refusal.cache_clear()


def test_a_version_that_nobody_knows_has_no_layout(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(mujoco, "mj_version", lambda: 4_000_001)
    assert layout.known_layout() is None


def test_the_row_of_the_installed_version_is_what_its_headers_say(tmp_path: Path):
    known()
    sys.path.insert(0, str(LAYOUTS))
    try:
        import make  # pyright: ignore[reportMissingImports]
    finally:
        sys.path.remove(str(LAYOUTS))
    include = Path(mujoco.__file__).parent / "include"
    written = make.written(mujoco.__version__, make.row(include))
    assert written in (LAYOUTS / "table.h").read_text(), subprocess.list2cmdline(["make", "layouts"])
