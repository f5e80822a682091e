//! Rows of one width of which only a pattern is kept: J of a mechanism with many loops.
//!
//! Rows of up to [`SHORT`] entries are whole. Of others the pattern is that of compressed rows as they are given, and of dense ones it
//! grows where an entry appears that was zero before. It never shrinks: what is built on it stands until [`SparseRows::generation`] changes. Sums run in the order of the columns, so
//! that zeros in the pattern change no bit.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, are_finite, check_len};
use crate::linalg::kernels::{by_size, combined_fixed, largest, products_fixed};

/// Up to this length rows are taken whole: looking for zeros costs more than they do.
pub(crate) const SHORT: usize = 8;

/// Columns of a whole row.
const COLUMNS: [usize; SHORT] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Where an entry goes that is not kept.
const NOWHERE: usize = usize::MAX;

/// Numbers of patterns: no two in a process are the same.
static GENERATIONS: AtomicU64 = AtomicU64::new(1);

/// A number that nothing in this process was given before.
pub(crate) fn fresh_generation() -> u64 {
    GENERATIONS.fetch_add(1, Ordering::Relaxed)
}

/// Rows as somebody has them, row after row: dense, or compressed as MuJoCo keeps them.
#[derive(Debug, Clone, Copy)]
pub enum JacobianView<'a> {
    /// All entries (`n×nv`, row-major).
    Dense(&'a [f64]),
    /// The entries that may not be zero.
    Compressed {
        /// Number of entries of each row (`n`).
        lengths: &'a [i32],
        /// Where each row begins in `columns` and `values` (`n`).
        starts: &'a [i32],
        /// Column of each entry, rising along a row.
        columns: &'a [i32],
        /// The entries.
        values: &'a [f64],
    },
}

/// Somebody's number as a size; a negative one is beyond every array.
pub(crate) fn size(number: i32) -> usize {
    usize::try_from(number).unwrap_or(usize::MAX)
}

impl JacobianView<'_> {
    /// The entries of a row in `columns` and `values`, or in the dense array.
    fn range(&self, row: usize, width: usize) -> Range<usize> {
        match self {
            Self::Dense(_) => row * width..(row + 1) * width,
            Self::Compressed { lengths, starts, .. } => {
                let start = size(starts[row]);
                start..start + size(lengths[row])
            }
        }
    }

    /// The entry with a place in the arrays, with its column.
    fn entry(&self, place: usize, first: usize) -> (usize, f64) {
        match self {
            Self::Dense(values) => (place - first, values[place]),
            Self::Compressed { columns, values, .. } => (size(columns[place]), values[place]),
        }
    }

    /// Hands over column and value of every entry of a row of `width`.
    #[inline]
    pub fn each(&self, row: usize, width: usize, mut take: impl FnMut(usize, f64)) {
        let range = self.range(row, width);
        match self {
            Self::Dense(values) => {
                values[range].iter().enumerate().for_each(|(column, &value)| take(column, value));
            }
            Self::Compressed { columns, values, .. } => {
                let entries = columns[range.clone()].iter().zip(&values[range]);
                entries.for_each(|(&column, &value)| take(size(column), value));
            }
        }
    }

    /// Checks that there are `n` rows of `width` entries, and that compressed ones lie within their arrays, columns rising.
    pub(crate) fn check(&self, n: usize, width: usize) -> Result<(), Error> {
        match self {
            Self::Dense(values) => check_len("jacobian", values.len(), &[n, width]),
            Self::Compressed { lengths, starts, columns, values } => {
                check_len("jacobian rows", lengths.len(), &[n])?;
                check_len("jacobian rows", starts.len(), &[n])?;
                let mut end = 0;
                for (&length, &start) in lengths.iter().zip(*starts) {
                    let (first, length) = (size(start), size(length));
                    if first != end || length > columns.len().min(values.len()).saturating_sub(end) {
                        return Err(Error::Pattern { what: "jacobian" });
                    }
                    end += length;
                    let own = &columns[first..end];
                    let rising = own.windows(2).all(|pair| pair[0] < pair[1]);
                    if !rising || own.iter().any(|&column| size(column) >= width) {
                        return Err(Error::Pattern { what: "jacobian" });
                    }
                }
                Ok(())
            }
        }
    }

    /// Refuses entries that are not finite; the rows have been checked.
    pub(crate) fn check_finite(&self, n: usize, width: usize) -> Result<(), Error> {
        let end = (0..n).next_back().map_or(0, |last| self.range(last, width).end);
        let (Self::Dense(values) | Self::Compressed { values, .. }) = self;
        if are_finite(&values[..end]) {
            return Ok(());
        }
        let found = (0..n).find_map(|row| {
            let mut entries = self.row(row, width);
            entries.find(|(_, value)| !value.is_finite()).map(|(column, value)| (row * width + column, value))
        });
        let (index, value) = found.unwrap_or((0, f64::NAN));
        Err(Error::NonFinite { what: "jacobian", index, value })
    }

    /// Column and value of every entry of a row of `width`.
    pub fn row(&self, row: usize, width: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let range = self.range(row, width);
        let first = range.start;
        range.map(move |place| self.entry(place, first))
    }
}

