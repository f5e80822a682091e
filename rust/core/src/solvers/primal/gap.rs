//! Redundant rows that stand open: their eigenvalues are small, but more than rounding.
//!
//! A rank r that is held says that they are dropped, and where τ lies between λᵣ and λᵣ₊₁ the factor of JᵀJ − τM proves it as for
//! rows that are closed. What would come back of them in x is taken out of b beforehand, by a polynomial of F = J P⁻¹ Jᵀ, which is
//! 1 + τ/σ where an eigenvalue counts, and −σ/τ of one that does not.

use super::{CLEAR, LEAST, Primal, distance};
use crate::problem::Blocks;

/// Eigenvalues are looked for at parts of the largest that are so many times apart.
const STRIDE: f64 = 4.0;

/// Above this part of the largest nobody looks.
const MOST: f64 = 1e-2;

/// Part of x that may come back of what is dropped, or be lost of what counts.
const NEGLIGIBLE: f64 = 1e-9;

/// Part of b that no x can reach, as long as nothing is known of it.
const UNREACHED: f64 = 1e-3;

/// It may grow so many times from one step to the next.
const GROWN: f64 = 4.0;

/// Rows that stand open by so many times more than when eigenvalues were looked for have others.
const WIDER: f64 = 1.5;

/// Solves after which they are looked for anew.
const AGE: usize = 128;

/// Places of τ that are weighed.
const PLACES: i32 = 12;

/// Orders of a filter: 1 − O(ε^kept) of what counts, O(ε'^dropped) of what does not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Filter {
    pub(super) kept: usize,
    pub(super) dropped: usize,
}

/// Highest orders.
const HIGHEST: Filter = Filter { kept: 6, dropped: 8 };

/// Parts of the largest eigenvalue between which there is none, and what follows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gap {
    lower: f64,
    upper: f64,
    /// How far rows stood open, and the part of b that no x could reach.
    open: f64,
    unreached: f64,
    age: usize,
    /// τ as a part of the largest eigenvalue.
    part: f64,
    filter: Filter,
}

impl Primal {
    /// The rank of A where it is that which is held, of rows that stand open; the factor is that of τ between what counts and what
    /// is dropped.
    pub(super) fn find_rank_between(&mut self, blocks: &Blocks) -> Option<usize> {
        if !self.expect(blocks) {
            return None;
        }
        let open = blocks.widest_gap();
        if let Some(gap) = &mut self.gap
            && open <= WIDER * gap.open
            && gap.age < AGE
        {
            gap.age += 1;
            let part = gap.part;
            if self.counts(part) {
                return Some(self.positive.iter().sum());
            }
        }
        let unreached = self.gap.map_or(UNREACHED, |gap| gap.unreached);
        self.gap = None;
        let part = CLEAR * self.rank_cut;
        if !self.counts(part) {
            return None;
        }
        let (mut lower, mut upper) = (self.part, self.part);
        while upper * STRIDE <= MOST && self.counts(upper * STRIDE) {
            upper *= STRIDE;
        }
        while lower > LEAST && self.counts(lower / STRIDE) {
            lower = self.part;
        }
        let filter = Filter { kept: 1, dropped: 1 };
        let mut gap = Gap { lower, upper, open, unreached, age: 0, part, filter };
        // Beyond what open rows explain a rank rises.
        gap.place(part, CLEAR * blocks.explained_of_all(self.rank_cut).0)?;
        self.gap = Some(gap);
        self.counts(gap.part).then(|| self.positive.iter().sum())
    }

    /// Whether as many eigenvalues as are expected exceed a part of the largest.
    fn counts(&mut self, part: f64) -> bool {
        self.count(part).is_some() && self.positive == self.expected
    }

    /// Takes what no x can reach out of b, until next to nothing of x comes of what is left of it.
    pub(super) fn leave_out_beforehand(&mut self, rhs: &[f64]) -> Option<()> {
        let mut gap = self.gap?;
        self.residual.copy_from_slice(&self.target);
        let reached = self.leave_out(gap.filter);
        gap.unreached = distance(rhs, &self.target) / reached;
        let enough = gap.comes_back() <= NEGLIGIBLE;
        // The next step weighs anew what this one shows to be too little.
        self.gap = enough.then_some(gap);
        enough.then_some(())
    }

    /// x ← F x. Rounding of the first δ is 1/τ times as large along what is dropped, and of x √σ/τ times that; later corrections put
    /// right what this changes of what counts.
    pub(super) fn drop_again(&mut self, x: &mut [f64]) {
        let Self { plan, pull, force, .. } = self;
        plan.ldl.solve(pull);
        x.fill(0.0);
        plan.add_and_transpose(pull, x, force);
        std::mem::swap(pull, force);
    }
}

