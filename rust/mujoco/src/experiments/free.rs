//! Everyone walks alone.

use std::mem;
use std::sync::Arc;

use oarlock_core::{Info, Status};

use super::Solver;
use super::common::{Companion, MujocoWalker, apart, loads, projecting, proving, pushing};
use crate::error::Error;
use crate::force::{SolvedForce, Tally};
use crate::library::Data;
use crate::projection::Projector;
use crate::run::{Experiment, Notes, Observed, Run, Setup, Snapshot};
use crate::state::{Form, State};
use crate::steps::Steps;
use crate::vectors::relative_difference;
use crate::walker::{ForcedWalker, bounded, is_sane};

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
        steps.word("status", Status::Converged.name());
        steps.int("solves", 1);
        steps.int("unconverged", 0);
        steps.int("iterations", iterations);
        steps.int("iterations_worst", iterations);
        if self.notes.inequalities {
            loads(steps, self.state.others(), &data.force()[data.ne()..]);
        }
        self.notes.free(steps, step, data)
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        self.steps.float("step_us", step_us);
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

/// The same walk with half the timestep and another solver, beside it: what is between the two says how far the walk is off,
/// be it by its steps or by its solver.
struct Halved {
    walker: ForcedWalker<SolvedForce>,
    /// 2^p / (2^p − 1) with p the order of the integrator: the whole error over the half that halving takes away (Richardson).
    scale: f64,
    alive: bool,
    apart: Vec<f64>,
}

impl Halved {
    fn new(setup: &Setup, form: Form, solver: Solver, projector: Option<&Projector>) -> Result<Self, Error> {
        let model = Arc::new(setup.model.unsolved(0.5 * setup.model.timestep())?);
        let projector = projector.map(|projector| projector.twin(&model));
        let nv = model.nv();
        let own = Setup { model, ..setup.clone() };
        let force = SolvedForce::new(own.state()?, form, solver, nv);
        let scale = if own.model.is_staged() { 16.0 / 15.0 } else { 2.0 };
        let walker = ForcedWalker::new(own.data()?, own.drive, force, projector)?;
        Ok(Self { walker, scale, alive: true, apart: vec![0.0; nv] })
    }

    /// Notes the estimates, rad or m, and takes two steps; infinity where it was lost.
    fn compare(&mut self, steps: &mut Steps, observed: Option<Observed>, ours: &Data) -> Result<(), Error> {
        self.look()?;
        let mut between = [f64::INFINITY; 2];
        if self.alive {
            let theirs = &self.walker.data;
            between[0] = apart(&mut self.apart, theirs, ours.qpos()).unwrap_or(f64::INFINITY);
            between[1] = observed.map_or(0.0, |observed| {
                let pairs = observed.place(ours).iter().zip(observed.place(theirs));
                pairs.map(|(own, other)| (own - other).abs()).fold(0.0, f64::max)
            });
        }
        let [whole, seen] = between.map(|between| self.scale * between);
        steps.float("error_estimate", whole);
        if observed.is_some() {
            steps.float("truth_error_estimate", seen);
        }
        self.step()?;
        self.look()?;
        self.step()
    }

    fn look(&mut self) -> Result<(), Error> {
        self.go_on(|walker| {
            walker.look()?;
            Ok(bounded(walker.data.qacc()))
        })
    }

    fn step(&mut self) -> Result<(), Error> {
        self.go_on(|walker| {
            walker.step()?;
            Ok(is_sane(&walker.data))
        })
    }

    /// What ends it does not end the walk that it is beside, unless MuJoCo itself failed.
    fn go_on(
        &mut self,
        call: impl FnOnce(&mut ForcedWalker<SolvedForce>) -> Result<bool, Error>,
    ) -> Result<(), Error> {
        if self.alive {
            self.alive = match call(&mut self.walker) {
                Err(error @ Error::Mujoco(_)) => return Err(error),
                outcome => outcome.unwrap_or(false),
            };
        }
        Ok(())
    }
}

struct FreeSolved {
    walker: ForcedWalker<SolvedForce>,
    /// MuJoCo as configured, and with it the judge of the multipliers; none where the walk alone is asked for.
    theirs: Option<Companion>,
    halved: Option<Halved>,
    /// What is known of the question of the step.
    known: Info,
    notes: Notes,
    steps: Steps,
}

/// A solver walks in a form; another one may walk beside it with half the timestep, which tells its error. Where it is `judged`,
/// so does MuJoCo as configured, and every multiplier is held against the minimum-norm ones of another solver.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`].
pub fn free_solved(
    setup: &Setup,
    form: Form,
    solver: Solver,
    projector: Option<Projector>,
    beside: Option<Solver>,
    judged: bool,
    steps: usize,
) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let halved = beside.map(|beside| Halved::new(setup, form, beside, projector.as_ref())).transpose()?;
    let force = SolvedForce::new(setup.state()?, form, solver, nv);
    let own = Setup { model: Arc::new(setup.model.unsolved(setup.model.timestep())?), ..setup.clone() };
    let experiment = FreeSolved {
        walker: ForcedWalker::new(own.data()?, own.drive, force, projector)?,
        theirs: judged.then(|| Companion::new(setup)).transpose()?,
        halved,
        known: Info::trivial(0.0),
        notes: Notes::new(setup),
        steps: Steps::default(),
    };
    Ok(Run::new(experiment, steps))
}

impl Experiment for FreeSolved {
    fn unrecorded(&mut self) {
        self.walker.force.answer.recorded = false;
    }

    fn look(&mut self) -> Result<(), Error> {
        self.walker.force.tally = Tally::default();
        self.walker.look()
    }

    fn record(&mut self, step: usize) -> Result<(), Error> {
        let Self { walker, theirs, halved, known, notes, steps } = self;
        let (data, force) = (&mut walker.data, &mut walker.force);
        notes.state(steps, step, data, &force.state, data.qacc());
        if let Some(theirs) = theirs {
            theirs.compare(steps, data.qpos())?;
            let (multipliers, info) = force.system.reference(&*force.solver)?;
            steps.float("min_norm_error", relative_difference(&force.answer.multipliers, multipliers));
            *known = *info;
        } else {
            *known = force.answer.info;
        }
        if let Some(halved) = halved {
            halved.compare(steps, notes.observed, data)?;
        }
        notes.free(steps, step, data)?;
        if notes.inequalities {
            pushing(steps, force.state.others(), &force.inequalities);
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        let tally = mem::take(&mut self.walker.force.tally);
        tally.write(&mut self.steps, &self.known);
        if self.notes.inequalities {
            proving(&mut self.steps, &tally);
        }
        projecting(&mut self.steps, self.walker.projector.as_ref());
        self.steps.float("step_us", step_us);
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
