//! Cholesky factors of E + B Bᵀ or E + Bᵀ B, in place; their eigenvalues are ≥ 1, so that no pivot vanishes.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{MatMut, Par, Spec};

use crate::linalg::kernels::{BLOCKED, axpy, dot_in_lanes, gemm_outer, gram, vectorised};

/// A factor and its workspace, which grows and never shrinks.
#[derive(Default)]
pub(super) struct Factor {
    size: usize,
    /// L in the lower triangle, column-major.
    matrix: Vec<f64>,
    scratch: Option<MemBuffer>,
    /// Size that the scratch memory was made for.
    room: usize,
}

impl Clone for Factor {
    /// A workspace of its own.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Factor {
    /// E + B Bᵀ of the `count` rows of B.
    pub(super) fn of_rows(&mut self, count: usize, b: &[f64]) {
        self.resize(count);
        if let Some(width) = b.len().checked_div(count) {
            gram(width, b, &mut self.matrix);
        }
        self.factorise();
    }

    /// E + Bᵀ B of the columns of B, whose rows have `width` entries.
    pub(super) fn of_columns(&mut self, width: usize, b: &[f64]) {
        self.resize(width);
        self.matrix.fill(0.0);
        if width >= BLOCKED {
            gemm_outer(width, 1.0, b, b, &mut self.matrix);
        } else {
            for row in b.chunks_exact(width.max(1)) {
                for (col, &entry) in row.iter().enumerate() {
                    axpy(entry, &row[col..], &mut self.matrix[col * width + col..(col + 1) * width]);
                }
            }
        }
        self.factorise();
    }

    fn resize(&mut self, size: usize) {
        self.size = size;
        self.matrix.resize(size * size, 0.0);
        if size >= BLOCKED && size > self.room {
            self.room = size.next_power_of_two();
            let scratch = llt::factor::cholesky_in_place_scratch::<f64>(self.room, Par::Seq, Spec::default());
            self.scratch = Some(MemBuffer::new(scratch));
        }
    }

    fn factorise(&mut self) {
        let n = self.size;
        (0..n).for_each(|i| self.matrix[i * n + i] += 1.0);
        if n >= BLOCKED
            && let Some(scratch) = &mut self.scratch
        {
            let view = MatMut::from_column_major_slice_mut(&mut self.matrix, n, n);
            let stack = MemStack::new(scratch);
            // Eigenvalues are at least 1: it cannot fail but by overflow, which shows in the solution.
            let _ = vectorised(|| {
                llt::factor::cholesky_in_place(
                    view,
                    llt::factor::LltRegularization::default(),
                    Par::Seq,
                    stack,
                    Spec::default(),
                )
            });
            return;
        }
        for col in 0..n {
            let (done, rest) = self.matrix.split_at_mut(col * n);
            let own = &mut rest[col..n];
            for earlier in done.chunks_exact(n) {
                axpy(-earlier[col], &earlier[col..], own);
            }
            // Rounding of large entries may leave less than the 1 that stands there.
            let inverse = own[0].max(f64::EPSILON).sqrt().recip();
            own.iter_mut().skip(1).for_each(|entry| *entry *= inverse);
            own[0] = inverse.recip();
        }
    }

    /// Solves in place.
    pub(super) fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        for col in 0..n {
            let own = &self.matrix[col * n..(col + 1) * n];
            let entry = x[col] / own[col];
            x[col] = entry;
            axpy(-entry, &own[col + 1..], &mut x[col + 1..]);
        }
        for col in (0..n).rev() {
            let own = &self.matrix[col * n..(col + 1) * n];
            x[col] = (x[col] - dot_in_lanes(&own[col + 1..], &x[col + 1..])) / own[col];
        }
    }
}
