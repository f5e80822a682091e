//! Force laws: what gives the constraint force of a state whose smooth stages are done.

use std::time::{Duration, Instant};

use oarlock_core::{ConstrainedSystem, Info, MultiplierSolver, Status, Wanted};

use crate::error::Error;
use crate::inequalities::Inequalities;
use crate::library::Data;
use crate::state::{Form, State};

/// Multipliers (ne) of one state, the accelerations and constraint forces (nv) they give, and the solver's figures.
#[derive(Debug, Clone)]
pub struct Answer {
    /// λ, ne.
    pub multipliers: Vec<f64>,
    /// a, nv.
    pub qacc: Vec<f64>,
    /// Jᵀ λ, nv.
    pub qfrc: Vec<f64>,
    /// What the solver says.
    pub info: Info,
    /// Wall time of the solve alone; zero where it is not taken.
    pub elapsed: Duration,
    /// Multipliers of the judge, and the force and acceleration that they give, where the answer is in doubt.
    least: Vec<f64>,
    other: [Vec<f64>; 2],
    /// Whether it is taken, and the solver held to its word: a look at the clock costs as much as a small solve.
    pub recorded: bool,
}

impl Answer {
    /// Room for an answer.
    #[must_use]
    pub fn new(nv: usize) -> Self {
        Self {
            multipliers: Vec::new(),
            qacc: vec![0.0; nv],
            qfrc: vec![0.0; nv],
            info: Info::trivial(0.0),
            elapsed: Duration::ZERO,
            least: Vec::new(),
            other: [Vec::new(), Vec::new()],
            recorded: true,
        }
    }

    /// Fills it with a solver's answer to the question that a state asks of a data.
    ///
    /// # Errors
    /// Those of [`ConstrainedSystem::solve`], [`State::acceleration`] and [`Inequalities::conclude`].
    pub fn fill(
        &mut self,
        data: &mut Data,
        state: &mut State,
        system: &mut ConstrainedSystem,
        inequalities: &mut Inequalities,
        solver: &mut dyn MultiplierSolver,
    ) -> Result<(), Error> {
        self.multipliers.resize(system.len(), 0.0);
        let began = self.recorded.then(Instant::now);
        self.info = system.solve_unchecked(solver, Wanted::Multipliers, &mut self.multipliers)?;
        self.elapsed = began.map_or(Duration::ZERO, |began| began.elapsed());
        if self.recorded {
            system.check(solver, &self.multipliers, &mut self.info)?;
        }
        state.acceleration(data, system, &self.multipliers, &mut self.qfrc, &mut self.qacc)?;
        if self.info.status == Status::Inaccurate {
            self.least.clear();
            self.least.extend_from_slice(system.reference(solver)?.0);
            self.other[0].resize(self.qacc.len(), 0.0);
            self.other[1].resize(self.qacc.len(), 0.0);
            let [qfrc, qacc] = &mut self.other;
            state.acceleration(data, system, &self.least, qfrc, qacc)?;
            system.confirm(&self.qacc, qacc, &mut self.info);
        }
        let proved = inequalities.conclude(&self.qacc, &mut self.qfrc)?;
        // Whoever iterates leaves a residual of its own, which stiff rows magnify.
        if !proved && self.info.products == 0 && self.info.status == Status::Converged {
            self.info.status = Status::Inaccurate;
        }
        Ok(())
    }
}

/// The figures of the solves of one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Status of the first solve that did not converge, or of one that did.
    pub status: Option<oarlock_core::Status>,
    /// Number of solves.
    pub solves: i64,
    /// Those that did not converge.
    pub unconverged: i64,
    /// Iterations of all.
    pub iterations: i64,
    /// Of the one that took most.
    pub iterations_worst: i64,
    /// Products of all.
    pub products: i64,
    /// Refreshes that no new fold asked for.
    pub refreshes: i64,
    /// New folds.
    pub refolds: i64,
    /// Whether a rank that was held rose.
    pub risen: bool,
    /// Largest relative residual.
    pub residual_rel: f64,
    /// Wall time, ns.
    pub solve_ns: i64,
    /// Newton iterations for limits, friction loss and contacts of all solves.
    pub newton: i64,
    /// Of the one that took most.
    pub newton_worst: i64,
    /// Largest gradient beyond rounding that any certificate leaves.
    pub optimality: f64,
    /// Whether rows that push changed.
    pub changed: bool,
    /// Whether there were such rows.
    pub pushed: bool,
}

