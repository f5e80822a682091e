//! The reference, carried: x = A⁺ b from eigenvectors that are refined from step to step.
//!
//! The same answer as [`pinv`](crate::solvers::pinv) to rounding, for less: see [`CarriedEigen`]. Its iterations are the rounds of the
//! refinement; a step that is decomposed anew has none, and counts as a refresh.

use crate::error::{Error, check_len};
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::eigen::carried::CarriedEigen;
use crate::solvers::solver::{Solver, State};

/// Parameters of [`PinvTracked`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PinvTrackedParams {
    /// Eigenvalues below this part of the largest count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for PinvTrackedParams {
    const SOLVER: &'static str = "pinv-tracked";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// x = A⁺ b from the eigenvectors of the last step.
#[derive(Clone)]
pub struct PinvTracked {
    params: PinvTrackedParams,
    carried: CarriedEigen,
}

impl Solver for PinvTracked {
    type Params = PinvTrackedParams;
    const SUMMARY: &'static str = "pseudo-inverse by eigenvectors refined from step to step, to rounding";
    const NEEDS: Needs = Needs::Dense;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: PinvTrackedParams) -> Self {
        Self { params, carried: CarriedEigen::new(0) }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        if self.carried.eigen().len() != n {
            self.carried = CarriedEigen::new(n);
        }
        let (matrix, blocks) = problem.matrix_and_blocks();
        let rounds = self.carried.decompose(matrix, self.params.rank_cut, blocks)?;
        let (iterations, refreshed) = (rounds.unwrap_or(0), rounds.is_none());
        Ok(Info { iterations, refreshed, ..self.carried.eigen().answer(problem, x) })
    }

    fn reset(&mut self) {
        self.carried.forget();
    }

    fn state(&self) -> State {
        self.carried.save(PinvTrackedParams::SOLVER)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.carried = CarriedEigen::load(state, PinvTrackedParams::SOLVER)?;
        Ok(())
    }
}
