"""Mechanisms that the tests make up, and folders of cases around them."""

import importlib.util
import shutil
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import polars as pl
from oarlock.cases.case import MODELS, Case, load_case
from oarlock.cases.case_file import CaseFile
from oarlock.cases.conditions import Conditions
from oarlock.cases.integrators import RUNNING
from oarlock.experiments.laboratory import Laboratory
from oarlock.experiments.outcome import Results
from oarlock.stepping.prepared import PreparedCase

INTEGRATORS = list(RUNNING)

COMMAND = Path(sys.executable).with_name("oarlock")
"""The installed command."""

BOAT = MODELS / "boat"


def four_bar(*, joint: str = "", rocker: str = "", pivot: str = "0.7 0 0", body: str = "", rest: str = "") -> str:
    """A planar four-bar, closed in its rest pose: 3 coordinates, 3 rows of rank 2 (one is out of plane), 1 dof.

    ``joint`` and ``rocker`` are attributes of all joints and of the rocker's; ``pivot`` is the rocker's place on the
    ground; ``body`` goes into the coupler, ``rest`` to the end of the model, where an equality may be added.
    """
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <default><joint axis="0 1 0" {joint}/><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank">
      <joint name="crank"/><geom fromto="0 0 0 0 0 0.3"/>
      <body name="coupler" pos="0 0 0.3">
        <joint name="coupler"/><geom fromto="0 0 0 0.5 0 0.2"/><site name="tip1" pos="0.5 0 0.2"/>{body}
      </body>
    </body>
    <body name="rocker" pos="{pivot}">
      <joint name="rocker" {rocker}/><geom fromto="0 0 0 -0.2 0 0.5"/><site name="tip2" pos="-0.2 0 0.5"/>
    </body>
  </worldbody>
  <equality><connect name="pin" site1="tip1" site2="tip2"/></equality>
  {rest}
</mujoco>"""


GROUPED = """
<mujoco>
  <option timestep="0.002" jacobian="sparse"/>
  <default><geom size=".1" mass="1" contype="0" conaffinity="0"/><joint axis="0 1 0"/></default>
  <worldbody>
    <body pos=".1 0 -.1"><joint/><geom/>
      <body pos=".2 0 -.4"><joint/><geom/>
        <body pos=".3 0 -.3"><joint/><geom/>
          <body pos=".2 0 -.1"><joint/><geom/></body>
          <body name="a" pos=".2 0 -.2"><joint/><geom/></body>
        </body>
        <body name="b" pos=".3 0 -.1"><joint/><geom/></body>
      </body>
      <body name="c" pos=".1 0 -.2"><joint/><geom/><body pos=".3 0 -.4"><joint/><geom/></body></body>
      <body name="d" pos=".1 0 -.3"><joint/><geom/></body>
    </body>
  </worldbody>
  <equality>
    <connect body1="a" body2="d" anchor=".01 0 .05"/>
    <connect body1="c" body2="b" anchor=".02 0 .05"/>
    <connect body1="b" body2="a" anchor=".03 0 .05"/>
  </equality>
</mujoco>"""
"""Three loops of nine hinges, closed in their rest pose, of which Newton of MuJoCo 4.0.0 uses a wrong factor."""


def gripper(*, cone: str = "elliptic", condim: int = 3, option: str = "", flags: str = "") -> str:
    """A planar gripper of two four-bars and a mimic joint, which closes on a block that stands aside on a table.

    Fingers rub (friction loss of joints, and of a tendon with a limit), their idle bars have limits that they come to;
    contacts of ``condim``, cones of kind ``cone``. Two connects and a joint equality, 7 rows of rank 5; nv 12.
    """

    def finger(side: str, sign: int) -> str:
        return f"""
      <body name="{side}_drive" pos="{sign * 0.03} 0 -0.012">
        <joint name="{side}_drive" frictionloss="0.02"/><geom fromto="0 0 0 {sign * 0.02} 0 -0.05"/>
        <body name="{side}_tip" pos="{sign * 0.02} 0 -0.05">
          <joint name="{side}_tip" frictionloss="0.01"/><geom fromto="0 0 0 {-sign * 0.012} 0 0"/>
          <geom class="touching" type="box" size="0.003 0.01 0.016" pos="{-sign * 0.006} 0 -0.03"/>
          <site name="{side}" pos="{-sign * 0.006} 0 -0.03"/>
        </body>
      </body>
      <body name="{side}_idle" pos="{sign * 0.018} 0 -0.012">
        <joint name="{side}_idle" limited="true" range="{"-20 60" if sign < 0 else "-60 20"}"/>
        <geom fromto="0 0 0 {sign * 0.02} 0 -0.05"/>
      </body>"""

    return f"""
