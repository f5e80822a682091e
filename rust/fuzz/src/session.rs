//! One solver through one script, and what must hold at every step of it.

use nalgebra::{DMatrix, DVector};
use oarlock_core::params::Value;
use oarlock_core::registry::SolverKind;
use oarlock_core::{ConstrainedSystem, Error, Info, MultiplierSolver, Options, State, Wanted};

use crate::expected::{of_dense, of_step, tame, tame_input, view};
use crate::script::{Action, Corruption, Input, Script};

/// Rounding of one product of at most a dozen rows, and of what folding and unfolding adds.
const ROUNDING: f64 = 1e-12;

/// The same where the solver parts range(A) from null(A): what the rank cut of 1e-10 of the trace drops, and as much
/// again for a null space that is tracked to 1e-9.
const DROPPED: f64 = 1e-8;

/// Relative error of a residual that is put together from parts: what the rank cut drops, its square root in b.
const APART: f64 = 1e-5;

/// Residual asked of the good system that ends a script: `eps_abs` of the quasi-Newton solvers, b of order one.
const SOLVED: f64 = 1e-6;

/// Iterations of a solver made with options, at most: a script may not ask for a million.
const MOST_ITERATIONS: i64 = 200;

/// Plays a script to a solver.
///
/// # Panics
/// If the solver does what it must not.
pub fn play(kind: &'static SolverKind, script: &Script) {
    let names = (kind.options)();
    let mut options = Options::new();
    let of_iterations = |(name, value): &(&str, Value)| (*name == "max_iterations").then_some(*value);
    let mut limit = names.iter().find_map(of_iterations);
    for &(number, value) in &script.options {
        let (name, _) = names[usize::from(number) % names.len()];
        let value = match value {
            Value::Integer(value) if name == "max_iterations" => Value::Integer(value.min(MOST_ITERATIONS)),
            Value::Float(value) if name == "max_iterations" => {
                Value::Float(value.min(MOST_ITERATIONS as f64))
            }
            value => value,
        };
        limit = of_iterations(&(name, value)).or(limit);
        options = options.with(name, value);
    }
    match (kind.build)(&options) {
        Ok(solver) => {
            let by_default = script.options.is_empty();
            let mut session = Session {
                kind,
                options,
                limit: limit.map(|limit| match limit {
                    Value::Float(most) => most,
                    Value::Integer(most) => most as f64,
                    Value::Switch(_) => f64::NAN,
                }),
                by_default,
                solver,
                system: ConstrainedSystem::new(),
                anew: true,
                tampered: false,
            };
            script.actions.iter().for_each(|action| session.act(action));
            session.end_well();
        }
        Err(Error::OptionValue { solver, option, .. }) => {
            assert!(
                solver == kind.name && names.iter().any(|(name, _)| *name == option),
                "{}: {option}",
                kind.name
            );
        }
        Err(error) => panic!("{}: {error} for {options:?}", kind.name),
    }
}

/// One solver and its system.
pub struct Session {
    kind: &'static SolverKind,
    options: Options,
    limit: Option<f64>,
    /// Whether the solver has its default options, with which it must find the solution.
    by_default: bool,
    solver: Box<dyn MultiplierSolver>,
    system: ConstrainedSystem,
    /// Whether a new solver would answer the same.
    anew: bool,
    /// Whether it goes on from a state that was tampered with, by which its x may overflow, or be wrong.
    tampered: bool,
}

impl Session {
    fn fresh(&self) -> Box<dyn MultiplierSolver> {
        (self.kind.build)(&self.options).expect("built before")
    }

    fn restored(&self, state: &State) -> Result<Box<dyn MultiplierSolver>, Error> {
        let mut solver = self.fresh();
        solver.restore(state)?;
        Ok(solver)
    }

