"""Copies of a model: whole or not at all, through links, and to what is no file."""

import numpy as np
import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.diagnosis.edit import keyframe
from oarlock.diagnosis.edit.keyframe import write_keyframe
from oarlock.mechanics.load import load_model


def test_a_copy_that_is_not_the_same_model_is_not_left_behind(tmp_path, monkeypatch):
    path = write_model(tmp_path, four_bar())
    out = tmp_path / "out.xml"
    out.write_text("the user's own")
    monkeypatch.setattr(keyframe, "differences", lambda *_: ["body_mass"])
    with pytest.raises(InputError, match="another body_mass"):
        write_keyframe(path, out, np.zeros(load_model(path).nq))
    assert out.read_text() == "the user's own"
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["model.xml", "out.xml"]


def test_a_copy_through_a_link_names_files_as_seen_from_where_it_lies(tmp_path):
    path = write_model(tmp_path, four_bar())
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "link.xml").symlink_to("far/away/copy.xml")
    write_keyframe(path, tmp_path / "link.xml", np.zeros(load_model(path).nq))
    assert (tmp_path / "link.xml").is_symlink()
    assert load_model(tmp_path / "far" / "away" / "copy.xml").nkey == 1
