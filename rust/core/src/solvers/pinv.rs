//! The reference: x = A⁺ b from a symmetric eigendecomposition.

use crate::error::{Error, check_len};
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::eigen::{RANK_CUT, SymmetricEigen};
use crate::solvers::solver::Solver;

/// Parameters of [`Pinv`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinvParams {
    /// Eigenvalues below this part of the largest count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for PinvParams {
    const SOLVER: &'static str = "pinv";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// x = A⁺ b, decomposed anew every step; nothing is carried but the workspace.
#[derive(Clone)]
pub struct Pinv {
    params: PinvParams,
    eigen: SymmetricEigen,
}

impl Solver for Pinv {
    type Params = PinvParams;
    const SUMMARY: &'static str = "pseudo-inverse by symmetric eigendecomposition: the reference";
    const NEEDS: Needs = Needs::Dense;
    const DIRECT: bool = true;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: PinvParams) -> Self {
        Self { params, eigen: SymmetricEigen::new(0) }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        if self.eigen.len() != n {
            self.eigen = SymmetricEigen::new(n);
        }
        let (matrix, blocks) = problem.matrix_and_blocks();
        self.eigen.decompose(matrix, self.params.rank_cut, blocks)?;
        Ok(self.eigen.answer(problem, x))
    }

    fn reset(&mut self) {}
}