/// Rows as they were last taken.
#[derive(Debug, Clone, Default)]
pub(crate) struct SparseRows {
    width: usize,
    /// Where each row begins; one past the last at the end. Of whole rows there is nothing.
    starts: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    most: f64,
    count: usize,
    /// The pattern of what was last given in compressed rows, and where every entry that was given has gone.
    lengths: Vec<i32>,
    given: Vec<i32>,
    homes: Vec<usize>,
    /// Where every entry that is kept comes from, and whether all come in order.
    places: Vec<usize>,
    straight: bool,
    generation: u64,
}

impl SparseRows {
    /// Rows of a dense matrix (`width` columns, row-major).
    pub(crate) fn of(rows: &[f64], width: usize) -> Self {
        let mut taken = Self::default();
        taken.take(&JacobianView::Dense(rows), false, rows.len().checked_div(width).unwrap_or(0), width);
        taken
    }

    /// Takes `n` rows of `width` entries; what is kept of rows of other sizes is forgotten. `known`: they are laid out as the last
    /// ones.
    pub(crate) fn take(&mut self, given: &JacobianView<'_>, known: bool, n: usize, width: usize) {
        if (self.count, self.width) != (n, width) {
            *self = Self { width, count: n, ..Self::default() };
            self.starts.resize(n + 1, 0);
            self.renumber();
        }
        if self.whole() {
            self.take_whole(given);
        } else if !(known && self.refill(given)) {
            self.grow(given);
        }
        self.most = largest(&self.values);
    }

    fn renumber(&mut self) {
        self.generation = fresh_generation();
    }

    fn take_whole(&mut self, given: &JacobianView<'_>) {
        self.values.resize(self.count * self.width, 0.0);
        match given {
            JacobianView::Dense(values) => self.values.copy_from_slice(values),
            JacobianView::Compressed { .. } => {
                self.values.fill(0.0);
                for (row, entries) in self.values.chunks_exact_mut(self.width.max(1)).enumerate() {
                    given.row(row, self.width).for_each(|(column, value)| entries[column] = value);
                }
            }
        }
    }

    /// Whether `n` rows of `width` entries are laid out as what was last given.
    pub(crate) fn knows(&self, given: &JacobianView<'_>, n: usize, width: usize) -> bool {
        if (self.count, self.width) != (n, width) || self.whole() {
            return false;
        }
        match given {
            JacobianView::Dense(values) => self.lengths.is_empty() && self.homes.len() == values.len(),
            JacobianView::Compressed { lengths, starts, columns, .. } => {
                if self.lengths.len() != lengths.len() || self.lengths != *lengths {
                    return false;
                }
                // As MuJoCo keeps them, without gaps.
                let end = lengths.last().zip(starts.last()).map_or(0, |(count, start)| size(start + count));
                self.given.len() == end && columns.len() >= end && self.given[..] == columns[..end]
            }
        }
    }

