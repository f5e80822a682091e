"""All that was found out about a model, part by part."""

from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from oarlock.diagnosis.lint.collision import Collision
from oarlock.diagnosis.lint.view import Remark
from oarlock.diagnosis.loops.events import RankHistory
from oarlock.diagnosis.loops.gaps import Opening
from oarlock.diagnosis.loops.poses import ClosedPose
from oarlock.diagnosis.loops.stops import Stops
from oarlock.diagnosis.loops.uniqueness import Uniqueness
from oarlock.diagnosis.loops.wrenches import Wrench
from oarlock.diagnosis.options import CheckOptions, usual_target
from oarlock.diagnosis.runs.behind import Behind
from oarlock.diagnosis.runs.branch import Branch
from oarlock.diagnosis.runs.deadpoint import DeadPoint
from oarlock.diagnosis.runs.drifts import Drift
from oarlock.diagnosis.runs.exact import ExactRun
from oarlock.diagnosis.runs.fights import Fight
from oarlock.diagnosis.runs.lag import Lag
from oarlock.diagnosis.runs.lasting import Lasting
from oarlock.diagnosis.runs.leverless import Leverless
from oarlock.diagnosis.runs.missed import Clipped, Missed
from oarlock.diagnosis.runs.overdriven import Overdriven
from oarlock.diagnosis.runs.pace import Pace
from oarlock.diagnosis.runs.parted import Parted
from oarlock.diagnosis.runs.recipe import Recipe
from oarlock.diagnosis.runs.recording import Recording
from oarlock.diagnosis.runs.rotors import Rotors
from oarlock.diagnosis.runs.row_law import Accelerations, Attribution
from oarlock.diagnosis.runs.slips import Slip
from oarlock.diagnosis.runs.stability import EqualityStability
from oarlock.diagnosis.runs.stopped import Stopped
from oarlock.diagnosis.runs.stuck import Stuck
from oarlock.diagnosis.runs.targets import Target
from oarlock.diagnosis.runs.throttled import Throttled
from oarlock.diagnosis.runs.trials import Made
from oarlock.diagnosis.runs.undriven import Undriven
from oarlock.diagnosis.runs.without import Without
from oarlock.mechanics import controls
from oarlock.mechanics.state_log import StateLog