impl Gap {
    /// Places τ, at most `most` of the largest eigenvalue and at least `least`, where corrections and a filter that is good enough take
    /// fewest solves; `None` if none is.
    fn place(&mut self, least: f64, most: f64) -> Option<()> {
        let (from, to) = (self.lower.max(least), self.upper.min(most).max(least));
        let mut fewest: Option<(f64, f64, Filter)> = None;
        for place in 0..=PLACES {
            self.part = from * (to / from).powf(f64::from(place) / f64::from(PLACES));
            let Some(filter) = self.least_filter() else { continue };
            // Two solves a correction, each of which leaves τ/σ of the error of the one before.
            let corrections = (1e-13_f64.ln() / (self.part / self.upper).min(0.5).ln()).ceil();
            let solves = 2.0 * corrections + (filter.kept + filter.dropped) as f64;
            if fewest.is_none_or(|(least, ..)| solves < least) {
                fewest = Some((solves, self.part, filter));
            }
        }
        let (_, part, filter) = fewest?;
        (self.part, self.filter) = (part, filter);
        Some(())
    }

    /// The filter of lowest orders that is good enough with τ where it is, though more of b than now may be out of reach.
    fn least_filter(&self) -> Option<Filter> {
        let tried = Self { unreached: (GROWN * self.unreached).max(f64::EPSILON), ..*self };
        let good = |filter: Filter| {
            filter.loss(tried.part / tried.upper) <= NEGLIGIBLE
                && Self { filter, ..tried }.comes_back() <= NEGLIGIBLE
        };
        let all = (1..=HIGHEST.kept)
            .flat_map(|kept| (1..=HIGHEST.dropped).map(move |dropped| Filter { kept, dropped }));
        all.filter(|&filter| good(filter)).min_by_key(|filter| filter.kept + filter.dropped)
    }

    /// The part of x that may come of what is dropped: an eigenvalue σ brings back σ/τ² times what is left in b, and no x is smaller than
    /// b over the largest.
    fn comes_back(&self) -> f64 {
        let dropped = self.lower / self.part;
        dropped / self.part * self.filter.leak(dropped) * self.unreached
    }
}

impl Filter {
    /// Coefficients of F^dropped, F^(dropped + 1), … in F^d Σ C(d+j−1, j) (1 − F)^j over j < k: 1 where F is 1, and 0 where F is 0, as
    /// often differentiated as the orders say.
    pub(super) fn coefficients(self) -> [f64; HIGHEST.kept] {
        let mut found = [0.0; HIGHEST.kept];
        for j in 0..self.kept {
            let outer = choose(self.dropped + j - 1, j);
            for (i, entry) in found.iter_mut().enumerate().take(j + 1) {
                let inner = outer * choose(j, i);
                *entry += if i.is_multiple_of(2) { inner } else { -inner };
            }
        }
        found
    }

    /// What it lacks to 1, at most, where F is within ε of 1.
    fn loss(self, epsilon: f64) -> f64 {
        choose(self.dropped + self.kept - 1, self.kept) * (2.0 * epsilon).powi(self.kept as i32)
    }

    /// What it has beside 0, at most, where F is within ε of 0.
    fn leak(self, epsilon: f64) -> f64 {
        choose(self.dropped + self.kept - 1, self.dropped) * epsilon.powi(self.dropped as i32)
    }
}

/// n over k.
fn choose(n: usize, k: usize) -> f64 {
    (0..k).map(|i| (n - i) as f64 / (i + 1) as f64).product()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_keep_what_is_near_one_and_drop_what_is_near_zero() {
        let apply = |filter: Filter, f: f64| {
            let terms = filter.coefficients().into_iter().take(filter.kept).enumerate();
            terms.map(|(i, c)| c * f.powi((filter.dropped + i) as i32)).sum::<f64>()
        };
        for filter in [(1, 1), (2, 2), (1, 4), (3, 2), (4, 6)].map(|(kept, dropped)| Filter { kept, dropped })
        {
            for epsilon in [1e-1, 1e-2, 1e-3] {
                let (lost, left) = (1.0 - apply(filter, 1.0 + epsilon), apply(filter, -epsilon));
                let rounding = 1e-13;
                assert!(lost.abs() <= filter.loss(epsilon) + rounding, "{filter:?}, {epsilon}: {lost:e}");
                let leak = filter.leak(epsilon) * (1.0 + epsilon).powi(filter.kept as i32 * 3);
                assert!(left.abs() <= leak + rounding, "{filter:?}, {epsilon}: {left:e}");
            }
        }
        assert_eq!(Filter { kept: 2, dropped: 2 }.coefficients()[..2], [3.0, -2.0]);
    }
}
