"""Runs that diverge though no row, servo or damper is unstable: light pieces under a load, beside plain MuJoCo."""

import mujoco
import numpy as np
import oarlock
import pytest
from oarlock import Checked
from seen import lasts

PIECES = 6
"""Of a tow line, 0.1 m and some grams each, to a sled on a slope."""


def towed(mass: float = 0.002, load: float = 30.0, timestep: float = 0.002, settings: str = "") -> str:
    pieces = "".join(
        f'<body name="p{i}" pos="{0.1 if i else 0.0} 0 0"><joint name="p{i}" axis="0 1 0" damping="1e-4"/>'
        f'<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.004" mass="{mass}"/>'
        for i in range(PIECES)
    )
    return f"""<mujoco><option timestep="{timestep}" gravity="6 0 -7.7"/>
      <default><geom contype="0" conaffinity="0"/></default>
      <worldbody>{pieces}{"</body>" * PIECES}<body name="sled" pos="{0.1 * PIECES} 0 0">
        <joint name="sled" type="slide" axis="1 0 0"/><geom type="box" size="0.05 0.05 0.03" mass="{load}"/></body>
      </worldbody>
      <equality><connect name="hitch" body1="sled" body2="p{PIECES - 1}" anchor="0 0 0" {settings}/></equality>
      </mujoco>"""


def opened(text: str) -> float:
    """Largest distance of the ends of the hitch in two seconds of plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(text)
    data, worst = mujoco.MjData(model), 0.0
    for _ in range(round(2.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.linalg.norm(data.efc_pos[:3])))
    return worst


@pytest.fixture(scope="module")
def checked(tmp_path_factory) -> Checked:
    file = tmp_path_factory.mktemp("towed") / "towed.xml"
    file.write_text(towed())
    return oarlock.check(file)


def test_a_run_that_shorter_steps_keep_finite_says_so_and_what_is_left(checked):
    (one,) = [one for one in checked.verdict if one.code == "R1"]
    assert not lasts(towed(), 2.0)
    shorter = float(one.line.partition("with a timestep of ")[2].split()[0])
    assert shorter in (0.0005, 0.000125)
    left = float(one.line.partition("'hitch' opens by ")[2].split()[0])
    assert left == pytest.approx(opened(towed(timestep=shorter)), rel=0.01)
    assert "too soft as well" in one.line


def test_what_whips_from_disturbed_starts_alone_is_held_from_its_own(checked):
    """The settings that are named hold it in plain MuJoCo, and no shorter timestep is asked for in vain."""
    recipe = checked.examination.recipe
    assert recipe.outcome == "not-reached"
    setting = recipe.chosen.setting
    assert setting.timestep_s == max(trial.setting.timestep_s for trial in recipe.trials if np.isfinite(trial.drift))
    solref, solimp = (" ".join(map(repr, values)) for values in (setting.solref, setting.solimp))
    settings = f'solref="{solref}" solimp="{solimp}"'
    assert opened(towed(timestep=setting.timestep_s, settings=settings)) <= recipe.target
    assert "from its own start alone" in checked.answer
    (one,) = [one for one in checked.verdict if one.code == "T3"]
    assert "from a disturbed one the run diverges" in one.line
    assert "inf" not in one.line


def test_a_line_that_is_drawn_straight_is_not_locked(checked):
    """It bends, and the sled follows: a step that closing makes shorter is one."""
    assert "S3" not in {one.code for one in checked.verdict}
