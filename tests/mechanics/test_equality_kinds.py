"""What the table of equality kinds says of MuJoCo, held against MuJoCo; and flexes, whose rows depend on the model."""

import json

import mujoco
import pytest
from mechanisms import TANGLE, four_bar, write_model
from oarlock import InputError, run
from oarlock.base.text import quoted
from oarlock.cases.equality_kinds import KIND_OF, KINDS
from oarlock.mechanics.engine_version import lacks_curvature
from oarlock.mechanics.names import element_name, equalities
from oarlock.report.case_report import write_report

# Four points with five edges; in SKINNED, before the loop of a four-bar, with an equality that is switched off.
CLOTH = """<body name="frame">
  <flexcomp name="cloth" type="grid" count="2 2 1" spacing=".1 .1 .1" mass="1" radius="0.01">
    {edge}<pin id="{pinned}"/><contact selfcollide="none" contype="0" conaffinity="0"/>
  </flexcomp>
</body>"""
SKINNED = four_bar().replace("<equality>", '<equality><flex name="skin" flex="cloth" active="false"/>')
SKINNED = SKINNED.replace("</worldbody>", f"{CLOTH.format(edge='', pinned='0 1')}</worldbody>")


def test_every_kind_of_mujocos_is_in_the_table_once():
    named = [f"mjEQ_{element.upper()}" for kind in KINDS for element in kind.elements]
    assert sorted(named) == sorted(set(mujoco.mjtEq.__members__) - {"mjEQ_DISTANCE"})  # which no model may have
    assert len(KIND_OF) == len(named)


def test_every_known_kind_is_met_by_the_tests_of_rows_and_curvature():
    """TANGLE has some of each: its rows, units, anchors and J̇v are held against MuJoCo's arrays and differences."""
    met = {equality.kind for equality in equalities(mujoco.MjModel.from_xml_string(TANGLE))}
    assert met == {kind for kind in KINDS if kind.known}


@pytest.mark.parametrize("name", ["connect", "weld"])
def test_where_the_table_says_so_mujoco_knows_the_curvature(name):
    """A point that circles at ω has J̇v = −ω² r; what is left of aref without its B and K terms is −J̇v."""
    model = mujoco.MjModel.from_xml_string(f"""
      <mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody><body name="arm"><joint type="ball"/>
        <geom size="0.1" pos="0.5 0 0"/></body><body name="other" mocap="true"/></worldbody>
        <equality><{name} body1="arm" body2="other" {'anchor="0.5 0 0"' if name == "connect" else ""}/></equality>
      </mujoco>""")
    data = mujoco.MjData(model)
    (equality,) = equalities(model)
    assert not lacks_curvature(equality.kind)
    data.qvel[2] = 2.0
    mujoco.mj_forward(model, data)
    law = data.efc_KBIP[:3]
    left = -data.efc_aref[:3] - law[:, 1] * data.efc_vel[:3] - law[:, 0] * law[:, 2] * data.efc_pos[:3]
    assert left == pytest.approx(-4.0 * equality.anchor(model, 0), abs=1e-12)


@pytest.mark.parametrize(("pinned", "rows"), [("0", 5), ("0 1", 4), ("0 1 2", 3)])
def test_a_flex_has_a_row_for_every_edge_that_is_not_rigid(pinned, rows):
    body = CLOTH.format(edge='<edge equality="true"/>', pinned=pinned)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    (equality,) = equalities(model)
    assert (data.ne, model.nflexedge - int(model.flexedge_rigid.sum())) == (rows, rows)
    assert (equality.kind.name, equality.kind.rows, equality.unit) == ("flex", None, "m or rad")
    with pytest.raises(InputError, match=r"'#0' is a flex, expected connect, weld, joint or tendon$"):
        _ = equality.rows


@pytest.mark.parametrize("multipliers", ["[0]", "[0, 0, 0, 0]"])
def test_published_multipliers_of_a_flex_are_refused_however_many(tmp_path, multipliers):
    published = f"[[published]]\nsource = 's'\ntime_s = 0.0\nequality = 'skin'\nmultipliers = {multipliers}\n"
    folder = write_model(tmp_path / "bar", SKINNED, f"title = 'x'\n{published}")
    with pytest.raises(InputError, match=r"multipliers of 'skin', a flex, expected connect, weld, joint or tendon"):
        run(folder, mode="free", solver="pinv", duration=0.01)


def test_a_flex_that_is_switched_off_is_described_and_the_report_shows_the_loop(tmp_path):
    folder = write_model(tmp_path / "bar", SKINNED)
    run(folder, mode="free", solver="pinv", duration=0.02, out=tmp_path / "results")
    told = json.loads((tmp_path / "results" / "case.json").read_text(encoding="utf-8"))["model"]["equalities"]
    assert [(one["name"], one["kind"], one["rows"]) for one in told] == [("skin", "flex", None), ("pin", "connect", 3)]
    report = write_report(tmp_path / "results", tmp_path / "report")
    assert "Deviations of the constraint rows of 'pin'" in (report / "README.md").read_text(encoding="utf-8")


UNNAMED = """<mujoco><worldbody>
  <body name="crank"><joint axis="0 1 0"/><joint axis="0 0 1"/><joint name="own" axis="1 0 0"/><geom size="0.1"/>
    <site name="tip"/></body>
  <body name="rocker" pos="1 0 0"><joint axis="0 1 0"/><geom size="0.1"/><site name="top"/></body></worldbody>
  <tendon><fixed><joint joint="own" coef="1"/></fixed></tendon>
  <equality>
    <connect body1="crank" body2="rocker" anchor="0 0 0"/>
    <connect body1="crank" anchor="0 0 0"/>
    <connect site1="tip" site2="top"/>
    <weld name="mine" body1="crank" body2="rocker"/>
    <joint joint1="own"/>
    <tendon tendon1="{tendon}"/>
  </equality></mujoco>"""


def test_what_has_no_name_goes_by_its_bodies():
    text = UNNAMED.replace("<fixed>", '<fixed name="t">').format(tendon="t")
    model = mujoco.MjModel.from_xml_string(text)
    assert [one.name for one in equalities(model)] == [
        "connect of 'crank' and 'rocker'",
        "connect of 'crank' and 'world'",
        "connect of 'crank' and 'rocker' (2)",
        "mine",
        "joint of 'own'",
        "tendon of 't'",
    ]
    objects = mujoco.mjtObj
    joints = [element_name(model, objects.mjOBJ_JOINT, joint) for joint in range(model.njnt)]
    assert joints == ["joint of 'crank'", "joint of 'crank' (2)", "own", "joint of 'rocker'"]
    assert element_name(model, objects.mjOBJ_GEOM, 1) == "geom of 'rocker'"


def test_a_name_that_quotes_is_not_quoted_again():
    assert (quoted("pin"), quoted("connect of 'a' and 'b'")) == ("'pin'", "connect of 'a' and 'b'")
