//! Everyone walks alone.

use std::mem;
use std::sync::Arc;

use oarlock_core::{Info, Status};

use super::Solver;
use super::common::{Companion, MujocoWalker, projecting};
use crate::error::Error;
use crate::force::{SolvedForce, Tally};
use crate::library::Data;
use crate::projection::Projector;
use crate::run::{Experiment, Notes, Run, Setup, Snapshot};
use crate::state::{Form, State};
use crate::steps::Steps;
use crate::vectors::relative_difference;
use crate::walker::ForcedWalker;

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

struct FreeSolved {
    walker: ForcedWalker<SolvedForce>,
    theirs: Companion,
    /// What is known of the question of the step.
    known: Info,
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
    steps: usize,
) -> Result<Run, Error> {
    let nv = setup.model.nv();
    let force = SolvedForce::new(setup.state()?, form, solver, nv);
    let own = Setup { model: Arc::new(setup.model.unsolved()?), ..setup.clone() };
    let experiment = FreeSolved {
        walker: ForcedWalker::new(own.data()?, own.drive, force, projector)?,
        theirs: Companion::new(setup)?,
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
        let Self { walker, theirs, known, notes, steps } = self;
        let (data, force) = (&mut walker.data, &mut walker.force);
        notes.state(steps, step, data, &force.state, data.qacc());
        theirs.compare(steps, data.qpos())?;
        notes.free(steps, step, data)?;
        let (multipliers, info) = force.system.reference(&*force.solver)?;
        steps.float("min_norm_error", relative_difference(&force.answer.multipliers, multipliers));
        *known = *info;
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.walker.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        mem::take(&mut self.walker.force.tally).write(&mut self.steps, &self.known);
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