    /// Fills the pattern in; false where something that it leaves out is not zero.
    fn refill(&mut self, given: &JacobianView<'_>) -> bool {
        let (JacobianView::Dense(values) | JacobianView::Compressed { values, .. }) = given;
        if let (true, Some(values)) = (self.straight, values.get(..self.values.len())) {
            self.values.copy_from_slice(values);
            return true;
        }
        for (entry, &place) in self.values.iter_mut().zip(&self.places) {
            *entry = values.get(place).copied().unwrap_or(0.0);
        }
        let count = |values: &[f64]| values.iter().map(|value| u64::from(*value != 0.0)).sum::<u64>();
        count(&values[..self.homes.len().min(values.len())]) == count(&self.values)
    }

    /// Adds what is not zero to the pattern, and fills it in.
    #[cold]
    fn grow(&mut self, given: &JacobianView<'_>) {
        let (before, known) = (std::mem::take(&mut self.columns), std::mem::take(&mut self.starts));
        self.values.clear();
        self.homes.clear();
        self.starts.push(0);
        let mut row_columns = Vec::new();
        for row in 0..self.count {
            row_columns.clear();
            row_columns.extend_from_slice(&before[known[row]..known[row + 1]]);
            let sparse = matches!(given, JacobianView::Compressed { .. });
            let kept = given.row(row, self.width).filter(|(_, value)| sparse || *value != 0.0);
            row_columns.extend(kept.map(|(column, _)| column));
            row_columns.sort_unstable();
            row_columns.dedup();
            self.columns.extend_from_slice(&row_columns);
            self.starts.push(self.columns.len());
        }
        self.values.resize(self.columns.len(), 0.0);
        for row in 0..self.count {
            let range = given.range(row, self.width);
            // What lies between rows goes nowhere.
            self.homes.resize(range.start.max(self.homes.len()), NOWHERE);
            let own = &self.columns[self.starts[row]..self.starts[row + 1]];
            for (column, value) in given.row(row, self.width) {
                let home = own.binary_search(&column).map_or(NOWHERE, |at| self.starts[row] + at);
                if home != NOWHERE {
                    self.values[home] = value;
                }
                self.homes.push(home);
            }
        }
        self.places.clear();
        self.places.resize(self.columns.len(), NOWHERE);
        for (place, &home) in self.homes.iter().enumerate() {
            if home != NOWHERE {
                self.places[home] = place;
            }
        }
        let in_order = self.places.iter().enumerate().all(|(at, &place)| at == place);
        self.straight = in_order && self.homes.len() == self.places.len();
        self.lengths.clear();
        self.given.clear();
        if let JacobianView::Compressed { lengths, columns, .. } = given {
            self.lengths.extend_from_slice(lengths);
            self.given.extend_from_slice(&columns[..self.homes.len().min(columns.len())]);
        }
        if self.columns != before || self.starts != known {
            self.renumber();
        }
    }

    /// A number that no other pattern has.
    pub(crate) const fn generation(&self) -> u64 {
        self.generation
    }

    /// Number of rows.
    pub(crate) const fn len(&self) -> usize {
        self.count
    }

    /// Number of columns.
    pub(crate) const fn width(&self) -> usize {
        self.width
    }

    /// Whether rows are kept whole.
    pub(crate) const fn whole(&self) -> bool {
        self.width <= SHORT
    }

    /// The largest magnitude of an entry.
    pub(crate) const fn most(&self) -> f64 {
        self.most
    }

