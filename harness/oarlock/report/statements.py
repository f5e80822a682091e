"""Which runs the report of a case compares, and what it states of them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from oarlock.base.numbers import figure
from oarlock.render.template import cell
from oarlock.report.tables import Tables
from oarlock.tables.promise import doubts

Row = dict[str, Any]


@dataclass(frozen=True)
class Compared:
    """The runs that a report is about, as rows of the summary; None or an empty list where a case has no such run.

    Attributes:
        calibrations: MuJoCo's own force taken through our stepping.
        matched: the reference answers MuJoCo's own question at MuJoCo's states.
        exact: the free run of the reference on exact constraints.
        default: MuJoCo's free run with its default softness; stiff: with the stiffest settings of the case.
        question: the free run of the reference on MuJoCo's question with stiff settings.
        along: sr1 along the exact trajectory; soft: along MuJoCo's; loops: sr1, with whatever
            options, in free runs of its own with Baumgarte's terms.
        projected: free runs that are projected onto the constraints.
    """

    calibrations: list[Row]
    matched: Row | None
    exact: Row | None
    default: Row | None
    stiff: Row | None
    question: Row | None
    along: Row | None
    soft: Row | None
    loops: list[Row]
    projected: list[Row]

    @classmethod
    def of(cls, tables: Tables) -> "Compared":
        """Picks them from the runs of a folder; of several integrators the case's own comes first."""
        free, sr1 = tables.free_runs(), {"mode": "lockstep", "form": "hard", "solver": "sr1"}
        projected = tables.all(stabilisation="projection") + tables.all(stabilisation="both")
        return cls(
            calibrations=tables.all(mode="calibration"),
            matched=tables.pick(mode="lockstep", form="matched", solver="pinv"),
            exact=free.get("exact (pinv)"),
            default=free.get("MuJoCo default"),
            stiff=free.get("MuJoCo stiff"),
            question=tables.pick(mode="free", form="matched", solver="pinv", settings="stiff"),
            along=tables.pick(walker="pinv", **sr1),
            soft=tables.pick(walker="mujoco", **sr1),
            loops=[
                row
                for row in tables.all(mode="free", form="hard", stabilisation="baumgarte")
                if row["solver"].partition(":")[0] == "sr1" and row["iterations_mean"] is not None
            ],
            projected=[row for row in projected if row["mode"] == "free"],
        )


def statements(tables: Tables, compared: Compared) -> list[str]:
    """What a report says first, a paragraph of Markdown each; what there are no runs for is left out."""
    every = (
        _gates,
        _motion,
        _ignored,
        _ranks,
        _stepping,
        _matched,
        _exact,
        _pushing,
        _curvature,
        _projection,
        _iterations,
        _in_the_loop,
        _claims,
    )
    return [said for make in every for said in make(tables, compared)]


def _gates(tables: Tables, _: Compared) -> Iterator[str]:
    checked = [gate for gate in tables.gates if gate["held"] is not None]
    failed = [gate for gate in checked if not gate["held"]]
    if failed:
        names = ", ".join(dict.fromkeys(gate["figure"] for gate in failed))
        yield f"**{len(failed)} of {len(checked)} gates do not hold: {names}.**"
    elif checked:
        yield f"**All {len(checked)} gates hold.**"


def _motion(tables: Tables, _: Compared) -> Iterator[str]:
    if "motion" in tables.provenance:
        yield f"**Motion:** {cell(tables.provenance['motion'])}."


def _ignored(tables: Tables, _: Compared) -> Iterator[str]:
    if "inequalities_ignored" in tables.provenance:
        yield f"**Inequalities ignored:** {cell(tables.provenance['inequalities_ignored'])}."
    if "python_solvers" in tables.provenance:
        yield (
            f"**Called in Python:** {cell(tables.provenance['python_solvers'])}. Every solve is a call of Python, "
            "which is slow: its time says nothing of the method."
        )


def _ranks(tables: Tables, _: Compared) -> Iterator[str]:
    for doubt in doubts(tables.rows):
        yield f"**Rank in doubt:** {doubt}."


def _stepping(_: "Tables", compared: Compared) -> Iterator[str]:
    runs = compared.calibrations
    if runs:
        yield (
            "**Stepping.** MuJoCo's own constraint force, taken through our stepping, gives MuJoCo's trajectory to "
            f"{figure(max(row['trajectory_diff_max'] for row in runs))} (rad or m) over "
            f"{figure(runs[0]['steps_done'])} steps ({', '.join(row['integrator'] for row in runs)})."
        )


def _matched(_: "Tables", compared: Compared) -> Iterator[str]:
    row = compared.matched
    if row:
        yield (
            "**Same question, same answer.** Asked MuJoCo's own soft question with MuJoCo's M, J, R and aref, the Rust "
            f"solver gives its accelerations to {figure(row['qacc_rel_diff_max'])} and its constraint forces to "
            f"{figure(row['qfrc_constraint_rel_diff_max'])}, relative, at every one of {figure(row['steps_done'])} "
            "states."
        )


def _exact(tables: Tables, compared: Compared) -> Iterator[str]:
    exact, default, stiff = compared.exact, compared.default, compared.stiff
    if not exact:
        return

    def drift(row: Row) -> str:
        return figure(row["drift_pos_max"], tables.unit)

    def away(row: Row) -> str:
        return figure(row["truth_error_max"], tables.truth_unit)

    said = f"**Exact question.** With exact constraints the loops stand open by at most {drift(exact)}"
    said += f"; MuJoCo's by {drift(default)} with its default softness" if default else ""
    said += f" and {drift(stiff)} with stiff settings" if stiff else ""
    said += f" ({exact['integrator']}, timestep {exact['timestep_s']} s)."
    if exact["truth_error_max"] is not None:
        said += f" From the outside truth the exact run is {away(exact)} away"
        said += f", MuJoCo {away(default)}" if default else ""
        said += f", MuJoCo stiff {away(stiff)}" if stiff else ""
        said += "."
    yield said


