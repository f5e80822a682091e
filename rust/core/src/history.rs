//! What a quantity was in earlier steps, and where it goes from there: polynomial extrapolation.
//!
//! Newton's form, P(t) = Σ Dₖ ∏ (t − tᵢ) over i < k: what order k misses a new value by, over the node polynomial there, is the new
//! divided difference Dₖ₊₁. One pass judges all orders and renews all differences, without a sum over pairs of nodes.
//!
//! The order is chosen by how each would have done lately. Time is counted in steps, some of which may bring no new value;
//! where steps are not equal, as at the stages of a Runge–Kutta method, the lowest order wins by itself.

use crate::error::Error;
use crate::kernels::{axpy, norm};
use crate::solver::State;

/// Values kept at most.
pub const LONGEST: usize = 4;

/// The last values of a vector (or of a matrix, flat), as divided differences.
#[derive(Debug, Clone, Default)]
pub struct History {
    /// Dₖ = f[t₀, …, tₖ], t₀ the newest: each hangs on the last k + 1 values only.
    differences: [Vec<f64>; LONGEST],
    kept: usize,
    /// Values that are kept at most.
    most: usize,
    /// Steps from each value to the newest.
    ages: [f64; LONGEST],
    /// Steps since the newest value.
    ahead: f64,
    /// How far each order was off lately, and the node polynomial ∏ (t − tⱼ) where it was; 0 before it was tried.
    misses: [f64; LONGEST],
    nodes: [f64; LONGEST],
    work: Vec<f64>,
}

impl History {
    /// Of at most `most` values of at most `len` numbers.
    #[must_use]
    pub fn new(most: usize, len: usize) -> Self {
        let vector = || Vec::with_capacity(len);
        let differences = std::array::from_fn(|order| if order < most { vector() } else { Vec::new() });
        let most = most.min(LONGEST);
        Self { differences, most, work: vector(), ..Self::default() }
    }

    /// Forgets everything; values have `len` numbers from now on.
    pub fn restart(&mut self, len: usize) {
        self.kept = 0;
        self.ahead = 0.0;
        self.misses = [0.0; LONGEST];
        self.nodes = [0.0; LONGEST];
        self.work.resize(len, 0.0);
        self.differences[..self.most].iter_mut().for_each(|difference| difference.resize(len, 0.0));
    }