<mujoco>
  <option timestep="0.002" cone="{cone}" impratio="{10 if cone == "elliptic" else 1}" {option}>
    <flag {flags}/>
  </option>
  <default>
    <joint type="hinge" axis="0 1 0" damping="0.01" armature="0.0005"/>
    <geom type="capsule" size="0.004" mass="0.02" contype="0" conaffinity="0"/>
    <default class="touching">
      <geom contype="1" conaffinity="1" condim="{condim}" friction="0.8 0.005 0.0001" mass="0.01"/>
    </default>
  </default>
  <worldbody>
    <body name="palm" pos="0 0 0.3">{finger("l", -1)}{finger("r", 1)}</body>
    <body name="block" pos="0.008 0 0.2">
      <freejoint/><geom class="touching" type="box" size="0.02 0.02 0.02" mass="0.08"/>
    </body>
    <geom class="touching" type="box" size="0.2 0.2 0.02" pos="0 0 0.16"/>
  </worldbody>
  <tendon>
    <spatial name="width" limited="true" range="0.03 0.1" frictionloss="0.05"><site site="l"/><site site="r"/></spatial>
  </tendon>
  <equality>
    <connect name="l_pin" body1="l_idle" body2="l_tip" anchor="-0.02 0 -0.05"/>
    <connect name="r_pin" body1="r_idle" body2="r_tip" anchor="0.02 0 -0.05"/>
    <joint name="mimic" joint1="r_drive" joint2="l_drive" polycoef="0 -1 0 0 0"/>
  </equality>
  <actuator><position name="close" joint="l_drive" kp="8" forcerange="-3 3"/></actuator>
</mujoco>"""


def parallelogram() -> str:
    """A planar four-bar of two equal pairs of bars: lying flat, twice a turn, its rows are of rank 1 instead of 2."""
    return """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="crank">
      <joint name="crank"/><geom fromto="0 0 0 0 0 0.5"/>
      <body name="coupler" pos="0 0 0.5">
        <joint name="coupler"/><geom fromto="0 0 0 1 0 0"/><site name="tip1" pos="1 0 0"/>
      </body>
    </body>
    <body name="rocker" pos="1 0 0">
      <joint name="rocker"/><geom fromto="0 0 0 0 0 0.5"/><site name="tip2" pos="0 0 0.5"/>
    </body>
  </worldbody>
  <equality><connect name="pin" site1="tip1" site2="tip2"/></equality>
