//! Rows of J as MuJoCo keeps them, beside M and its factor, and as a dense matrix of one's own.

use std::ffi::c_int;
use std::ops::Range;

use oarlock_core::{JacobianView, TreeView};

use super::{Data, array, size};
use crate::vectors::times;

/// Rows of J (`n×nv`, row-major) as they were last read.
#[derive(Debug, Default)]
pub struct Jacobian {
    entries: Vec<f64>,
    /// Where MuJoCo keeps it in compressed rows: their lengths, then their columns.
    pattern: Vec<c_int>,
}

impl Jacobian {
    /// Takes the equality rows (ne) from a data whose position stage is done.
    pub fn read(&mut self, data: &Data) {
        self.read_rows(data, 0..data.ne());
    }

    /// Takes the rows of limits, friction loss and contacts: those after the equality rows.
    pub fn read_inequalities(&mut self, data: &Data) {
        self.read_rows(data, data.ne()..data.nefc());
    }

    fn read_rows(&mut self, data: &Data, rows: Range<usize>) {
        let (n, nv) = (rows.len(), data.model().nv());
        let sparse = data.model().is_sparse();
        let count = if sparse { size(data.rows.njacobian) } else { rows.end * nv };
        // SAFETY: nJ is the number of entries of the array, dense or not, after constraints were made.
        let given = unsafe { array(data.rows.jacobian, count) };
        if !sparse {
            self.entries.clear();
            self.entries.extend_from_slice(&given[rows.start * nv..]);
            return;
        }
        // SAFETY: rows of nefc, columns of nJ.
        let (counts, starts, columns) = unsafe {
            (
                &array(data.rows.rownnz, rows.end)[rows.clone()],
                &array(data.rows.rowadr, rows.end)[rows],
                array(data.rows.colind, count),
            )
        };
        // Rows keep their columns from step to step: then what lies between them is zero already.
        if self.entries.len() != n * nv
            || self.pattern.len() != n + count
            || self.pattern[..n] != *counts
            || self.pattern[n..] != *columns
        {
            self.entries.clear();
            self.entries.resize(n * nv, 0.0);
            self.pattern.clear();
            self.pattern.extend_from_slice(counts);
            self.pattern.extend_from_slice(columns);
        }
        for (row, (&length, &start)) in self.entries.chunks_exact_mut(nv).zip(counts.iter().zip(starts)) {
            let range = size(start.into())..size(start.into()) + size(length.into());
            for (&column, &value) in columns[range.clone()].iter().zip(&given[range]) {
                row[size(column.into())] = value;
            }
        }
    }

    /// Its entries.
    #[must_use]
    pub fn entries(&self) -> &[f64] {
        &self.entries
    }
}

impl Data {
    /// Columns and entries of every row of J (nefc) of a model whose Jacobian is sparse, after constraints were made.
    pub(super) fn sparse_rows(&self) -> impl Iterator<Item = (&[c_int], &[f64])> {
        let (all, count) = (self.nefc(), size(self.rows.njacobian));
        // SAFETY: rows of nefc, columns and entries of nJ.
        let (lengths, starts, columns, values) = unsafe {
            (
                array(self.rows.rownnz, all),
                array(self.rows.rowadr, all),
                array(self.rows.colind, count),
                array(self.rows.jacobian, count),
            )
        };
        lengths.iter().zip(starts).map(move |(&length, &start)| {
            let range = size(start.into())..size(start.into()) + size(length.into());
            (&columns[range.clone()], &values[range])
        })
    }

    /// The equality rows of J (ne), as MuJoCo keeps them, at a state whose position stage is done.
    #[must_use]
    pub fn jacobian(&self) -> JacobianView<'_> {
        let (ne, nv) = (self.ne(), self.model().nv());
        if !self.model().is_sparse() {
            // SAFETY: nefc rows of nv entries, after constraints were made.
            return JacobianView::Dense(unsafe { array(self.rows.jacobian, ne * nv) });
        }
        let count = size(self.rows.njacobian);
        // SAFETY: rows of nefc, columns and entries of nJ.
        unsafe {
            JacobianView::Compressed {
                lengths: array(self.rows.rownnz, ne),
                starts: array(self.rows.rowadr, ne),
                columns: array(self.rows.colind, count),
                values: array(self.rows.jacobian, count),
            }
        }
    }

    /// M and its factor, at a state whose position stage is done.
    #[must_use]
    pub fn inertia(&self) -> TreeView<'_> {
        let (nv, view) = (self.model().nv(), &self.model().view);
        // SAFETY: the model's arrays of nv; those of nC end with the last row.
        unsafe {
            let (lengths, starts) = (array(view.mass_lengths, nv), array(view.mass_starts, nv));
            let end =
                lengths.last().zip(starts.last()).map_or(0, |(&count, &start)| size((count + start).into()));
            TreeView {
                lengths,
                starts,
                columns: array(view.mass_columns, end),
                mass: array(self.view.mass, end),
                factor: array(self.view.mass_factor, end),
                inverse_diagonal: self.inverse_diagonal(),
            }
        }
    }

    /// `product` (ne) = J `vector` (nv) of the equality rows.
    pub fn jacobian_times(&self, vector: &[f64], product: &mut [f64]) {
        match self.jacobian() {
            JacobianView::Dense(entries) => times(entries, vector, product),
            rows @ JacobianView::Compressed { .. } => {
                for (row, entry) in product.iter_mut().enumerate() {
                    let mut sum = -0.0;
                    rows.each(row, vector.len(), |column, value| sum += value * vector[column]);
                    *entry = sum;
                }
            }
        }
    }
}
