//! H ≈ A⁺ carried from step to step, with what it starts from: an eigendecomposition, or a sparse factor where that proves that
//! A has an inverse. What the quasi-Newton solvers share.

use crate::error::Error;
use crate::info::{Info, Status};
use crate::linalg::kernels::{axpy, gemv, norm};
use crate::problem::Problem;
use crate::solvers::dual::Dual;
use crate::solvers::eigen::SymmetricEigen;
use crate::solvers::solver::State;
use crate::solvers::sparse::SparseFactor;

/// Fields of a saved state.
pub(crate) const FIELDS: [&str; 2] = ["inverse", "least"];

/// Default of the absolute stopping test of the solvers that stay faithful to the paper, in the units of b.
pub(crate) const EPS_ABS: f64 = 1e-6;

/// How far ‖x‖ may exceed the bound ‖b‖ / λ⁺ of the minimum-norm solution before a solve counts as broken down. A
/// turning null space alone doubles ‖x‖ on the boat; 100 leaves room for λ⁺ to have changed since it was computed.
pub(crate) const GROWTH_LIMIT: f64 = 100.0;

/// Sizes up to this are decomposed at once: what a sparse factor would save is not worth its patterns.
const SMALL: usize = 24;

/// The carried inverse.
#[derive(Clone)]
pub(crate) struct CarriedInverse {
    /// H, `n×n`, column-major.
    pub inverse: Vec<f64>,
    eigen: SymmetricEigen,
    dual: Dual,
    rank_cut: f64,
    stale: bool,
    /// Whether A had an inverse at the last refresh, and was not decomposed.
    regular: bool,
    /// λ⁺ of the last refresh, or less; 0 if there was none, or A was zero.
    least: f64,
}

impl CarriedInverse {
    /// For `n×n`; stale until its first [`refresh`](Self::refresh).
    #[must_use]
    pub(crate) fn new(n: usize, rank_cut: f64) -> Self {
        let (inverse, eigen, dual) = (vec![0.0; n * n], SymmetricEigen::new(n), Dual::new(rank_cut));
        Self { inverse, eigen, dual, rank_cut, stale: true, regular: false, least: 0.0 }
    }

    /// The size it was made for.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.eigen.len()
    }

    /// Whether it must be refreshed before it is used.
    #[must_use]
    pub(crate) const fn is_stale(&self) -> bool {
        self.stale
    }

    /// Asks for a refresh before the next use.
    pub(crate) const fn invalidate(&mut self) {
        self.stale = true;
    }

    /// Asks for a refresh if H has overflowed. An update that overflows does so on the diagonal, for |uᵢ uⱼ| is at most the
    /// larger of uᵢ² and uⱼ².
    pub(crate) fn invalidate_overflow(&mut self) {
        let n = self.len();
        self.stale |= !(0..n).all(|i| self.inverse[i * n + i].is_finite());
    }

    /// An orthonormal basis of null(A) at the last refresh.
    pub(crate) fn null_vectors(&self) -> impl Iterator<Item = &[f64]> {
        let dropped = if self.regular { 0 } else { self.len() - self.eigen.rank() };
        (0..dropped).map(|i| self.eigen.vector(i))
    }

    /// ‖A N‖ / ‖A‖ of that basis.
    #[must_use]
    pub(crate) fn null_residual(&self) -> f64 {
        if self.regular { 0.0 } else { self.eigen.null_residual() }
    }

    /// H = A⁺ of this problem's A.
    ///
    /// # Errors
    /// Those of [`SymmetricEigen::decompose`]; H stays stale then.
    pub(crate) fn refresh(&mut self, problem: &mut Problem<'_>) -> Result<(), Error> {
        let n = self.len();
        self.stale = true;
        self.regular = n > SMALL && self.dual.invert(problem, &mut self.inverse);
        self.least = if self.regular {
            // Of a positive definite matrix 1/λ⁺ is at most the trace of its inverse.
            (0..n).map(|i| self.inverse[i * n + i]).sum::<f64>().recip()
        } else {
            let (matrix, blocks) = problem.matrix_and_blocks();
            self.eigen.decompose(matrix, self.rank_cut, blocks)?;
            self.eigen.pseudo_inverse(&mut self.inverse);
            self.eigen.least()
        };
        self.stale = false;
        Ok(())
    }

    /// Takes H as it is given.
    pub(crate) fn start_from(&mut self, inverse: &[f64]) {
        self.inverse.copy_from_slice(inverse);
        self.least = 0.0;
        self.stale = false;
    }

    /// Whether ‖x‖ lies beyond what the minimum-norm solution for this ‖b‖ could be, by [`GROWTH_LIMIT`].
    #[must_use]
    pub(crate) fn too_large(&self, x_norm: f64, b_norm: f64) -> bool {
        x_norm * self.least > GROWTH_LIMIT * b_norm
    }

    /// For saving.
    #[must_use]
    pub(crate) fn state(&self, solver: &str) -> State {
        let state = State::new(solver, self.len());
        if self.stale { state } else { state.with("inverse", &self.inverse).with("least", &[self.least]) }
    }

    /// From a saved state that [`check_state`] has passed; one without fields leaves it stale.
    pub(crate) fn restore(&mut self, state: &State) {
        self.stale = true;
        if !state.fields.is_empty() {
            self.start_from(state.field("inverse"));
            self.least = state.field("least")[0];
        }
    }
}

