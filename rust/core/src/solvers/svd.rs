//! A second reference: x = A⁺ b from the singular values of W = L⁻¹ Jᵀ, with A = Wᵀ W.
//!
//! No square is taken, so that a condition of 1e10 of A is one of 1e5 here. It shares neither factor nor eigenvalues with
//! [`cholesky`](crate::solvers::cholesky) and [`pinv`](crate::solvers::pinv), and stands behind them as their judge. A system that is given
//! as dense (A, b) has no W, and its A is decomposed.

use crate::error::{Error, check_len};
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::eigen::{RANK_CUT, SymmetricEigen};
use crate::solvers::solver::Solver;

/// Parameters of [`Svd`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SvdParams {
    /// Squares of singular values below this part of the largest count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for SvdParams {
    const SOLVER: &'static str = "svd";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// x = A⁺ b, decomposed anew every step; nothing is carried but the workspace.
#[derive(Clone)]
pub struct Svd {
    params: SvdParams,
    found: SymmetricEigen,
}

impl Solver for Svd {
    type Params = SvdParams;
    const SUMMARY: &'static str = "pseudo-inverse by singular values of L⁻¹Jᵀ: a second, slower reference";
    const NEEDS: Needs = Needs::Operator;
    const DIRECT: bool = true;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: SvdParams) -> Self {
        Self { params, found: SymmetricEigen::new(0) }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        if self.found.len() != n {
            self.found = SymmetricEigen::new(n);
        }
        self.found.decompose_factor(problem, self.params.rank_cut)?;
        Ok(self.found.answer(problem, x))
    }

    fn reset(&mut self) {}
}
