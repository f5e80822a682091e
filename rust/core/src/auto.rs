//! The default: the fastest right solver by the table of [`bench`](crate::bench), with the reference behind it.
//!
//! That table says the same at every size from 6 to 192, with a third of the rows redundant: rank-revealing Cholesky. Where
//! its own residual says that it went wrong, the step is solved again by [`pinv`](crate::pinv), and counted as a fallback.

use crate::cholesky::{Cholesky, CholeskyParams};
use crate::eigen::RANK_CUT;
use crate::error::Error;
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::pinv::{Pinv, PinvParams};
use crate::problem::{Needs, Problem};
use crate::solver::{MultiplierSolver, SolverKind, State};

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: AutoParams::SOLVER,
    summary: "the default: the fastest right solver for the size, the reference where it fails",
    build: |options| Ok(Box::new(Auto::new(AutoParams::from_options(options)?))),
    options: AutoParams::defaults,
};

/// Residual in the least-squares sense, relative to b, above which the fast solver is not believed: a direct solve of a
/// system with a condition of up to 1e8 leaves 1e-8.
const BELIEVED: f64 = 1e-7;

/// Parameters of [`Auto`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutoParams {
    /// Pivots, or eigenvalues, below this part of the first count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for AutoParams {
    const SOLVER: &'static str = "auto";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// The fast solver and the one to fall back on.
#[derive(Clone)]
pub struct Auto {
    fast: Cholesky,
    safe: Pinv,
}

impl Auto {
    /// A solver with these parameters.
    #[must_use]
    pub fn new(params: AutoParams) -> Self {
        let AutoParams { rank_cut } = params;
        Self { fast: Cholesky::new(CholeskyParams { rank_cut }), safe: Pinv::new(PinvParams { rank_cut }) }
    }
}

impl MultiplierSolver for Auto {
    fn name(&self) -> &'static str {
        AutoParams::SOLVER
    }

    fn needs(&self) -> Needs {
        Needs::Dense
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let solved = self.fast.solve(problem, x);
        if solved.as_ref().is_ok_and(|info| info.residual_rel > BELIEVED) {
            return self.safe.solve(problem, x).map(|info| Info { fallbacks: 1, ..info });
        }
        solved
    }

    fn reset(&mut self) {
        self.fast.reset();
        self.safe.reset();
    }

    fn state(&self) -> State {
        self.fast.save(AutoParams::SOLVER)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.fast.load(state, AutoParams::SOLVER)
    }

    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Box::new(self.clone())
    }
}
