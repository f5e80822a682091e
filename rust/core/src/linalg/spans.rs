//! Where the entries of sparse rows lie, and those of the matrix of their products.
//!
//! A row of J touches the velocities of its loop, a column of W = H Jᵀ those and their ancestors. Between the first and the
//! last of them a row is taken as full. Sums run in order, so that leaving zeros out at both ends does not change a bit; and
//! spans are exact at every step, so that what is computed depends on the step alone.

use crate::error::in_lanes;
use crate::linalg::kernels::{axpy, by_size, combined_fixed, dot, products_fixed, widest};
use crate::linalg::rows::SHORT;

/// An envelope is narrow when this many of it fit into the square of A: from there on it is faster than dense blocks.
const NARROW: usize = 6;

/// First and one past the last entry of each of some rows of one width.
#[derive(Debug, Clone, Default)]
pub(crate) struct Spans {
    width: usize,
    spans: Vec<(usize, usize)>,
}

impl Spans {
    /// Whether these are the spans of `n` rows, but for zeros at their ends, and all entries are finite.
    #[must_use]
    pub(crate) fn hold(&self, rows: &[f64], n: usize) -> bool {
        if self.spans.len() != n || rows.len() != n * self.width || self.width == 0 {
            return false;
        }
        if self.whole() {
            return rows.iter().fold(true, |finite, entry| finite & entry.is_finite());
        }
        // A pass over all of J, for which the processor's widest vectors are worth asking.
        widest(
            #[inline(always)]
            || self.hold_finite(rows),
        )
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn hold_finite(&self, rows: &[f64]) -> bool {
        let mut sum = 0.0;
        for (row, &(first, end)) in rows.chunks_exact(self.width).zip(&self.spans) {
            // What has no part in a sum is no number either.
            let beside = row[..first].iter().chain(&row[end..]);
            sum += beside.map(|entry| entry.abs()).sum::<f64>();
        }
        sum == 0.0 && in_lanes(rows, |entry| 0.0 * entry) == 0.0
    }

    /// Finds the spans; those that are `known` to hold are only trimmed. Whether they changed.
    pub(crate) fn update(&mut self, rows: &[f64], width: usize, known: bool) -> bool {
        let n = rows.len() / width;
        if !known && (self.width, self.spans.len()) != (width, n) {
            (self.width, self.spans) = (width, vec![(0, width); n]);
            self.update(rows, width, false);
            return true;
        }
        if self.whole() {
            return false;
        }
        let mut changed = false;
        for (span, row) in self.spans.iter_mut().zip(rows.chunks_exact(width)) {
            let (mut first, mut end) = if known { *span } else { (0, width) };
            while first < end && row[first] == 0.0 {
                first += 1;
            }
            while first < end && row[end - 1] == 0.0 {
                end -= 1;
            }
            changed |= *span != (first, end);
            *span = (first, end);
        }
        changed
    }

    /// Hands over the product of every row with a vector, or with itself without one.
    #[inline]
    pub(crate) fn products(&self, rows: &[f64], vector: Option<&[f64]>, mut take: impl FnMut(usize, f64)) {
        by_size!(
            self.width,
            products_fixed(rows, vector, take),
            for (index, row) in rows.chunks_exact(self.width.max(1)).enumerate() {
                let own = self.cut(index, row);
                take(index, dot(own, vector.map_or(own, |vector| self.cut(index, vector))));
            }
        );
    }

    /// `out` = the rows, each times its factor, summed.
    pub(crate) fn combine(&self, rows: &[f64], factors: &[f64], out: &mut [f64]) {
        by_size!(self.width, combined_fixed(rows, factors, out), self.combine_cut(rows, factors, out));
    }

    fn combine_cut(&self, rows: &[f64], factors: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (index, (row, &factor)) in rows.chunks_exact(self.width.max(1)).zip(factors).enumerate() {
            axpy(factor, self.cut(index, row), self.cut_mut(index, out));
        }
    }

    /// Whether rows are taken whole.
    #[must_use]
    pub(crate) const fn whole(&self) -> bool {
        self.width <= SHORT
    }

    /// First and one past the last entry of a row.
    #[must_use]
    pub(crate) fn of(&self, index: usize) -> (usize, usize) {
        self.spans[index]
    }

    /// The entries of a vector where a row has its own.
    #[must_use]
    pub(crate) fn cut<'a>(&self, index: usize, vector: &'a [f64]) -> &'a [f64] {
        let (first, end) = self.spans[index];
        &vector[first..end]
    }

    /// The same, to change.
    #[must_use]
    pub(crate) fn cut_mut<'a>(&self, index: usize, vector: &'a mut [f64]) -> &'a mut [f64] {
        let (first, end) = self.spans[index];
        &mut vector[first..end]
    }
}

/// For every row of a symmetric matrix, its first column that may hold an entry (its own at the latest).
#[derive(Debug, Clone, Default)]
pub(crate) struct Envelope {
    first: Vec<usize>,
    narrow: bool,
}

impl Envelope {
    /// That of A = `WᵀW`, from the spans of the `n` columns of W: products of columns that do not meet are zero.
    pub(crate) fn find(&mut self, spans: &Spans, n: usize) {
        self.first.clear();
        self.narrow = false;
        if n <= SHORT || spans.whole() {
            return;
        }
        let meet =
            |(first, end): (usize, usize), (other, until): (usize, usize)| first < until && other < end;
        let first = |row: usize| (0..row).find(|&col| meet(spans.of(row), spans.of(col))).unwrap_or(row);
        self.first.extend((0..n).map(first));
        let size: usize = self.first.iter().enumerate().map(|(row, first)| row - first).sum();
        self.narrow = NARROW * size <= n * n;
    }

    /// The first columns, if they leave most of the matrix out.
    #[must_use]
    pub(crate) fn narrow(&self) -> Option<&[usize]> {
        self.narrow.then_some(&self.first[..])
    }
}
