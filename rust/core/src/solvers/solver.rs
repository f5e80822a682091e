//! Interfaces of a solver: [`Solver`] to write one, [`MultiplierSolver`] to use one, and [`State`] to save one.

use std::collections::BTreeMap;
use std::mem;
use std::ops::RangeInclusive;

use crate::error::Error;
use crate::info::Info;
use crate::params::Params;
use crate::problem::{Needs, Problem};

/// Solves A x = b, one step after another. Callers hold this interface, and every [`Solver`] has it.
///
/// Callers hand steps to [`ConstrainedSystem::solve`](crate::ConstrainedSystem::solve), which folds first.
pub trait MultiplierSolver: Send + Sync {
    /// Returns the name in the registry.
    fn name(&self) -> &'static str;

    /// What the solver works with.
    fn needs(&self) -> Needs;

    /// The rank cut that the solver works with, if it has one.
    fn rank_cut(&self) -> Option<f64>;

    /// Whether the answer comes from a factorisation of this step's A alone, whose rank is checked: see
    /// [`ConstrainedSystem::solve`](crate::ConstrainedSystem::solve).
    fn is_direct(&self) -> bool;

    /// Solves the problem of one step into `x` (`n`).
    ///
    /// A problem of another size than the last one starts the solver anew, as [`reset`](Self::reset) does.
    ///
    /// # Errors
    /// [`Error`] for bad input only; not converging is a [`Status`](crate::info::Status), with a usable x.
    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error>;

    /// Forgets all earlier steps.
    fn reset(&mut self);

    /// Returns a copy with everything that the solver carries.
    fn clone_box(&self) -> Box<dyn MultiplierSolver>;

    /// Returns what the solver carries between steps; empty for a solver that carries nothing.
    fn state(&self) -> State {
        State::new(self.name(), 0)
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// [`Error::State`] if the state is another solver's or incomplete.
    fn restore(&mut self, state: &State) -> Result<(), Error> {
        state.check(self.name(), &[])?;
        state.check_names(self.name(), &[])
    }
}

/// A solver as its author writes it. It owns its workspace and everything that it carries between steps.
///
/// Its methods are those of [`MultiplierSolver`], which follows from it.
pub trait Solver: Clone + Send + Sync + 'static {
    /// Parameters of the solver, which also name it in the registry.
    type Params: Params;

    /// What the solver is, in one line.
    const SUMMARY: &'static str;

    /// What the solver works with.
    const NEEDS: Needs;

    /// Whether the answer comes from a factorisation of this step's A alone, whose rank is checked.
    const DIRECT: bool = false;

    /// Returns the rank cut that the solver works with; `None` for one that has none.
    fn rank_cut(&self) -> Option<f64> {
        None
    }

    /// Makes a solver with these parameters, before its first step.
    fn new(params: Self::Params) -> Self;

    /// Solves the problem of one step; see [`MultiplierSolver::solve`].
    ///
    /// # Errors
    /// Those of [`MultiplierSolver::solve`].
    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error>;

    /// Forgets all earlier steps.
    fn reset(&mut self);

    /// Returns what the solver carries between steps; empty for a solver that carries nothing.
    fn state(&self) -> State {
        State::new(Self::Params::SOLVER, 0)
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// [`Error::State`] if the state is another solver's or incomplete.
    fn restore(&mut self, state: &State) -> Result<(), Error> {
        state.check(Self::Params::SOLVER, &[])?;
        state.check_names(Self::Params::SOLVER, &[])
    }
}

impl<S: Solver> MultiplierSolver for S {
    fn name(&self) -> &'static str {
        S::Params::SOLVER
    }

    fn needs(&self) -> Needs {
        S::NEEDS
    }

    fn rank_cut(&self) -> Option<f64> {
        Solver::rank_cut(self)
    }

    fn is_direct(&self) -> bool {
        S::DIRECT
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        Solver::solve(self, problem, x)
    }

    fn reset(&mut self) {
        Solver::reset(self);
    }

    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Box::new(self.clone())
    }

    fn state(&self) -> State {
        Solver::state(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        Solver::restore(self, state)
    }
}

/// Everything that a solver carries between steps, for saving.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct State {
    /// Name of the solver.
    pub solver: String,
    /// Number of rows n of the last step; 0 before the first solve.
    pub size: usize,
    /// Fields by name, as flat arrays.
    pub fields: BTreeMap<String, Vec<f64>>,
}

impl State {
    /// Returns a state without fields.
    #[must_use]
    pub fn new(solver: &str, size: usize) -> Self {
        Self { solver: solver.to_owned(), size, fields: BTreeMap::new() }
    }

    /// Adds a field.
    #[must_use]
    pub fn with(mut self, name: &str, values: &[f64]) -> Self {
        self.fields.insert(name.to_owned(), values.to_vec());
        self
    }

    /// Returns a field; empty if it is missing.
    #[must_use]
    pub fn field(&self, name: &str) -> &[f64] {
        self.fields.get(name).map_or(&[], Vec::as_slice)
    }

    /// The x of the last solve, if it was saved, of a state that holds nothing else.
    ///
    /// # Errors
    /// [`Error::State`] if it is another solver's or incomplete.
    pub(crate) fn last_x(&self, solver: &'static str) -> Result<Option<&[f64]>, Error> {
        let kept = self.fields.contains_key("x");
        self.check(solver, &[("x", if kept { self.size } else { 0 })])?;
        self.check_names(solver, &["x"])?;
        Ok(kept.then(|| self.field("x")))
    }

    /// Returns a whole number in `range` that was saved as a float.
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

    /// Returns a field that holds every row once, in some order.
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

    /// Checks that the state is this solver's and that its fields have these lengths and are finite.
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

    /// Checks that the state has no fields but these. A field that the solver does not know comes from another version.
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
