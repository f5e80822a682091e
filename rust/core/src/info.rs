//! What a solve reports.

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// The stopping test of the solver was met.
    Converged,
    /// The iteration limit was reached first, or nothing was left to gain. The multipliers come from a refresh where the
    /// solver carries an inverse, and are the best it has met where it does not.
    IterationLimit,
    /// The iteration could not go on: an overflow, an x beyond all bounds, no curvature or no progress. The multipliers are
    /// those of [`IterationLimit`](Self::IterationLimit).
    Breakdown,
}

impl Status {
    /// The name used in tables: `converged`, `iteration-limit`, `breakdown`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::IterationLimit => "iteration-limit",
            Self::Breakdown => "breakdown",
        }
    }
}

/// The figures of one solve. A figure that the solver cannot know is `None`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Info {
    /// How the solve ended.
    pub status: Status,
    /// Iterations, in the solver's own count (for `sr1` the paper's k); 0 for a direct solver.
    pub iterations: usize,
    /// Products with A or with the carried inverse, O(n²) each.
    pub products: usize,
    /// ‖A x − b‖ / ‖b‖, in the least-squares sense (‖A x − P b‖ / ‖b‖, P onto range(A)) where the solver knows range(A).
    /// What folding takes out of b, where proportional rows contradict one another, counts for no solver.
    pub residual_rel: f64,
    /// ‖Nᵀ b‖, N an orthonormal basis of null(A): how far the redundant rows contradict one another.
    pub inconsistency: Option<f64>,
    /// Rank of A by the solver's rank cut.
    pub rank: Option<usize>,
    /// ‖A N‖ / ‖A‖ of the null-space basis that the solver used.
    pub null_residual: Option<f64>,
    /// Whether the carried pseudo-inverse was recomputed from scratch in this solve.
    pub refreshed: bool,
    /// Updates that were skipped or replaced by a safer one.
    pub fallbacks: usize,
    /// Rows that folding took out before the solver saw the system: zero rows and all but one of proportional ones.
    pub folded: usize,
    /// Whether the fold of earlier steps did not hold any more and was found anew.
    pub refolded: bool,
}

impl Info {
    /// The figures of a system whose rows are all zero, with ‖b‖: x = 0, and all of b is inconsistent.
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
            refreshed: false,
            fallbacks: 0,
            folded: 0,
            refolded: false,
        }
    }
}
