//! What the experiments share.

use oarlock_core::{Info, Status};

use crate::drive::Drive;
use crate::error::Error;
use crate::force::Tally;
use crate::inequalities::{Inequalities, Loads, Rows};
use crate::library::{Data, with_controls};
use crate::projection::Projector;
use crate::run::Setup;
use crate::steps::Steps;
use crate::vectors::largest;
use crate::walker::is_sane;

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
        if !drive.is_staged() || !data.model().is_staged() {
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
            steps.maybe("trajectory_diff", None);
            return Ok(());
        }
        steps.maybe("trajectory_diff", apart(&mut self.apart, &self.walker.data, qpos));
        self.walker.look()?;
        self.walker.step()?;
        self.alive = is_sane(&self.walker.data);
        Ok(())
    }
}

/// Largest difference of positions from those of a data in any coordinate; nothing if one is not finite.
pub(super) fn apart(work: &mut [f64], data: &Data, qpos: &[f64]) -> Option<f64> {
    data.model().differentiate(work, data.qpos(), qpos);
    let difference = largest(work);
    difference.is_finite().then_some(difference)
}

impl Tally {
    /// Writes it down, with what is known of the question.
    pub(super) fn write(&self, steps: &mut Steps, known: &Info) {
        steps.word("status", self.status.unwrap_or(Status::Converged).name());
        steps.int("solves", self.solves);
        steps.int("unconverged", self.unconverged);
        steps.int("iterations", self.iterations);
        steps.int("iterations_worst", self.iterations_worst);
        steps.int("products", self.products);
        steps.int("refreshes", self.refreshes);
        steps.int("refolds", self.refolds);
        steps.float("residual_rel", self.residual_rel);
        steps.int("solve_ns", self.solve_ns);
        steps.maybe_size("rank", known.rank);
        steps.maybe("inconsistency", known.inconsistency);
        steps.maybe("rank_margin", known.margin.filter(|margin| margin.is_finite()));
        steps.int("rank_rises", i64::from(known.risen || self.risen));
    }
}

/// Writes down what limits, friction loss and contacts do at the start of a step; nothing of a state without.
pub(super) fn pushing(steps: &mut Steps, rows: &Rows, inequalities: &Inequalities) {
    loads(steps, rows, inequalities.forces());
    steps.maybe_size("active", inequalities.report.map(|report| report.active));
    steps.maybe_size("blocked", inequalities.report.map(|report| report.blocked));
}

/// Writes down what it took to find that out, in all solves of the step.
pub(super) fn proving(steps: &mut Steps, tally: &Tally) {
    let counted = |count: i64| tally.pushed.then(|| usize::try_from(count).unwrap_or(0));
    steps.maybe_size("active_changes", counted(i64::from(tally.changed)));
    steps.maybe_size("newton", counted(tally.newton));
    steps.maybe_size("newton_worst", counted(tally.newton_worst));
    steps.maybe("optimality", tally.pushed.then_some(tally.optimality));
}

/// Writes down how many limits, friction losses and contacts there are, and how hard they push with such forces.
pub(super) fn loads(steps: &mut Steps, rows: &Rows, forces: &[f64]) {
    let found = (forces.len() == rows.len() && !rows.is_empty()).then(|| rows.loads(forces));
    steps.maybe_size("inequalities", found.map(|_| rows.len()));
    let of = |load: fn(&Loads) -> f64| found.as_ref().map(load);
    steps.maybe("limit_force", of(|loads| loads.limit));
    steps.maybe("friction_force", of(|loads| loads.friction));
    steps.maybe("contact_force", of(|loads| loads.contact));
}

/// Writes down what the projection at the end of the step took.
pub(super) fn projecting(steps: &mut Steps, projector: Option<&Projector>) {
    if let Some(last) = projector.and_then(|projector| projector.last) {
        steps.word("projection", last.landing.name());
        steps.int("projection_rounds", last.rounds);
        steps.int("projection_solves", last.solves);
        steps.int("projection_iterations", last.iterations);
        steps.float("projection_moved", last.moved);
    }
}