    fn act(&mut self, action: &Action) {
        match action {
            Action::Solve(input, wanted) => self.step(input, *wanted),
            Action::Reset => {
                self.solver.reset();
                (self.anew, self.tampered) = (true, false);
            }
            Action::Copy => self.solver = self.solver.clone_box(),
            Action::Restore => self.solver = self.restored(&self.solver.state()).expect("its own state"),
            Action::Corrupt(corruption) => {
                let state = corrupted(self.solver.state(), *corruption);
                match self.restored(&state) {
                    Ok(solver) => {
                        assert!(!matches!(corruption, Corruption::Unknown), "{}: {state:?}", self.kind.name);
                        self.solver = solver;
                        (self.anew, self.tampered) = (false, true);
                    }
                    Err(error @ Error::State { .. }) => named(&error),
                    Err(error) => panic!("{}: {error} for {state:?}", self.kind.name),
                }
            }
        }
    }

    fn step(&mut self, input: &Input, wanted: Wanted) {
        let filled = match input {
            Input::Step(step) => self.system.assemble(&view(step)),
            Input::Dense(dense) => self.system.set_dense(&dense.matrix, &dense.rhs),
        };
        let expected = match input {
            Input::Step(step) => of_step(step, &filled),
            Input::Dense(dense) => of_dense(dense, &filled),
        };
        assert!(expected, "{}: {filled:?} of {input:?}", self.kind.name);
        match filled {
            Ok(()) => self.solve(input, wanted),
            Err(error) => named(&error),
        }
    }

    fn solve(&mut self, input: &Input, wanted: Wanted) {
        let mut twins = vec![
            ("copy", self.solver.clone_box()),
            ("restored", self.restored(&self.solver.state()).expect("its own state")),
        ];
        if self.anew {
            twins.push(("new", self.fresh()));
        }
        let system = self.system.clone();
        let before = self.solver.state();
        let (got, x) = answer(&mut self.system, &mut *self.solver, wanted);
        let (kind, options) = (self.kind.name, self.options.clone());
        let told = || format!("{kind}: {got:?} {x:?} of {input:?}, {options:?}, from {before:?}");
        for (name, mut twin) in twins {
            let (same, twin_x) = answer(&mut system.clone(), &mut *twin, wanted);
            let bits = |x: &[f64]| x.iter().map(|entry| entry.to_bits()).collect::<Vec<_>>();
            let agree = match (&got, &same) {
                (Ok(info), Ok(same)) => info == same && bits(&x) == bits(&twin_x),
                (Err(error), Err(same)) => error.to_string() == same.to_string(),
                _ => false,
            };
            assert!(agree, "the {name} one gives {same:?} {twin_x:?}; {}", told());
        }
        match &got {
            Ok(info) => {
                self.anew = false;
                self.check(input, info, &x, &told);
            }
            Err(error) => {
                named(error);
                // A is positive semidefinite, or the system would have refused it: only an overflow is left.
                let tame = self.by_default && !self.tampered && tame_input(input);
                let possible = matches!(error, Error::NonFinite { value, .. } if !tame && !value.is_finite());
                assert!(possible, "{}", told());
            }
        }
    }

    /// A and b, before folding.
    fn given(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.system.len();
        let matrix = DMatrix::from_vec(n, n, self.system.full_matrix());
        (matrix, DVector::from_column_slice(self.system.rhs()))
    }

