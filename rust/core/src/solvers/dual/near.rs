//! Which eigenvalues of A lie below the cut, and their vectors, where a few of them are near it: on the way through a singular pose.
//!
//! Inertia counts them (Sylvester), and the method of Lanczos with A⁻¹ finds their vectors, for they are the largest of A⁻¹ and stand
//! apart. What both say is believed where they say the same.

use std::mem;

use crate::linalg::kernels::{axpy, dot, norm};
use crate::solvers::eigen::SymmetricEigen;

/// Steps of Lanczos, and room for as many vectors.
const STEPS: usize = 24;

/// Eigenvalues below the cut that are looked for at most: others take vectors of their own.
const MOST: usize = 8;

/// The largest eigenvalue is at most this many times what Lanczos finds, from below; that no one is larger, inertia says.
pub(super) const SLACK: f64 = 1.05;

/// Residual of an eigenpair of A⁻¹, relative to how far the eigenvalues that are dropped stand from those that are kept.
const FOUND: f64 = 1e-9;

/// Orthonormal vectors, what A or its inverse is on them, and the eigenvectors that are dropped.
#[derive(Clone)]
pub(super) struct Near {
    /// Vectors of Lanczos, one after another.
    basis: Vec<f64>,
    tridiagonal: Vec<f64>,
    eigen: SymmetricEigen,
    /// Eigenvectors of the eigenvalues below the cut, one after another.
    dropped: Vec<f64>,
    /// The largest of these eigenvalues, and the smallest that is kept.
    pub(super) largest_dropped: f64,
    pub(super) least_kept: f64,
}

impl Near {
    pub(super) fn new() -> Self {
        Self {
            basis: Vec::new(),
            tridiagonal: Vec::new(),
            eigen: SymmetricEigen::new(0),
            dropped: Vec::new(),
            largest_dropped: 0.0,
            least_kept: f64::INFINITY,
        }
    }

    /// Drops nothing.
    pub(super) fn drop_none(&mut self) {
        self.dropped.clear();
    }

    /// The largest eigenvalue of a matrix of n rows, from below.
    pub(super) fn largest(&mut self, n: usize, multiply: impl FnMut(&[f64], &mut [f64])) -> Option<f64> {
        self.span(n, multiply)?;
        Some(self.eigen.value(STEPS - 1))
    }

    /// Finds the eigenvectors of the `count` smallest eigenvalues of a matrix of n rows, all of them below `cut` and no others, from
    /// products with its inverse; tells whether it did.
    pub(super) fn find(
        &mut self,
        n: usize,
        (count, cut): (usize, f64),
        solve: impl FnMut(&[f64], &mut [f64]),
    ) -> Option<()> {
        self.dropped.clear();
        if count > MOST {
            return None;
        }
        let left = self.span(n, solve)?;
        let value = |place: usize| self.eigen.value(STEPS - 1 - place).recip();
        (self.largest_dropped, self.least_kept) = (value(count - 1), value(count));
        if !(self.largest_dropped < cut && self.least_kept > cut) {
            return None;
        }
        let apart = self.largest_dropped.recip() - self.least_kept.recip();
        for place in 0..=count {
            let vector = self.eigen.vector(STEPS - 1 - place);
            if left * vector[STEPS - 1].abs() > FOUND * apart {
                return None;
            }
            if place < count {
                let first = self.dropped.len();
                self.dropped.resize(first + n, 0.0);
                for (part, basis) in vector.iter().zip(self.basis.chunks_exact(n)) {
                    axpy(*part, basis, &mut self.dropped[first..]);
                }
            }
        }
        Some(())
    }

    /// v ← v without what is dropped; gives the norm of that.
    pub(super) fn project(&self, v: &mut [f64]) -> f64 {
        let mut square = 0.0;
        for vector in self.dropped.chunks_exact(v.len().max(1)) {
            let part = dot(vector, v);
            square += part * part;
            axpy(-part, vector, v);
        }
        square.sqrt()
    }

