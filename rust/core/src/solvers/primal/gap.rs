//! Redundant rows that stand open: their eigenvalues are small, but more than rounding.
//!
//! A rank r that is held says that they are dropped, and where τ lies between λᵣ and λᵣ₊₁ the factor of `JᵀJ − τM` proves it as for
//! rows that are closed. What would come back of them in x is taken out of b beforehand, by a polynomial of F = J P⁻¹ Jᵀ, which is
//! 1 + τ/σ where an eigenvalue counts, and −σ/τ of one that does not.

/// Part of x that may come back of what is dropped, or be lost of what counts.
pub(super) const NEGLIGIBLE: f64 = 1e-9;

/// Part of b that no x can reach, as long as nothing is known of it.
pub(super) const UNREACHED: f64 = 1e-3;

/// It may grow so many times before τ is placed anew.
const GROWN: f64 = 4.0;

/// So many times more may rows stand open before.
const WIDER: f64 = 1.5;

/// Of a factor, relative to the largest entry.
const ROUNDING: f64 = 10.0 * f64::EPSILON;

/// Times that F is applied to the first x at most.
const MOST_DROPS: usize = 6;

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
    pub(super) lower: f64,
    pub(super) upper: f64,
    /// How far rows stood open, the part of b that no x could reach, and that which was reckoned with.
    pub(super) open: f64,
    pub(super) unreached: f64,
    pub(super) reckoned: f64,
    pub(super) age: usize,
    /// τ as a part of the largest eigenvalue.
    pub(super) part: f64,
    pub(super) filter: Filter,
}

impl Gap {
    /// Takes note of how far rows stand open, eigenvalues of what is dropped growing as its square; tells whether τ has a place.
    pub(super) fn widen(&mut self, open: f64, least: f64, most: f64) -> bool {
        let wider = open > WIDER * self.open;
        if wider {
            self.lower *= (open / self.open).powi(2);
            self.open = open;
        }
        !(wider || self.unreached > self.reckoned) || self.place(least, most).is_some()
    }

    /// Places τ, at most `most` of the largest eigenvalue and at least `least`, where corrections and a filter that is good enough take
    /// fewest solves; `None` if none is.
    pub(super) fn place(&mut self, least: f64, most: f64) -> Option<()> {
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
    pub(super) fn drops(self) -> usize {
        let dropped = self.lower / self.part;
        let rounding = ROUNDING * self.lower.sqrt() / self.part.powi(2);
        (1..MOST_DROPS).find(|&drops| rounding * power(dropped, drops) <= NEGLIGIBLE).unwrap_or(MOST_DROPS)
    }

    /// The part of x that may come of what is dropped after some filters: an eigenvalue σ brings back σ/τ² times what is left in b, and no x is smaller than
    /// b over the largest.
    pub(super) fn comes_back(&self, filters: usize) -> f64 {
        let dropped = self.lower / self.part;
        dropped / self.part * power(self.filter.leak(dropped), filters) * self.unreached
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
        choose(self.dropped + self.kept - 1, self.kept) * power(2.0 * epsilon, self.kept)
    }

    /// What it has beside 0, at most, where F is within ε of 0.
    fn leak(self, epsilon: f64) -> f64 {
        choose(self.dropped + self.kept - 1, self.dropped) * power(epsilon, self.dropped)
    }
}

/// A whole power.
fn power(base: f64, exponent: usize) -> f64 {
    (0..exponent).map(|_| base).product()
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
            terms.map(|(i, c)| c * power(f, filter.dropped + i)).sum::<f64>()
        };
        for filter in [(1, 1), (2, 2), (1, 4), (3, 2), (4, 6)].map(|(kept, dropped)| Filter { kept, dropped })
        {
            for epsilon in [1e-1, 1e-2, 1e-3] {
                let (lost, left) = (1.0 - apply(filter, 1.0 + epsilon), apply(filter, -epsilon));
                let rounding = 1e-13;
                assert!(lost.abs() <= filter.loss(epsilon) + rounding, "{filter:?}, {epsilon}: {lost:e}");
                let leak = filter.leak(epsilon) * power(1.0 + epsilon, 3 * filter.kept);
                assert!(left.abs() <= leak + rounding, "{filter:?}, {epsilon}: {left:e}");
            }
        }
        let squares = Filter { kept: 2, dropped: 2 }.coefficients();
        assert!((squares[0] - 3.0).abs() < 1e-15 && (squares[1] + 2.0).abs() < 1e-15);
    }
}
