"""Models that a program holds are those of files."""

import json

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar
from oarlock.base.errors import InputError
from oarlock.mechanics.given import compiled_at, path_of
from oarlock.mechanics.load import load_model

XML = four_bar().replace("<mujoco>", '<mujoco model="my four-bar">', 1)


def forms(path):
    path.write_text(XML)
    return {
        "file": path,
        "text": XML,
        "model": mujoco.MjModel.from_xml_string(XML),
        "spec": mujoco.MjSpec.from_string(XML),
    }


def test_every_form_of_a_model_is_checked_run_and_sampled_alike(tmp_path):
    found = {}
    for form, model in forms(tmp_path / "my-four-bar.xml").items():
        checked = oarlock.check(model, duration=0.05, budget=0)
        results = oarlock.run(model, mode="free", form="hard", solver="auto", duration=0.02)
        steps = results.steps.drop("step_us", "solve_ns", "run", strict=False)
        states = oarlock.sample(model, 20).qpos
        found[form] = (checked.drift, [finding.code for finding in checked.verdict], steps, states)
    first = found.pop("file")
    for drift, ids, steps, states in found.values():
        assert drift.equals(first[0])
        assert ids == first[1]
        assert steps.equals(first[2])
        assert np.array_equal(states, first[3])


def test_a_model_is_taken_as_it_is_now():
    model, spec = forms_of_now()
    for given in (model, spec):
        path = path_of(given)
        loaded = load_model(path)
        assert loaded.opt.timestep == 0.004
        assert path.stem == "my-four-bar"
        loaded.opt.timestep = 0.5
        assert load_model(path).opt.timestep == 0.004
    model.opt.timestep = 0.001
    assert load_model(path_of(model)).opt.timestep == 0.001


def forms_of_now():
    model, spec = mujoco.MjModel.from_xml_string(XML), mujoco.MjSpec.from_string(XML)
    model.opt.timestep = spec.option.timestep = 0.004
    return model, spec


def test_text_can_be_fixed_and_a_compiled_model_cannot(tmp_path):
    out = tmp_path / "out.xml"
    oarlock.check(XML, duration=0.05, budget=0.1).fix(out)
    assert load_model(out).neq == load_model(path_of(XML)).neq
    with pytest.raises(InputError, match="stands for a compiled model, expected MJCF to change"):
        oarlock.check(mujoco.MjModel.from_xml_string(XML), duration=0.05, budget=0).fix(tmp_path / "no.xml")


@pytest.mark.parametrize(
    ("model", "line"),
    [
        (3, "model is a int, expected a name, a path, MJCF, an MjModel or an MjSpec"),
        (
            "<mujoco><worldbody>",
            "the MJCF that was given: XML that cannot be read: mismatched element <worldbody>",
        ),
        (mujoco.MjModel.from_xml_string("<mujoco/>"), "no <equality> element"),
    ],
)
def test_what_is_no_model_is_one_line(model, line):
    for ask in (oarlock.check, oarlock.run, oarlock.sample):
        with pytest.raises(InputError, match=line):
            ask(model)


def test_nobody_elses_compiled_model_is_believed(tmp_path):
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(XML), str(path), None)
    for call in (compiled_at, oarlock.check, oarlock.run):
        with pytest.raises(InputError, match="is a compiled model, expected the MJCF that it was made of"):
            call(path)


def test_messages_say_what_was_given_and_no_place_of_ours(recwarn):
    open_loop = XML.replace("<equality>", "<!--").replace("</equality>", "-->")
    for given, said in (
        (open_loop, "the MJCF that was given"),
        (mujoco.MjSpec.from_string(open_loop), "the MjSpec"),
        (mujoco.MjModel.from_xml_string(open_loop), "the MjModel"),
    ):
        for function in (oarlock.check, oarlock.run, lambda model: oarlock.sample(model, 3)):
            with pytest.raises(InputError, match=f"^{said}: no <equality> element"):
                function(given)
    for given, said in ((XML, "the MJCF that was given"), (mujoco.MjModel.from_xml_string(XML), "the MjModel")):
        checked = oarlock.check(given, duration=0.02, budget=0)
        assert checked.examination.file == said
        assert {finding.file for finding in checked.verdict} == {said}
        assert str(checked.examination.path) not in repr(checked) + json.dumps(checked.document())


def test_results_of_a_model_that_a_program_held_say_so(tmp_path):
    kept = oarlock.run(XML, duration=0.02, mode="free", solver="auto", out=tmp_path / "kept").folder
    assert json.loads((kept / "case.json").read_text())["model_file"] is None
