//! Products with small square matrices: fixed sizes up to 8 (unrolled, nalgebra), dynamic ones beyond (faer).
//!
//! Matrices are flat and column-major; sizes are checked by the callers, which own the workspace.

use faer::linalg::matmul::{matmul, triangular};
use faer::{Accum, MatMut, MatRef, Par};

/// From here on faer's kernels beat plain loops (measured: `make bench`).
pub(crate) const BLOCKED: usize = 24;

/// Runs kernels of faer and clears the upper halves of the vector registers after them, which some leave in use: on many
/// processors all older vector code of the process, MuJoCo's too, is slow until then (a decomposition of nalgebra's ×2 to ×3).
#[inline]
pub(crate) fn vectorised<R>(kernels: impl FnOnce() -> R) -> R {
    let result = kernels();
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        simd.avx._mm256_zeroupper();
    }
    result
}

/// Runs `work` as compiled for the processor's widest vectors, which never fuses or reorders a sum: the bits stay the same.
///
/// The closure must be `#[inline(always)]`, and so must be what it calls that is to be wide: code that is only called from
/// here is compiled for the oldest processor. It is taken as `FnMut`, for the shim that makes a `FnOnce` of it is a call too.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn widest<R>(work: impl FnMut() -> R) -> R {
    struct Wide<F>(F);
    impl<R, F: FnMut() -> R> pulp::WithSimd for Wide<F> {
        type Output = R;

        #[inline(always)]
        fn with_simd<S: pulp::Simd>(mut self, _: S) -> R {
            (self.0)()
        }
    }
    pulp::Arch::new().dispatch(Wide(work))
}

/// Calls a function generic in the size for sizes 1 to 8, and another for the rest.
macro_rules! by_size {
    ($n:expr, $($fixed:ident)::+($($arg:expr),*), $dynamic:expr) => {
        match $n {
            1 => $($fixed)::+::<1>($($arg),*),
            2 => $($fixed)::+::<2>($($arg),*),
            3 => $($fixed)::+::<3>($($arg),*),
            4 => $($fixed)::+::<4>($($arg),*),
            5 => $($fixed)::+::<5>($($arg),*),
            6 => $($fixed)::+::<6>($($arg),*),
            7 => $($fixed)::+::<7>($($arg),*),
            8 => $($fixed)::+::<8>($($arg),*),
            _ => $dynamic,
        }
    };
}
pub(crate) use by_size;

/// x · y.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// x · y, summed in four lanes: a chain of sums would wait for each.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn dot_in_lanes(x: &[f64], y: &[f64]) -> f64 {
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<4>(), y.as_chunks::<4>());
    let mut lanes = [0.0; 4];
    for (x, y) in x.iter().zip(y) {
        for (lane, (a, b)) in lanes.iter_mut().zip(x.iter().zip(y)) {
            *lane += a * b;
        }
    }
    (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]) + dot(x_rest, y_rest)
}

/// ‖x‖, summed in four lanes: a chain of sums would wait for each.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn norm(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<4>();
    let mut lanes = [0.0; 4];
    for chunk in chunks {
        for (lane, entry) in lanes.iter_mut().zip(chunk) {
            *lane += entry * entry;
        }
    }
    ((lanes[0] + lanes[2]) + (lanes[1] + lanes[3]) + dot(rest, rest)).sqrt()
}

/// Largest magnitude, which unlike the length neither overflows nor underflows; 0 of nothing.
#[inline]
pub(crate) fn largest(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<8>();
    let mut lanes = [0.0_f64; 8];
    for chunk in chunks {
        for (lane, entry) in lanes.iter_mut().zip(chunk) {
            *lane = lane.max(entry.abs());
        }
    }
    lanes.iter().chain(rest).fold(0.0, |largest, entry| largest.max(entry.abs()))
}

/// y += alpha x.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn axpy(alpha: f64, x: &[f64], y: &mut [f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += alpha * x;
    }
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn gemv_fixed<const N: usize>(a: &[f64], x: &[f64], y: &mut [f64]) {
    let (columns, _) = a.as_chunks::<N>();
    let mut sum = [0.0; N];
    for (column, factor) in columns.iter().zip(x) {
        for (entry, other) in sum.iter_mut().zip(column) {
            *entry += factor * other;
        }
    }
    y.copy_from_slice(&sum);
}

fn gemv_dynamic(a: &[f64], x: &[f64], y: &mut [f64]) {
    let n = x.len();
    if n >= BLOCKED {
        let a = MatRef::from_column_major_slice(a, n, n);
        let x = MatRef::from_column_major_slice(x, n, 1);
        let y = MatMut::from_column_major_slice_mut(y, n, 1);
        vectorised(|| matmul(y, Accum::Replace, a, x, 1.0, Par::Seq));
        return;
    }
    y.fill(0.0);
    for (column, &entry) in a.chunks_exact(n).zip(x) {
        axpy(entry, column, y);
    }
}

