//! The figures that a solve reports.

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// The stopping test of the solver was met.
    Converged,
    /// The iteration limit was reached, or no further progress was possible. The multipliers come from a refresh if the solver
    /// carries an inverse, and are the best that it has met otherwise.
    IterationLimit,
    /// The iteration could not go on, because of an overflow, an x beyond all bounds, no curvature or no progress. The
    /// multipliers are chosen as for [`IterationLimit`](Self::IterationLimit).
    Breakdown,
    /// The stopping test of the solver was met, but the acceleration is not what an independent solve of the same step gives.
    Inaccurate,
}

impl Status {
    /// Returns the name used in tables: `converged`, `iteration-limit`, `breakdown` or `inaccurate`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::IterationLimit => "iteration-limit",
            Self::Breakdown => "breakdown",
            Self::Inaccurate => "inaccurate",
        }
    }
}

/// The figures of one solve. Figures that the solver cannot know are `None`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Info {
    /// How the solve ended.
    pub status: Status,
    /// Number of iterations, in the solver's own count (for `sr1` the paper's k); 0 for a direct solver.
    pub iterations: usize,
    /// Number of products with A or with the carried inverse, O(n²) each.
    pub products: usize,
    /// Relative residual ‖A x − b‖ / ‖b‖; if the solver knows range(A), in the least-squares sense, ‖A x − P b‖ / ‖b‖ with the
    /// projector P onto range(A). The part of b that folding removes, where proportional rows contradict one another, does not count.
    pub residual_rel: f64,
    /// How far the redundant rows contradict one another: ‖Nᵀ b‖, with an orthonormal basis N of null(A).
    pub inconsistency: Option<f64>,
    /// Rank of A, by the solver's rank cut.
    pub rank: Option<usize>,
    /// Error of the null-space basis N that the solver used, ‖A N‖ / ‖A‖.
    pub null_residual: Option<f64>,
    /// How many times the eigenvalue nearest to the rank cut of its block is larger or smaller than the cut. Pivots stand for
    /// eigenvalues where the solver has none.
    pub margin: Option<f64>,
    /// Whether a rank that was held rose in this step, because more stands than open rows explain.
    pub risen: bool,
    /// Residual ‖A x − b‖ / ‖b‖ that the stopping test may leave beyond what `converged` promises of every solver; 0 for none.
    pub tolerance: f64,
    /// Whether the carried pseudo-inverse was recomputed from scratch in this solve.
    pub refreshed: bool,
    /// Number of updates that were skipped or replaced by a safer one.
    pub fallbacks: usize,
    /// Number of rows that folding removed before the solver saw the system: zero rows, and all but one of proportional rows.
    pub folded: usize,
    /// Whether the fold of earlier steps no longer held and was found anew.
    pub refolded: bool,
}

impl Info {
    /// Returns the figures of a system whose rows are all zero: x = 0, and all of b is inconsistent. `norm` is ‖b‖.
    #[must_use]
    pub const fn trivial(norm: f64) -> Self {
        Self {
            status: Status::Converged,
            iterations: 0,
            products: 0,
            residual_rel: 0.0,
            inconsistency: Some(norm),
            rank: Some(0),
            null_residual: Some(0.0),
            margin: None,
            risen: false,
            tolerance: 0.0,
            refreshed: false,
            fallbacks: 0,
            folded: 0,
            refolded: false,
        }
    }
}
