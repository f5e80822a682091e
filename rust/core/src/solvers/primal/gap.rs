//! Redundant rows that stand open: their eigenvalues are small, but more than rounding.
//!
//! A rank r that is held says that they are dropped, and where τ lies between λᵣ and λᵣ₊₁ the factor of JᵀJ − τM proves it as for
//! rows that are closed. What would come back of them in x is taken out of b beforehand, by a polynomial of F = J P⁻¹ Jᵀ, which is
//! 1 + τ/σ where an eigenvalue counts, and −σ/τ of one that does not.

use super::{CLEAR, LEAST, Primal, distance};
use crate::problem::Blocks;

/// Eigenvalues are looked for at parts of the largest that are so many times apart.
const STRIDE: f64 = 5.0;

/// Above this part of the largest nobody looks.
const MOST: f64 = 1e-2;

/// Part of x that may come back of what is dropped, or be lost of what counts.
const NEGLIGIBLE: f64 = 1e-9;

/// Part of b that no x can reach, as long as nothing is known of it.
const UNREACHED: f64 = 1e-3;

/// It may grow so many times before τ is placed anew.
const GROWN: f64 = 4.0;

/// So many times more may rows stand open before.
const WIDER: f64 = 1.5;

/// Of a factor, relative to the largest entry.
const ROUNDING: f64 = 10.0 * f64::EPSILON;

/// Times that F is applied to the first x at most.
const MOST_DROPS: usize = 6;

/// Times that a filter is used at most.
const FILTERS: usize = 3;

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
    /// How far rows stood open, the part of b that no x could reach, and that which was reckoned with.
    open: f64,
    unreached: f64,
    reckoned: f64,
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
        // Beyond what open rows explain a rank rises.
        let (least, most) = (CLEAR * self.rank_cut, CLEAR * blocks.explained_of_all(self.rank_cut).0);
        let before = self.gap.take();
        if let Some(mut gap) = before
            && gap.age < AGE
            && gap.widen(open, least, most)
            && self.counts(gap.part)
        {
            gap.age += 1;
            self.gap = Some(gap);
            return Some(self.positive.iter().sum());
        }
        let unreached = before.map_or(UNREACHED, |gap| gap.unreached);
        if !self.counts(least) {
            return None;
        }
        let (mut lower, mut upper) = (self.part, self.part);
        while upper * STRIDE <= MOST && self.counts(upper * STRIDE) {
            upper *= STRIDE;
        }
        while lower > LEAST && self.counts(lower / STRIDE) {
            lower = self.part;
        }
        let (part, filter) = (self.part, Filter { kept: 1, dropped: 1 });
        let mut gap = Gap { lower, upper, open, unreached, reckoned: 0.0, age: 0, part, filter };
        gap.place(least, most)?;
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
        let mut comes_back = f64::INFINITY;
        for time in 1..=FILTERS {
            self.residual.copy_from_slice(&self.target);
            let reached = self.leave_out(gap.filter);
            gap.unreached = distance(rhs, &self.target) / reached;
            comes_back = gap.comes_back(time);
            if comes_back <= NEGLIGIBLE {
                break;
            }
        }
        self.gap = Some(gap);
        (comes_back <= NEGLIGIBLE).then_some(())
    }

    /// x ← F x, as often as rounding makes it necessary; later corrections put right what this changes of what counts.
    pub(super) fn drop_again(&mut self, x: &mut [f64]) {
        let Self { plan, pull, force, gap, .. } = self;
        for _ in 0..gap.map_or(1, Gap::drops) {
            plan.ldl.solve(pull);
            x.fill(0.0);
            plan.add_and_transpose(pull, x, force);
            std::mem::swap(pull, force);
        }
    }
}

impl Gap {
    /// Takes note of how far rows stand open, eigenvalues of what is dropped growing as its square; tells whether τ has a place.
    fn widen(&mut self, open: f64, least: f64, most: f64) -> bool {
        let wider = open > WIDER * self.open;
        if wider {
            self.lower *= (open / self.open).powi(2);
            self.open = open;
        }
        !(wider || self.unreached > self.reckoned) || self.place(least, most).is_some()
    }

    /// Places τ, at most `most` of the largest eigenvalue and at least `least`, where corrections and a filter that is good enough take
    /// fewest solves; `None` if none is.
    fn place(&mut self, least: f64, most: f64) -> Option<()> {
        let (from, to) = (self.lower.max(least), self.upper.min(most).max(least));
        self.reckoned = (GROWN * self.unreached).max(f64::EPSILON);
        let mut fewest: Option<(f64, f64, Filter)> = None;
        if from > to {
            return None;
        }
        for place in 0..=PLACES {
            self.part = from * (to / from).powf(f64::from(place) / f64::from(PLACES));
            let Some(filter) = self.least_filter() else { continue };
            // Two solves a correction, each of which leaves τ/σ of the error of the one before.
            let corrections = (1e-13_f64.ln() / (self.part / self.upper).min(0.5).ln()).ceil();
            let solves = 2.0 * corrections + (filter.kept + filter.dropped + self.drops()) as f64;
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
        let tried = Self { unreached: self.reckoned, ..*self };
        let good = |filter: Filter| {
            filter.loss(tried.part / tried.upper) <= NEGLIGIBLE
                && Self { filter, ..tried }.comes_back(1) <= NEGLIGIBLE
        };
        let all = (1..=HIGHEST.kept)
            .flat_map(|kept| (1..=HIGHEST.dropped).map(move |dropped| Filter { kept, dropped }));
        all.filter(|&filter| good(filter)).min_by_key(|filter| filter.kept + filter.dropped)
    }

    /// How often F has to be applied to the first x: rounding of the first δ is 1/τ times as large along what is dropped, and that of x
    /// √σ/τ times that.
    fn drops(self) -> usize {
        let dropped = self.lower / self.part;
        let rounding = ROUNDING * self.lower.sqrt() / self.part.powi(2);
        (1..MOST_DROPS)
            .find(|&drops| rounding * dropped.powi(drops as i32) <= NEGLIGIBLE)
            .unwrap_or(MOST_DROPS)
    }

    /// The part of x that may come of what is dropped after some filters: an eigenvalue σ brings back σ/τ² times what is left in b, and no x is smaller than
    /// b over the largest.
    fn comes_back(&self, filters: usize) -> f64 {
        let dropped = self.lower / self.part;
        dropped / self.part * self.filter.leak(dropped).powi(filters as i32) * self.unreached
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
