"""The cost of a step at many sizes and where it goes: that the clocks change nothing, and what is made of figures."""

import dataclasses
import json

import mujoco
import numpy as np
import pytest
from oarlock import InputError
from oarlock.bench import growth as growth_module
from oarlock.bench.budget import LEAST, MOST, Budget, steps_for
from oarlock.bench.families import FAMILIES, LEVEL, families, turned
from oarlock.bench.growth import (
    COUNTS,
    FASTEST,
    OWN_PARTS,
    PARTS,
    PROFILED,
    SOLVERS,
    STEP,
    bench_growth,
    exponent,
    exponents,
    grow,
    later_step_s,
    own_parts_us,
    parts_us,
)
from oarlock.bench.standings import LOSES, NONE, TIES, WINS, shares, standings
from oarlock.bench.steps import BARE, SETTINGS, Track
from oarlock.mechanics.rows import closing_jacobian
from oarlock.stepping import native_path
from tolerances import EXACT_DRIFT

STEPS = 300

UNTIMED = 1e-3
"""Part of a walk that no lap holds: two looks at the clock around thousands, unless something else runs just then."""

GENEROUS = Budget(60.0)
"""s: no tiny walk takes so long, whatever else the machine does."""


def small(name, *sizes):
    return dataclasses.replace(families([name])[0], sizes=sizes)


@pytest.fixture(scope="module", autouse=True)
def short_walks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(growth_module, "steps_for", lambda step_s: 20)
        yield


@pytest.fixture(scope="module")
def measured():
    return bench_growth([small("chain-twice", 1, 10, 20), small("chain-singular", 2)], 2, GENEROUS)


@pytest.mark.parametrize("solver", PROFILED)
@pytest.mark.parametrize("model", ["n_four_bar:N=3,connects=2", "boat", "gear_train"])
def test_the_profiled_walk_ends_where_the_free_run_does(model, solver):
    track = Track(model, STEPS)
    profile = track.profile(solver)()
    qpos, qvel, time_s = profile["state"]
    expected_qpos, expected_qvel, expected_time_s = track.walked(solver).state
    assert np.array_equal(qpos, expected_qpos)
    assert np.array_equal(qvel, expected_qvel)
    assert time_s == expected_time_s
    assert profile["solves"] == STEPS


def test_the_parts_are_the_whole():
    once = Track("n_four_bar:N=5,connects=2", 2000).profile("auto")
    untimed = []
    for _ in range(5):  # one of them is not interrupted between the last lap and the end
        profile = once()
        assert set(profile["parts"]) == set(PARTS)
        whole_ns, parts = profile["whole_ns"], profile["parts"]
        spent_ns = sum(time_ns for time_ns, _ in parts.values())
        assert spent_ns <= whole_ns
        untimed.append(1 - spent_ns / whole_ns)
        # What is taken off is what the looks cost, and leaves every part something.
        looks = sum(looks for _, looks in parts.values())
        taken_us = (spent_ns - looks * profile["look_ns"]) / 2000 / 1e3
        assert sum(parts_us(profile, 2000).values()) == pytest.approx(taken_us)
        assert min(time_ns - looks * profile["look_ns"] for time_ns, looks in parts.values() if looks) > 0
    assert min(untimed) < UNTIMED


def test_looks_at_the_clock_are_counted():
    """One a part and step; W and A are parts of those alone who ask for them."""
    looks = {
        solver: {part: looks for part, (_, looks) in Track("four_bar", STEPS).profile(solver)()["parts"].items()}
        for solver in ("auto", "sr1-tracked", "cg")
    }
    every = dict.fromkeys(PARTS, STEPS)
    assert looks["auto"] == looks["sr1-tracked"] == every | {"matrix": 0}
    assert looks["cg"] == every


@pytest.mark.parametrize("power", [0.0, 0.7, 1.0, 2.0, 3.0])
def test_exponents_of_powers_are_found(power):
    sizes = (1, 2, 5, 10, 20, 40)
    assert exponent(sizes, [3e-3 * size**power for size in sizes]) == pytest.approx(power, abs=1e-12)
    rng = np.random.default_rng(7)
    noisy = [size**power * np.exp(0.02 * rng.standard_normal()) for size in sizes]
    assert exponent(sizes, noisy) == pytest.approx(power, abs=0.05)