def _pushing(_: "Tables", compared: Compared) -> Iterator[str]:
    row = compared.exact
    if not row or row.get("newton_mean") is None:
        return
    forces = {"limits": "limit_force_max", "friction": "friction_force_max", "contacts": "contact_force_max"}

    def told(run: Row) -> str:
        known = [f"{what} {figure(run[name])}" for what, name in forces.items() if run[name]]
        return ", ".join(known) or "none"

    said = (
        f"**Limits, friction and contacts** act as MuJoCo has them, beside exact loops: up to {row['active_max']} rows "
        f"push, and which of them changes in {figure(row['active_changes'])} of {figure(row['steps_done'])} steps. "
        f"Their forces take {figure(row['newton_mean'])} Newton iterations a solve, {row['newton_max']} at most, and "
        f"leave a relative gradient of {figure(row['optimality_max'])} beyond rounding. Largest forces, N or N m: "
        f"{told(row)}"
    )
    if compared.default:
        said += f"; in MuJoCo's run {told(compared.default)}"
    if row["blocked_max"]:
        said += f". {row['blocked_max']} of them push against loops that nothing can move"
    yield f"{said}."


def _curvature(tables: Tables, compared: Compared) -> Iterator[str]:
    exact, stiff, question = compared.exact, compared.stiff, compared.question
    if not (tables.without_curvature and stiff and exact):
        return
    answered = ""
    if question:
        answered = f", and by {figure(question['drift_pos_max'], tables.unit)} when the Rust solver answers the same "
        answered += "question"
    yield (
        "**J̇v left out.** MuJoCo's question has no J̇v for joint and tendon equalities "
        f"({cell(', '.join(tables.without_curvature))}): with stiff settings the loops stand open by "
        f"{figure(stiff['drift_pos_max'], tables.unit)}{answered}. The exact question has it: "
        f"{figure(exact['drift_pos_max'], tables.unit)}."
    )


def _projection(tables: Tables, compared: Compared) -> Iterator[str]:
    landed = [row for row in compared.projected if row["status"] == "done"]
    if not landed:
        return
    known = [
        f"{row['integrator']} is {figure(row['truth_error_max'], tables.truth_unit)} away"
        for row in landed
        if row["truth_error_max"] is not None
    ]
    yield (
        "**Projection.** With positions and velocities projected onto the constraints after every step the loops stand "
        f"open by at most {figure(max(row['drift_pos_max'] for row in landed), tables.unit)} and their rows move by at "
        f"most {figure(max(row['drift_vel_max'] for row in landed), tables.rate_unit)} "
        f"({', '.join(dict.fromkeys(row['integrator'] for row in landed))})"
        f"{'; from the outside truth ' if known else ''}{', '.join(known)}."
    )


def _iterations(tables: Tables, compared: Compared) -> Iterator[str]:
    along, soft = compared.along, compared.soft
    if not along:
        return
    paper = (tables.case["paper"] or {}).get("iterations_mean")
    said = (
        f"**Iterations.** The paper's algorithm (sr1) takes {figure(along['iterations_mean'])} iterations a step along "
        f"the exact trajectory{f'; the paper reports {paper}' if paper else ''}. It solves A λ = b to "
        f"{figure(along['residual_rel_max'])}, relative, but its multipliers are not the minimum-norm ones: they are "
        f"off by up to {round(100 * along['min_norm_error_max'], 1)} % "
        f"(median {round(100 * along['min_norm_error_median'], 1)} %)."
    )
    if soft and soft["unconverged"]:
        said += (
            " Along MuJoCo's soft trajectory, where the redundant rows contradict one another by up to "
            f"{figure(soft['inconsistency_max'])}, its stopping test is out of reach in {figure(soft['unconverged'])} "
            f"of {figure(soft['solves'])} solves."
        )
    yield said


def _in_the_loop(tables: Tables, compared: Compared) -> Iterator[str]:
    runs = compared.loops
    if not runs:
        return
    paper = tables.case["paper"] or {}
    whose = "The paper's own experiment is another one" if paper and compared.along else "Here sr1 walks"
    said = f"**In the loop.** {whose}: the solver walks, and its next system is what its own answers led to. "
    told = []
    for row in runs:
        options = row["solver"].partition(":")[2].replace(",", ", ")
        one = f"{figure(row['iterations_mean'])} ({row['integrator']}{', ' if options else ''}{options}"
        if row["unconverged"]:
            one += f"; {figure(row['unconverged'])} of {figure(row['solves'])} not converged"
        told.append(f"{one})")
    said += f"There sr1 takes {', '.join(told)} iterations a solve."
    if wanted := paper.get("iterations_mean"):
        nearest = min((row["iterations_mean"] for row in runs), key=lambda found: abs(found - wanted))
        said += f" The nearest of these to the {wanted} of the paper ({cell(paper['source'])}) is {figure(nearest)}"
        said += f", {figure(abs(nearest - wanted))} away." if abs(nearest - wanted) >= 5e-4 else "."
    yield said


def _claims(tables: Tables, _: Compared) -> Iterator[str]:
    claims = (tables.case["paper"] or {}).get("claims") or []
    if not claims:
        return
    failed = [cell(claim["claim"].rstrip(".")) for claim in claims if not claim["holds"]]
    held = len(claims) - len(failed)
    said = f"**The paper's claims.** {held} of {len(claims)} hold{'s' if held == 1 else ''}"
    yield f"{said}; these do not: {'; '.join(failed)}." if failed else f"{said}."
