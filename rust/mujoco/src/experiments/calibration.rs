//! MuJoCo's own force through our stepping.

use oarlock_core::Status;

use super::common::Companion;
use crate::error::Error;
use crate::force::MujocoForce;
use crate::library::Data;
use crate::run::{Experiment, Notes, Run, Setup, Snapshot};
use crate::steps::Steps;
use crate::walker::ForcedWalker;

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
        self.steps.word("status", Status::Converged.name());
        self.theirs.compare(&mut self.steps, self.walker.data.qpos())
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
