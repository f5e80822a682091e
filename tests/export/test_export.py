"""Exports: the same mechanism to rounding, and what readers of other engines make of it where they are there."""

import json
from pathlib import Path

import mujoco
import numpy as np
import oarlock
import pytest
from engine_asks import Engine, exact_of
from mechanisms import TANGLE, four_bar, write_model
from oarlock.engines import running
from oarlock.engines.answers import read
from oarlock.engines.asking import arrays_of, ask, states_of, write
from oarlock.export import session
from oarlock.export.readers import READERS
from oarlock.export.session import Exported, closed_model, compile_export, export
from oarlock.export.writer import EARTH, Export, Writer
from oarlock.mechanics.names import equalities

SAME = 1e-12
"""Relative to the largest entry: every number is written with all its digits, and poses are turned once."""

READ = 1e-6
"""Relative. Accelerations of what Pinocchio read, with its own softness of 1e-8: 1e-9 (measured)."""


def matrices(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, on: list[str]) -> list[np.ndarray]:
    """M, the bias and JᵀJ at a state, with some equalities alone; a weld of sites has its rows turned."""
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    data.qpos[:], data.qvel[:] = qpos, qvel
    for equality in equalities(model):
        data.eq_active[equality.index] = equality.name in on
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fullM(model, data, inertia)
    jacobian = data.efc_J.reshape(-1, model.nv)[: data.ne]
    return [inertia, data.qfrc_bias.copy(), jacobian.T @ jacobian]


def compare(model: mujoco.MjModel, reference: np.ndarray, written: Export) -> None:
    copy, random = compile_export(written), np.random.default_rng(0)
    assert copy.nv == model.nv
    for one in (model, copy):
        one.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for _ in range(5):
        qpos, qvel = reference.copy(), random.normal(size=model.nv)
        mujoco.mj_integratePos(model, qpos, random.normal(size=model.nv), 0.5)
        own = matrices(model, qpos, qvel, written.equalities)
        other = matrices(copy, written.coordinates(qpos), qvel, written.equalities)
        for expected, value in zip(own, other, strict=True):
            assert np.abs(value - expected).max() <= SAME * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", oarlock.model_names())
def test_an_export_is_the_same_mechanism(name: str, reader: str):
    model, reference = closed_model(name)
    written = Writer(model, READERS[reader], reference).write()
    compare(model, reference, written)
    kinds = {one.name: one.kind.name for one in equalities(model)}
    assert set(written.equalities) == {one for one, kind in kinds.items() if kind in READERS[reader].equalities}
    lost = [one.element for one in written.left if "equality" in one.element]
    assert len(lost) == model.neq - len(written.equalities)


@pytest.mark.parametrize("reader", READERS)
def test_anchors_references_and_several_joints_are_kept(reader: str):
    model = mujoco.MjModel.from_xml_string(TANGLE.replace('type="slide"', 'type="slide" ref="0.3"'))
    random = np.random.default_rng(1)
    for _ in range(3):
        reference = model.qpos0.copy()
        mujoco.mj_integratePos(model, reference, random.normal(size=model.nv), 0.7)
        written = Writer(model, READERS[reader], reference).write()
        compare(model, reference, written)
        # Its connects are open in this pose: a reader would close them elsewhere.
        assert not any(name.startswith("connect") for name in written.equalities)
        assert ("weld sites" in written.equalities) == ("weld" in READERS[reader].equalities)
        assert ("angles" in written.equalities) == ("joint" in READERS[reader].equalities)


def test_what_is_left_out_is_said(tmp_path: Path):
    rest = """<tendon><fixed name="t"><joint joint="crank" coef="1"/></fixed></tendon>
      <equality>
        <tendon name="held" tendon1="t"/><joint name="off" joint1="crank" joint2="rocker" active="false"/>
      </equality>
      <actuator><motor name="m" joint="crank" gear="3"/><position name="p" joint="rocker" kp="2"/></actuator>
      <keyframe><key name="k"/></keyframe>"""
    path = write_model(tmp_path, four_bar(rest=rest, body='<body mocap="false" gravcomp="1" name="light"/>'))
    model, reference = closed_model(str(path))
    said = {name: [str(one) for one in Writer(model, READERS[name], reference).write().left] for name in READERS}
    assert "tendon equality 'held': Drake's reader has none of its kind" in said["drake"]
    assert "joint equality 'off': it is off" in said["newton"]
    assert "actuator 'm': Pinocchio's reader has none" in said["pinocchio"]
    assert "actuator 'p': no motor of a hinge or slide" in said["newton"]
    assert "gravcomp of body 'light': no reader takes it" in said["drake"]
    for lines in said.values():
        assert {"1 tendon: not written", "1 keyframe: not written"} <= set(lines)


def test_motors_keep_their_gear(tmp_path: Path):
    rest = '<actuator><general name="m" joint="crank" gear="3" gainprm="2" ctrlrange="-1 2"/></actuator>'
    model, reference = closed_model(str(write_model(tmp_path, four_bar(rest=rest))))
    copy = compile_export(Writer(model, READERS["newton"], reference).write())
    assert copy.actuator_gear[0, 0] * copy.actuator_gainprm[0, 0] == 6.0
    assert copy.actuator_ctrlrange[0].tolist() == [-1.0, 2.0]


