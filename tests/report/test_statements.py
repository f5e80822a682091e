"""Which runs a report compares, and what it states first: by hand-written rows, and as paragraphs of the page."""

import pytest
from markdown_it import MarkdownIt
from oarlock.report.case_report import write_report
from oarlock.report.statements import Compared, statements
from oarlock.report.tables import Tables

FIGURES = {
    "iterations_mean": 2.5,
    "min_norm_error_max": 0.1234,
    "min_norm_error_median": 0.0512,
    "residual_rel_max": 1e-12,
    "inconsistency_max": 3e-4,
    "qacc_rel_diff_max": 2e-13,
    "qfrc_constraint_rel_diff_max": 3e-13,
    "drift_pos_max": 4e-6,
    "drift_vel_max": 5e-6,
    "truth_error_max": None,
    "trajectory_diff_max": 6e-14,
    "steps_done": 1200,
    "solves": 4800,
    "unconverged": 0,
    "timestep_s": 0.001,
}


def row(**given):
    """A row of a summary: a free run of the reference on exact constraints, unless it says otherwise."""
    key = {
        "mode": "free",
        "walker": "pinv",
        "solver": "pinv",
        "form": "hard",
        "settings": "default",
        "stabilisation": "baumgarte",
        "integrator": "rk4",
        "status": "done",
    }
    return {**key, **FIGURES, **given}


def tables(*rows, gates=(), provenance=None, kind="connect", paper=None):
    """The results of a case that has nothing but these rows and gates."""
    some = object.__new__(Tables)
    some.rows, some.gates, some.provenance = list(rows), list(gates), provenance or {}
    some.case = {
        "run": {"integrator": "rk4"},
        "truth": {"joint": "crank"},
        "paper": paper,
        "model": {
            "equalities": [{"name": "a|b", "kind": kind, "unit": "m"}],
            "coordinates": [{"name": "crank", "unit": "rad"}],
        },
    }
    return some


def said(some):
    return statements(some, Compared.of(some))


def mujoco(**given):
    return row(solver="mujoco", form="matched", walker="mujoco", **given)


def test_runs_are_picked_by_what_they_are():
    euler, rk4 = row(integrator="euler", drift_pos_max=1.0), row(drift_pos_max=2.0)
    stiff = mujoco(settings="stiff")
    sr1 = {walker: row(mode="lockstep", solver="sr1", walker=walker) for walker in ("pinv", "mujoco")}
    held = [row(stabilisation=way) for way in ("projection", "both")]
    one = row(mode="one-step", stabilisation="projection")
    some = Compared.of(tables(euler, rk4, stiff, *sr1.values(), *held, one))
    assert some.exact is rk4  # the case's own integrator
    assert (some.stiff, some.default, some.matched, some.loops) == (stiff, None, None, [])
    assert (some.along, some.soft) == (sr1["pinv"], sr1["mujoco"])
    assert some.projected == held
    assert some.calibrations == []


def test_nothing_is_said_of_runs_that_are_not_there():
    assert said(tables(mujoco())) == []


@pytest.mark.parametrize(
    ("held", "text"),
    [
        ([], None),
        ([None], None),
        ([True, True, None], "**All 2 gates hold.**"),
        ([True, False, False, None], "**2 of 3 gates do not hold: drift.**"),
    ],
)
def test_gates_come_first(held, text):
    gates = [{"figure": "drift", "held": one} for one in held]
    first = said(tables(row(), gates=gates))[0]
    assert first == text if text else first.startswith("**Exact question.**")


def test_what_is_not_there_is_left_out_of_a_sentence():
    exact, default, stiff = row(truth_error_max=1e-5), mujoco(truth_error_max=2e-3), mujoco(settings="stiff")
    whole = "**Exact question.** With exact constraints the loops stand open by at most 4.00e-06 m"
    (alone,) = said(tables(exact))
    assert alone.startswith(f"{whole} (rk4, timestep 0.001 s). From the outside truth the exact run is 1.00e-05 rad")
    assert alone.endswith("away.")
    (beside,) = said(tables(exact, default, stiff))
    assert "; MuJoCo's by 4.00e-06 m with its default softness and 4.00e-06 m with stiff settings (rk4" in beside
    assert beside.endswith("1.00e-05 rad away, MuJoCo 2.00e-03 rad, MuJoCo stiff –.")
    (unknown,) = said(tables(row(), default))
    assert "truth" not in unknown


def test_what_is_left_out_of_rows_is_said_of_couplings_only():
    runs = (row(), mujoco(settings="stiff"))
    assert not [one for one in said(tables(*runs)) if "J̇v left out" in one]
    (one,) = [one for one in said(tables(*runs, kind="joint")) if "J̇v left out" in one]
    assert r"(a\|b)" in one
    assert "same question" not in one
    question = row(form="matched", settings="stiff", drift_pos_max=7e-3)
    (one,) = [one for one in said(tables(*runs, question, kind="joint")) if "J̇v left out" in one]
    assert "and by 7.00e-03 m when the Rust solver answers the same question." in one