    /// Lanczos from rows that push one way or the other, as the bits of their numbers say, with vectors kept orthonormal; the eigenpairs
    /// of what it finds. Gives the norm of what the next vector would be.
    fn span(&mut self, n: usize, mut apply: impl FnMut(&[f64], &mut [f64])) -> Option<f64> {
        if n <= STEPS {
            return None;
        }
        if self.eigen.len() != STEPS {
            self.eigen = SymmetricEigen::new(STEPS);
            self.tridiagonal = vec![0.0; STEPS * STEPS];
        }
        self.basis.resize((STEPS + 1) * n, 0.0);
        let size = (n as f64).sqrt().recip();
        for (row, entry) in self.basis[..n].iter_mut().enumerate() {
            let forward = (row.wrapping_mul(0x9E37_79B9) >> 16) & 1 == 0;
            *entry = if forward { size } else { -size };
        }
        self.tridiagonal.fill(0.0);
        let mut left = 0.0;
        for step in 0..STEPS {
            let (basis, rest) = self.basis.split_at_mut((step + 1) * n);
            let (last, next) = (&basis[step * n..], &mut rest[..n]);
            apply(last, next);
            self.tridiagonal[step * (STEPS + 1)] = dot(last, next);
            // Twice is enough (Giraud, Langou and Rozložník 2005).
            for _ in 0..2 {
                for vector in basis.chunks_exact(n) {
                    axpy(-dot(vector, next), vector, next);
                }
            }
            left = norm(next);
            if !(left.is_finite() && left > f64::MIN_POSITIVE) {
                return None;
            }
            for entry in next.iter_mut() {
                *entry /= left;
            }
            if step + 1 < STEPS {
                self.tridiagonal[step * (STEPS + 1) + 1] = left;
                self.tridiagonal[(step + 1) * STEPS + step] = left;
            }
        }
        let tridiagonal = mem::take(&mut self.tridiagonal);
        let decomposed = self.eigen.decompose_alone(&tridiagonal, 0.0);
        self.tridiagonal = tridiagonal;
        decomposed.ok()?;
        (self.eigen.rank() == STEPS).then_some(left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 60;

    /// Two small eigenvalues below 1e-8, the others from 1e-7 to 2.
    fn value(at: usize) -> f64 {
        match at {
            0 => 1e-9,
            1 => 6e-9,
            _ => 1e-7 * 2e7_f64.powf((at - 2) as f64 / (N - 3) as f64),
        }
    }

    /// H diag(f) H v, H the reflection at a vector without zeros.
    fn apply(v: &[f64], image: &mut [f64], f: impl Fn(usize) -> f64) {
        let normal: Vec<f64> = (0..N).map(|at| 1.0 + (0.9 * at as f64).sin()).collect();
        let reflect = |v: &mut [f64]| axpy(-2.0 * dot(&normal, v) / dot(&normal, &normal), &normal, v);
        image.copy_from_slice(v);
        reflect(image);
        image.iter_mut().enumerate().for_each(|(at, entry)| *entry *= f(at));
        reflect(image);
    }

    #[test]
    fn what_lies_below_the_cut_is_found_and_taken_out() {
        let mut near = Near::new();
        let largest = near.largest(N, |v, image| apply(v, image, value)).expect("a largest one");
        assert!((2.0 / SLACK..=2.0 * (1.0 + 1e-12)).contains(&largest), "{largest}");
        near.find(N, (2, 1e-8), |v, image| apply(v, image, |at| value(at).recip())).expect("two of them");
        assert!((near.largest_dropped - 6e-9).abs() < 1e-14 && (near.least_kept - 1e-7).abs() < 1e-12);
        // Of a vector along both and a third one only that is left.
        let (mut v, mut left) = (vec![0.0; N], vec![0.0; N]);
        apply(&[1.0; N], &mut v, |at| if at < 3 { 1.0 } else { 0.0 });
        apply(&[1.0; N], &mut left, |at| if at == 2 { 1.0 } else { 0.0 });
        near.project(&mut v);
        axpy(-1.0, &left, &mut v);
        assert!(norm(&v) < 1e-7 * norm(&left), "{:e}", norm(&v));
    }

    #[test]
    fn counts_that_do_not_agree_are_no_answer() {
        let mut near = Near::new();
        let mut find =
            |count, cut| near.find(N, (count, cut), |v, image| apply(v, image, |at| value(at).recip()));
        assert!(find(1, 1e-8).is_none() && find(3, 1e-8).is_none() && find(2, 1e-6).is_none());
        assert!(find(MOST + 1, 1.0).is_none() && find(2, 1e-8).is_some());
    }
}
