//! The experiments: calibration, lockstep, one-step, free run. The same as `oarlock.experiments`, figure for figure.

use std::mem;

use oarlock_core::{ConstrainedSystem, Info, MultiplierSolver, Status};

use crate::drive::Drive;
use crate::error::Error;
use crate::force::{Answer, MujocoForce, SolvedForce, Tally};
use crate::library::{Data, Integrator, with_controls};
use crate::projection::Projector;
use crate::run::{Experiment, Notes, Run, Setup, Snapshot};
use crate::state::{Form, State};
use crate::steps::Steps;
use crate::vectors::{largest, relative_difference};
use crate::walker::{ForcedWalker, is_finite};

/// A solver of its own.
pub type Solver = Box<dyn MultiplierSolver>;

/// MuJoCo on its own way.
struct MujocoWalker {
    data: Data,
    drive: Drive,
}

impl MujocoWalker {
    fn new(setup: &Setup) -> Result<Self, Error> {
        Ok(Self { data: setup.data()?, drive: setup.drive.clone() })
    }

    fn look(&mut self) -> Result<(), Error> {
        self.drive.apply(&mut self.data)?;
        self.data.forward()
    }

    /// The integrator alone.
    fn step(&mut self) -> Result<(), Error> {
        self.controlled(Data::integrate)
    }

    /// A call that asks for controls at the stages of Runge–Kutta.
    fn controlled(&mut self, call: impl FnOnce(&mut Data) -> Result<(), Error>) -> Result<(), Error> {
        let Self { data, drive } = self;
        if drive.is_empty() || data.model().integrator() != Integrator::RungeKutta {
            return call(data);
        }
        let model = data.model().clone();
        with_controls(&model, drive, || call(data))?;
        drive.take_failure()
    }
}

/// MuJoCo's own trajectory, beside another one.
struct Companion {
    walker: MujocoWalker,
    alive: bool,
    apart: Vec<f64>,
}

impl Companion {
    fn new(setup: &Setup) -> Result<Self, Error> {
        Ok(Self { walker: MujocoWalker::new(setup)?, alive: true, apart: vec![0.0; setup.model.nv()] })
    }

    /// Notes how far positions are from it, rad or m, and takes its next step.
    fn compare(&mut self, steps: &mut Steps, qpos: &[f64]) -> Result<(), Error> {
        if !self.alive {
            steps.trajectory_diff.push(f64::NAN);
            return Ok(());
        }
        steps.trajectory_diff.push(apart(&mut self.apart, &self.walker.data, qpos));
        self.walker.look()?;
        self.walker.step()?;
        self.alive = is_finite(&self.walker.data);
        Ok(())
    }
}

/// Largest difference of positions from those of a data in any coordinate; NaN if one is not finite.
fn apart(work: &mut [f64], data: &Data, qpos: &[f64]) -> f64 {
    data.model().differentiate(work, data.qpos(), qpos);
    let difference = largest(work);
    if difference.is_finite() { difference } else { f64::NAN }
}

impl Tally {
    /// Writes it down, with what is known of the question.
    fn write(&self, steps: &mut Steps, known: &Info) {
        steps.status.push(self.status.unwrap_or(Status::Converged).name());
        steps.solves.push(self.solves);
        steps.unconverged.push(self.unconverged);
        steps.iterations.push(self.iterations);
        steps.iterations_worst.push(self.iterations_worst);
        steps.products.push(self.products);
        steps.refreshes.push(self.refreshes);
        steps.refolds.push(self.refolds);
        steps.residual_rel.push(self.residual_rel);
        steps.solve_ns.push(self.solve_ns);
        steps.rank.push(known.rank.map_or(-1, |rank| i64::try_from(rank).unwrap_or(i64::MAX)));
        steps.inconsistency.push(known.inconsistency.unwrap_or(f64::NAN));
    }
}

/// Writes down what the projection at the end of the step took.
fn projecting(steps: &mut Steps, projector: Option<&Projector>) {
    if let Some(last) = projector.and_then(|projector| projector.last) {
        steps.projection.push(last.landing.name());
        steps.projection_rounds.push(last.rounds);
        steps.projection_solves.push(last.solves);
        steps.projection_iterations.push(last.iterations);
        steps.projection_moved.push(last.moved);
    }
}

struct Calibration {
    walker: ForcedWalker<MujocoForce>,
    theirs: Companion,
    notes: Notes,
    steps: Steps,
}

