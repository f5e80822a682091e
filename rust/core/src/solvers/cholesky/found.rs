//! What a factorisation is asked, and what it says of rank and null space.

use crate::problem::Wanted;

/// A null space found to this many rounding errors of a factor, n ε λ₁ each, is left as it is.
const ROUNDING: f64 = 16.0;

/// How far the factor's null space may be off, by what is left over against the smallest pivot, to be refined: a step squares it.
const REFINABLE: f64 = 0.1;

/// What is asked of a factorisation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Asked {
    /// Pivots below this part of the first count as zero.
    pub rank_cut: f64,
    /// Pivots at most: the rank that is held.
    pub ceiling: usize,
    /// Whether multipliers are to have minimum norm.
    pub wanted: Wanted,
}

/// What the factorisation found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// Rank r.
    pub rank: usize,
    /// The first pivot.
    pub first: f64,
    /// The smallest one that was kept; infinite if none was.
    pub last: f64,
    /// Largest diagonal entry that was dropped.
    pub dropped: f64,
    /// The smallest one, which a positive semidefinite A keeps ≥ 0.
    pub lowest: f64,
}

impl Found {
    /// Before anything is dropped.
    pub(crate) const fn full(rank: usize, first: f64) -> Self {
        Self { rank, first, last: f64::INFINITY, dropped: 0.0, lowest: 0.0 }
    }

    /// A bound of λᵣ₊₁ of the n×n matrix: the trace of what is left over.
    pub(crate) fn left(&self, n: usize) -> f64 {
        (n - self.rank) as f64 * self.dropped
    }

    /// Whether that is more than rounding, and little enough for the null space of the factor to be a start.
    pub(crate) fn wants_refining(&self, n: usize) -> bool {
        let rounding = ROUNDING * n as f64 * f64::EPSILON * self.first;
        self.rank > 0 && self.dropped > rounding && self.left(n) < REFINABLE * self.last
    }
}
