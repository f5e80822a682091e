//! What the experiments share.

use oarlock_core::{Info, Status};

use crate::drive::Drive;
use crate::error::Error;
use crate::force::Tally;
use crate::library::{Data, Integrator, with_controls};
use crate::projection::Projector;
use crate::run::Setup;
use crate::steps::Steps;
use crate::vectors::largest;
use crate::walker::is_finite;

/// MuJoCo on its own way.
pub(super) struct MujocoWalker {
    pub(super) data: Data,
    pub(super) drive: Drive,
}

impl MujocoWalker {
    pub(super) fn new(setup: &Setup) -> Result<Self, Error> {
        Ok(Self { data: setup.data()?, drive: setup.drive.clone() })
    }

    pub(super) fn look(&mut self) -> Result<(), Error> {
        self.drive.apply(&mut self.data)?;
        self.data.forward()
    }

    /// The integrator alone.
    pub(super) fn step(&mut self) -> Result<(), Error> {
        self.controlled(Data::integrate)
    }

    /// A call that asks for controls at the stages of Runge–Kutta.
    pub(super) fn controlled(
        &mut self,
        call: impl FnOnce(&mut Data) -> Result<(), Error>,
    ) -> Result<(), Error> {
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
pub(super) struct Companion {
    walker: MujocoWalker,
    alive: bool,
    apart: Vec<f64>,
}

impl Companion {
    pub(super) fn new(setup: &Setup) -> Result<Self, Error> {
        Ok(Self { walker: MujocoWalker::new(setup)?, alive: true, apart: vec![0.0; setup.model.nv()] })
    }

    /// Notes how far positions are from it, rad or m, and takes its next step.
    pub(super) fn compare(&mut self, steps: &mut Steps, qpos: &[f64]) -> Result<(), Error> {
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
pub(super) fn apart(work: &mut [f64], data: &Data, qpos: &[f64]) -> f64 {
    data.model().differentiate(work, data.qpos(), qpos);
    let difference = largest(work);
    if difference.is_finite() { difference } else { f64::NAN }
}

impl Tally {
    /// Writes it down, with what is known of the question.
    pub(super) fn write(&self, steps: &mut Steps, known: &Info) {
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
pub(super) fn projecting(steps: &mut Steps, projector: Option<&Projector>) {
    if let Some(last) = projector.and_then(|projector| projector.last) {
        steps.projection.push(last.landing.name());
        steps.projection_rounds.push(last.rounds);
        steps.projection_solves.push(last.solves);
        steps.projection_iterations.push(last.iterations);
        steps.projection_moved.push(last.moved);
    }
}
