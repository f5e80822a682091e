//! Algorithm (11) from within: a copy of every pass of a solve.

use nalgebra::{DMatrix, DVector};
use oarlock_core::solvers::Solver;
use oarlock_core::solvers::sr1::{Iteration, Sr1, Sr1Params};
use oarlock_core::{Error, Info, Needs, Problem};

/// What pass k left: see [`Iteration`].
#[derive(Debug, Clone)]
pub struct Pass {
    /// Hₖ.
    pub inverse: DMatrix<f64>,
    /// The factor of sₖ: 1 at the start, then −αₖ₋₁.
    pub step: f64,
    /// sₖ.
    pub s: DVector<f64>,
    /// yₖ.
    pub y: DVector<f64>,
    /// xₖ₊₁.
    pub x: DVector<f64>,
    /// rₖ₊₁.
    pub r: DVector<f64>,
}

impl From<&Iteration<'_>> for Pass {
    fn from(at: &Iteration<'_>) -> Self {
        let n = at.x.len();
        Self {
            inverse: DMatrix::from_column_slice(n, n, at.inverse),
            step: at.step,
            s: DVector::from_column_slice(at.direction) * at.step,
            y: DVector::from_column_slice(at.y),
            x: DVector::from_column_slice(at.x),
            r: DVector::from_column_slice(at.r),
        }
    }
}

impl Pass {
    /// Hₖ rₖ₊₁.
    pub fn hr(&self) -> DVector<f64> {
        &self.inverse * &self.r
    }

    /// |rₖ₊₁ᵀ Hₖ yₖ| / (‖Hₖ rₖ₊₁‖ ‖yₖ‖): what the guard looks at.
    pub fn relative_denominator(&self) -> f64 {
        let hr = self.hr();
        hr.dot(&self.y).abs() / (hr.norm() * self.y.norm())
    }
}

/// [`Sr1`] that keeps the passes of its last solve.
#[derive(Clone)]
pub struct Traced {
    /// The solver.
    pub solver: Sr1,
    /// Pass 0 to the last.
    pub passes: Vec<Pass>,
}

impl Solver for Traced {
    type Params = Sr1Params;
    const SUMMARY: &'static str = Sr1::SUMMARY;
    const NEEDS: Needs = Sr1::NEEDS;

    /// Before its first solve.
    fn new(params: Sr1Params) -> Self {
        Self { solver: Sr1::new(params), passes: Vec::new() }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let Self { solver, passes } = self;
        passes.clear();
        solver.solve_observed(problem, x, |at| passes.push(at.into()))
    }

    fn reset(&mut self) {
        self.solver.reset();
    }
}
