//! L D Lᵀ of sparse symmetric matrices of one pattern, without pivots (Davis, *Direct Methods for Sparse Linear Systems*, 2006, §4.8).
//!
//! The pattern, an order that keeps it sparse (AMD of faer) and where L has entries are found once. Pivots may be of either sign:
//! their signs are those of the eigenvalues, in number (Sylvester).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;

use crate::linalg::kernels::{axpy, dot_in_lanes, widest};

/// Where entries of a matrix of one pattern lie, and its factor.
#[derive(Debug, Clone, Default)]
pub(crate) struct SparseLdl {
    /// Place of each row and column in the order of elimination.
    places: Vec<u32>,
    /// Rows of the strict lower triangle of the reordered matrix.
    row_starts: Vec<usize>,
    row_columns: Vec<u32>,
    /// Its diagonal, then the entries of its rows.
    entries: Vec<f64>,
    /// Columns that each row of L has entries in, rising.
    fill_starts: Vec<usize>,
    fill: Vec<u32>,
    /// L by columns, and how far each column has come.
    starts: Vec<usize>,
    rows: Vec<u32>,
    factor: Vec<f64>,
    /// From where on the rows of each column follow one another: in what is nearly dense, all of them.
    tails: Vec<usize>,
    ends: Vec<usize>,
    /// D.
    pivots: Vec<f64>,
    inverses: Vec<f64>,
    work: Vec<f64>,
}

/// A place in an array as it is kept where there are many: half the memory of a `usize`.
#[allow(clippy::cast_possible_truncation)] // nobody has as many
pub(crate) fn short(number: usize) -> u32 {
    number as u32
}

impl SparseLdl {
    /// For matrices of `n` rows that are coupled as `pairs` say, each in either order and as often as they like.
    pub(crate) fn new(n: usize, pairs: &[(usize, usize)]) -> Self {
        let mut upper: Vec<(usize, usize)> =
            pairs.iter().filter(|(a, b)| a != b).map(|&(a, b)| (a.max(b), a.min(b))).collect();
        upper.sort_unstable();
        upper.dedup();
        let places = order(n, &upper);
        let mut lower: Vec<(usize, usize)> =
            upper.iter().map(|&(a, b)| (places[a].max(places[b]), places[a].min(places[b]))).collect();
        lower.sort_unstable();
        let (row_starts, columns) = compress(n, &lower);
        let mut found = Self {
            places: places.into_iter().map(short).collect(),
            row_starts,
            entries: vec![0.0; n + columns.len()],
            row_columns: columns.into_iter().map(short).collect(),
            pivots: vec![0.0; n],
            inverses: vec![0.0; n],
            work: vec![0.0; n],
            ..Self::default()
        };
        found.find_fill();
        found
    }

    /// Where L has entries: row k in the columns on the ways up the elimination tree from its entries (Liu 1986).
    fn find_fill(&mut self) {
        let n = self.places.len();
        let mut parents = vec![usize::MAX; n];
        let mut met = vec![usize::MAX; n];
        let mut counts = vec![0; n];
        self.fill_starts = vec![0];
        for row in 0..n {
            met[row] = row;
            let first = self.fill.len();
            for &column in &self.row_columns[self.row_starts[row]..self.row_starts[row + 1]] {
                let mut at = column as usize;
                while met[at] != row {
                    if parents[at] == usize::MAX {
                        parents[at] = row;
                    }
                    met[at] = row;
                    self.fill.push(short(at));
                    counts[at] += 1;
                    at = parents[at];
                }
            }
            self.fill[first..].sort_unstable();
            self.fill_starts.push(self.fill.len());
        }
        self.starts = vec![0];
        for count in counts {
            self.starts.push(self.starts[self.starts.len() - 1] + count);
        }
        self.rows = vec![0; self.fill.len()];
        self.factor = vec![0.0; self.fill.len()];
        self.ends = self.starts[..n].to_vec();
        for row in 0..n {
            for &column in &self.fill[self.fill_starts[row]..self.fill_starts[row + 1]] {
                let end = &mut self.ends[column as usize];
                self.rows[*end] = short(row);
                *end += 1;
            }
        }
        for column in self.starts.windows(2) {
            let mut tail = column[1];
            while tail > column[0]
                && self.rows[tail - 1] as usize + (column[1] - tail) == self.rows[column[1] - 1] as usize
            {
                tail -= 1;
            }
            self.tails.push(tail);
        }
    }

    /// Number of rows.
    pub(crate) fn len(&self) -> usize {
        self.places.len()
    }