impl Tally {
    /// Adds a solve.
    pub fn add(&mut self, info: &Info, elapsed: Duration) {
        let count = |number: usize| i64::try_from(number).unwrap_or(i64::MAX);
        let converged = info.status == oarlock_core::Status::Converged;
        if self.status.is_none() || (!converged && self.unconverged == 0) {
            self.status = Some(info.status);
        }
        self.solves += 1;
        self.unconverged += i64::from(!converged);
        self.iterations += count(info.iterations);
        self.iterations_worst = self.iterations_worst.max(count(info.iterations));
        self.products += count(info.products);
        // A new fold changes the size, and a solver has to start from something: that is counted apart.
        self.refreshes += i64::from(info.refreshed && !info.refolded);
        self.refolds += i64::from(info.refolded);
        self.risen |= info.risen;
        self.residual_rel = self.residual_rel.max(info.residual_rel);
        self.solve_ns += i64::try_from(elapsed.as_nanos()).unwrap_or(i64::MAX);
    }

    /// Adds the answer to the limits, friction loss and contacts beside it.
    pub fn add_inequalities(&mut self, inequalities: &Inequalities) {
        if let Some(report) = inequalities.report {
            let count = i64::try_from(report.iterations).unwrap_or(i64::MAX);
            self.newton += count;
            self.newton_worst = self.newton_worst.max(count);
            self.changed |= report.changed;
            self.pushed = true;
        }
        if let Some(certificate) = inequalities.certificate {
            self.optimality = self.optimality.max(certificate.gradient - certificate.rounding);
        }
    }
}

/// Gives the constraint force of a state whose smooth stages are done.
pub trait ForceLaw {
    /// Writes qacc, `qfrc_constraint` and `efc_force`. All are needed: Euler reads one or the other by damping.
    ///
    /// # Errors
    /// What makes the state one that it cannot answer.
    fn apply(&mut self, data: &mut Data) -> Result<(), Error>;
}

/// The answer of one solver to the question of every state it is shown.
pub struct SolvedForce {
    /// The state as it was last read.
    pub state: State,
    /// The question as it was last asked.
    pub system: ConstrainedSystem,
    /// Limits, friction loss and contacts as they were last answered.
    pub inequalities: Inequalities,
    /// The last answer.
    pub answer: Answer,
    /// The solves since it was last cleared: one a stage.
    pub tally: Tally,
    /// Who solves.
    pub solver: Box<dyn MultiplierSolver>,
    form: Form,
}

impl SolvedForce {
    /// A solver for a form.
    #[must_use]
    pub fn new(state: State, form: Form, solver: Box<dyn MultiplierSolver>, nv: usize) -> Self {
        let (system, answer) = (ConstrainedSystem::new(), Answer::new(nv));
        let inequalities = Inequalities::default();
        Self { state, system, inequalities, answer, tally: Tally::default(), form, solver }
    }
}

impl ForceLaw for SolvedForce {
    fn apply(&mut self, data: &mut Data) -> Result<(), Error> {
        self.state.read(data)?;
        let Self { state, system, inequalities, answer, tally, solver, form } = self;
        state.ask(data, *form, system, inequalities)?;
        answer.fill(data, state, system, inequalities, &mut **solver)?;
        inequalities.remember(&answer.qacc);
        data.qacc_mut().copy_from_slice(&answer.qacc);
        data.qfrc_constraint_mut().copy_from_slice(&answer.qfrc);
        data.write_force(&answer.multipliers, inequalities.forces());
        tally.add(&answer.info, answer.elapsed);
        tally.add_inequalities(inequalities);
        Ok(())
    }
}

