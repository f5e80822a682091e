//! One step of exact constraints on data that belong to others, in place of `mj_step`.

use std::mem;
use std::sync::Arc;

use oarlock_core::{Info, MultiplierSolver};
use rayon::prelude::*;

use crate::drive::Drive;
use crate::error::Error;
use crate::force::{SolvedForce, Tally};
use crate::library::{Data, Model, Placement, without_timers};
use crate::projection::{Landing, Projection, Projector};
use crate::state::{Baumgarte, Form, State};
use crate::vectors::largest;
use crate::walker::{ForcedWalker, bounded, is_sane};

/// Steps the states of one model, each data in a lane of its own, which carries what its solver and its projector learn.
pub struct Stepper {
    model: Arc<Model>,
    terms: Baumgarte,
    solver: Box<dyn MultiplierSolver>,
    projector: Option<Box<dyn MultiplierSolver>>,
    noted: Noted,
    mocaps: bool,
    lanes: Vec<Lane>,
}

/// What a step writes into a data besides its state and forces.
#[derive(Debug, Clone, Copy, Default)]
pub struct Noted {
    /// Sensors.
    pub sensors: bool,
    /// Energies.
    pub energy: bool,
}

/// What the last step of a lane did.
#[derive(Debug, Clone, Copy)]
pub struct Figures<'a> {
    /// What its solver said of the last solve.
    pub info: &'a Info,
    /// All solves of the step.
    pub tally: &'a Tally,
    /// Multipliers at the last solve, ne.
    pub multipliers: &'a [f64],
    /// What rows leave open after the step, m or rad; before it where nothing projects.
    pub drift: f64,
    /// Limits, friction losses and contacts that push, and those of them that push against loops alone.
    pub pushing: Option<(usize, usize)>,
    /// What the projection did.
    pub projection: Option<Projection>,
}

struct Lane {
    walker: ForcedWalker<SolvedForce>,
    /// Whether the first state was looked at.
    begun: bool,
    /// m or rad.
    drift: f64,
    noted: Noted,
    start: Start,
    /// What the last step left.
    left: Placement,
    mocaps: bool,
}

/// The state that a step begins at, to which a data goes back where the step cannot be taken.
#[derive(Debug, Default)]
struct Start {
    time: f64,
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    act: Vec<f64>,
    /// What rows leave open, m or rad, and how fast that changes, 1/s of it.
    open: f64,
    rate: f64,
}

/// Of what a step leaves open, the part up to which its start may have been open itself and is not to blame for it.
const OWN: f64 = 0.01;

impl Start {
    fn take(&mut self, data: &Data) {
        self.time = data.time();
        for (kept, given) in
            [(&mut self.qpos, data.qpos()), (&mut self.qvel, data.qvel()), (&mut self.act, data.act())]
        {
            kept.clear();
            kept.extend_from_slice(given);
        }
    }

    fn give_back(&self, data: &mut Data) {
        data.set_time(self.time);
        data.qpos_mut().copy_from_slice(&self.qpos);
        data.qvel_mut().copy_from_slice(&self.qvel);
        data.act_mut().copy_from_slice(&self.act);
    }

    /// Why a step that ends with rows open by `drift` (m or rad) is none.
    fn refusal(&self, drift: f64, step: f64, mocaps: bool) -> Error {
        let close = if mocaps {
            "close the start first, and after every move of a mocap body (stepper.close(data))"
        } else {
            "close the start first (stepper.close(data))"
        };
        let time = self.time;
        Error::Refused(if self.open.max(self.rate * step) < OWN * drift {
            format!(
                "a step of {step} s from closed loops at t = {time:.6} s leaves them open by {drift:.3e} m or rad, more \
                 than can be closed without a jump: the motion is too fast for the timestep, take a shorter one"
            )
        } else if self.rate * step > self.open {
            let rate = self.rate;
            format!(
                "the velocities at t = {time:.6} s take the loops apart by {rate:.3e} m/s or rad/s: {close}"
            )
        } else {
            format!(
                "the loops stand open by {drift:.3e} m or rad at t = {time:.6} s, more than a step explains: {close}"
            )
        })
    }
}

impl Stepper {
    /// For states of a model as it is now, by its own integrator. A `projector` is a solver that ends every step; a model
    /// with `mocaps` has mocap bodies.
    ///
    /// # Errors
    /// Those of [`Model::unsolved`], [`State::new`] and [`ForcedWalker::new`].
    pub fn new(
        model: &Model,
        terms: Baumgarte,
        solver: Box<dyn MultiplierSolver>,
        projector: Option<Box<dyn MultiplierSolver>>,
        noted: Noted,
        mocaps: bool,
    ) -> Result<Self, Error> {
        let model = Arc::new(model.unsolved(model.timestep())?);
        let mut stepper = Self { model, terms, solver, projector, noted, mocaps, lanes: Vec::new() };
        stepper.reach(1)?;
        Ok(stepper)
    }