    fn check(&mut self, input: &Input, info: &Info, x: &[f64], told: &dyn Fn() -> String) {
        let n = self.system.len();
        let figures = [Some(info.residual_rel), info.inconsistency, info.null_residual];
        let sane = x.iter().all(|entry| entry.is_finite())
            && figures.iter().flatten().all(|figure| figure.is_finite() && *figure >= 0.0)
            && info.rank.is_none_or(|rank| rank <= n)
            && info.folded <= n
            && self.limit.is_none_or(|limit| info.iterations as f64 <= limit);
        assert!(sane, "{}", told());

        let (matrix, rhs) = self.given();
        let entries = matrix.iter().chain(rhs.iter()).chain(x);
        // A rank cut that is asked for may drop what is not small, and pivots, unlike eigenvalues, do not part b then.
        if tame(entries) && tame_input(input) && (self.by_default || info.inconsistency.is_none()) {
            let x = DVector::from_column_slice(x);
            let miss = (&matrix * &x - &rhs).norm();
            let mut reduced = vec![0.0; self.system.fold().reduced()];
            let outside = self.system.fold().reduce(rhs.as_slice(), &mut reduced);
            let reported = (info.residual_rel * rhs.norm()).hypot(info.inconsistency.unwrap_or(outside));
            let rounding = if info.inconsistency.is_some() { DROPPED } else { ROUNDING };
            let noise = rounding * matrix.norm() * x.norm() + ROUNDING * rhs.norm();
            let near = (miss - reported).abs() <= noise + APART * miss;
            assert!(near, "residual {miss:e}, not {reported:e}: {}", told());
        }
        if self.system.nv() > 0 {
            let (mut qfrc, mut qacc) = (vec![0.0; self.system.nv()], vec![0.0; self.system.nv()]);
            match self.system.acceleration(x, &mut qfrc, &mut qacc) {
                Ok(()) => {
                    let finite = qfrc.iter().chain(&qacc).all(|entry| entry.is_finite());
                    assert!(finite, "{qacc:?}, {}", told());
                }
                Err(error) => assert!(matches!(error, Error::NonFinite { .. }), "{error}, {}", told()),
            }
        }
    }

    /// After whatever came, a good system is solved well.
    fn end_well(&mut self) {
        self.system
            .set_dense(&[2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 4.0], &[1.0, -1.0, 2.0])
            .expect("good");
        for _ in 0..2 {
            let (got, x) = answer(&mut self.system, &mut *self.solver, Wanted::Multipliers);
            // A state that was tampered with and is still whole is believed: sr1-tracked need not find out.
            if self.by_default && !self.tampered {
                let (matrix, rhs) = self.given();
                let miss = (matrix * DVector::from_column_slice(&x) - rhs).norm();
                assert!(got.is_ok() && miss <= SOLVED, "{}: {got:?} {x:?}, {miss:e} off", self.kind.name);
            }
        }
    }
}

/// Solves into an x of NaNs.
fn answer(
    system: &mut ConstrainedSystem,
    solver: &mut dyn MultiplierSolver,
    wanted: Wanted,
) -> (Result<Info, Error>, Vec<f64>) {
    let mut x = vec![f64::NAN; system.len()];
    (system.solve(solver, wanted, &mut x), x)
}

/// One line that names a value, or an array that has none.
fn named(error: &Error) {
    let message = error.to_string();
    let value = message.contains(|c: char| c.is_ascii_digit() || c == '\'')
        || ["is empty", "inf"].iter().any(|word| message.contains(word));
    assert!(value && !message.contains('\n'), "{message}");
}

fn corrupted(mut state: State, corruption: Corruption) -> State {
    let name = |state: &State, number: u8| {
        let names = state.fields.keys().collect::<Vec<_>>();
        (!names.is_empty()).then(|| names[usize::from(number) % names.len()].clone())
    };
    match corruption {
        Corruption::Entry(field, index, value) => {
            if let Some(field) = name(&state, field).and_then(|name| state.fields.get_mut(&name)) {
                let len = field.len().max(1);
                if let Some(entry) = field.get_mut(usize::from(index) % len) {
                    *entry = value;
                }
            }
        }
        Corruption::Cut(field) => {
            if let Some(field) = name(&state, field).and_then(|name| state.fields.get_mut(&name)) {
                field.pop();
            }
        }
        Corruption::Missing(field) => {
            if let Some(name) = name(&state, field) {
                state.fields.remove(&name);
            }
        }
        Corruption::Unknown => return state.with("unknown", &[1.0]),
        Corruption::Size(size) => state.size = size,
        Corruption::Emptied(size) => {
            state.fields.clear();
            state.size = size;
        }
    }
    state
}
