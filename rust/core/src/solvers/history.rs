//! What a quantity was in earlier steps, and where it goes from there: polynomial extrapolation.
//!
//! Newton's form, P(t) = Σ Dₖ ∏ (t − tᵢ) over i < k: what order k misses a new value by, over the node polynomial there, is the new
//! divided difference Dₖ₊₁. One pass judges all orders and renews all differences, without a sum over pairs of nodes.
//!
//! The order is chosen by how each would have done lately. Time is counted in steps, some of which may bring no new value;
//! where steps are not equal, as at the stages of a Runge–Kutta method, the lowest order wins by itself.

use crate::error::Error;
use crate::solvers::solver::State;

/// Values kept at most.
pub(crate) const LONGEST: usize = 5;

/// Entries that are worked on together: vectors are filled up with zeros to whole ones.
const LANES: usize = 4;

/// The last values of a vector (or of a matrix, flat), as divided differences.
#[derive(Debug, Clone, Default)]
pub(crate) struct History {
    /// Dₖ = f[t₀, …, tₖ], t₀ the newest, of a few entries after another: each hangs on the last k + 1 values only.
    differences: Vec<[[f64; LANES]; LONGEST]>,
    /// Length of a value.
    len: usize,
    kept: usize,
    /// Values that are kept at most.
    most: usize,
    /// Steps from each value to the newest.
    ages: [f64; LONGEST],
    /// Steps since the newest value.
    ahead: f64,
    /// How far each order was off lately, squared, and the node polynomial ∏ (t − tⱼ) where it was; 0 before it was tried.
    misses: [f64; LONGEST],
    nodes: [f64; LONGEST],
}

impl History {
    /// Of at most `most` values of at most `len` numbers.
    #[must_use]
    pub(crate) fn new(most: usize, len: usize) -> Self {
        let most = most.min(LONGEST);
        let room = if most == 0 { 0 } else { len.div_ceil(LANES) };
        Self { differences: Vec::with_capacity(room), most, ..Self::default() }
    }

    /// Forgets everything; values have `len` numbers from now on.
    pub(crate) fn restart(&mut self, len: usize) {
        self.kept = 0;
        self.ahead = 0.0;
        self.misses = [0.0; LONGEST];
        self.nodes = [0.0; LONGEST];
        self.len = len;
        self.differences.clear();
        if self.most > 0 {
            self.differences.resize(len.div_ceil(LANES), Default::default());
        }
    }

    /// Whether there is nothing to extrapolate from.
    #[must_use]
    pub(crate) const fn is_empty(&self) -> bool {
        self.kept == 0
    }

    /// Time goes on by one step.
    pub(crate) fn advance(&mut self) {
        self.ahead += 1.0;
    }

    /// The order that was best lately; ties go to the higher one, for after a restart all have missed by nothing.
    fn order(&self) -> usize {
        (0..self.kept).rev().fold(self.kept.saturating_sub(1), |best, order| {
            if self.misses[order] < self.misses[best] { order } else { best }
        })
    }

    /// ∏ (t − tⱼ) over the nodes before each order, and over its own too, to which the error of its extrapolation is
    /// proportional.
    fn node_polynomials(&self) -> [f64; LONGEST + 1] {
        let mut nodes = [1.0; LONGEST + 1];
        for (order, age) in self.ages.iter().enumerate() {
            nodes[order + 1] = nodes[order] * (self.ahead + age);
        }
        nodes
    }

    /// The value to be expected now; nothing without a past.
    pub(crate) fn predict(&self, out: &mut [f64]) {
        if self.kept == 0 {
            return;
        }
        let nodes = self.node_polynomials();
        match self.order() {
            0 => self.extrapolate::<0>(&nodes, out),
            1 => self.extrapolate::<1>(&nodes, out),
            2 => self.extrapolate::<2>(&nodes, out),
            3 => self.extrapolate::<3>(&nodes, out),
            _ => self.extrapolate::<4>(&nodes, out),
        }
    }

    /// The same by an order that is known, as [`renew`](Self::renew).
    fn extrapolate<const ORDER: usize>(&self, nodes: &[f64; LONGEST + 1], out: &mut [f64]) {
        let value = |differences: &[[f64; LANES]; LONGEST]| {
            let mut value = differences[0];
            for order in 1..=ORDER {
                for (entry, difference) in value.iter_mut().zip(differences[order]) {
                    *entry += nodes[order] * difference;
                }
            }
            value
        };
        let (chunks, rest) = out.as_chunks_mut();
        for (chunk, differences) in chunks.iter_mut().zip(&self.differences) {
            *chunk = value(differences);
        }
        if let Some(differences) = self.differences.get(chunks.len()) {
            rest.copy_from_slice(&value(differences)[..rest.len()]);
        }
    }

