//! Conjugate gradients (M. R. Hestenes and E. Stiefel, "Methods of conjugate gradients for solving linear systems", J. Res.
//! NBS 49 (1952) 409–436), in the frame of [`krylov`](crate::solvers::krylov).
//!
//! ```text
//!     p = r = b − A x
//!     α = rᵀr / pᵀA p,   x += α p,   r −= α A p,   β = rᵀr / last rᵀr,   p = r + β p
//! ```
//!
//! One product an iteration; A r, for the least-squares test, is A p − β (last A p).
//!
//! **Contradicting rows.** Where b is not in range(A), ‖r‖ cannot fall below ‖Nᵀb‖, N a basis of null(A), p turns into
//! null(A), where pᵀA p = 0, and x runs away: CG minimises ½ xᵀA x − bᵀx, which has no minimum then. It stops there, or
//! when ‖r‖ has had no new minimum for 2 n + 10 iterations, and gives the x of least ‖r‖, the best it has met in least
//! squares. That is a [`Breakdown`](crate::Status::Breakdown); [`minres`](crate::solvers::minres) converges.
//!
//! faer's `conjugate_gradient` is not used: its operator is applied through `&self`, and a [`Problem`] needs its workspace;
//! it runs a Cholesky factorisation an iteration, for its block form; and at the limit or without curvature it gives
//! neither its best x nor that x's residual.

use std::mem;

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
        let [p, image, last, best, _] = space;
        let (floor, patience) = (f64::EPSILON * problem.trace(), 2 * x.len() + 10);
        p.copy_from_slice(r);
        best.copy_from_slice(x);
        last.fill(0.0);
        let mut square = dot(r, r);
        let (mut least, mut stalled, mut beta) = (square, 0, 0.0);
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
            let gradient =
                image.iter().zip(&*last).map(|(new, old)| (new - beta * old).powi(2)).sum::<f64>().sqrt();
            if goal.least_squares(gradient, square.sqrt()) {
                return End::Claimed;
            }
            if curvature <= floor * length * length {
                break End::Stuck;
            }
            let step = square / curvature;
            axpy(step, p, x);
            axpy(-step, image, r);
            let next = dot(r, r);
            (beta, square) = (next / square, next);
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
            mem::swap(image, last);
        };
        x.copy_from_slice(best);
        end
    }
}

#[cfg(test)]
mod tests {
    use crate::{ConstrainedSystem, Options, Status, Wanted, make_solver};

    #[test]
    fn a_contradiction_breaks_down_with_the_best_x_it_met() {
        // The third row is the sum of the others, and b is not: no x has ‖b − A x‖ below 2/√3.
        let mut system = ConstrainedSystem::new();
        system.set_dense(&[2.0, 0.0, 2.0, 0.0, 1.0, 1.0, 2.0, 1.0, 3.0], &[1.0, 1.0, 0.0]).unwrap();
        for warm in [false, true] {
            let mut cg = make_solver("cg", &Options::new().with("warm", warm)).unwrap();
            for _ in 0..3 {
                let mut x = [0.0; 3];
                let info = system.solve(&mut *cg, Wanted::Multipliers, &mut x).unwrap();
                assert_eq!(info.status, Status::Breakdown, "{info:?}");
                assert!(info.iterations <= 16 && info.residual_rel <= 1.0, "{info:?}");
                assert!(x.iter().all(|entry| entry.abs() < 10.0), "{x:?}");
            }
        }
    }
}