def test_names_that_are_missing_or_taken_are_given(tmp_path: Path):
    xml = four_bar().replace('<body name="crank">', '<body name="base">').replace('<joint name="coupler"/>', "<joint/>")
    model, reference = closed_model(str(write_model(tmp_path, xml)))
    written = Writer(model, READERS["pinocchio"], reference).write()
    copy = compile_export(written)
    names = [copy.body(body).name for body in range(copy.nbody)]
    assert len(set(names)) == copy.nbody
    assert names[1] == "base"
    assert copy.body_parentid[copy.body("base_2").id] == 1
    compare(model, reference, written)


def test_the_command_lists_and_writes(oarlock_here, tmp_path: Path):
    out, summary = tmp_path / "out.xml", tmp_path / "out.json"
    arguments = ["--for", "drake", "-o", out, "--json", summary, "--engine", "drake=/nowhere/python"]
    done = oarlock_here("export", "gripper", *arguments)
    assert done.returncode == 2
    assert "'/nowhere/python' is no Python that runs" in done.stderr
    assert out.is_file()
    done = oarlock_here("export", "gripper", "--for", "bullet")
    assert (done.returncode, done.stderr) == (
        2,
        "oarlock: unknown reader 'bullet', expected one of: " + ", ".join(READERS) + "\n",
    )
    done = oarlock_here("export", "gripper", "--for", "drake", "-o", tmp_path / "out.urdf")
    assert done.returncode == 2
    assert "ends in .xml" in done.stderr


class Told:
    """What a reader says that has all as it was written."""

    def __init__(self, model: mujoco.MjModel):
        rows = sum({0: 3, 1: 6}.get(int(kind), 1) for kind in model.eq_type)
        self.facts = {"total_mass": float(model.body_mass.sum()), "velocities": model.nv, "rows": rows}
        self.versions = {"reader": "1"}


@pytest.mark.parametrize(("name", "but"), [("gripping_gripper", ", without joint equality 'gears'"), ("four_bar", "")])
def test_what_was_left_out_is_not_as_written(name: str, but: str):
    model, reference = closed_model(name)
    written = Writer(model, READERS["drake"], reference).write()
    assert written.left  # at least a light, which nothing depends on
    exported = Exported(name, READERS["drake"], written)
    own = compile_export(written)
    session._compare(exported, own, Told(own))
    assert exported.read[-1] == f"as written{but}: velocities, rows"


# With the readers.


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("name", oarlock.model_names())
def test_the_reader_has_it_as_it_is_written(name: str, reader: str, tmp_path: Path):
    engine = Engine(READERS[reader].program)
    exported = export(name, reader, tmp_path / "out.xml", f"{engine.program.name}={engine.environment.python}")
    assert exported.differences == []
    assert exported.read[-1].endswith(": masses, places, velocities, rows")
    lacks = any(one.moves for one in exported.export.left)
    assert exported.read[-1].startswith("as written, without" if lacks else "as written: ")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["boat", "stewart", "ring", "welded_frame", "gripping_gripper", "spatial_slider_crank"]
)
def test_what_pinocchio_reads_moves_as_ours(name: str, tmp_path: Path):
    engine = Engine("pinocchio_reader")
    model, reference = closed_model(name)
    written = Writer(model, READERS["pinocchio"], reference).write()
    copy = compile_export(written)
    copy.opt.gravity[:] = EARTH  # all that this reader knows
    copy.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)
    copy.dof_frictionloss[:] = 0.0
    copy.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data, qvel = mujoco.MjData(copy), np.random.default_rng(0).normal(size=(3, copy.nv))
    mujoco.mj_forward(copy, data)
    jacobian = data.efc_J.reshape(-1, copy.nv)[: data.ne]
    qvel = qvel @ (np.eye(copy.nv) - np.linalg.pinv(jacobian, rcond=1e-9) @ jacobian)
    states = states_of(copy, np.tile(copy.qpos0, (3, 1)), qvel, np.zeros((3, copy.nu)))
    files = {"ask.json": ask(name, copy, "forward"), "model.npz": arrays_of(copy), "states.parquet": states.table()}
    files["model.xml"] = written.text.encode()
    done = running.run(engine.program, engine.environment, [write(tmp_path, files)])
    answer = read(done.files[0], copy.nq, copy.nv, 3, done.status)
    expected = exact_of(copy, states)
    apart = np.linalg.norm(answer.qacc - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert apart.max() <= READ


@pytest.mark.slow
def test_the_document_of_a_command_is_json(oarlock_here, tmp_path: Path):
    engine = Engine("newton")
    given = ["--engine", f"newton={engine.environment.python}"]
    done = oarlock_here("export", "ring", "--for", "newton", "--json", "-", *given)
    document = json.loads(done.stdout)
    assert document["equalities"] == ["closing"]
    assert document["differences"] == []
    assert [one["element"] for one in document["left_out"]] == ["gravity 0 0 0", "1 light", "1 keyframe"]
