"""Couplings in rings, against the rank of plain MuJoCo's rows."""

import math

import mujoco
import numpy as np
import pytest
from seen import chain, of_file, of_text, only, runs, text_of


def couple(first: str, second: str, polynomial: str, name: str = "") -> str:
    other = f'joint2="{second}"' if second else ""
    return f'<joint name="{name or first + second}" joint1="{first}" {other} polycoef="{polynomial} 0 0 0"/>'


def solutions(text: str) -> int:
    """Dimension of the poses that straight couplings leave, by the rank of plain MuJoCo's rows; -1: none."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = data.efc_J.reshape(-1, model.nv)[: data.ne]
    rank = np.linalg.matrix_rank(rows)
    both = np.linalg.matrix_rank(np.column_stack([rows, data.efc_pos[: data.ne]]))
    return model.nv - rank if both == rank else -1


@pytest.mark.parametrize(
    ("ratios", "left"),
    [((2, 3, -1, -1 / 6), 1), ((2, 3, -1, 1 / 6), 0), ((1, 1, 1, 1), 1), ((1, -1, 1, 1), 0), ((4, 0.5, 0.5, 1), 1)],
)
@pytest.mark.parametrize("turned", [0, 1, 2, 3])
def test_a_ring_of_ratios(ratios, left, turned):
    """Each coupling may be written from either end: one of the four is turned round."""
    names, text = "abcd", ""
    for at, ratio in enumerate(ratios):
        first, second = names[(at + 1) % 4], names[at]
        pair = (second, first, 1 / ratio) if at == turned else (first, second, ratio)
        text += couple(pair[0], pair[1], f"0 {pair[2]!r}")
    text = chain(text)
    assert solutions(text) == left
    found = [one for one in of_text(text) if one.code == "L9"]
    assert bool(found) == (left == 0)
    if found:
        (one,) = found
        product = math.prod(ratios)
        assert one.figures["product"] == pytest.approx(product if turned else 1 / product) or one.figures[
            "product"
        ] == pytest.approx(product)
        assert "is left" in one.line
        mended = text.replace(f'name="{one.element}"', "X").partition("X")
        joint = mended[2].partition('polycoef="')
        after = joint[2].partition('"')
        better = f'{mended[0]}name="{one.element}"{joint[0]}polycoef="0 {one.figures["wanted"]!r} 0 0 0"{after[2]}'
        assert solutions(better) == 1
        assert not [one for one in of_text(better) if one.code == "L9"]


def test_the_pose_that_is_left():
    """a = 2 b and b = 2 a − 3 (from the model's own pose, at 0.4 rad): b = 1, a = 2."""
    text = chain(couple("a", "b", "0 2") + couple("b", "a", "-3 2", "back"), "ab", 'ref="22.918311805232928"')
    one = only(of_text(text), "L9")
    assert one.element == "back"
    assert "only 'b' = 1.4 rad is left" in one.line


@pytest.mark.parametrize(
    ("couplings", "severity", "said"),
    [
        (couple("a", "b", "0.1 1") + couple("a", "b", "0.2 1", "two"), "found", "no pose satisfies its offsets"),
        (
            couple("a", "", "0.3 0") + couple("a", "b", "0 1") + couple("b", "", "0.5 0"),
            "found",
            "no pose satisfies both",
        ),
        (couple("a", "b", "0 1.414") + couple("b", "a", "0 0.707"), "warning", "product 0.999698"),
        (couple("a", "", "0.3 0") + couple("a", "b", "0 1") + couple("b", "", "0.3 0"), None, ""),
        (couple("a", "b", "0 1") + couple("c", "b", "0 1") + couple("d", "c", "0 -2"), None, ""),
        (couple("a", "b", "0 3") + couple("b", "a", "0 0.3333333333"), None, ""),
    ],
)
def test_rings_with_offsets_and_few_digits(couplings, severity, said):
    found = [one for one in of_text(chain(couplings)) if one.code == "L9"]
    assert bool(found) == (severity is not None)
    if found:
        assert found[0].severity == (None if severity == "found" else severity)
        assert said in found[0].line


@pytest.mark.parametrize(("second", "contradicts"), [("0 1 0.5", False), ("0 1 0.6", True), ("0 1 0", True)])
def test_two_polynomials_of_the_same_joints(second, contradicts):
    def bent(polynomial, name):
        return f'<joint name="{name}" joint1="a" joint2="b" polycoef="{polynomial} 0 0"/>'

    remarks = of_text(chain(bent("0 1 0.5", "one") + bent(second, "two")))
    assert ("L9" in {one.code for one in remarks}) == contradicts
    assert ("L11" in {one.code for one in remarks}) != contradicts


def test_a_bent_ring_that_comes_back_is_none():
    """b = a + a²/2, c = 2 b, and a from c read backwards is the same curve: c = 2 a + a²."""
    bent = '<joint joint1="{0}" joint2="{1}" polycoef="{2} 0 0"/>'
    sound = bent.format("b", "a", "0 1 0.5") + couple("c", "b", "0 2") + bent.format("c", "a", "0 2 1")
    assert "L9" not in {one.code for one in of_text(chain(sound, "abc"))}
    wrong = bent.format("b", "a", "0 1 0.5") + couple("c", "b", "0 2") + bent.format("c", "a", "0 2 0.9")
    assert "does not come back" in only(of_text(chain(wrong, "abc")), "L9").line


def test_the_ring_moves_with_the_ratio_that_is_named():
    text = text_of("mimic_ring.xml")
    one = only(of_file("mimic_ring.xml"), "L9")
    assert one.figures["wanted"] == pytest.approx(4 / 3)
    *_, (_, stuck) = runs(text)
    stuck = abs(float(stuck.joint("thumb").qpos[0]))
    mended = text.replace('joint2="ring" polycoef="0 1 ', f'joint2="ring" polycoef="0 {one.figures["wanted"]} ')
    *_, (_, free) = runs(mended)
    assert abs(float(free.joint("thumb").qpos[0])) > 2 * stuck  # soft couplings give way: to 0.18 rad of 0.5


# Couplings against loops.


def moves(text: str) -> int:
    """Degrees of freedom at the first keyframe, by plain MuJoCo; its rows have to be closed there."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-9
    return model.nv - int(np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv)[: data.ne], tol=1e-8))


@pytest.mark.parametrize("polynomial", ["0 -1", "0 0.5", "0 2"])
def test_a_coupling_against_the_loop(polynomial):
    """The bar turns both cranks alike: with the ratio that is named plain MuJoCo's rows leave a motion."""
    text = text_of("wrong_sign.xml").replace("0 -1 0 0 0", f"{polynomial} 0 0 0")
    assert moves(text) == 0
    one = only(of_text(text, 0), "L9")
    assert (one.element, one.figures["also"], one.figures["wanted"]) == ("mirror", ["hinge"], 1.0)
    assert "contradicts 'hinge'" in one.line
    assert f"with the ratio 1 in place of {polynomial.split()[1]} it turns" in one.line
    mended = text.replace(f"{polynomial} 0 0 0", "0 1 0 0 0")
    assert moves(mended) == 1
    assert not {"L9", "S3"} & {one.code for one in of_text(mended, 0)}


def test_a_coupling_whose_loop_turns_by_no_constant_ratio():
    """A lock all the same: no ratio is offered that would not hold it, and both are named."""
    text = text_of("wrong_sign.xml").replace('<geom fromto="0 0 0 0.09 0 0"/>', '<geom fromto="0 0 0 0.2 0 0"/>')
    text = text.replace('name="right" pos="0.09 0 0"', 'name="right" pos="0.13 0.02 0"')
    text = text.replace('anchor="0.09 0 0"', 'anchor="0.13 0.03 0"')
    assert moves(text) == 0
    found = of_text(text, 0)
    assert "L9" not in {one.code for one in found}
    one = only(found, "S3")
    assert "'mirror' and 'hinge' contradict each other: it would move without 'mirror' or 'hinge'" in one.line
    for name, dof in (("mirror", 1), ("hinge", 2)):
        assert moves(text.replace(f'name="{name}"', f'name="{name}" active="false"')) == dof