/// x and r = A x − b of one solve, and its figures: how the solvers that stay faithful to their papers begin, when they
/// are done, and what they hand on. A solve that does not converge ends in a refresh, so that no garbage is carried.
#[derive(Clone, Default)]
pub(crate) struct Iterate {
    /// x, `n`.
    pub x: Vec<f64>,
    /// A x − b, `n`.
    pub r: Vec<f64>,
    /// Iterations so far.
    pub iterations: usize,
    /// Products with A or with H so far.
    pub products: usize,
    /// Updates skipped so far.
    pub fallbacks: usize,
    /// ‖b‖.
    pub b_norm: f64,
    /// ‖A x − b‖ that is small enough.
    pub tolerance: f64,
    /// Whether that is more than the default allows.
    pub loose: bool,
    refreshed: bool,
}

impl Iterate {
    /// For n rows.
    #[must_use]
    pub(crate) fn new(n: usize) -> Self {
        Self { x: vec![0.0; n], r: vec![0.0; n], ..Self::default() }
    }

    /// Zeroes the figures, and refreshes H if it must not be used as it is. Leaves x and r alone.
    ///
    /// # Errors
    /// Those of [`CarriedInverse::refresh`].
    pub(crate) fn begin(
        &mut self,
        carried: &mut CarriedInverse,
        problem: &mut Problem<'_>,
    ) -> Result<(), Error> {
        (self.iterations, self.products, self.fallbacks) = (0, 0, 0);
        self.b_norm = norm(problem.rhs());
        self.refreshed = carried.is_stale();
        if self.refreshed { carried.refresh(problem) } else { Ok(()) }
    }

    /// x = H b and its residual.
    pub(crate) fn solve_with(&mut self, carried: &CarriedInverse, problem: &mut Problem<'_>) {
        gemv(&carried.inverse, problem.rhs(), &mut self.x);
        self.products += 1;
        self.residual(problem);
    }

    /// r = A x − b, computed.
    pub(crate) fn residual(&mut self, problem: &mut Problem<'_>) {
        problem.apply(&self.x, &mut self.r);
        axpy(-1.0, problem.rhs(), &mut self.r);
        self.products += 1;
    }

    /// How the solve ends here, if it does: ‖r‖ small enough, the limit, or numbers that cannot be right.
    #[must_use]
    pub(crate) fn verdict(&self, carried: &CarriedInverse, max_iterations: usize) -> Option<Status> {
        let r_norm = norm(&self.r);
        if !r_norm.is_finite() || carried.too_large(norm(&self.x), self.b_norm) {
            Some(Status::Breakdown)
        } else if r_norm <= self.tolerance {
            Some(Status::Converged)
        } else {
            (self.iterations == max_iterations).then_some(Status::IterationLimit)
        }
    }

    /// Hands x over, after a refresh if the solve did not converge.
    ///
    /// # Errors
    /// Those of [`CarriedInverse::refresh`].
    pub(crate) fn finish(
        &mut self,
        status: Status,
        carried: &mut CarriedInverse,
        problem: &mut Problem<'_>,
        x: &mut [f64],
    ) -> Result<Info, Error> {
        if status != Status::Converged {
            carried.refresh(problem)?;
            self.refreshed = true;
            self.solve_with(carried, problem);
        }
        carried.invalidate_overflow();
        x.copy_from_slice(&self.x);
        Ok(Info {
            status,
            iterations: self.iterations,
            products: self.products,
            residual_rel: if self.b_norm == 0.0 { 0.0 } else { norm(&self.r) / self.b_norm },
            inconsistency: None,
            rank: None,
            null_residual: None,
            tolerance: if self.loose && self.b_norm > 0.0 { self.tolerance / self.b_norm } else { 0.0 },
            refreshed: self.refreshed,
            fallbacks: self.fallbacks,
            ..Info::trivial(0.0)
        })
    }
}

/// Checks the part of a saved state that holds H, and that of its other fields all are `known`.
///
/// # Errors
/// [`Error::State`].
pub(crate) fn check_state(state: &State, solver: &'static str, known: &[&str]) -> Result<(), Error> {
    if state.fields.is_empty() {
        return state.check(solver, &[]);
    }
    if state.size == 0 {
        return Err(Error::State { solver, reason: "it has fields for size 0".to_owned() });
    }
    state.check(solver, &[("inverse", state.size.saturating_mul(state.size)), ("least", 1)])?;
    state.check_names(solver, known)
}