/// y = A x, A square of the size of x.
#[inline]
pub(crate) fn gemv(a: &[f64], x: &[f64], y: &mut [f64]) {
    by_size!(x.len(), gemv_fixed(a, x, y), gemv_dynamic(a, x, y));
}

/// W x of some columns of W, of a length of 1 to 8.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn combined_fixed<const N: usize>(w: &[f64], x: &[f64], out: &mut [f64]) {
    let (columns, _) = w.as_chunks::<N>();
    out.copy_from_slice(&combine_fixed(columns.iter().zip(x.iter().copied())));
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn combine_fixed<'a, const N: usize>(columns: impl Iterator<Item = (&'a [f64; N], f64)>) -> [f64; N] {
    let mut sum = [0.0; N];
    for (column, factor) in columns {
        for (entry, other) in sum.iter_mut().zip(column) {
            *entry += factor * other;
        }
    }
    sum
}

/// y = Wᵀ W x of columns W of a length of 1 to 8.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn normal_fixed<const N: usize>(w: &[f64], x: &[f64], y: &mut [f64]) {
    let (columns, _) = w.as_chunks::<N>();
    let image = combine_fixed(columns.iter().zip(x.iter().copied()));
    for (column, entry) in columns.iter().zip(y) {
        *entry = dot(column, &image);
    }
}

/// Hands over Wᵀ x, entry by entry, or the squares of the columns of W where there is no x; columns of a length of 1 to 8.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn products_fixed<const N: usize>(w: &[f64], x: Option<&[f64]>, mut take: impl FnMut(usize, f64)) {
    let (columns, _) = w.as_chunks::<N>();
    let x = x.and_then(|x| x.first_chunk::<N>());
    for (index, column) in columns.iter().enumerate() {
        take(index, dot(column, x.unwrap_or(column)));
    }
}

/// ‖W x‖ of some columns of W, of a length of 1 to 8.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn combined_norm_fixed<const N: usize>(w: &[f64], rows: &[usize], x: &[f64]) -> f64 {
    let (columns, _) = w.as_chunks::<N>();
    norm(&combine_fixed(rows.iter().map(|&row| (&columns[row], x[row]))))
}

fn rank_one_fixed<const N: usize>(alpha: f64, w: &[f64], a: &mut [f64]) {
    for col in 0..N {
        let scaled = alpha * w[col];
        for row in 0..N {
            a[col * N + row] += w[row] * scaled;
        }
    }
}

fn rank_one_dynamic(alpha: f64, w: &[f64], a: &mut [f64]) {
    for (column, &entry) in a.chunks_exact_mut(w.len()).zip(w) {
        axpy(alpha * entry, w, column);
    }
}

/// A += alpha w wᵀ.
#[inline]
pub(crate) fn rank_one(alpha: f64, w: &[f64], a: &mut [f64]) {
    by_size!(w.len(), rank_one_fixed(alpha, w, a), rank_one_dynamic(alpha, w, a));
}

fn rank_two_fixed<const N: usize>(alpha: f64, u: &[f64], v: &[f64], a: &mut [f64]) {
    let (columns, _) = a.as_chunks_mut::<N>();
    for (column, (u_entry, v_entry)) in columns.iter_mut().zip(u.iter().zip(v)) {
        let (of_u, of_v) = (alpha * v_entry, alpha * u_entry);
        for (entry, (u, v)) in column.iter_mut().zip(u.iter().zip(v)) {
            *entry = *entry + of_u * u + of_v * v;
        }
    }
}

fn rank_two_dynamic(alpha: f64, u: &[f64], v: &[f64], a: &mut [f64]) {
    for ((column, &u_entry), &v_entry) in a.chunks_exact_mut(u.len()).zip(u).zip(v) {
        axpy(alpha * v_entry, u, column);
        axpy(alpha * u_entry, v, column);
    }
}

/// A += alpha (u vᵀ + v uᵀ).
#[inline]
pub(crate) fn rank_two(alpha: f64, u: &[f64], v: &[f64], a: &mut [f64]) {
    by_size!(u.len(), rank_two_fixed(alpha, u, v, a), rank_two_dynamic(alpha, u, v, a));
}

/// Y = A X with A (`rows×inner`) and X (`inner×cols`); faer's kernels, which pay from a few columns on.
pub(crate) fn gemm(rows: usize, inner: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    let cols = x.len() / inner.max(1);
    vectorised(|| {
        matmul(
            MatMut::from_column_major_slice_mut(y, rows, cols),
            Accum::Replace,
            MatRef::from_column_major_slice(a, rows, inner),
            MatRef::from_column_major_slice(x, inner, cols),
            1.0,
            Par::Seq,
        );
    });
}

