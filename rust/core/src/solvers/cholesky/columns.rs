//! The factorisation and its triangles column by column: sizes for which blocks do not pay.
//!
//! Matrices are flat, column-major, of stride n; the lower triangle is read and written.

use super::found::{Asked, Found};
use crate::linalg::kernels::{axpy, dot};

/// `out` = Pᵀ v.
pub(super) fn permute(pivots: &[usize], v: &[f64], out: &mut [f64]) {
    for (entry, &pivot) in out.iter_mut().zip(pivots) {
        *entry = v[pivot];
    }
}

/// Pᵀ A P = L Lᵀ in place, column by column.
pub(super) fn factorise(n: usize, asked: Asked, a: &mut [f64], pivots: &mut [usize]) -> Found {
    for (index, pivot) in pivots.iter_mut().enumerate() {
        *pivot = index;
    }
    // Below n·ε a pivot is rounding, and dividing by it makes garbage of the rest.
    let rank_cut = asked.rank_cut.max(n as f64 * f64::EPSILON);
    let mut found = Found::full(n, 0.0);
    for col in 0..n {
        let mut best = col;
        for candidate in col + 1..n {
            if a[candidate * n + candidate] > a[best * n + best] {
                best = candidate;
            }
        }
        let pivot = a[best * n + best];
        if col == 0 {
            found.first = pivot;
        }
        if col == asked.ceiling || pivot <= rank_cut * found.first || pivot <= f64::MIN_POSITIVE {
            found.rank = col;
            found.dropped = pivot.max(0.0);
            found.lowest = (col..n).map(|i| a[i * n + i]).fold(f64::INFINITY, f64::min);
            break;
        }
        found.last = found.last.min(pivot);
        if best != col {
            swap(n, col, best, a);
            pivots.swap(col, best);
        }
        eliminate(n, col, pivot, a);
    }
    found
}

/// One column of L, and what it takes off the rest.
fn eliminate(n: usize, col: usize, pivot: f64, a: &mut [f64]) {
    let root = pivot.sqrt();
    let (left, right) = a.split_at_mut((col + 1) * n);
    let column = &mut left[col * n..];
    column[col] = root;
    let inverse = root.recip();
    for entry in &mut column[col + 1..] {
        *entry *= inverse;
    }
    for (offset, target) in right.chunks_exact_mut(n).enumerate() {
        let row = col + 1 + offset;
        axpy(-column[row], &column[row..], &mut target[row..]);
    }
}

/// Swaps rows and columns p < q of the matrix whose lower triangle is stored, with the rows of the part that is factored.
fn swap(n: usize, p: usize, q: usize, a: &mut [f64]) {
    for col in 0..p {
        a.swap(col * n + p, col * n + q);
    }
    a.swap(p * n + p, q * n + q);
    for i in p + 1..q {
        a.swap(p * n + i, i * n + q);
    }
    for row in q + 1..n {
        a.swap(p * n + row, q * n + row);
    }
}

/// B = C Cᵀ in place, lower triangle.
pub(super) fn factorise_definite(n: usize, b: &mut [f64]) {
    for col in 0..n {
        eliminate(n, col, b[col * n + col].max(f64::MIN_POSITIVE), b);
    }
}

/// L z = z, L with stride n and as many rows as z.
pub(super) fn forward(n: usize, l: &[f64], inverses: &[f64], z: &mut [f64]) {
    let rank = z.len();
    for col in 0..rank {
        let entry = z[col] * inverses[col];
        z[col] = entry;
        axpy(-entry, &l[col * n + col + 1..col * n + rank], &mut z[col + 1..rank]);
    }
}

/// Lᵀ z = z, L with stride n and as many rows as z.
pub(super) fn backward(n: usize, l: &[f64], inverses: &[f64], z: &mut [f64]) {
    let rank = z.len();
    for col in (0..rank).rev() {
        let below = dot(&l[col * n + col + 1..col * n + rank], &z[col + 1..rank]);
        z[col] = (z[col] - below) * inverses[col];
    }
}