@dataclass
class Examination:
    """All that was found out; a part that is not there yet, or cannot be, is None, and ``missing`` says why.

    Attributes:
        file: as it was given; path: of the MJCF.
        model: the user's, with nothing changed.
        qpos, qvel, act: the user's start, (nq), (nv) and (na).
        begins: where that start comes from, in words.
        laws: actuator → control as a law of time; driven: the same in words.
        own_s: how long the case's own run takes, s; None of a file.
        steps: of the run.
        ignored: contacts, limits and friction that were left out, in words; empty if none were.
        remarks: lint → what can be seen without a run.
        collisions: bodies that an equality joins and that collide, with what they cost in the run.
        pose: the nearest closed start, with the loops there (``pose.loops``).
        settings: spring, damper and stability of every equality.
        recording: MuJoCo's own run; exact: the exact solution from the closed start.
        drifts: of every equality at three levels.
        attribution: the drift by cause; accelerations: what MuJoCo's differ by from the exact ones at the same states.
        history: the rank along the exact motion, or along MuJoCo's where there is none.
        recipe: what would hold it.
        reactions: which are unique.
        size: of the loops at the closed start, m.
        without: what is left of the drift where time stepping, or a solver that stops early, is taken away.
        behind: what makes most of the largest drift, or makes the run diverge.
        calmer: the part of the force of the driver of ``pace`` with which the worst drift is a tenth, and that tenth.
        rotors: an armature that soft couplings lack.
        pace: the joint that turns furthest within a step.
        dead_point: a joint that MuJoCo takes beyond what the loops admit.
        branch: another branch that MuJoCo's run ends on.
        lasting: what stays open for good behind an open start.
        lags: couplings that lag because their joints rub.
        stops: the limits that lock it at the closed start.
        stopped: limits that open an equality of their loop in MuJoCo's run.
        parted: equalities that are switched off, whose sides part in the run.
        overdriven: servos that pull a loop apart which has not so much freedom.
        stuck: servos that something holds short of where they are told to be.
        missed: servos that do not come to where they are told; clipped: controls beyond their range.
        throttled: joints whose own range cuts what drives them.
        undriven: loops with more freedom than drives.
        leverless: actuators without a lever at the start.
        slips: objects that a gripper lets go.
        targets: mocap bodies that what is joined to them cannot follow.
        fight: limits and contacts that push against loops alone in the exact run.
        given, determined: wrenches of MuJoCo's run and of the exact one.
        states: the log of states that takes the place of MuJoCo's own run.
        missing: part → why it is not there.
        withheld: code of what has to be mended before settings that hold the loops are of use; empty: nothing.
        made: trials, for those that look for more.
    """

    file: str
    path: Path
    model: mujoco.MjModel
    qpos: np.ndarray
    qvel: np.ndarray
    begins: str
    laws: dict[str, str]
    driven: str
    own_s: float | None
    options: CheckOptions
    act: np.ndarray = field(default_factory=lambda: np.zeros(0))
    steps: int = 0
    ignored: str = ""
    remarks: dict[str, list[Remark]] = field(default_factory=dict)
    collisions: tuple[Collision, ...] = ()
    pose: ClosedPose | None = None
    settings: list[EqualityStability] = field(default_factory=list)
    recording: Recording | None = None
    exact: ExactRun | None = None
    drifts: list[Drift] = field(default_factory=list)
    attribution: Attribution | None = None
    accelerations: Accelerations | None = None
    history: RankHistory | None = None
    recipe: Recipe | None = None
    reactions: Uniqueness | None = None
    size: float = 1.0
    without: list[Without] = field(default_factory=list)
    behind: Behind | None = None
    calmer: tuple[float, Opening] | None = None
    rotors: Rotors | None = None
    pace: Pace | None = None
    dead_point: DeadPoint | None = None
    branch: Branch | None = None
    lasting: list[Lasting] = field(default_factory=list)
    lags: tuple[Lag, ...] = ()
    stops: Stops | None = None
    stopped: tuple[Stopped, ...] = ()
    overdriven: tuple[Overdriven, ...] = ()
    stuck: tuple[Stuck, ...] = ()
    missed: tuple[Missed, ...] = ()
    throttled: tuple[Throttled, ...] = ()
    clipped: tuple[Clipped, ...] = ()
    undriven: tuple[Undriven, ...] = ()
    leverless: tuple[Leverless, ...] = ()
    slips: tuple[Slip, ...] = ()
    targets: tuple[Target, ...] = ()
    parted: tuple[Parted, ...] = ()
    fight: Fight | None = None
    given: tuple[Wrench, ...] = ()
    determined: tuple[Wrench, ...] = ()
    states: StateLog | None = None
    missing: dict[str, str] = field(default_factory=dict)
    withheld: str = ""
    made: Made = field(default_factory=Made)

    @property
    def timestep_s(self) -> float:
        """Of the model."""
        return float(self.model.opt.timestep)

    @property
    def duration_s(self) -> float:
        """Of the run."""
        return self.steps * self.timestep_s

    @property
    def target(self) -> float:
        """Wanted drift, m or rad: as asked for, or by the size of the loops."""
        return self.options.target or usual_target(self.size)

    @property
    def moved(self) -> bool:
        """Whether mocap bodies are moved: then a pose is closed at the time that it belongs to alone."""
        return controls.moves_mocaps(self.laws)

    @property
    def closed(self) -> bool:
        """Whether there is a closed start to run the exact solution from."""
        return self.pose is not None and self.pose.closed