def test_nothing_has_no_exponent():
    assert exponent([10], [1.0]) is None
    assert exponent([1, 2], [0.0, 1.0]) is None


def made_up(name, sizes, cost, **more):
    return [
        {
            "family": "made",
            "name": name,
            "size": n,
            "count": n,
            "step_us": cost(n),
            "parts_us": {},
            "left_out": "",
            **more,
        }
        for n in sizes
    ]


def test_many_loops_have_an_exponent_of_their_own():
    rows = made_up("auto", (1, 5, 10, 40), lambda n: 100 + n**2)
    for row in rows:
        row["parts_us"] = {"solve": row["count"] ** 2, "matrix": 0.0}
    fits = {row["part"]: row for row in exponents(rows)}
    assert list(fits) == [STEP, "solve", "matrix"]
    assert fits[STEP]["all"] < fits[STEP]["many"] < 2
    assert fits["solve"]["all"] == pytest.approx(2)
    assert fits["solve"]["many"] == pytest.approx(2)
    assert fits["matrix"]["all"] is fits["matrix"]["many"] is None


def test_what_was_not_walked_is_in_no_exponent():
    rows = made_up("pinv", (1, 10, 100), lambda n: float(n**3))
    rows[-1] |= {"step_us": None, "left_out": "too long"}
    rows += made_up("sr1", (1, 10), lambda n: None, **{"left_out": "too long"})
    assert [(row["name"], row["part"]) for row in exponents(rows)] == [("pinv", STEP), ("sr1", STEP)]
    assert exponents(rows)[0]["all"] == pytest.approx(3)
    assert exponents(rows)[0]["many"] is exponents(rows)[1]["all"] is None


def test_a_budget_is_kept_and_said():
    budget = Budget(2.0)
    assert budget.refusal(0.5, 0.01, 150) == ""
    assert budget.refusal(0.5, 0.01, 151) == "10 ms a step, 2 s for 151 of them, more than 2 s"
    assert budget.refusal(3.0, 0.0, 1) == "its first step took 3 s, more than the 2 s of a walk"
    assert (steps_for(1.0), steps_for(1e-4), steps_for(1e-9)) == (LEAST, 200, MOST)


def test_the_first_step_is_not_among_the_others():
    assert later_step_s(5.0, 3.0, 4) == pytest.approx(0.5)
    assert later_step_s(5.0, 6.0, 4) == pytest.approx(1.0)


def test_whatever_the_budget_does_not_cover_is_left_out_for_good():
    """And has no figure, while what MuJoCo does is measured all the same."""
    ticks = []
    rows = grow(small("net", 2, 3), 2, Budget(1e-9), tick=lambda: ticks.append(1))
    assert len(ticks) == 4
    assert len(rows) == 2 * (2 + len(SOLVERS))
    for row in rows:
        if row["name"] in (BARE, FASTEST):
            assert row["step_us"] > 0
            assert row["left_out"] == ""
        else:
            assert row["step_us"] is row["ratio"] is row["unconverged"] is None
            assert "first step took" in row["left_out"] or row["left_out"] == "left out at net:k=2 already"
    assert {row["left_out"] for row in rows if row["size"] == 3} == {"", "left out at net:k=2 already"}


def test_a_row_a_size_and_contender(measured):
    rows = measured["rows"]
    sizes = [("chain-twice", 1), ("chain-twice", 10), ("chain-twice", 20), ("chain-singular", 2)]
    contenders = (BARE, FASTEST, *SOLVERS)
    assert [(row["family"], row["size"], row["name"]) for row in rows] == [
        (*at, who) for at in sizes for who in contenders
    ]
    for row in rows:
        assert row["left_out"] == ""
        assert row["step_us"] > 0
        assert row["first_us"] > 0
        assert row["count"] == row["size"]
        assert row["velocities"] == 2 * row["size"] + 1
        assert row["steps"] == 20
        if row["name"] in (BARE, FASTEST):
            assert row["ratio" if row["name"] == BARE else "ratio_to_fastest"] == 1
            assert all(row[name] is None for name in COUNTS)
        else:
            assert list(row["parts_us"]) == list(PARTS)
            assert (row["rows"], row["folded_rows"]) == (6 * row["size"], 2 * row["size"])
            assert 0 < row["looks_us"] < row["profiled_us"]
            assert sum(shares(row).values()) == pytest.approx(1)
        assert (row["setting"] in (*SETTINGS, BARE)) == (row["name"] == FASTEST)
    for row in (row for row in rows if row["name"] == BARE):
        assert list(row["parts_us"]) == list(OWN_PARTS)
        assert sum(row["parts_us"].values()) == pytest.approx(row["step_us"])
    assert [family["name"] for family in measured["families"]] == ["chain-twice", "chain-singular"]
    json.dumps(measured, allow_nan=False)