/// MuJoCo's own force through our stepping, against MuJoCo: the trajectory difference must be rounding.
///
/// # Errors
/// Those of [`ForcedWalker::new`].
pub fn calibration(setup: &Setup, steps: usize) -> Result<Run, Error> {
    let force = MujocoForce::new(setup.model.nv());
    let experiment = Calibration {
        walker: ForcedWalker::new(setup.data()?, setup.drive.clone(), force, None)?,
        theirs: Companion::new(setup)?,
        notes: Notes::new(setup),
        steps: Steps::default(),
    };
    Ok(Run::new(experiment, steps))
}

impl Experiment for Calibration {
    fn look(&mut self) -> Result<(), Error> {
        self.walker.look()
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        self.notes.place(&mut self.steps, step, &self.walker.data);
        self.steps.status.push(Status::Converged.name());
        self.theirs.compare(&mut self.steps, self.walker.data.qpos())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        self.steps.step_us.push(step_us);
        Ok(())
    }

    fn data(&self) -> &Data {
        &self.walker.data
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        vec![&mut self.steps]
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}

/// Who walks in lockstep.
enum Leader {
    Mujoco(Box<(MujocoWalker, State)>),
    Solver(Box<ForcedWalker<SolvedForce>>),
}

/// A question of a form with everyone who answers it.
struct Question {
    form: Form,
    system: ConstrainedSystem,
    reference: Solver,
    truth: Answer,
    answer: Answer,
    solvers: Vec<(Solver, Steps)>,
}

struct Lockstep {
    leader: Leader,
    questions: Vec<Question>,
    notes: Notes,
    qacc: Vec<f64>,
    qfrc: Vec<f64>,
    own: [Vec<f64>; 3],
}

/// A form, the solver whose multipliers count as the minimum-norm ones, and the solvers held against it.
pub type Asked = (Form, Solver, Vec<Solver>);

/// One engine walks; at each of its states every solver answers the same question, and MuJoCo its own. `leader` is a solver
/// that walks in the hard form with what ends its steps, or none for MuJoCo.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`].
pub fn lockstep(
    setup: &Setup,
    leader: Option<(Solver, Option<Projector>)>,
    asked: Vec<Asked>,
    steps: usize,
) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let leader = match leader {
        None => Leader::Mujoco(Box::new((MujocoWalker::new(setup)?, setup.state()?))),
        Some((solver, projector)) => {
            let force = SolvedForce::new(setup.state()?, Form::Hard, solver, nv);
            Leader::Solver(Box::new(ForcedWalker::new(setup.data()?, setup.drive.clone(), force, projector)?))
        }
    };
    let question = |(form, reference, solvers): Asked| Question {
        form,
        system: ConstrainedSystem::new(),
        reference,
        truth: Answer::new(nv),
        answer: Answer::new(nv),
        solvers: solvers.into_iter().map(|solver| (solver, Steps::default())).collect(),
    };
    let experiment = Lockstep {
        leader,
        questions: asked.into_iter().map(question).collect(),
        notes: Notes::new(setup),
        qacc: vec![0.0; nv],
        qfrc: vec![0.0; nv],
        own: [vec![0.0; nv], vec![0.0; nv], Vec::new()],
    };
    Ok(Run::new(experiment, steps))
}

impl Lockstep {
    /// MuJoCo's own acceleration and constraint force here; the leader's are put back.
    fn ask_mujoco(&mut self) -> Result<(), Error> {
        let theirs = match &mut self.leader {
            Leader::Mujoco(theirs) => {
                let (walker, state) = &mut **theirs;
                state.read(&mut walker.data)?;
                self.qacc.copy_from_slice(walker.data.qacc());
                self.qfrc.copy_from_slice(walker.data.qfrc_constraint());
                return Ok(());
            }
            Leader::Solver(walker) => {
                walker.force.state.read(&mut walker.data)?;
                &mut walker.data
            }
        };
        let [qacc, qfrc, force] = &mut self.own;
        qacc.copy_from_slice(theirs.qacc());
        qfrc.copy_from_slice(theirs.qfrc_constraint());
        force.clear();
        force.extend_from_slice(theirs.force());
        theirs.constraint_stage()?;
        self.qacc.copy_from_slice(theirs.qacc());
        self.qfrc.copy_from_slice(theirs.qfrc_constraint());
        theirs.qacc_mut().copy_from_slice(qacc);
        theirs.qfrc_constraint_mut().copy_from_slice(qfrc);
        theirs.force_mut().copy_from_slice(force);
        Ok(())
    }
}

