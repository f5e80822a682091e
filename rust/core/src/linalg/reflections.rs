//! Householder's reflections and Jacobi's rotations of small matrices, which are flat; sizes are checked by the callers.

use crate::linalg::kernels::{axpy, dot_in_lanes, norm};
use crate::linalg::packs::{self, Pack};

/// Rotations stop where rows are orthogonal to this, relative to their lengths.
const ORTHOGONAL: f64 = 1e-15;

/// Sweeps at most; rows that come from a pivoted factor take three or four.
const SWEEPS: usize = 40;

/// Makes of `v` the vector of E − v vᵀ which takes it to (r, 0 …); gives r. A zero vector stays one.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflector(v: &mut [f64]) -> f64 {
    let length = norm(v);
    if length == 0.0 {
        return 0.0;
    }
    let result = if v[0] > 0.0 { -length } else { length };
    v[0] -= result;
    // ‖v‖² = 2 r (r − v₀), without the sum.
    let scale = (-result * v[0]).sqrt().recip();
    for entry in v {
        *entry *= scale;
    }
    result
}

/// The same of packs that begin with zeros, as many as `lane`.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflector_of(v: &mut [Pack], lane: usize) -> f64 {
    let length = packs::product(v, v).sqrt();
    if length == 0.0 {
        return 0.0;
    }
    let first = v[0][lane];
    let result = if first > 0.0 { -length } else { length };
    v[0][lane] = first - result;
    let scale = (-result * (first - result)).sqrt().recip();
    for entry in v {
        *entry = entry.map(|entry| entry * scale);
    }
    result
}

/// x ← (E − v vᵀ) x.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflect(v: &[f64], x: &mut [f64]) {
    axpy(-dot_in_lanes(v, x), v, x);
}

/// Q R of a matrix (`rows×cols`, column-major, rows ≥ cols) in place, and `x` ← Qᵀ x. The upper triangle without its diagonal is R's,
/// which stands in `diagonal`.
pub(crate) fn triangularise(rows: usize, matrix: &mut [f64], diagonal: &mut Vec<f64>, x: &mut [f64]) {
    diagonal.clear();
    let cols = matrix.len() / rows.max(1);
    for col in 0..cols {
        let (own, rest) = matrix[col * rows..].split_at_mut(rows);
        let v = &mut own[col..];
        diagonal.push(reflector(v));
        for other in rest.chunks_exact_mut(rows) {
            reflect(v, &mut other[col..]);
        }
        reflect(v, &mut x[col..]);
    }
}

/// R x = x of such a factor; entries beside a zero of the diagonal become zero.
pub(crate) fn solve_upper(rows: usize, matrix: &[f64], diagonal: &[f64], x: &mut [f64]) {
    for col in (0..diagonal.len()).rev() {
        let entry = if diagonal[col] == 0.0 { 0.0 } else { x[col] / diagonal[col] };
        x[col] = entry;
        axpy(-entry, &matrix[col * rows..col * rows + col], &mut x[..col]);
    }
}

/// Rotates `count` rows of `width` until they are orthogonal, and those of `turns` (`count×count`) with them (Hestenes 1958). Their
/// lengths are singular values then.
pub(crate) fn orthogonalise(count: usize, width: usize, rows: &mut [f64], turns: &mut [f64]) {
    for _ in 0..SWEEPS {
        let mut settled = true;
        for second in 1..count {
            for first in 0..second {
                let (low, high) = rows.split_at_mut(second * width);
                let (p, q) = (&mut low[first * width..(first + 1) * width], &mut high[..width]);
                let (a, b, both) = (dot_in_lanes(p, p), dot_in_lanes(q, q), dot_in_lanes(p, q));
                if both.abs() <= ORTHOGONAL * (a * b).sqrt() {
                    continue;
                }
                settled = false;
                let zeta = (b - a) / (2.0 * both);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cosine = tangent.hypot(1.0).recip();
                rotate(p, q, cosine, cosine * tangent);
                let (low, high) = turns.split_at_mut(second * count);
                let (p, q) = (&mut low[first * count..(first + 1) * count], &mut high[..count]);
                rotate(p, q, cosine, cosine * tangent);
            }
        }
        if settled {
            return;
        }
    }
}

fn rotate(p: &mut [f64], q: &mut [f64], cosine: f64, sine: f64) {
    for (p, q) in p.iter_mut().zip(q) {
        (*p, *q) = (cosine * *p - sine * *q, sine * *p + cosine * *q);
    }
}
