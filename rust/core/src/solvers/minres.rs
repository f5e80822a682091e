//! MINRES (C. C. Paige and M. A. Saunders, "Solution of sparse indefinite systems of linear equations", SIAM J. Numer.
//! Anal. 12 (1975) 617–629), in the frame of [`krylov`](crate::solvers::krylov).
//!
//! ```text
//!     A V = V⁺ T       Lanczos: V orthonormal from r₀ / ‖r₀‖, T tridiagonal, one row longer than wide
//!     T = Q R          a rotation a column; ‖r‖ is multiplied by its sine
//!     x += φ w         W = V R⁻¹, by a recurrence of three terms; φ the rotated ‖r₀‖
//! ```
//!
//! x minimises ‖b − A x‖ over x₀ + K, so ‖r‖ never rises. One product an iteration.

use std::mem;

use crate::linalg::kernels::{axpy, dot, norm};
use crate::problem::Problem;
use crate::solvers::krylov::{End, Goal, Method, Space};

/// Minimum residuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Minres;

impl Method for Minres {
    const NAME: &'static str = "minres";
    const SUMMARY: &'static str = "MINRES, from the last solution";

    fn run(
        space: &mut Space,
        problem: &mut Problem<'_>,
        x: &mut [f64],
        r: &mut [f64],
        goal: &mut Goal,
    ) -> End {
        let [v, v_old, image, w, w_old] = space;
        let mut residual = norm(r);
        for ((v, v_old), r) in v.iter_mut().zip(v_old.iter_mut()).zip(&*r) {
            (*v, *v_old) = (r / residual, 0.0);
        }
        w.fill(0.0);
        w_old.fill(0.0);
        // The last column of T that the rotations so far have touched: its entry left to rotate, and the one above.
        let (mut beta, mut cosine, mut sine) = (0.0, -1.0, 0.0);
        let (mut pending, mut above) = (0.0, 0.0);
        loop {
            if residual <= goal.tolerance {
                return End::Claimed;
            }
            if goal.left == 0 {
                return End::Limit;
            }
            // Lanczos: A v = β⁺ v⁺ + α v + β v_old.
            problem.apply(v, image);
            goal.left -= 1;
            let stretched = norm(image);
            if !stretched.is_finite() {
                return End::Stuck;
            }
            goal.norm = goal.norm.max(stretched);
            axpy(-beta, v_old, image);
            let alpha = dot(v, image);
            axpy(-alpha, v, image);
            beta = norm(image);
            // The last rotation on the new column, and on the one to come.
            let far = above;
            let near = cosine * pending + sine * alpha;
            let diagonal = sine * pending - cosine * alpha;
            above = sine * beta;
            pending = -cosine * beta;
            let length = diagonal.hypot(beta);
            (cosine, sine) = (diagonal / length, beta / length);
            for ((w_old, w), v) in w_old.iter_mut().zip(&*w).zip(&*v) {
                *w_old = (v - far * *w_old - near * w) / length;
            }
            mem::swap(w, w_old);
            axpy(cosine * residual, w, x);
            residual *= sine;
            mem::swap(v, v_old);
            for (v, image) in v.iter_mut().zip(&*image) {
                *v = image / beta;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{ConstrainedSystem, Options, Status, Wanted, make_solver};

    #[test]
    fn a_contradiction_is_solved_by_least_squares_with_minimum_norm() {
        // The third row is the sum of the others, and b is not.
        let mut system = ConstrainedSystem::new();
        system.set_dense(&[2.0, 0.0, 2.0, 0.0, 1.0, 1.0, 2.0, 1.0, 3.0], &[1.0, 1.0, 0.0]).unwrap();
        let (mut x, mut reference) = ([0.0; 3], [0.0; 3]);
        let mut solve = |name: &str, x: &mut [f64]| {
            let mut solver = make_solver(name, &Options::new()).unwrap();
            system.solve(&mut *solver, Wanted::Multipliers, x).unwrap()
        };
        let info = solve("minres", &mut x);
        solve("pinv", &mut reference);
        assert_eq!(info.status, Status::Converged, "{info:?}");
        assert!(info.residual_rel < 1e-14, "{info:?}");
        for (x, reference) in x.iter().zip(reference) {
            assert!((x - reference).abs() < 1e-13, "{x} {reference}");
        }
    }
}