    /// Its model, a copy.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Makes lanes, up to so many.
    fn reach(&mut self, count: usize) -> Result<(), Error> {
        while self.lanes.len() < count {
            let fresh = |solver: &dyn MultiplierSolver| {
                let mut solver = solver.clone_box();
                solver.reset();
                solver
            };
            let state = State::new(&self.model, self.terms)?;
            let force = SolvedForce::new(state, Form::Hard, fresh(&*self.solver), self.model.nv());
            let projector =
                self.projector.as_deref().map(|solver| Projector::new(&self.model, fresh(solver)));
            let walker = ForcedWalker::new(Data::new(&self.model)?, Drive::default(), force, projector)?;
            let (start, left) = (Start::default(), Placement::default());
            self.lanes.push(Lane {
                walker,
                begun: false,
                drift: 0.0,
                noted: self.noted,
                start,
                left,
                mocaps: self.mocaps,
            });
        }
        Ok(())
    }

    /// Takes a step with a data of a model like this one, in the first lane.
    ///
    /// # Errors
    /// [`Error::Refused`]: a state that is not finite; what the stages, the force law or the projection say.
    pub fn step(&mut self, theirs: Data) -> Result<(), Error> {
        self.reach(1)?;
        without_timers(|| self.lanes[0].take(theirs, 1, |_, _| ()))
    }

    /// Takes so many steps with each of several data, side by side on all cores, the first data in the first lane. `look` is
    /// called with lane, step and data before each of them, and may write controls.
    ///
    /// # Errors
    /// As [`step`](Self::step), the first lane's that ran into one, with its number; the others took all their steps.
    pub fn step_all(
        &mut self,
        theirs: Vec<Data>,
        steps: usize,
        look: impl Fn(usize, usize, &mut Data) + Sync,
    ) -> Result<(), (usize, Error)> {
        self.reach(theirs.len()).map_err(|error| (0, error))?;
        let outcomes: Vec<_> = without_timers(|| {
            let lanes = self.lanes.par_iter_mut().zip(theirs).enumerate();
            lanes
                .map(|(number, (lane, data))| {
                    let taken = lane.take(data, steps, |step, data| look(number, step, data));
                    taken.map_err(|error| (number, error))
                })
                .collect()
        });
        outcomes.into_iter().collect()
    }

    /// Forgets all earlier steps.
    pub fn forget(&mut self) {
        self.lanes.clear();
    }

    /// What the last step of a lane did; nothing of one that took none.
    #[must_use]
    pub fn figures(&self, lane: usize) -> Option<Figures<'_>> {
        let lane = self.lanes.get(lane).filter(|lane| lane.begun)?;
        let (force, projector) = (&lane.walker.force, &lane.walker.projector);
        let report = force.inequalities.report;
        Some(Figures {
            info: &force.answer.info,
            tally: &force.tally,
            multipliers: &force.answer.multipliers,
            drift: lane.drift,
            pushing: report.map(|report| (report.active, report.blocked)),
            projection: projector.as_ref().and_then(|projector| projector.last),
        })
    }
}

impl Lane {
    fn take(&mut self, theirs: Data, steps: usize, look: impl Fn(usize, &mut Data)) -> Result<(), Error> {
        let own = mem::replace(&mut self.walker.data, theirs);
        let outcome = (0..steps).try_for_each(|step| {
            look(step, &mut self.walker.data);
            if step == 0 {
                // Whoever owns the data may have put it elsewhere.
                self.walker.data.moved(&self.left);
            }
            self.start.take(&self.walker.data);
            self.step().inspect_err(|_| self.start.give_back(&mut self.walker.data))
        });
        if outcome.is_ok() && !self.mocaps {
            self.left.take(&self.walker.data);
        } else {
            self.left.forget();
        }
        self.walker.data = own;
        outcome
    }

    fn step(&mut self) -> Result<(), Error> {
        let walker = &mut self.walker;
        walker.force.answer.recorded = false;
        walker.force.tally = Tally::default();
        if !is_sane(&walker.data) {
            return Err(Error::Refused(format!(
                "the state at t = {:.6} s is not finite",
                walker.data.time()
            )));
        }
        if !mem::replace(&mut self.begun, true)
            && let Some(projector) = &mut walker.projector
        {
            projector.begin_at(&mut walker.data)?;
        }
        walker.data.position_stage()?;
        if walker.data.ne() == 0 {
            return Err(Error::Refused(
                "no equality is active, expected one at least: take mj_step".to_owned(),
            ));
        }
        walker.look()?;
        self.drift = largest(walker.data.pos());
        (self.start.open, self.start.rate) = (self.drift, largest(walker.data.vel()));
        // As mj_step leaves them: those of the start of the step.
        if self.noted.sensors {
            walker.data.sensors()?;
        }
        if self.noted.energy {
            walker.data.energy()?;
        }
        if !bounded(walker.data.qacc()) {
            return Err(Error::Refused(format!(
                "the acceleration at t = {:.6} s is beyond all bounds",
                walker.data.time()
            )));
        }
        walker.step()?;
        if let Some(projector) = &walker.projector {
            self.drift = largest(walker.data.pos());
            if projector.last.is_some_and(|last| last.landing == Landing::TooFar) {
                return Err(self.start.refusal(self.drift, walker.data.model().timestep(), self.mocaps));
            }
        }
        if is_sane(&walker.data) {
            return Ok(());
        }
        Err(Error::Refused(format!("the state at t = {:.6} s is not finite", walker.data.time())))
    }
}
