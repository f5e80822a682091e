//! The trait that every solver implements, and the registry of names.

use crate::error::Error;
use crate::info::Info;
use crate::params::Options;
use crate::system::ConstrainedSystem;
use crate::{pinv, sr1};

/// Solves A λ = b, one step after another. A solver owns its workspace and whatever it carries between steps.
pub trait MultiplierSolver: Send + Sync {
    /// Name in the registry.
    fn name(&self) -> &'static str;

    /// Solves the system of one step into `x` (`n`).
    ///
    /// A system of another size than the last one starts the solver anew, as [`reset`](Self::reset) does.
    ///
    /// # Errors
    /// [`Error`] for bad input only; not converging is a [`Status`](crate::info::Status), with a usable x.
    fn solve(&mut self, system: &ConstrainedSystem, x: &mut [f64]) -> Result<Info, Error>;

    /// Forgets all earlier steps.
    fn reset(&mut self);
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
pub static SOLVERS: &[SolverKind] = &[sr1::KIND, pinv::KIND];

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
