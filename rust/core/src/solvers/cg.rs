//! Conjugate gradients (M. R. Hestenes and E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res.
//! NBS 49 (1952) 409–436), in the frame of [`krylov`](crate::solvers::krylov).
//!
//! ```text
//!     p = r = b − A x
//!     α = rᵀr / pᵀA p,   x += α p,   r −= α A p,   β = rᵀr / last rᵀr,   p = r + β p
//! ```
//!
//! One product an iteration. It stops where pᵀA p = 0 to rounding, or when ‖r‖ has had no new minimum for 2 n + 10 iterations, and
//! gives the x of least ‖r‖, the best it has met. That is a [`Breakdown`](crate::Status::Breakdown).
//!
//! faer's `conjugate_gradient` is not used: its operator is applied through `&self`, and a [`Problem`] needs its workspace;
//! it runs a Cholesky factorisation an iteration, for its block form; and at the limit or without curvature it gives
//! neither its best x nor that x's residual.

use crate::linalg::kernels::{axpy, dot, norm};
use crate::problem::Problem;
use crate::solvers::krylov::{End, Goal, Method, Space};

/// Conjugate gradients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cg;

impl Method for Cg {
    const NAME: &'static str = "cg";
    const SUMMARY: &'static str = "conjugate gradients, from the last solution";

    fn run(
        space: &mut Space,
        problem: &mut Problem<'_>,
        x: &mut [f64],
        r: &mut [f64],
        goal: &mut Goal,
    ) -> End {
        let [p, image, best, ..] = space;
        let (floor, patience) = (f64::EPSILON * problem.trace(), 2 * x.len() + 10);
        p.copy_from_slice(r);
        best.copy_from_slice(x);
        let mut square = dot(r, r);
        let (mut least, mut stalled) = (square, 0);
        let end = loop {
            if square.sqrt() <= goal.tolerance {
                return End::Claimed;
            }
            if goal.left == 0 {
                break End::Limit;
            }
            problem.apply(p, image);
            goal.left -= 1;
            let (length, stretched) = (norm(p), norm(image));
            let curvature = dot(p, image);
            if !stretched.is_finite() {
                break End::Stuck;
            }
            goal.norm = goal.norm.max(stretched / length);
            if curvature <= floor * length * length {
                break End::Stuck;
            }
            let step = square / curvature;
            axpy(step, p, x);
            axpy(-step, image, r);
            let next = dot(r, r);
            let beta = next / square;
            square = next;
            if next < least {
                (least, stalled) = (next, 0);
                best.copy_from_slice(x);
            } else {
                stalled += 1;
            }
            if stalled == patience || !next.is_finite() {
                break End::Stuck;
            }
            for (p, r) in p.iter_mut().zip(&*r) {
                *p = r + beta * *p;
            }
        };
        x.copy_from_slice(best);
        end
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
        let mut reference = [0.0; 3];
        let mut pinv = make_solver("pinv", &Options::new()).unwrap();
        system.solve(&mut *pinv, Wanted::Multipliers, &mut reference).unwrap();
        for warm in [false, true] {
            let mut cg = make_solver("cg", &Options::new().with("warm", warm)).unwrap();
            for _ in 0..3 {
                let mut x = [0.0; 3];
                let info = system.solve(&mut *cg, Wanted::Multipliers, &mut x).unwrap();
                assert_eq!((info.status, info.rank), (Status::Converged, Some(2)), "{info:?}");
                assert!(info.iterations <= 2 && info.residual_rel <= 1e-10, "{info:?}");
                for (x, reference) in x.iter().zip(reference) {
                    assert!((x - reference).abs() < 1e-13, "{x} {reference}");
                }
            }
        }
    }
}
