//! The registry of solvers by name.

use crate::error::Error;
use crate::params::{Options, Params, Value};
use crate::solvers::auto::Auto;
use crate::solvers::cg::Cg;
use crate::solvers::cholesky::Cholesky;
use crate::solvers::dual::Dual;
use crate::solvers::krylov::Krylov;
use crate::solvers::minres::Minres;
use crate::solvers::pinv::Pinv;
use crate::solvers::pinv_tracked::PinvTracked;
use crate::solvers::primal::Primal;
use crate::solvers::quasi_newton::{Bfgs, Dfp, QuasiNewton, Sr1Update};
use crate::solvers::regularised::Regularised;
use crate::solvers::solver::{MultiplierSolver, Solver};
use crate::solvers::sparse::Sparse;
use crate::solvers::sr1::Sr1;
use crate::solvers::svd::Svd;
use crate::solvers::tracked::Tracked;

/// An entry of the registry.
pub struct SolverKind {
    /// Name of the solver, as in `--solver NAME`.
    pub name: &'static str,
    /// What the solver is, in one line.
    pub summary: &'static str,
    /// Makes the solver from options.
    pub build: fn(&Options) -> Result<Box<dyn MultiplierSolver>, Error>,
    /// Returns the names and defaults of its options.
    pub options: fn() -> Vec<(&'static str, Value)>,
}

impl SolverKind {
    const fn of<S: Solver>() -> Self {
        Self {
            name: S::Params::SOLVER,
            summary: S::SUMMARY,
            build: |options| Ok(Box::new(S::new(S::Params::from_options(options)?))),
            options: S::Params::defaults,
        }
    }
}

/// All solvers. A new one is one file and one line here.
pub static SOLVERS: &[SolverKind] = &[
    SolverKind::of::<Auto>(),
    SolverKind::of::<Sr1>(),
    SolverKind::of::<Tracked>(),
    SolverKind::of::<QuasiNewton<Sr1Update>>(),
    SolverKind::of::<QuasiNewton<Bfgs>>(),
    SolverKind::of::<QuasiNewton<Dfp>>(),
    SolverKind::of::<Pinv>(),
    SolverKind::of::<PinvTracked>(),
    SolverKind::of::<Svd>(),
    SolverKind::of::<Cholesky>(),
    SolverKind::of::<Sparse<Dual>>(),
    SolverKind::of::<Sparse<Primal>>(),
    SolverKind::of::<Regularised>(),
    SolverKind::of::<Krylov<Cg>>(),
    SolverKind::of::<Krylov<Minres>>(),
];

/// Looks a solver up by its name.
///
/// # Errors
/// [`Error::UnknownSolver`], which lists the names that exist.
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
