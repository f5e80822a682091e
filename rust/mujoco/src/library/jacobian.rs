//! Rows of J as a dense matrix of one's own.

use std::ffi::c_int;
use std::ops::Range;

use super::{Data, array, size};

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