    /// Columns and entries of a row.
    #[inline]
    pub(crate) fn row(&self, row: usize) -> (&[usize], &[f64]) {
        if self.whole() {
            return (&COLUMNS[..self.width], &self.values[row * self.width..(row + 1) * self.width]);
        }
        let range = self.starts[row]..self.starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Hands over the product of every row with a vector.
    #[inline]
    pub(crate) fn products(&self, vector: &[f64], mut take: impl FnMut(usize, f64)) {
        by_size!(
            self.width,
            products_fixed(&self.values, Some(vector), take),
            for (row, range) in self.starts.windows(2).enumerate() {
                let range = range[0]..range[1];
                let entries = self.columns[range.clone()].iter().zip(&self.values[range]);
                take(row, entries.map(|(&column, value)| value * vector[column]).sum());
            }
        );
    }

    /// `out` = the rows, each times its factor, summed.
    pub(crate) fn combine(&self, factors: &[f64], out: &mut [f64]) {
        by_size!(self.width, combined_fixed(&self.values, factors, out), self.combine_sparse(factors, out));
    }

    fn combine_sparse(&self, factors: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        for (&factor, range) in factors.iter().zip(self.starts.windows(2)) {
            let range = range[0]..range[1];
            for (&column, value) in self.columns[range.clone()].iter().zip(&self.values[range]) {
                out[column] += factor * value;
            }
        }
    }

    /// `out` = `scale` times a row.
    pub(crate) fn scatter(&self, row: usize, scale: f64, out: &mut [f64]) {
        out.fill(0.0);
        let (columns, values) = self.row(row);
        for (&column, value) in columns.iter().zip(values) {
            out[column] = scale * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 10;

    fn dense(entries: &[(usize, usize, f64)], n: usize) -> Vec<f64> {
        let mut rows = vec![0.0; n * WIDTH];
        for &(row, column, value) in entries {
            rows[row * WIDTH + column] = value;
        }
        rows
    }

    #[test]
    fn a_pattern_grows_and_is_renumbered_then_and_only_then() {
        let mut rows = SparseRows::of(&dense(&[(0, 1, 2.0), (1, 9, 3.0)], 2), WIDTH);
        let first = rows.generation();
        assert_eq!(rows.row(0), (&[1][..], &[2.0][..]));
        let later = dense(&[(1, 9, 4.0)], 2);
        let later = JacobianView::Dense(&later);
        assert!(rows.knows(&later, 2, WIDTH) && !rows.knows(&later, 2, WIDTH + 1));
        rows.take(&later, true, 2, WIDTH);
        assert_eq!((rows.row(0), rows.generation()), ((&[1][..], &[0.0][..]), first));
        rows.take(&JacobianView::Dense(&dense(&[(0, 5, 7.0), (1, 9, 4.0)], 2)), true, 2, WIDTH);
        assert_eq!(rows.row(0), (&[1, 5][..], &[0.0, 7.0][..]));
        assert_ne!(rows.generation(), first);
    }

    #[test]
    fn compressed_rows_are_the_same_as_dense_ones() {
        let entries = [(0, 1, 2.0), (0, 4, 0.0), (1, 0, -1.0), (1, 9, 3.0)];
        let view = JacobianView::Compressed {
            lengths: &[2, 2],
            starts: &[0, 2],
            columns: &[1, 4, 0, 9],
            values: &[2.0, 0.0, -1.0, 3.0],
        };
        let mut rows = SparseRows::default();
        rows.take(&view, false, 2, WIDTH);
        let other = SparseRows::of(&dense(&entries, 2), WIDTH);
        assert_eq!((rows.row(0), rows.row(1)), ((&[1, 4][..], &[2.0, 0.0][..]), other.row(1)));
        let generation = rows.generation();
        rows.take(&view, rows.knows(&view, 2, WIDTH), 2, WIDTH);
        assert_eq!(rows.generation(), generation);
        let mut product = [0.0; 2];
        let vector: Vec<f64> = (0..10).map(f64::from).collect();
        rows.products(&vector, |row, value| product[row] = value);
        // Small whole numbers: there is nothing to round.
        assert!(
            product.iter().zip([2, 27]).all(|(got, expected)| got.to_bits() == f64::from(expected).to_bits())
        );
        let mut sum = [0.0; WIDTH];
        rows.combine(&[1.0, 2.0], &mut sum);
        let expected = dense(&[(0, 0, -2.0), (0, 1, 2.0), (0, 9, 6.0)], 1);
        assert!(sum.iter().zip(expected).all(|(got, expected)| (got - expected).abs() < 1e-300));
    }
}
