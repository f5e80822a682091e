//! The iteration itself: steps towards A x = b, and what H learns from them.

use super::{Count, Lost, Tracked};
use crate::linalg::kernels::{axpy, dot, gemv, norm, rank_one, rank_two};
use crate::problem::Problem;

/// A pair of which H misses no more than this part has nothing to teach: w is then mostly rounding.
const LEARNT: f64 = 1e-5;

impl Tracked {
    /// `hr` = Π H Π r for an r that is projected.
    pub(super) fn apply_inverse(&mut self) {
        gemv(&self.carried.inverse, &self.r, &mut self.hr);
        if !self.projected {
            self.null.project(&mut self.hr);
        }
    }

    /// `x` = H `rhs` with its residual, and the secant pair that it makes.
    pub(super) fn start(&mut self, problem: &mut Problem<'_>, rhs: &[f64], x: &mut [f64], count: &mut Count) {
        gemv(&self.carried.inverse, rhs, x);
        if !self.projected {
            self.null.project(x);
        }
        self.residual(problem, rhs, x);
        count.products += 2;
        self.s.copy_from_slice(x);
        self.y.copy_from_slice(&self.r);
        axpy(1.0, rhs, &mut self.y);
        self.paired = true;
    }

    fn residual(&mut self, problem: &mut Problem<'_>, rhs: &[f64], x: &[f64]) {
        problem.apply(x, &mut self.r);
        let off = |column| (dot(column, &self.r) - dot(column, problem.rhs())).powi(2);
        self.leak = self.null.columns().map(off).sum::<f64>().sqrt();
        axpy(-1.0, rhs, &mut self.r);
        self.null.project(&mut self.r);
    }

    /// Goes on from `x` and r until ‖r‖ ≤ `target` and the step that is left is small beside ‖x‖ (and beside `scale`);
    /// gives ‖r‖ before the last step, and the number of steps but the last.
    pub(super) fn iterate(
        &mut self,
        problem: &mut Problem<'_>,
        (rhs, target): (&[f64], f64),
        (x, scale): (&mut [f64], f64),
        count: &mut Count,
    ) -> Result<(f64, usize), Lost> {
        let flat = self.params.rank_cut * self.trace;
        let mut steps = 0;
        loop {
            let r_norm = norm(&self.r);
            if !r_norm.is_finite() {
                return Err(Lost);
            }
            self.apply_inverse();
            count.products += 1;
            if self.paired {
                self.update(count);
            }
            axpy(-1.0, &self.hr, x);
            let left = self.staleness * norm(&self.hr);
            if r_norm <= target && (left <= self.params.rtol * norm(x).max(scale) || r_norm == 0.0) {
                return Ok((r_norm, steps));
            }
            if steps == self.params.max_iterations {
                return Err(Lost);
            }
            for (s, hr) in self.s.iter_mut().zip(&self.hr) {
                *s = -hr;
            }
            self.y.copy_from_slice(&self.r);
            self.residual(problem, rhs, x);
            count.products += 1;
            for (y, r) in self.y.iter_mut().zip(&self.r) {
                *y = r - *y;
            }
            // No curvature along a direction in range(H): the rank has dropped.
            if dot(&self.s, &self.y) <= flat * dot(&self.s, &self.s) {
                return Err(Lost);
            }
            self.paired = true;
            steps += 1;
        }
    }

    /// Improves H by the pair (s, y), for which s − H y = −H r, and makes hr = H r again.
    fn update(&mut self, count: &mut Count) {
        let (size, step) = (norm(&self.hr), norm(&self.s));
        self.saw_staleness(size, step);
        if size <= LEARNT * step {
            return;
        }
        let product = -dot(&self.hr, &self.y);
        if product.abs() > self.params.guard * size * norm(&self.y) {
            let along = dot(&self.hr, &self.r) / product;
            rank_one(product.recip(), &self.hr, &mut self.carried.inverse);
            self.hr.iter_mut().for_each(|entry| *entry *= 1.0 + along);
        } else {
            count.fallbacks += 1;
            self.bfgs();
            self.apply_inverse();
            count.products += 1;
        }
    }

    /// H += (1 + yᵀHy ρ) ρ s sᵀ − ρ (H y sᵀ + s yᵀ H), ρ = 1/(sᵀ y), with H y = hr + s.
    fn bfgs(&mut self) {
        let product = dot(&self.s, &self.y);
        if product <= f64::EPSILON * norm(&self.s) * norm(&self.y) {
            return;
        }
        axpy(1.0, &self.s, &mut self.hr);
        let rho = product.recip();
        let curvature = dot(&self.y, &self.hr);
        rank_one((1.0 + curvature * rho) * rho, &self.s, &mut self.carried.inverse);
        rank_two(-rho, &self.hr, &self.s, &mut self.carried.inverse);
    }
}
