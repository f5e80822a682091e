//! One step from each of MuJoCo's states.

use super::Solver;
use super::common::{MujocoWalker, apart, proving, pushing};
use crate::error::Error;
use crate::force::{SolvedForce, Tally};
use crate::library::Data;
use crate::run::{Experiment, Notes, Run, Setup, Snapshot};
use crate::state::Form;
use crate::steps::Steps;
use crate::walker::ForcedWalker;

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
            steps.list("multipliers", &walker.force.answer.multipliers);
            if self.notes.inequalities {
                pushing(steps, walker.force.state.others(), &walker.force.inequalities);
            }
            walker.step()?;
            walker.force.tally.write(steps, &known);
            if self.notes.inequalities {
                proving(steps, &walker.force.tally);
            }
        }
        Ok(())
    }

    fn step(&mut self) -> Result<(), Error> {
        self.theirs.step()
    }

    fn finish(&mut self, step_us: f64) -> Result<(), Error> {
        for (walker, steps) in &mut self.ours {
            steps.maybe("trajectory_diff", apart(&mut self.apart, &self.theirs.data, walker.data.qpos()));
            steps.float("step_us", step_us);
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
