//! Factors L D Lᵀ of E + B Bᵀ or E + Bᵀ B, in place; their eigenvalues are ≥ 1, so that no pivot vanishes.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{MatMut, Par, Spec};

use crate::linalg::kernels::{BLOCKED, axpy, by_size, gemm_outer, gram, vectorised, widest};
use crate::linalg::packs::{self, LANES, Pack};

/// A factor and its workspace, which grows and never shrinks.
#[derive(Default)]
pub(super) struct Factor {
    size: usize,
    /// See [`factor`].
    matrix: Vec<f64>,
    /// B row after row.
    rows: Vec<f64>,
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
    /// E + B Bᵀ of the first `count` rows of B, `width` packs each four.
    pub(super) fn of_rows(&mut self, count: usize, width: usize, b: &[Pack]) {
        self.resize(count);
        if width == 0 {
            self.matrix.fill(0.0);
        } else if count > 0 {
            self.spread(count, width, b);
            gram(width, &self.rows, &mut self.matrix);
        }
        self.factorise();
    }

    /// E + Bᵀ B of the columns of B.
    pub(super) fn of_columns(&mut self, width: usize, b: &[Pack]) {
        self.resize(width);
        if width >= BLOCKED {
            self.spread(b.len() / width * LANES, width, b);
            self.matrix.fill(0.0);
            gemm_outer(width, 1.0, &self.rows, &self.rows, &mut self.matrix);
        } else {
            let matrix = &mut self.matrix;
            widest(
                #[inline(always)]
                || by_size!(width, squares_fixed(b, matrix), squares(width, b, matrix)),
            );
        }
        self.factorise();
    }

    /// Puts rows one after another.
    fn spread(&mut self, count: usize, width: usize, b: &[Pack]) {
        self.rows.clear();
        for row in 0..count {
            let own = &b[row / LANES * width..][..width];
            self.rows.extend(own.iter().map(|pack| pack[row % LANES]));
        }
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
            for (col, own) in self.matrix.chunks_exact_mut(n).enumerate() {
                let inverse = own[col].recip();
                own[col + 1..].iter_mut().for_each(|entry| *entry *= inverse);
                own[col] = inverse * inverse;
            }
            mirror(n, &mut self.matrix);
            return;
        }
        let matrix = &mut self.matrix;
        widest(
            #[inline(always)]
            || by_size!(n, factor_fixed(matrix), factor(n, matrix)),
        );
    }

    /// Solves in place.
    pub(super) fn solve(&self, x: &mut [f64]) {
        let (n, matrix) = (self.size, &self.matrix);
        widest(
            #[inline(always)]
            || by_size!(n, solve_fixed(matrix, x), solve(n, matrix, x)),
        );
    }
}

/// Products of the columns of B from its packs, those of the lower triangle.
#[allow(clippy::inline_always)]
#[inline(always)]
fn squares(width: usize, b: &[Pack], matrix: &mut [f64]) {
    for col in 0..width {
        for row in col..width {
            let mut sum = packs::NONE;
            for own in b.chunks_exact(width) {
                packs::add_product(&own[col], &own[row], &mut sum);
            }
            matrix[col * width + row] = packs::total(&sum);
        }
    }
}

/// L D Lᵀ of a positive definite matrix, column-major: L below the diagonal, Lᵀ above it, and 1/D on it.
#[allow(clippy::inline_always)]
#[inline(always)]
fn factor(n: usize, matrix: &mut [f64]) {
    for col in 0..n {
        let (done, rest) = matrix.split_at_mut((col + 1) * n);
        let own = &mut done[col * n + col..];
        // Rounding of large entries may leave less than the 1 that stands there.
        let inverse = own[0].max(f64::EPSILON).recip();
        for (index, other) in rest.chunks_exact_mut(n).enumerate() {
            let below = &own[index + 1..];
            axpy(-below[0] * inverse, below, &mut other[col + index + 1..]);
        }
        own.iter_mut().skip(1).for_each(|entry| *entry *= inverse);
        own[0] = inverse;
    }
    mirror(n, matrix);
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn mirror(n: usize, matrix: &mut [f64]) {
    for col in 1..n {
        for row in 0..col {
            matrix[col * n + row] = matrix[row * n + col];
        }
    }
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn solve(n: usize, matrix: &[f64], x: &mut [f64]) {
    for col in 0..n {
        let own = &matrix[col * n..(col + 1) * n];
        let entry = x[col];
        axpy(-entry, &own[col + 1..], &mut x[col + 1..]);
    }
    for col in 0..n {
        x[col] *= matrix[col * n + col];
    }
    for col in (1..n).rev() {
        let own = &matrix[col * n..(col + 1) * n];
        let entry = x[col];
        axpy(-entry, &own[..col], &mut x[..col]);
    }
}

// The same of sizes that are known: loops of a few entries are unrolled.

#[allow(clippy::inline_always)]
#[inline(always)]
fn squares_fixed<const N: usize>(b: &[Pack], matrix: &mut [f64]) {
    let (rows, _) = b.as_chunks::<N>();
    for (col, column) in matrix.chunks_exact_mut(N).enumerate() {
        // Whole columns: their sums stay in registers.
        let mut sums = [packs::NONE; N];
        for own in rows {
            for (sum, row) in sums.iter_mut().zip(own) {
                packs::add_product(&own[col], row, sum);
            }
        }
        column.iter_mut().zip(&sums).for_each(|(entry, sum)| *entry = packs::total(sum));
    }
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn factor_fixed<const N: usize>(matrix: &mut [f64]) {
    let (columns, _) = matrix.as_chunks_mut::<N>();
    let columns = &mut columns[..N];
    for col in 0..N {
        let (own, others) = columns[col..].split_at_mut(1);
        let own = &mut own[0];
        // Rounding of large entries may leave less than the 1 that stands there.
        let inverse = own[col].max(f64::EPSILON).recip();
        let scaled = own.map(|entry| entry * inverse);
        // Whole columns, which are vectors: what stands above the diagonal is written anew in the end.
        for (other, &entry) in others.iter_mut().zip(&own[col + 1..]) {
            other.iter_mut().zip(&scaled).for_each(|(other, scaled)| *other -= entry * scaled);
        }
        *own = scaled;
        own[col] = inverse;
    }
    mirror(N, &mut matrix[..N * N]);
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn solve_fixed<const N: usize>(matrix: &[f64], x: &mut [f64]) {
    solve(N, &matrix[..N * N], &mut x[..N]);
}
