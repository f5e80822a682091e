//! Symmetric matrices with a narrow envelope, by rows (Jennings 1966): L of A = L D Lᵀ fills no more than the envelope of A.
//!
//! Matrices are flat, n×n. Row i of the lower triangle is read and written at `i * n`, from its first column `first[i]` on.

use crate::linalg::kernels::{axpy, dot};

/// A is clearly of full rank when its eigenvalues exceed this many times the rank cut.
const CLEAR: f64 = 16.0;

/// A x = x where A is clearly of full rank; gives the largest diagonal entry of A, of which `cut` is a part. `l` and
/// `inverses` are workspace of its size.
///
/// It is of full rank when A − τE has a factor, τ = 16 `cut` max Aᵢᵢ. Its eigenvalues are larger than τ then, and so is every
/// pivot in any order, the reciprocal of a diagonal entry of the inverse of a part of A: with complete pivoting none falls
/// below the cut. The pivots of A in the order of its rows would not tell: a chain with pivots of 1 can be singular.
pub(crate) fn solve_regular(
    first: &[usize],
    cut: f64,
    a: &[f64],
    l: &mut [f64],
    inverses: &mut [f64],
    x: &mut [f64],
) -> Option<f64> {
    let n = first.len();
    let largest = (0..n).fold(0.0_f64, |largest, i| largest.max(a[i * n + i]));
    for shift in [CLEAR * cut * largest, 0.0] {
        for (row, &start) in first.iter().enumerate() {
            let range = row * n + start..=row * n + row;
            l[range.clone()].copy_from_slice(&a[range]);
        }
        factorise(first, shift, l, inverses)?;
    }
    solve(first, l, inverses, x);
    Some(largest)
}

/// L of A − `shift` E in place, without its unit diagonal, and 1/D. `None` where a pivot is not positive.
fn factorise(first: &[usize], shift: f64, a: &mut [f64], inverses: &mut [f64]) -> Option<()> {
    let n = first.len();
    for (row, &start) in first.iter().enumerate() {
        let (above, rest) = a.split_at_mut(row * n);
        let own = &mut rest[..=row];
        // L D first, which the columns to come need.
        for col in start..row {
            let from = start.max(first[col]);
            own[col] -= dot(&own[from..col], &above[col * n + from..col * n + col]);
        }
        let mut pivot = own[row] - shift;
        for (entry, inverse) in own[start..row].iter_mut().zip(&inverses[start..row]) {
            let scaled = *entry * inverse;
            pivot -= scaled * *entry;
            *entry = scaled;
        }
        if pivot.is_nan() || pivot <= f64::MIN_POSITIVE {
            return None;
        }
        inverses[row] = pivot.recip();
    }
    Some(())
}

/// L D Lᵀ x = x.
fn solve(first: &[usize], l: &[f64], inverses: &[f64], x: &mut [f64]) {
    let n = first.len();
    for (row, &start) in first.iter().enumerate() {
        x[row] -= dot(&l[row * n + start..row * n + row], &x[start..row]);
    }
    for (entry, inverse) in x.iter_mut().zip(inverses) {
        *entry *= inverse;
    }
    for (row, &start) in first.iter().enumerate().rev() {
        axpy(-x[row], &l[row * n + start..row * n + row], &mut x[start..row]);
    }
}

/// y = A x.
pub(crate) fn product(first: &[usize], a: &[f64], x: &[f64], y: &mut [f64]) {
    let n = first.len();
    for (row, &start) in first.iter().enumerate() {
        let own = &a[row * n + start..=row * n + row];
        y[row] = dot(own, &x[start..=row]);
        axpy(x[row], &own[..row - start], &mut y[start..row]);
    }
}