    /// Whether there is nothing to extrapolate from.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.kept == 0
    }

    /// Time goes on by one step.
    pub fn advance(&mut self) {
        self.ahead += 1.0;
    }

    /// The order that was best lately; ties go to the higher one, for after a restart all have missed by nothing.
    fn order(&self) -> usize {
        (0..self.kept).rev().fold(self.kept.saturating_sub(1), |best, order| {
            if self.misses[order] < self.misses[best] { order } else { best }
        })
    }

    /// ∏ (t − tⱼ) over the nodes of an order, to which the error of the extrapolation is proportional.
    fn node_polynomial(&self, order: usize) -> f64 {
        self.ages[..=order].iter().map(|age| self.ahead + age).product()
    }

    /// The value to be expected now; nothing without a past.
    pub fn predict(&self, out: &mut [f64]) {
        if self.kept == 0 {
            return;
        }
        out.copy_from_slice(&self.differences[0]);
        let mut nodes = 1.0;
        for order in 1..=self.order() {
            nodes *= self.ahead + self.ages[order - 1];
            axpy(nodes, &self.differences[order], out);
        }
    }

    /// How far off [`predict`](Self::predict) is to be expected, judging by the last value; infinite without a full past.
    #[must_use]
    pub fn expected_miss(&self) -> f64 {
        let order = self.order();
        if self.kept < self.most || self.nodes[order] == 0.0 {
            return f64::INFINITY;
        }
        self.misses[order] * self.node_polynomial(order) / self.nodes[order]
    }

    /// Takes the value of now, and sees how far each order missed it.
    pub fn push(&mut self, value: &[f64]) {
        if self.most == 0 {
            return;
        }
        // The difference that falls out makes room for the new value; the others move up by one before they are renewed.
        self.differences[..self.most].rotate_right(1);
        self.work.copy_from_slice(value);
        let mut nodes = 1.0;
        for order in 0..self.kept {
            let next = (order + 1) % self.most;
            axpy(-nodes, &self.differences[next], &mut self.work);
            nodes *= self.ahead + self.ages[order];
            self.misses[order] = norm(&self.work).max(0.5 * self.misses[order]).min(f64::MAX);
            self.nodes[order] = nodes;
            if next > 0 {
                let part = nodes.recip();
                for (difference, miss) in self.differences[next].iter_mut().zip(&self.work) {
                    *difference = part * miss;
                }
            }
        }
        self.differences[0].copy_from_slice(value);
        self.ages.rotate_right(1);
        self.ages.iter_mut().for_each(|age| *age += self.ahead);
        self.ages[0] = 0.0;
        self.ahead = 0.0;
        self.kept = (self.kept + 1).min(self.most);
    }

    /// Adds itself to a saved state, as two fields.
    #[must_use]
    pub fn save(&self, state: State, name: &str) -> State {
        let mut track = vec![self.kept as f64, self.ahead];
        for part in [&self.ages, &self.misses, &self.nodes] {
            track.extend_from_slice(part);
        }
        state.with(name, &self.differences[..self.kept].concat()).with(&format!("{name}_track"), &track)
    }

    /// Takes values of `len` numbers from a saved state, at least `least` of them.
    ///
    /// # Errors
    /// [`Error::State`] if the fields are not whole.
    pub fn load(
        &mut self,
        state: &State,
        name: &str,
        (len, least): (usize, usize),
        solver: &'static str,
    ) -> Result<(), Error> {
        let track_name = format!("{name}_track");
        state.check(solver, &[(&track_name, 2 + 3 * LONGEST)])?;
        let (head, parts) = state.field(&track_name).split_at(2);
        let kept = State::count(head[0], least..=self.most, solver)?;
        state.check(solver, &[(name, kept * len)])?;
        self.restart(len);
        self.kept = kept;
        self.ahead = head[1];
        for (part, saved) in
            [&mut self.ages, &mut self.misses, &mut self.nodes].into_iter().zip(parts.chunks_exact(LONGEST))
        {
            part.copy_from_slice(saved);
        }
        if len > 0 {
            for (difference, saved) in self.differences.iter_mut().zip(state.field(name).chunks_exact(len)) {
                difference.copy_from_slice(saved);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn push(history: &mut History, value: &[f64]) {
        history.advance();
        history.push(value);
    }

    #[test]
    fn a_polynomial_is_continued_by_the_order_that_it_needs_over_any_steps() {
        for degree in 0..4 {
            let value = |t: i32| [f64::from(t.pow(degree)), 1.0];
            let mut history = History::new(LONGEST, 2);
            history.restart(2);
            assert!(history.is_empty() && history.expected_miss().is_infinite());
            let mut next = [0.0; 2];
            // Values at 0, 1, 3, 6, 10, …
            let mut now = 0;
            for gap in 1..9 {
                push(&mut history, &value(now));
                (1..gap).for_each(|_| history.advance());
                now += gap;
            }
            history.advance();
            history.predict(&mut next);
            let [expected, one] = value(now);
            assert!(
                (next[0] - expected).abs() <= 1e-11 * expected && (next[1] - one).abs() < 1e-13,
                "{degree}"
            );
        }
    }

    #[test]
    fn the_expected_miss_of_the_next_power_is_its_miss() {
        let mut history = History::new(3, 1);
        history.restart(1);
        (0..7).for_each(|t| push(&mut history, &[f64::from(t).powi(3)]));
        for ahead in 1..5 {
            history.advance();
            let mut next = [0.0];
            history.predict(&mut next);
            let missed = (next[0] - f64::from(6 + ahead).powi(3)).abs();
            assert!((history.expected_miss() / missed - 1.0).abs() < 1e-10, "{ahead} ahead: {missed}");
        }
    }

    #[test]
    fn noise_is_met_with_the_lowest_order() {
        let mut history = History::new(LONGEST, 1);
        history.restart(1);
        let noise = [1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, -1.0, 1.0, 1.0];
        for value in noise {
            push(&mut history, &[value]);
        }
        history.advance();
        let mut next = [0.0];
        history.predict(&mut next);
        assert!((next[0] - 1.0).abs() < 1e-15, "the last value again, not {}", next[0]);
    }
}