def test_projected_runs_that_ended_early_are_not_counted():
    landed = row(stabilisation="projection", truth_error_max=1e-3)
    lost = row(stabilisation="both", status="diverged", drift_pos_max=9.0)
    (one,) = [one for one in said(tables(landed, lost)) if "Projection" in one]
    assert "at most 4.00e-06 m and their rows move by at most 5.00e-06 m/s (rk4)" in one
    assert one.endswith("; from the outside truth rk4 is 1.00e-03 rad away.")
    assert not [one for one in said(tables(lost)) if "Projection" in one]


def test_nothing_is_said_of_runs_that_diverged():
    lost = {"status": "diverged", "message": "step 3, t = 0.1 s: b is not finite"}
    every = (row(mode="calibration", **lost), row(**lost), row(mode="lockstep", form="matched", **lost))
    assert said(tables(*every)) == []


def test_iterations_are_told_with_what_did_not_converge():
    along = row(mode="lockstep", solver="sr1")
    (one,) = said(tables(along))
    assert "takes 2.500 iterations a step along the exact trajectory. It solves" in one
    assert one.endswith("off by up to 12.3 % (median 5.1 %).")
    soft = {**along, "walker": "mujoco", "unconverged": 7}
    (one,) = said(tables(along, soft, paper={"iterations_mean": 1.994}))
    assert "; the paper reports 1.994. It" in one
    assert one.endswith("out of reach in 7 of 4 800 solves.")


def test_the_solver_in_the_loop_is_another_experiment():
    along = row(mode="lockstep", solver="sr1", iterations_mean=1.986)
    walks = [
        row(solver="sr1", unconverged=9, iterations_mean=1.5),
        row(solver="sr1:eps_abs=0.1,guard=0.2", integrator="euler", iterations_mean=9.75),
    ]
    others = [
        row(solver="sr1-classic"),
        row(solver="sr1", stabilisation="projection"),
        row(solver="sr1", form="matched"),
    ]
    (one,) = [one for one in said(tables(*walks, *others)) if one.startswith("**In the loop.** Here sr1 walks: ")]
    assert one.endswith(
        "sr1 takes 1.500 (rk4; 9 of 4 800 not converged), 9.750 (euler, eps_abs=0.1, guard=0.2) iterations a solve."
    )
    paper = {"source": "A. <N>", "iterations_mean": 1.994}
    (one,) = [one for one in said(tables(along, *walks, paper=paper)) if "In the loop" in one]
    assert one.startswith("**In the loop.** The paper's own experiment is another one: ")
    assert one.endswith(r"The nearest of these to the 1.994 of the paper (A. \<N\>) is 1.500, 0.494 away.")
    (met,) = [
        one for one in said(tables(along, row(solver="sr1", iterations_mean=1.994), paper=paper)) if "loop" in one
    ]
    assert met.endswith("is 1.994.")


@pytest.mark.parametrize(
    ("holds", "text"),
    [
        ([True, True], "**The paper's claims.** 2 of 2 hold."),
        ([True, False], "**The paper's claims.** 1 of 2 holds; these do not: x \\< 1."),
        ([False, False], "**The paper's claims.** 0 of 2 hold; these do not: x \\< 0; x \\< 1."),
    ],
)
def test_claims_are_counted_and_those_that_fail_are_named(holds, text):
    claims = [{"claim": f"x < {index}.", "holds": one} for index, one in enumerate(holds)]
    assert said(tables(mujoco(), paper={"claims": claims})) == [text]


def test_other_statements_have_their_figures():
    runs = (row(mode="calibration", integrator="euler"), row(mode="lockstep", form="matched"))
    ignored, stepping, matched = said(tables(*runs, provenance={"inequalities_ignored": "limits of <a>"}))
    assert ignored == r"**Inequalities ignored:** limits of \<a\>."
    assert "to 6.00e-14 (rad or m) over 1 200 steps (euler)." in stepping
    assert "accelerations to 2.00e-13 and its constraint forces to 3.00e-13, relative, at every one of 1 200" in matched


def test_every_statement_is_a_paragraph_of_its_own(boat_run, tmp_path):
    text = (write_report(boat_run.folder, tmp_path / "report") / "README.md").read_text(encoding="utf-8")
    front = MarkdownIt("commonmark").parse(text.partition("\n## ")[0])
    paragraphs = [token.content for token in front if token.type == "inline" and token.content.startswith("**")]
    names = [paragraph.split("**")[1].split()[0] for paragraph in paragraphs]
    assert names == ["All", "Stepping.", "Same", "Exact", "Projection.", "Iterations.", "In", "The"]
    assert "\n\n\n" not in text