    /// Place of a row in the order of elimination, in which vectors are handed over.
    pub(crate) fn place(&self, row: usize) -> usize {
        self.places[row] as usize
    }

    /// Multiplications of a factorisation.
    pub(crate) fn work(&self) -> usize {
        self.starts.windows(2).map(|pair| (pair[1] - pair[0]) * (pair[1] - pair[0] + 3) / 2).sum()
    }

    /// Entries of L below its diagonal.
    pub(crate) fn size(&self) -> usize {
        self.fill.len()
    }

    /// Where the entry of two rows that the pattern couples is kept, for [`entries_mut`](Self::entries_mut).
    pub(crate) fn home(&self, row: usize, column: usize) -> u32 {
        let (a, b) = (self.places[row], self.places[column]);
        let (row, column) = (a.max(b) as usize, a.min(b));
        if a == b {
            return a;
        }
        let range = self.row_starts[row]..self.row_starts[row + 1];
        let at = self.row_columns[range.clone()].binary_search(&column).unwrap_or(0);
        short(self.places.len() + range.start + at)
    }

    /// The entries of the matrix, by their homes. The diagonal comes first, in the order of elimination.
    pub(crate) fn entries_mut(&mut self) -> &mut [f64] {
        &mut self.entries
    }

    /// Factorises; false where a pivot is zero or no number.
    pub(crate) fn factorise(&mut self) -> bool {
        widest(
            #[inline(always)]
            || self.factorise_widely(),
        )
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn factorise_widely(&mut self) -> bool {
        let n = self.places.len();
        self.ends.copy_from_slice(&self.starts[..n]);
        self.work.fill(0.0);
        let (diagonal, entries) = self.entries.split_at(n);
        for (row, &entry) in diagonal.iter().enumerate() {
            let (mut pivot, own) = (entry, self.row_starts[row]..self.row_starts[row + 1]);
            for (&column, &entry) in self.row_columns[own.clone()].iter().zip(&entries[own]) {
                self.work[column as usize] = entry;
            }
            for &column in &self.fill[self.fill_starts[row]..self.fill_starts[row + 1]] {
                let column = column as usize;
                let entry = std::mem::take(&mut self.work[column]);
                let (start, end) = (self.starts[column], self.ends[column]);
                let tail = self.tails[column].min(end);
                for (&below, factor) in self.rows[start..tail].iter().zip(&self.factor[start..tail]) {
                    self.work[below as usize] -= factor * entry;
                }
                if tail < end {
                    let first = self.rows[tail] as usize;
                    axpy(-entry, &self.factor[tail..end], &mut self.work[first..first + end - tail]);
                }
                let scaled = entry * self.inverses[column];
                pivot -= scaled * entry;
                self.factor[end] = scaled;
                self.ends[column] = end + 1;
            }
            let inverse = pivot.recip();
            if !inverse.is_finite() || inverse == 0.0 {
                return false;
            }
            self.pivots[row] = pivot;
            self.inverses[row] = inverse;
        }
        true
    }

    /// D, in the order of elimination.
    pub(crate) fn pivots(&self) -> &[f64] {
        &self.pivots
    }

    /// Solves in place, in the order of elimination.
    pub(crate) fn solve(&self, x: &mut [f64]) {
        widest(
            #[inline(always)]
            || self.solve_widely(x),
        );
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn solve_widely(&self, x: &mut [f64]) {
        for (column, (range, &tail)) in self.starts.windows(2).zip(&self.tails).enumerate() {
            let (entry, start, end) = (x[column], range[0], range[1]);
            for (&row, factor) in self.rows[start..tail].iter().zip(&self.factor[start..tail]) {
                x[row as usize] -= factor * entry;
            }
            if tail < end {
                let first = self.rows[tail] as usize;
                axpy(-entry, &self.factor[tail..end], &mut x[first..first + end - tail]);
            }
        }
        for (column, (range, &tail)) in self.starts.windows(2).zip(&self.tails).enumerate().rev() {
            let (start, end) = (range[0], range[1]);
            let mut entry = x[column] * self.inverses[column];
            for (&row, factor) in self.rows[start..tail].iter().zip(&self.factor[start..tail]) {
                entry -= factor * x[row as usize];
            }
            if tail < end {
                let first = self.rows[tail] as usize;
                entry -= dot_in_lanes(&self.factor[tail..end], &x[first..first + end - tail]);
            }
            x[column] = entry;
        }
    }

    /// A bound of the largest eigenvalue: the largest sum of magnitudes of a row. `sums` has one entry a row.
    pub(crate) fn bound(&self, sums: &mut [f64]) -> f64 {
        let (diagonal, entries) = self.entries.split_at(self.places.len());
        sums.iter_mut().zip(diagonal).for_each(|(sum, entry)| *sum = entry.abs());
        for (row, range) in self.row_starts.windows(2).enumerate() {
            let range = range[0]..range[1];
            for (&column, entry) in self.row_columns[range.clone()].iter().zip(&entries[range]) {
                sums[row] += entry.abs();
                sums[column as usize] += entry.abs();
            }
        }
        sums.iter().fold(0.0, |most, &sum| if sum <= most { most } else { sum })
    }

    /// y = the matrix times x, in the order of elimination.
    pub(crate) fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let (diagonal, entries) = self.entries.split_at(self.places.len());
        for (row, range) in self.row_starts.windows(2).enumerate() {
            let (own, range) = (x[row], range[0]..range[1]);
            let mut sum = diagonal[row] * own;
            for (&column, entry) in self.row_columns[range.clone()].iter().zip(&entries[range]) {
                sum += entry * x[column as usize];
                y[column as usize] += entry * own;
            }
            y[row] = sum;
        }
    }
}

/// Starts and columns of rows, of sorted pairs (row, column).
fn compress(n: usize, pairs: &[(usize, usize)]) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0; n + 1];
    for &(row, _) in pairs {
        starts[row + 1] += 1;
    }
    for row in 0..n {
        starts[row + 1] += starts[row];
    }
    (starts, pairs.iter().map(|&(_, column)| column).collect())
}