impl Experiment for Lockstep {
    fn look(&mut self) -> Result<(), Error> {
        match &mut self.leader {
            Leader::Mujoco(theirs) => theirs.0.look(),
            Leader::Solver(walker) => {
                walker.force.tally = Tally::default();
                walker.look()
            }
        }
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        self.ask_mujoco()?;
        let (data, state) = match &mut self.leader {
            Leader::Mujoco(theirs) => (&mut theirs.0.data, &mut theirs.1),
            Leader::Solver(walker) => (&mut walker.data, &mut walker.force.state),
        };
        for question in &mut self.questions {
            let Question { form, system, reference, truth, answer, solvers } = question;
            state.ask(data, *form, system)?;
            truth.fill(data, state, system, &mut **reference)?;
            for (solver, steps) in solvers {
                answer.fill(data, state, system, &mut **solver)?;
                self.notes.state(steps, step, data, state, &answer.qacc);
                let mut tally = Tally::default();
                tally.add(&answer.info, answer.elapsed);
                tally.write(steps, &truth.info);
                steps.min_norm_error.push(relative_difference(&answer.multipliers, &truth.multipliers));
                steps.qacc_rel_diff.push(relative_difference(&answer.qacc, &self.qacc));
                steps.qfrc_constraint_rel_diff.push(relative_difference(&answer.qfrc, &self.qfrc));
                steps.multipliers.push(&answer.multipliers);
            }
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        match &mut self.leader {
            Leader::Mujoco(theirs) => theirs.0.step(),
            Leader::Solver(walker) => walker.step(),
        }
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        let projector = match &self.leader {
            Leader::Mujoco(_) => None,
            Leader::Solver(walker) => walker.projector.as_ref(),
        };
        for (_, steps) in self.questions.iter_mut().flat_map(|question| &mut question.solvers) {
            projecting(steps, projector);
            steps.step_us.push(step_us);
        }
        Ok(())
    }

    fn data(&self) -> &Data {
        match &self.leader {
            Leader::Mujoco(theirs) => &theirs.0.data,
            Leader::Solver(walker) => &walker.data,
        }
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        self.questions.iter_mut().flat_map(|question| &mut question.solvers).map(|(_, steps)| steps).collect()
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}

struct OneStep {
    theirs: MujocoWalker,
    ours: Vec<(ForcedWalker<SolvedForce>, Steps)>,
    notes: Notes,
    apart: Vec<f64>,
}

/// From each of MuJoCo's states, one step each: what a single step adds to the difference. Never projected: from MuJoCo's
/// states, which are open, the way to the manifold would drown what a step adds.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`].
pub fn one_step(setup: &Setup, asked: Vec<(Form, Solver)>, steps: usize) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let walker = |(form, solver)| {
        let force = SolvedForce::new(setup.state()?, form, solver, nv);
        Ok((ForcedWalker::new(setup.data()?, setup.drive.clone(), force, None)?, Steps::default()))
    };
    let experiment = OneStep {
        theirs: MujocoWalker::new(setup)?,
        ours: asked.into_iter().map(walker).collect::<Result<_, Error>>()?,
        notes: Notes::new(setup),
        apart: vec![0.0; nv],
    };
    Ok(Run::new(experiment, steps))
}

impl Experiment for OneStep {
    fn look(&mut self) -> Result<(), Error> {
        self.theirs.look()
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        for (walker, steps) in &mut self.ours {
            let (data, from) = (&mut walker.data, &self.theirs.data);
            data.qpos_mut().copy_from_slice(from.qpos());
            data.qvel_mut().copy_from_slice(from.qvel());
            data.act_mut().copy_from_slice(from.act());
            data.set_time(from.time());
            walker.force.tally = Tally::default();
            walker.look()?;
            let known = walker.force.answer.info;
            self.notes.state(steps, step, &walker.data, &walker.force.state, walker.data.qacc());
            steps.multipliers.push(&walker.force.answer.multipliers);
            walker.step()?;
            walker.force.tally.write(steps, &known);
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.theirs.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        for (walker, steps) in &mut self.ours {
            steps.trajectory_diff.push(apart(&mut self.apart, &self.theirs.data, walker.data.qpos()));
            steps.step_us.push(step_us);
        }
        Ok(())
    }

    fn data(&self) -> &Data {
        &self.theirs.data
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        self.ours.iter_mut().map(|(_, steps)| steps).collect()
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}

struct FreeMujoco {
    walker: MujocoWalker,
    state: State,
    notes: Notes,
    steps: Steps,
}

/// MuJoCo walks alone.
///
/// # Errors
/// Those of [`State::new`].
pub fn free_mujoco(setup: &Setup, steps: usize) -> Result<Run, Error> {
    let experiment = FreeMujoco {
        walker: MujocoWalker::new(setup)?,
        state: setup.state()?,
        notes: Notes::new(setup),
        steps: Steps::default(),
    };
    Ok(Run::new(experiment, steps))
}

impl Experiment for FreeMujoco {
    fn look(&mut self) -> Result<(), Error> {
        self.walker.look()
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        let (data, steps) = (&mut self.walker.data, &mut self.steps);
        self.state.read(data)?;
        self.notes.state(steps, step, data, &self.state, data.qacc());
        let iterations = data.solver_iterations();
        steps.status.push(Status::Converged.name());
        steps.solves.push(1);
        steps.unconverged.push(0);
        steps.iterations.push(iterations);
        steps.iterations_worst.push(iterations);
        self.notes.free(steps, step, data)
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        self.steps.step_us.push(step_us);
        Ok(())
    }

    fn data(&self) -> &Data {
        &self.walker.data
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        vec![&mut self.steps]
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}

struct Bare {
    walker: MujocoWalker,
}

/// `mj_step` alone, and nothing written down: what a comparison is measured against.
///
/// # Errors
/// Those of [`Setup::data`].
pub fn bare(setup: &Setup, steps: usize) -> Result<Run, Error> {
    Ok(Run::new(Bare { walker: MujocoWalker::new(setup)? }, steps))
}

impl Experiment for Bare {
    fn look(&mut self) -> Result<(), Error> {
        self.walker.drive.apply(&mut self.walker.data)
    }

    fn record(&mut self, _step: usize) -> Result<(), Error> {
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.controlled(Data::step)
    }

    fn finish(&mut self, _step_us: f64) -> Result<(), Error> {
        Ok(())
    }

    fn data(&self) -> &Data {
        &self.walker.data
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        Vec::new()
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        Vec::new()
    }
}

struct FreeSolved {
    walker: ForcedWalker<SolvedForce>,
    theirs: Companion,
    reference: Solver,
    truth: Answer,
    notes: Notes,
    steps: Steps,
}

/// A solver walks alone in a form, against MuJoCo as configured.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`].
pub fn free_solved(
    setup: &Setup,
    form: Form,
    solver: Solver,
    projector: Option<Projector>,
    reference: Solver,
    steps: usize,
) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let force = SolvedForce::new(setup.state()?, form, solver, nv);
    let experiment = FreeSolved {
        walker: ForcedWalker::new(setup.data()?, setup.drive.clone(), force, projector)?,
        theirs: Companion::new(setup)?,
        reference,
        truth: Answer::new(nv),
        notes: Notes::new(setup),
        steps: Steps::default(),
    };
    Ok(Run::new(experiment, steps))
}

impl Experiment for FreeSolved {
    fn unrecorded(&mut self) {
        self.walker.force.answer.timed = false;
    }

    fn look(&mut self) -> Result<(), Error> {
        self.walker.force.tally = Tally::default();
        self.walker.look()
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        let Self { walker, theirs, reference, truth, notes, steps } = self;
        let (data, force) = (&mut walker.data, &mut walker.force);
        notes.state(steps, step, data, &force.state, data.qacc());
        theirs.compare(steps, data.qpos())?;
        notes.free(steps, step, data)?;
        truth.fill(data, &mut force.state, &mut force.system, &mut **reference)?;
        steps.min_norm_error.push(relative_difference(&force.answer.multipliers, &truth.multipliers));
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        mem::take(&mut self.walker.force.tally).write(&mut self.steps, &self.truth.info);
        projecting(&mut self.steps, self.walker.projector.as_ref());
        self.steps.step_us.push(step_us);
        Ok(())
    }

    fn data(&self) -> &Data {
        &self.walker.data
    }

    fn tables(&mut self) -> Vec<&mut Steps> {
        vec![&mut self.steps]
    }

    fn snapshots(&mut self) -> Vec<Snapshot> {
        self.notes.take_snapshots()
    }
}
