"""Ranks that hang on a small number: that they flip along the motion, and that what hangs on them says so."""

import mujoco
import numpy as np
import oarlock
import pytest
from mechanisms import four_bar, write_model
from oarlock.diagnosis.loops.rank import CUT, NEAR

SIZE = 10.0
"""Times. Singular values of rows that are scaled and weighted by M agree with those of plain rows in size alone."""


def checked(folder, tilt: float, **asked):
    text = four_bar(rocker=f'axis="0 1 {tilt}"', joint='damping="0.002"')
    return oarlock.check(write_model(folder, text), budget=0, **({"duration": 1.0} | asked))


def least_of_plain_mujoco(exam) -> np.ndarray:
    """The third singular value of the pin's rows beside the first, at the poses of MuJoCo's run."""
    model, found = exam.model, []
    data, dense = mujoco.MjData(model), np.zeros((3, model.nv))
    for pose in exam.recording.qpos[::20]:
        data.qpos[:] = pose
        mujoco.mj_forward(model, data)
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(dense, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind)
        else:
            dense[:] = data.efc_J[: 3 * model.nv].reshape(3, model.nv)
        sizes = np.linalg.svd(dense, compute_uv=False)
        found.append(sizes[2] / sizes[0])
    return np.array(found)


def test_a_rank_that_flips_along_the_motion_is_a_finding_with_its_figure(tmp_path):
    answer = checked(tmp_path, 4e-5)
    exam = answer.examination
    (one,) = (one for one in answer.verdict if one.code == "L14")
    assert (one.element, one.severity) == ("pin", "warning")
    assert {one.figures["rank"], *one.figures["ranks_along"]} == {2, 3}
    least, most = one.figures["least"], one.figures["most"]
    plain = least_of_plain_mujoco(exam)
    assert plain.max() < NEAR * CUT  # small throughout, and never what a mechanism has
    assert least < most < NEAR * CUT
    assert 1.0 / SIZE < most / plain.max() < SIZE
    assert f"goes from {least:.2g} to {most:.2g} of the largest" in one.line
    assert "L5" not in {one.code for one in answer.verdict}  # it passes no singular pose


@pytest.mark.parametrize("tilt", [0.0, 4e-5])
def test_what_is_unique_by_a_small_number_says_so(tmp_path, tilt):
    """In section 6, in the JSON, of the equality and of the joints of its loop."""
    answer = checked(tmp_path, tilt)
    small = tilt > 0.0
    said = {tuple(one["names"]): one["by_a_small_number"] for one in answer.document()["reactions"]}
    assert said == dict.fromkeys([("pin",), ("crank",), ("coupler",), ("rocker",)], small)
    answer.report(tmp_path / "page")
    text = (tmp_path / "page" / "README.md").read_text().split("## 6. Forces")[1]
    assert ("by a small number (L8)" in text) == small


def test_a_start_at_a_singular_pose_is_no_rank_that_flips(tmp_path):
    """A parallelogram that begins flat: the rank is less there, by a number that grows at once."""
    text = """<mujoco><compiler angle="radian"/><option timestep="0.002"/>
      <default><joint axis="0 1 0"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default><worldbody>
      <body name="a"><joint name="a"/><geom fromto="0 0 0 0.2 0 0"/>
        <body name="bar" pos="0.2 0 0"><joint name="bar"/><geom fromto="0 0 0 0.5 0 0"/></body></body>
      <body name="b" pos="0.5 0 0"><joint name="b"/><geom fromto="0 0 0 0.2 0 0"/></body></worldbody>
      <equality><connect name="pin" body1="bar" body2="b" anchor="0.5 0 0"/></equality>
      <keyframe><key qvel="1 -1 1"/></keyframe></mujoco>"""
    answer = oarlock.check(write_model(tmp_path, text), budget=0, duration=0.5)
    assert answer.examination.history.rank > answer.examination.pose.loops.rank
    assert "L14" not in {one.code for one in answer.verdict}


NEAR_FLAT = """<mujoco><compiler angle="radian"/><option timestep="0.002" gravity="0 0 0"/>
  <default><joint axis="0 1 0"/><geom type="capsule" size="0.01" contype="0" conaffinity="0"/></default><worldbody>
  <body name="a"><joint name="a"/><geom fromto="0 0 0 0.2 0 0"/>
    <body name="bar" pos="0.2 0 0"><joint name="bar"/><geom fromto="0 0 0 0.5 0 0"/></body></body>
  <body name="b" pos="0.5 0 0"><joint name="b"/><geom fromto="0 0 0 0.2 0 0"/></body></worldbody>
  <equality><connect name="pin" body1="bar" body2="b" anchor="0.5 0 0"/></equality>
  <keyframe><key qpos="{q} -{q} {q}" qvel="1 -1 1"/></keyframe></mujoco>"""


def test_the_rank_of_a_motion_is_that_of_most_of_it(tmp_path):
    """A start so near to the flat pose that a row is lost there says nothing about the rest."""
    history = oarlock.check(
        write_model(tmp_path, NEAR_FLAT.format(q="1e-8")), budget=0, duration=0.5
    ).examination.history
    assert history.ranks.count(history.rank) > len(history.ranks) // 2
    assert float(np.median(history.smallest)) > NEAR * CUT
