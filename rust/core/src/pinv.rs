//! The reference: x = A⁺ b from a symmetric eigendecomposition.

use crate::eigen::{RANK_CUT, SymmetricEigen};
use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::params::{Params, Reader};
use crate::solver::{MultiplierSolver, SolverKind};
use crate::system::ConstrainedSystem;

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: PinvParams::SOLVER,
    summary: "pseudo-inverse by symmetric eigendecomposition: the reference",
    build: |options| Ok(Box::new(Pinv::new(PinvParams::from_options(options)?))),
    options: PinvParams::defaults,
};

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
pub struct Pinv {
    params: PinvParams,
    eigen: SymmetricEigen,
}

impl Pinv {
    /// A solver with these parameters.
    #[must_use]
    pub fn new(params: PinvParams) -> Self {
        Self { params, eigen: SymmetricEigen::new(0) }
    }
}

impl MultiplierSolver for Pinv {
    fn name(&self) -> &'static str {
        PinvParams::SOLVER
    }

    fn solve(&mut self, system: &ConstrainedSystem, x: &mut [f64]) -> Result<Info, Error> {
        let n = system.len();
        if n == 0 {
            return Err(Error::Empty { what: "system" });
        }
        check_len("x", x.len(), &[n])?;
        if self.eigen.len() != n {
            self.eigen = SymmetricEigen::new(n);
        }
        self.eigen.decompose(system.matrix(), self.params.rank_cut)?;
        let inconsistency = self.eigen.solve(system.rhs(), x);
        Ok(Info {
            status: Status::Converged,
            iterations: 0,
            products: 0,
            residual_rel: self.eigen.residual_rel(system, x),
            inconsistency: Some(inconsistency),
            rank: Some(self.eigen.rank()),
            null_residual: Some(self.eigen.null_residual()),
            refreshed: false,
            fallbacks: 0,
        })
    }

    fn reset(&mut self) {}
}