def test_an_exponent_a_family_contender_and_part(measured):
    fits = {(row["family"], row["name"], row["part"]): row for row in measured["exponents"]}
    assert len(fits) == len(measured["exponents"]) == 2 * (2 + len(OWN_PARTS) + len(SOLVERS) * (1 + len(PARTS)))
    assert fits[("chain-twice", "auto", STEP)]["all"] > 0
    assert fits[("chain-singular", "auto", STEP)]["all"] is None


def test_timers_of_mujoco_are_a_step():
    parts = own_parts_us(Track("net:k=3", 10), 10, 5.0)
    assert list(parts) == list(OWN_PARTS)
    assert sum(parts.values()) == pytest.approx(5.0)
    assert min(parts.values()) > 0


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_families_grow(family):
    small, larger = family.sizes[0], family.sizes[1]
    assert list(family.sizes) == sorted(set(family.sizes))
    models = [Track(family.model_at(size), 1, family.start).prepared() for size in (small, larger)]
    assert models[0].model.nv < models[1].model.nv
    assert family.count(small) < family.count(larger)
    data = models[0].data()
    mujoco.mj_fwdPosition(models[0].model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < EXACT_DRIFT
    rate = closing_jacobian(models[0].model, data) @ data.qvel
    assert np.abs(rate).max() < 1e-10 * max(1.0, np.abs(data.qvel).max()) * models[0].model.nv


def test_counts_are_those_of_loops():
    """Connects of a planar model, less what doubles them: nets are counted by quadrilaterals, couplers by cranks."""
    assert [family.name for family in FAMILIES if family.squared] == ["net", "net-tree"]
    for name, size, loops in (("chain", 3, 3), ("coupler", 5, 4), ("net", 3, 9)):
        (family,) = families([name])
        assert family.count(size) == loops
    with pytest.raises(InputError, match="unknown family 'nets', expected one of: chain, "):
        families(["nets"])


def test_cranks_turn_closed_up_to_the_singular_pose():
    model = Track("n_four_bar:N=4,connects=2", 1).model
    ranks = []
    for angle in (0.0, 0.7, LEVEL):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = turned(model, angle, 2.0)
        mujoco.mj_fwdPosition(model, data)
        J = closing_jacobian(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < 1e-14
        assert np.abs(J @ data.qvel).max() < 1e-13
        ranks.append(np.linalg.matrix_rank(J, tol=1e-9))
    assert ranks == [8, 8, 4]


def test_standings_name_who_wins_and_by_how_much():
    def at(size, **costs):
        named = {name.replace("_", "-"): cost for name, cost in costs.items()}
        return [
            {
                "family": "made",
                "size": size,
                "name": name,
                "ratio": cost,
                "left_out": "" if cost else "long",
                "unconverged": 0,
            }
            for name, cost in named.items()
        ]

    rows = at(1, dual=1.0, sr1_tracked=0.5, sr1=0.6) + at(2, dual=1.0, pinv=9.0, sr1_tracked=1.1, sr1=None)
    rows += at(3, primal=1.0, sr1_tracked=3.0, sr1=2.0) + at(4, primal=1.0, sr1_tracked=None, sr1=0.1)
    rows[-1]["unconverged"] = 0.02  # quick, and no answer
    found = standings(rows)
    assert [(one.size, one.verdict) for one in found] == [(1, WINS), (2, TIES), (3, LOSES), (4, NONE)]
    assert [one.mine for one in found] == ["sr1-tracked", "sr1-tracked", "sr1", ""]
    assert [one.other for one in found] == ["dual", "dual", "primal", "primal"]
    assert [one.factor for one in found] == pytest.approx([0.5, 1.1, 2.0, 0.0])


def test_without_the_native_path_there_is_nothing_to_time(monkeypatch):
    monkeypatch.setattr(native_path, "refusal", lambda: "another version")
    with pytest.raises(InputError, match="no native stepping: another version"):
        bench_growth([small("chain", 1)], rounds=1)