/// Y = A X with A (`n×n`) and X (`n×cols`), column by column or blocked.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn multiply(n: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    by_size!(n, multiply_fixed(a, x, y), multiply_dynamic(n, a, x, y));
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn multiply_fixed<const N: usize>(a: &[f64], x: &[f64], y: &mut [f64]) {
    for (x, y) in x.chunks_exact(N).zip(y.chunks_exact_mut(N)) {
        gemv_fixed::<N>(a, x, y);
    }
}

fn multiply_dynamic(n: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    if n >= BLOCKED && x.len() > 2 * n {
        gemm(n, n, a, x, y);
        return;
    }
    for (x, y) in x.chunks_exact(n).zip(y.chunks_exact_mut(n)) {
        gemv_dynamic(a, x, y);
    }
}

/// Y = Aᵀ X, `n×n` each.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn multiply_tr(n: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    by_size!(n, multiply_tr_fixed(a, x, y), multiply_tr_dynamic(n, a, x, y));
}

fn multiply_tr_dynamic(n: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    if n >= BLOCKED {
        gemm_tr(n, n, a, x, y);
        return;
    }
    for (x, y) in x.chunks_exact(n).zip(y.chunks_exact_mut(n)) {
        for (a, y) in a.chunks_exact(n).zip(y) {
            *y = dot(a, x);
        }
    }
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn multiply_tr_fixed<const N: usize>(a: &[f64], x: &[f64], y: &mut [f64]) {
    let mut transposed = [[0.0; N]; N];
    for (col, column) in a.chunks_exact(N).take(N).enumerate() {
        for (row, &entry) in column.iter().enumerate() {
            transposed[row][col] = entry;
        }
    }
    multiply_fixed::<N>(transposed.as_flattened(), x, y);
}

/// Y = Aᵀ X with A (`inner×rows`) and X (`inner×cols`).
pub(crate) fn gemm_tr(rows: usize, inner: usize, a: &[f64], x: &[f64], y: &mut [f64]) {
    let cols = x.len() / inner.max(1);
    vectorised(|| {
        matmul(
            MatMut::from_column_major_slice_mut(y, rows, cols),
            Accum::Replace,
            MatRef::from_column_major_slice(a, inner, rows).transpose(),
            MatRef::from_column_major_slice(x, inner, cols),
            1.0,
            Par::Seq,
        );
    });
}

/// A += alpha X Yᵀ with A (`n×n`), X and Y (`n×cols`).
pub(crate) fn gemm_outer(n: usize, alpha: f64, x: &[f64], y: &[f64], a: &mut [f64]) {
    let cols = x.len() / n.max(1);
    vectorised(|| {
        matmul(
            MatMut::from_column_major_slice_mut(a, n, n),
            Accum::Add,
            MatRef::from_column_major_slice(x, n, cols),
            MatRef::from_column_major_slice(y, n, cols).transpose(),
            alpha,
            Par::Seq,
        );
    });
}

/// `C = AᵀA` with A (`inner×n`).
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn gram(inner: usize, a: &[f64], c: &mut [f64]) {
    let n = a.len() / inner.max(1);
    by_size!(n, gram_fixed(inner, a, c), gram_dynamic(n, inner, a, c));
}

/// As a sum over the rows of A, whose length is known.
#[allow(clippy::inline_always)]
#[inline(always)]
fn gram_fixed<const N: usize>(inner: usize, a: &[f64], c: &mut [f64]) {
    let mut sum = [[0.0; N]; N];
    let columns: [&[f64]; N] = std::array::from_fn(|col| &a[col * inner..][..inner]);
    for k in 0..inner {
        let row = columns.map(|column| column[k]);
        for (column, factor) in sum.iter_mut().zip(row) {
            for (entry, other) in column.iter_mut().zip(row) {
                *entry += factor * other;
            }
        }
    }
    for (column, from) in c.chunks_exact_mut(N).zip(&sum) {
        column.copy_from_slice(from);
    }
}

/// The lower triangle, by faer's kernels from [`BLOCKED`] on, mirrored.
fn gram_dynamic(n: usize, inner: usize, a: &[f64], c: &mut [f64]) {
    if n < BLOCKED {
        for (col, left) in a.chunks_exact(inner).enumerate() {
            for (row, right) in a.chunks_exact(inner).enumerate().skip(col) {
                c[col * n + row] = dot(left, right);
            }
        }
    } else {
        let view = MatRef::from_column_major_slice(a, inner, n);
        vectorised(|| {
            triangular::matmul(
                MatMut::from_column_major_slice_mut(c, n, n),
                triangular::BlockStructure::TriangularLower,
                Accum::Replace,
                view.transpose(),
                triangular::BlockStructure::Rectangular,
                view,
                triangular::BlockStructure::Rectangular,
                1.0,
                Par::Seq,
            );
        });
    }
    for col in 0..n {
        for row in col + 1..n {
            c[row * n + col] = c[col * n + row];
        }
    }
}
