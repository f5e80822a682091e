//! J of the equality rows as a dense matrix of one's own.

use std::ffi::c_int;

use super::{Data, array, size};

/// J, ne×nv, row-major, as it was last read.
#[derive(Debug, Default)]
pub struct Jacobian {
    entries: Vec<f64>,
    /// Where MuJoCo keeps it in compressed rows: their lengths, then their columns.
    pattern: Vec<c_int>,
}

impl Jacobian {
    /// Takes it from a data whose position stage is done.
    pub fn read(&mut self, data: &Data) {
        let (ne, nv) = (data.ne(), data.model().nv());
        let sparse = data.model().is_sparse();
        let count = if sparse { size(data.rows.njacobian) } else { ne * nv };
        // SAFETY: nJ is the number of entries of the array, dense or not, after constraints were made.
        let given = unsafe { array(data.rows.jacobian, count) };
        if !sparse {
            self.entries.clear();
            self.entries.extend_from_slice(given);
            return;
        }
        // SAFETY: rows of nefc, columns of nJ.
        let (counts, starts, columns) = unsafe {
            (array(data.rows.rownnz, ne), array(data.rows.rowadr, ne), array(data.rows.colind, count))
        };
        // Rows keep their columns from step to step: then what lies between them is zero already.
        if self.entries.len() != ne * nv
            || self.pattern.len() != ne + count
            || self.pattern[..ne] != *counts
            || self.pattern[ne..] != *columns
        {
            self.entries.clear();
            self.entries.resize(ne * nv, 0.0);
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