/// Place of each row in an order of approximately least fill; `pairs` are sorted, (column, row above it).
fn order(n: usize, pairs: &[(usize, usize)]) -> Vec<usize> {
    let (starts, rows) = compress(n, pairs);
    let (mut order, mut places) = (vec![0; n], vec![0; n]);
    let mut scratch = MemBuffer::new(amd::order_scratch::<usize>(n, rows.len()));
    let pattern = SymbolicSparseColMatRef::new_checked(n, n, &starts, None, &rows);
    let stack = MemStack::new(&mut scratch);
    match amd::order(&mut order, &mut places, pattern, amd::Control::default(), stack) {
        Ok(_) => places,
        // Beyond the sizes that it counts in; any order is right.
        Err(_) => (0..n).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric matrix of both signs with a ring and a star in it.
    fn matrix(n: usize) -> Vec<(usize, usize, f64)> {
        let mut entries: Vec<_> =
            (0..n).map(|i| (i, i, if i % 3 == 0 { -3.0 - i as f64 } else { 4.0 + i as f64 })).collect();
        entries.extend((0..n).map(|i| (i, (i + 1) % n, 0.3 + 0.01 * i as f64)));
        entries.extend((2..n - 1).step_by(2).map(|i| (0, i, -0.2)));
        entries
    }

    #[test]
    fn solutions_solve_and_pivots_have_the_signs_of_the_eigenvalues() {
        for n in [4, 9, 30] {
            let entries = matrix(n);
            let pairs: Vec<_> = entries.iter().map(|&(a, b, _)| (a, b)).collect();
            let mut ldl = SparseLdl::new(n, &pairs);
            let mut dense = nalgebra::DMatrix::zeros(n, n);
            for &(a, b, value) in &entries {
                let home = ldl.home(a, b) as usize;
                ldl.entries_mut()[home] += value;
                dense[(a, b)] += value;
                if a != b {
                    dense[(b, a)] += value;
                }
            }
            assert!(ldl.factorise());
            let truth = nalgebra::DVector::from_fn(n, |i, _| 1.0 - 0.3 * i as f64);
            let rhs = &dense * &truth;
            let (mut x, mut product) = (vec![0.0; n], vec![0.0; n]);
            (0..n).for_each(|i| x[ldl.place(i)] = rhs[i]);
            ldl.solve(&mut x);
            ldl.multiply(&x, &mut product);
            for i in 0..n {
                assert!((x[ldl.place(i)] - truth[i]).abs() < 1e-12, "{n}: {i}");
                assert!((product[ldl.place(i)] - rhs[i]).abs() < 1e-12, "{n}: {i}");
            }
            let positive = |values: &[f64]| values.iter().filter(|value| **value > 0.0).count();
            assert_eq!(positive(ldl.pivots()), positive(dense.symmetric_eigenvalues().as_slice()));
        }
    }

    #[test]
    fn a_zero_pivot_is_no_factor() {
        let mut ldl = SparseLdl::new(2, &[(0, 1)]);
        ldl.entries_mut().fill(1.0);
        assert!(!ldl.factorise());
    }
}
