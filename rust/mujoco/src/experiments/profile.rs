//! Where the time of a step goes: an exact free run with looks at the clock between the parts of its steps.
//!
//! The walk of [`free_solved`](super::free_solved) in the hard form, bit for bit, by a force law of its own: the step that
//! nobody profiles reads no clock.

use std::sync::Arc;
use std::time::{Duration, Instant};

use oarlock_core::{ConstrainedSystem, Needs, Wanted};

use super::Solver;
use crate::error::Error;
use crate::force::{Answer, ForceLaw, Tally};
use crate::library::{Data, without_timers};
use crate::run::Setup;
use crate::state::{Form, State};
use crate::walker::ForcedWalker;

/// A part of a step, in the order in which a step goes through them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// The drive and MuJoCo's position, velocity, actuation and acceleration stages.
    Stages,
    /// J and J̇v.
    Rows,
    /// Checks, folding, where the entries of A lie, and b.
    Question,
    /// W = H Jᵀ of the folded rows and A = Wᵀ W, by a solver that takes it formed.
    Matrix,
    /// The solver itself: a factorisation, or an iteration; for one that does not take A formed, all its products.
    Solve,
    /// Jᵀλ, accelerations, and what is written for the integrator.
    Force,
    /// MuJoCo's integrator, and what Runge–Kutta does between stages.
    Integrator,
}

impl Part {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::Stages, Self::Rows, Self::Question, Self::Matrix, Self::Solve, Self::Force, Self::Integrator];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stages => "stages",
            Self::Rows => "rows",
            Self::Question => "question",
            Self::Matrix => "matrix",
            Self::Solve => "solve",
            Self::Force => "force",
            Self::Integrator => "integrator",
        }
    }
}

/// What was spent on a part over a walk.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Spent {
    /// Wall time, looks at the clock included.
    pub time: Duration,
    /// Looks at the clock in it.
    pub looks: u32,
}

/// A walk and where its time went.
pub struct Profile {
    /// By [`Part::ALL`].
    pub spent: [Spent; Part::ALL.len()],
    /// Wall time of the whole walk.
    pub whole: Duration,
    /// What a look at the clock costs, ns: the median of some stretches of looks with nothing between them.
    pub look_ns: f64,
    /// The solves.
    pub tally: Tally,
    /// Rows of the last step, and those of them that folding left.
    pub rows: [usize; 2],
    /// Where the walk ended.
    pub data: Data,
}

/// Laps without gaps: what is not one part's is the next one's.
struct Stopwatch {
    last: Instant,
    spent: [Spent; Part::ALL.len()],
}

impl Stopwatch {
    fn start() -> Self {
        Self { last: Instant::now(), spent: Default::default() }
    }

    fn lap(&mut self, part: Part) {
        let now = Instant::now();
        let spent = &mut self.spent[part as usize];
        spent.time += now - self.last;
        spent.looks += 1;
        self.last = now;
    }

    /// What a lap costs, ns.
    fn cost() -> f64 {
        const STRETCHES: usize = 15;
        const LAPS: u32 = 1000;
        let mut costs = [0.0; STRETCHES];
        for cost in &mut costs {
            let mut watch = Self::start();
            for _ in 0..LAPS {
                watch.lap(Part::Stages);
            }
            *cost = 1e9 * watch.spent[Part::Stages as usize].time.as_secs_f64() / f64::from(LAPS);
        }
        costs.sort_by(f64::total_cmp);
        costs[STRETCHES / 2]
    }
}

/// What [`SolvedForce`](crate::force::SolvedForce) does in the hard form, with laps.
struct ClockedForce {
    state: State,
    system: ConstrainedSystem,
    answer: Answer,
    tally: Tally,
    solver: Solver,
    watch: Stopwatch,
}

impl ForceLaw for ClockedForce {
    fn apply(&mut self, data: &mut Data) -> Result<(), Error> {
        let Self { state, system, answer, tally, solver, watch } = self;
        watch.lap(Part::Stages);
        state.read(data)?;
        if !state.others().is_empty() {
            return Err(Error::Refused(
                "limits, friction loss or contacts act, expected equality rows only".to_owned(),
            ));
        }
        watch.lap(Part::Rows);
        state.ask_equalities(data, Form::Hard, system)?;
        watch.lap(Part::Question);
        if solver.needs() == Needs::Dense {
            system.form_matrix();
            watch.lap(Part::Matrix);
        }
        answer.multipliers.resize(system.len(), 0.0);
        answer.info = system.solve_unchecked(&mut **solver, Wanted::Multipliers, &mut answer.multipliers)?;
        watch.lap(Part::Solve);
        state.acceleration(data, system, &answer.multipliers, &mut answer.qfrc, &mut answer.qacc)?;
        data.qacc_mut().copy_from_slice(&answer.qacc);
        data.qfrc_constraint_mut().copy_from_slice(&answer.qfrc);
        data.write_force(&answer.multipliers, &[]);
        tally.add(&answer.info, Duration::ZERO);
        watch.lap(Part::Force);
        Ok(())
    }
}

/// A solver walks alone in the hard form, without projection and with MuJoCo's timers standing still.
///
/// # Errors
/// Those of [`ForcedWalker::new`] and [`State::new`], and what ends the walk.
pub fn profile(setup: &Setup, solver: Solver, steps: usize) -> Result<Profile, Error> {
    let own = Setup { model: Arc::new(setup.model.unsolved(setup.model.timestep())?), ..setup.clone() };
    let force = ClockedForce {
        state: setup.state()?,
        system: ConstrainedSystem::new(),
        answer: Answer::new(setup.model.nv()),
        tally: Tally::default(),
        solver,
        watch: Stopwatch::start(),
    };
    let mut walker = ForcedWalker::new(own.data()?, own.drive, force, None)?;
    let whole = without_timers(|| -> Result<Duration, Error> {
        let began = Instant::now();
        walker.force.watch = Stopwatch::start();
        for _ in 0..steps {
            walker.look()?;
            walker.step()?;
            walker.force.watch.lap(Part::Integrator);
        }
        Ok(began.elapsed())
    })?;
    let ForcedWalker { data, force, .. } = walker;
    Ok(Profile {
        spent: force.watch.spent,
        whole,
        look_ns: Stopwatch::cost(),
        tally: force.tally,
        rows: [force.system.len(), force.system.fold().reduced()],
        data,
    })
}
