//! The null space of a step: N corrected, H improved on the way and projected.

use super::{CAUTION, Count, Lost, NULL_FLOOR, Tracked};
use crate::linalg::kernels::{
    BLOCKED, axpy, dot, gemm, gemm_outer, gemm_tr, gemv, multiply, norm, rank_one, rank_two,
};
use crate::problem::Problem;

/// Rounds of correction of N before a solve gives up and refreshes. Each contracts by ‖1 − H A‖, and finite termination
/// of SR1 promises the end after rank(A); beyond a handful an eigendecomposition is cheaper.
const ROUNDS: usize = 12;

/// Rounds of correction teach H only where they leave more than this part: where they go well, pairs are next to dependent,
/// and what H would learn from them is noise.
const WORTHWHILE: f64 = 1e-2;

/// A correction of N that leaves more than this part of the last one shows an H that cannot judge it.
const SLOW: f64 = 0.5;

impl Tracked {
    /// Corrects the extrapolated N, improving H on the way; gives a bound of its error.
    pub(super) fn track(
        &mut self,
        problem: &mut Problem<'_>,
        tolerance: f64,
        count: &mut Count,
    ) -> Result<f64, Lost> {
        let (n, d) = (self.x.len(), self.null.dim());
        if d == 0 {
            return Ok(0.0);
        }
        let trace = self.trace;
        let mut last = f64::INFINITY;
        for round in 0..ROUNDS {
            problem.apply_columns(self.null.basis(), &mut self.image, &mut self.scratch);
            multiply(n, &self.carried.inverse, &self.image, &mut self.correction);
            count.products += 2 * d;
            let size = norm(&self.correction);
            if size.is_nan() {
                return Err(Lost);
            }
            let rayleigh =
                self.null.columns().zip(self.image.chunks_exact(n)).map(|(v, image)| dot(v, image).abs());
            // Beyond what the error of N explains it is a dropped eigenvalue, or one that is no longer to be dropped.
            if size < 0.1 && rayleigh.fold(0.0, f64::max) > (self.explained + size * size) * trace {
                return Err(Lost);
            }
            if size > SLOW * last {
                return Err(Lost);
            }
            if round > 0 {
                self.saw_staleness(size, last);
                self.learn_from_rounds(WORTHWHILE * last);
            }
            if self.image_outside() > trace * (CAUTION * size + NULL_FLOOR + self.params.rank_cut) {
                return Err(Lost);
            }
            self.null.correct(&self.correction);
            let error = self.staleness * size;
            if error <= tolerance || size <= NULL_FLOOR {
                return if self.null.accept() { Ok(error) } else { Err(Lost) };
            }
            last = size;
            std::mem::swap(&mut self.image, &mut self.earlier);
        }
        Err(Lost)
    }

    /// ‖Π A N‖, at most ‖A‖ times the error of N and what the cut drops. If it is more than of the error that H sees, H is
    /// blind to a part.
    fn image_outside(&mut self) -> f64 {
        let mut squares = 0.0;
        for image in self.image.chunks_exact(self.x.len()) {
            self.y.copy_from_slice(image);
            self.null.project(&mut self.y);
            squares += dot(&self.y, &self.y);
        }
        squares.sqrt()
    }

    /// Whether N may be left as it was predicted: what it cuts off b, v, is null to `tolerance`, by ‖A⁺‖ ‖Π A v‖, a bound of its
    /// error whatever H has missed.
    pub(super) fn cuts_off_what_is_null(
        &mut self,
        problem: &mut Problem<'_>,
        tolerance: f64,
        inconsistency: f64,
        count: &mut Count,
    ) -> bool {
        if inconsistency <= self.params.rtol * norm(problem.rhs()) {
            return true;
        }
        for ((s, rhs), b) in self.s.iter_mut().zip(problem.rhs()).zip(&self.b) {
            *s = rhs - b;
        }
        problem.apply(&self.s, &mut self.y);
        count.products += 1;
        let curvature = dot(&self.s, &self.y) / (inconsistency * inconsistency);
        self.null.project(&mut self.y);
        let error = self.inverse_trace() * norm(&self.y) / inconsistency;
        error <= tolerance && curvature <= (self.explained + error * error) * self.trace
    }

    /// The pairs (C, A C) of the last correction: y = A N − A N', and w = C − H y = H A N', which is the new C.
    /// What is not longer than `least` is left alone.
    fn learn_from_rounds(&mut self, least: f64) {
        let n = self.x.len();
        for at in (0..self.correction.len()).step_by(n).map(|at| at..at + n) {
            for ((y, old), new) in
                self.y.iter_mut().zip(&self.earlier[at.clone()]).zip(&self.image[at.clone()])
            {
                *y = old - new;
            }
            // Earlier columns have changed H since the block product.
            gemv(&self.carried.inverse, &self.image[at.clone()], &mut self.hr);
            let (size, product) = (norm(&self.hr), dot(&self.hr, &self.y));
            if size > least && product.abs() > self.params.guard * size * norm(&self.y) {
                let along = dot(&self.hr, &self.image[at.clone()]) / product;
                rank_one(product.recip(), &self.hr, &mut self.carried.inverse);
                self.hr.iter_mut().for_each(|entry| *entry *= 1.0 + along);
            }
            self.correction[at].copy_from_slice(&self.hr);
        }
    }

    /// H ← Π H Π.
    pub(super) fn project_inverse(&mut self) {
        let (n, d) = (self.x.len(), self.null.dim());
        if n >= BLOCKED && d > 2 {
            let (basis, hn) = (self.null.basis(), &mut self.correction);
            gemm(n, n, &self.carried.inverse, basis, hn);
            gemm_tr(d, n, basis, hn, &mut self.gram);
            gemm(n, d, basis, &self.gram, &mut self.image);
            axpy(-0.5, &self.image, hn);
            gemm_outer(n, -1.0, basis, hn, &mut self.carried.inverse);
            gemm_outer(n, -1.0, hn, basis, &mut self.carried.inverse);
            return;
        }
        for column in self.null.columns() {
            gemv(&self.carried.inverse, column, &mut self.hr);
            // One column after another: each is orthogonal to the others, so Π is the product of their projectors.
            axpy(-0.5 * dot(column, &self.hr), column, &mut self.hr);
            rank_two(-1.0, column, &self.hr, &mut self.carried.inverse);
        }
    }
}