    /// How far off [`predict`](Self::predict) is to be expected, judging by the last value; infinite without a full past.
    #[must_use]
    pub(crate) fn expected_miss(&self) -> f64 {
        let order = self.order();
        if self.kept < self.most || self.nodes[order] == 0.0 {
            return f64::INFINITY;
        }
        self.misses[order].sqrt() * self.node_polynomials()[order + 1] / self.nodes[order]
    }

    /// Takes the value of now, and sees how far each order missed it.
    pub(crate) fn push(&mut self, value: &[f64]) {
        if self.most == 0 {
            return;
        }
        debug_assert_eq!(value.len(), self.len, "a value of another length");
        let nodes = self.node_polynomials();
        let squares = match self.kept {
            0 => self.renew::<0>(value, &nodes),
            1 => self.renew::<1>(value, &nodes),
            2 => self.renew::<2>(value, &nodes),
            3 => self.renew::<3>(value, &nodes),
            4 => self.renew::<4>(value, &nodes),
            _ => self.renew::<LONGEST>(value, &nodes),
        };
        let (kept, most) = (self.kept, self.most);
        for order in 0..kept {
            let [a, b, c, d] = squares[order];
            self.misses[order] = ((a + c) + (b + d)).max(0.25 * self.misses[order]).min(f64::MAX);
            self.nodes[order] = nodes[order + 1];
        }
        self.ages.rotate_right(1);
        self.ages.iter_mut().for_each(|age| *age += self.ahead);
        self.ages[0] = 0.0;
        self.ahead = 0.0;
        self.kept = (kept + 1).min(most);
    }

    /// Renews all differences; gives the squares of how far the `KEPT` orders missed the value. One pass, in which a few entries
    /// go through all orders, whose number is known, without leaving the registers.
    fn renew<const KEPT: usize>(
        &mut self,
        value: &[f64],
        nodes: &[f64; LONGEST + 1],
    ) -> [[f64; LANES]; LONGEST] {
        let parts: [f64; LONGEST] = std::array::from_fn(|order| nodes[order + 1].recip());
        let mut squares = [[0.0; LANES]; LONGEST];
        let more = KEPT < self.most;
        for (differences, chunk) in self.differences.iter_mut().zip(value.chunks(LANES)) {
            let mut miss = *chunk.first_chunk().unwrap_or(&[0.0; LANES]);
            if chunk.len() < LANES {
                miss[..chunk.len()].copy_from_slice(chunk);
            }
            let mut renewed = miss;
            for order in 0..KEPT {
                for lane in 0..LANES {
                    miss[lane] -= nodes[order] * differences[order][lane];
                    squares[order][lane] += miss[lane] * miss[lane];
                }
                differences[order] = renewed;
                renewed = miss.map(|miss| parts[order] * miss);
            }
            if more && KEPT < LONGEST {
                differences[KEPT] = renewed;
            }
        }
        squares
    }

    /// Adds itself to a saved state, as two fields.
    #[must_use]
    pub(crate) fn save(&self, state: State, name: &str) -> State {
        let mut track = vec![self.kept as f64, self.ahead];
        for part in [&self.ages, &self.misses, &self.nodes] {
            track.extend_from_slice(part);
        }
        let mut values = Vec::with_capacity(self.kept * self.len);
        for order in 0..self.kept {
            values.extend(self.differences.iter().flat_map(|differences| differences[order]).take(self.len));
        }
        state.with(name, &values).with(&format!("{name}_track"), &track)
    }

    /// Takes values of `len` numbers from a saved state, at least `least` of them.
    ///
    /// # Errors
    /// [`Error::State`] if the fields are not whole.
    pub(crate) fn load(
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
        for (index, &saved) in state.field(name).iter().enumerate() {
            let (order, entry) = (index / len, index % len);
            self.differences[entry / LANES][order][entry % LANES] = saved;
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
        for degree in 0..5 {
            // Seven numbers: more than are worked on together, and not a multiple of them.
            let value =
                |t: i32| std::array::from_fn::<_, 7, _>(|i| i as f64 * f64::from(t.pow(degree)) + 1.0);
            let mut history = History::new(LONGEST, 7);
            history.restart(7);
            assert!(history.is_empty() && history.expected_miss().is_infinite());
            let mut next = [0.0; 7];
            // Values at 0, 1, 3, 6, 10, …
            let mut now = 0;
            for gap in 1..9 {
                push(&mut history, &value(now));
                (1..gap).for_each(|_| history.advance());
                now += gap;
            }
            history.advance();
            history.predict(&mut next);
            for (next, expected) in next.iter().zip(value(now)) {
                assert!((next - expected).abs() <= 1e-11 * expected, "{degree}: {next}, not {expected}");
            }
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
