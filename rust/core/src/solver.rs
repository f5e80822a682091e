//! The trait that every solver implements, and the registry of names.

use std::collections::BTreeMap;
use std::mem;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::info::Info;
use crate::params::Options;
use crate::problem::{Needs, Problem};
use crate::{auto, cg, cholesky, minres, pinv, pinv_tracked, quasi_newton, regularised, sr1, tracked};

/// Solves A x = b, one step after another. A solver owns its workspace and whatever it carries between steps.
///
/// Callers hand steps to [`ConstrainedSystem::solve`](crate::ConstrainedSystem::solve), which folds first.
pub trait MultiplierSolver: Send + Sync {
    /// Name in the registry.
    fn name(&self) -> &'static str;

    /// What it works with.
    fn needs(&self) -> Needs;

    /// Solves the problem of one step into `x` (`n`).
    ///
    /// A problem of another size than the last one starts the solver anew, as [`reset`](Self::reset) does.
    ///
    /// # Errors
    /// [`Error`] for bad input only; not converging is a [`Status`](crate::info::Status), with a usable x.
    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error>;

    /// Forgets all earlier steps.
    fn reset(&mut self);

    /// A copy with everything it carries.
    fn clone_box(&self) -> Box<dyn MultiplierSolver>;

    /// What it carries between steps; empty for a solver that carries nothing.
    fn state(&self) -> State {
        State::new(self.name(), 0)
    }

    /// Goes on from a saved state.
    ///
    /// # Errors
    /// [`Error::State`] if the state is another solver's or not whole.
    fn restore(&mut self, state: &State) -> Result<(), Error> {
        state.check(self.name(), &[])?;
        state.check_names(self.name(), &[])
    }
}

/// What a solver carries between steps, for saving.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Name of the solver.
    pub solver: String,
    /// Number of rows n that it was at; 0 before the first solve.
    pub size: usize,
    /// Its fields, flat.
    pub fields: BTreeMap<String, Vec<f64>>,
}

impl State {
    /// A state without fields.
    #[must_use]
    pub fn new(solver: &str, size: usize) -> Self {
        Self { solver: solver.to_owned(), size, fields: BTreeMap::new() }
    }

    /// With one more field.
    #[must_use]
    pub fn with(mut self, name: &str, values: &[f64]) -> Self {
        self.fields.insert(name.to_owned(), values.to_vec());
        self
    }

    /// A field; empty if it is missing.
    #[must_use]
    pub fn field(&self, name: &str) -> &[f64] {
        self.fields.get(name).map_or(&[], Vec::as_slice)
    }

    /// A whole number in `range` that was saved as a float.
    ///
    /// # Errors
    /// [`Error::State`].
    pub fn count(value: f64, range: RangeInclusive<usize>, solver: &'static str) -> Result<usize, Error> {
        let (least, most) = range.into_inner();
        if value.fract() == 0.0 && value >= least as f64 && value <= most as f64 {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked just above
            return Ok(value as usize);
        }
        let reason = format!("a count is {value}, expected a whole number from {least} to {most}");
        Err(Error::State { solver, reason })
    }

    /// A field that holds every row once, in some order.
    ///
    /// # Errors
    /// [`Error::State`].
    pub fn order(&self, name: &str, solver: &'static str) -> Result<Vec<usize>, Error> {
        self.check(solver, &[(name, self.size)])?;
        let mut met = vec![false; self.size];
        let mut take = |&entry: &f64| {
            let row = Self::count(entry, 0..=self.size - 1, solver)?;
            if mem::replace(&mut met[row], true) {
                return Err(Error::State { solver, reason: format!("field '{name}' has row {row} twice") });
            }
            Ok(row)
        };
        self.field(name).iter().map(&mut take).collect()
    }

    /// Checks that it is this solver's and that its fields have these lengths and are finite.
    ///
    /// # Errors
    /// [`Error::State`].
    pub fn check(&self, solver: &'static str, lengths: &[(&str, usize)]) -> Result<(), Error> {
        let bad = |reason| Err(Error::State { solver, reason });
        if self.solver != solver {
            return bad(format!("it is that of solver '{}'", self.solver));
        }
        for &(name, length) in lengths {
            let field = self.field(name);
            if field.len() != length {
                return bad(format!("field '{name}' has {} entries, expected {length}", field.len()));
            }
            if let Some(index) = field.iter().position(|value| !value.is_finite()) {
                return bad(format!("{name}[{index}] = {}, expected finite numbers", field[index]));
            }
        }
        Ok(())
    }

    /// Checks that it has no fields but these: one that the solver does not know means another version.
    ///
    /// # Errors
    /// [`Error::State`].
    pub fn check_names(&self, solver: &'static str, known: &[&str]) -> Result<(), Error> {
        match self.fields.keys().find(|name| !known.contains(&name.as_str())) {
            None => Ok(()),
            Some(name) => {
                let expected = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
                Err(Error::State { solver, reason: format!("unknown field '{name}', expected {expected}") })
            }
        }
    }
}

/// An entry of the registry.
pub struct SolverKind {
    /// Name, as in `--solver NAME`.
    pub name: &'static str,
    /// One line on what it is.
    pub summary: &'static str,
    /// Builds it from options.
    pub build: fn(&Options) -> Result<Box<dyn MultiplierSolver>, Error>,
    /// Names and defaults of its options.
    pub options: fn() -> Vec<(&'static str, f64)>,
}

/// Every solver. A new one is one file and one line here.
pub static SOLVERS: &[SolverKind] = &[
    auto::KIND,
    sr1::KIND,
    tracked::KIND,
    quasi_newton::SR1_CLASSIC,
    quasi_newton::BFGS,
    quasi_newton::DFP,
    pinv::KIND,
    pinv_tracked::KIND,
    cholesky::KIND,
    regularised::KIND,
    cg::KIND,
    minres::KIND,
];

/// Looks a solver up by its name.
///
/// # Errors
/// [`Error::UnknownSolver`] with the names there are.
pub fn find_solver(name: &str) -> Result<&'static SolverKind, Error> {
    SOLVERS.iter().find(|kind| kind.name == name).ok_or_else(|| Error::UnknownSolver {
        name: name.to_owned(),
        valid: SOLVERS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", "),
    })
}

/// Makes a solver by its name.
///
/// # Errors
/// [`Error::UnknownSolver`], [`Error::UnknownOption`], [`Error::OptionValue`].
pub fn make_solver(name: &str, options: &Options) -> Result<Box<dyn MultiplierSolver>, Error> {
    (find_solver(name)?.build)(options)
}