</mujoco>"""


TANGLE = """
<mujoco>
  <default><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <site name="w1" pos="0.4 0.1 0.9" quat="1 0.2 0.3 0.1"/><site name="w2" pos="-0.9 -0.5 0.2"/>
    <body name="a">
      <joint name="ball" type="ball"/><geom fromto="0 0 0 0.3 0.1 0.4"/><site name="s0" pos="0 0 0.1"/>
      <body name="b" pos="0.3 0.1 0.4" quat="1 0.3 0.2 0.1">
        <joint name="skew" axis="1 2 3" pos="0.1 0 0"/><joint name="slide" type="slide" axis="2 -1 1"/>
        <geom fromto="0 0 0 0.2 -0.3 0.1"/><site name="s1" pos="0.1 -0.2 0.3" quat="1 0 0.2 0.1"/>
        <body name="d" pos="0.2 0 0">
          <joint name="wrist" axis="0 1 1"/><geom fromto="0 0 0 0.2 -0.3 0.1"/><site name="s3" pos="0.2 0.3 0.4"/>
        </body>
      </body>
    </body>
    <body name="c" pos="0.5 0.5 0.5">
      <freejoint name="free"/><geom fromto="0 0 0 0.3 0 0"/><site name="s2" pos="-0.1 0.2 0.1" quat="0.3 0.2 1 0"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="mix"><joint joint="skew" coef="0.7"/><joint joint="slide" coef="-1.2"/></fixed>
    <spatial name="line">
      <site site="w1"/><site site="s1"/><site site="s0"/><site site="s2"/><site site="w2"/>
    </spatial>
    <spatial name="pulleys">
      <site site="w1"/><site site="s1"/><pulley divisor="2"/><site site="s1"/><site site="s2"/>
      <pulley divisor="3"/><site site="s0"/><site site="s3"/>
    </spatial>
  </tendon>
  <equality>
    <connect name="connect bodies" body1="a" body2="c" anchor="0.2 0.3 -0.1"/>
    <connect name="connect world" body1="b" anchor="0.1 0.2 0.3"/>
    <connect name="connect sites" site1="s1" site2="s2"/>
    <weld name="weld bodies" body1="a" body2="c" anchor="0.2 0.3 -0.1" relpose="0.1 0.2 0.3 1 0.2 0.1 0.4"
          torquescale="0.7"/>
    <weld name="weld as it stands" body1="b" body2="c"/>
    <weld name="weld world" body1="b" torquescale="2"/>
    <weld name="weld sites" site1="s1" site2="s2" torquescale="1.5"/>
    <weld name="weld world site" site1="w1" site2="s2"/>
    <joint name="angles" joint1="skew" joint2="slide" polycoef="0.1 0.5 0.7 -0.3 0.2"/>
    <joint name="angle" joint1="wrist" polycoef="0.1 0 0 0 0"/>
    <tendon name="mix" tendon1="mix"/>
    <tendon name="line" tendon1="line"/>
    <tendon name="lines" tendon1="line" tendon2="pulleys" polycoef="0.1 0.5 0.7 -0.3 0.2"/>
    <tendon name="mix and line" tendon1="mix" tendon2="line" polycoef="0 1 1 0 0"/>
  </equality>
</mujoco>"""
"""Ball, hinge, slide and free joints in a tangle of equalities of every kind and form; it need not be closed."""


def write_model(folder: Path, xml: str, toml: str | None = None) -> Path:
    """A model file; with ``toml``, a case beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "model.xml"
    path.write_text(xml, encoding="utf-8")
    if toml is not None:
        (folder / "case.toml").write_text(toml, encoding="utf-8")
    return path


def case_of(path: Path, **contents: Any) -> Case:
    """A case around a model file, from the contents of a case file."""
    return Case("made-up", path, CaseFile.model_validate({"title": "made up", **contents}))


def boat_with(**changes: Any) -> Case:
    """The boat with tables of its case replaced."""
    case = load_case("boat")
    return Case("boat", case.model_path, CaseFile.model_validate({**case.file.model_dump(), **changes}))


def setup_of(
    case: Case, integrator: Any = "rk4", timestep_s: float | None = None, duration_s: float = 0.2
) -> PreparedCase:
    """A case prepared for a run."""
    return Laboratory(case, Conditions(timestep_s, duration_s)).setup(integrator)


def reference_script(model: str) -> ModuleType:
    """``reference.py`` of a model, as a module."""
    spec = importlib.util.spec_from_file_location(f"reference of {model}", MODELS / model / "reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def relative(value: Any, expected: Any) -> float:
    """‖value − expected‖ / ‖expected‖."""
    return float(np.linalg.norm(np.asarray(value) - expected) / np.linalg.norm(expected))


def frames_of(results: Results) -> list[pl.DataFrame]:
    """The steps, a table a run."""
    return pl.collect_all(results.tables)


def only(rows: list[dict[str, Any]], **where: Any) -> dict[str, Any]:
    """The one row that has these values."""
    found = [row for row in rows if all(row[key] == value for key, value in where.items())]
    assert len(found) == 1, f"{len(found)} rows with {where} among {[row['run'] for row in rows]}"
    return found[0]


def boat_copy(folder: Path, *, duration_s: float = 0.2, experiments: str = "", gates: str = "") -> Path:
    """The boat's folder under another name, shorter, with its own experiments and gates."""
    shutil.copytree(BOAT, folder)
    head = (BOAT / "case.toml").read_text(encoding="utf-8").partition("[[experiments]]")[0]
    assert "duration_s = 12.0" in head
    toml = head.replace("duration_s = 12.0", f"duration_s = {duration_s}") + experiments + gates
    (folder / "case.toml").write_text(toml, encoding="utf-8")
    return folder