/// MuJoCo's own `efc_force`, taken through our acceleration: the calibration.
pub struct MujocoForce {
    force: Vec<f64>,
    qfrc: Vec<f64>,
    change: Vec<f64>,
    qacc_smooth: Vec<f64>,
}

impl MujocoForce {
    /// For states of nv velocities.
    #[must_use]
    pub fn new(nv: usize) -> Self {
        Self { force: Vec::new(), qfrc: vec![0.0; nv], change: vec![0.0; nv], qacc_smooth: vec![0.0; nv] }
    }
}

impl ForceLaw for MujocoForce {
    /// Runs MuJoCo's solver, then computes Jᵀf and `qacc_smooth` + M⁻¹Jᵀf from its force alone.
    fn apply(&mut self, data: &mut Data) -> Result<(), Error> {
        data.constraint_stage()?;
        self.force.clear();
        self.force.extend_from_slice(data.force());
        data.jacobian_transposed_times(&self.force, &mut self.qfrc)?;
        data.solve_mass(&mut self.change, &self.qfrc)?;
        self.qacc_smooth.copy_from_slice(data.qacc_smooth());
        data.qfrc_constraint_mut().copy_from_slice(&self.qfrc);
        for ((qacc, smooth), change) in data.qacc_mut().iter_mut().zip(&self.qacc_smooth).zip(&self.change) {
            *qacc = smooth + change;
        }
        Ok(())
    }
}

#[cfg(all(test, unix))]
mod tests {
    use oarlock_core::{Options, make_solver};

    use super::*;
    use crate::library::testing::{LENGTH, PENDULUM, data, model};
    use crate::state::Baumgarte;

    const MASS: f64 = 2.0;
    const GRAVITY: f64 = 9.81;

    #[test]
    fn a_pendulum_on_a_rope_has_the_acceleration_and_the_tension_of_the_closed_form() {
        let model = model(PENDULUM);
        for (angle, rate) in [(0.0, 0.0), (0.7, -1.3), (2.5, 4.0)] {
            let (sin, cos) = f64::sin_cos(angle);
            let qpos = [LENGTH * sin, LENGTH - LENGTH * cos];
            let qvel = [LENGTH * rate * cos, LENGTH * rate * sin];
            let mut state = data(&model, &qpos, &qvel);
            let solver = make_solver("auto", &Options::new()).expect("registered");
            let mut force = SolvedForce::new(
                State::new(&model, Baumgarte::default()).expect("a tendon"),
                Form::Hard,
                solver,
                2,
            );
            force.apply(&mut state).expect("solvable");

            let turn = -GRAVITY / LENGTH * sin;
            let expected =
                [LENGTH * (turn * cos - rate * rate * sin), LENGTH * (turn * sin + rate * rate * cos)];
            for (got, expected) in state.qacc().iter().zip(expected) {
                assert!((got - expected).abs() < 1e-10, "at {angle}: {:?}, not {expected:?}", state.qacc());
            }
            // The multiplier of a rope that pulls is negative: it acts along the gradient of the length.
            let tension = MASS * (GRAVITY * cos + LENGTH * rate * rate);
            assert!(
                (force.answer.multipliers[0] + tension).abs() < 1e-10,
                "{:?}, not {tension}",
                force.answer
            );
        }
    }

    #[test]
    fn baumgartes_terms_ask_for_the_return_of_what_is_open() {
        // At rest straight below and 0.01 m too long: r̈ = −k r − 2β ṙ.
        let model = model(PENDULUM);
        let mut state = data(&model, &[0.0, -0.01], &[0.0, -0.1]);
        let solver = make_solver("pinv", &Options::new()).expect("registered");
        let terms = Baumgarte { beta: 3.0, k: 50.0 };
        let mut force = SolvedForce::new(State::new(&model, terms).expect("a tendon"), Form::Hard, solver, 2);
        force.apply(&mut state).expect("solvable");
        let expected = 50.0 * 0.01 + 2.0 * 3.0 * 0.1;
        assert!((state.qacc()[1] - expected).abs() < 1e-10, "{:?}, not {expected}", state.qacc());
    }
}
