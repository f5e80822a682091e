//! Algorithm (11) where the paper proves nothing: its first solve, and rows that contradict one another. What it proves
//! is in `claims.rs`; named problems and the life of a carried H are in `sr1_carried.rs`. Rows that folding takes out
//! never reach a solver, so the systems here have none.

use crate::support::change::{Change, PARAMS, either_sign, semidefinite_changes};
use crate::support::{SOLVED, assert_within, config, dense, solve, unfolded_systems};
use nalgebra::DMatrix;
use oarlock_core::Status;
use oarlock_core::solvers::Solver;
use oarlock_core::solvers::sr1::Sr1;
use proptest::prelude::*;

/// Changes with redundant rows and a b that is not in the range.
fn contradictions() -> impl Strategy<Value = Change> {
    let changes = semidefinite_changes(0.05..0.95, either_sign());
    changes.prop_filter("rows that contradict one another", |change| {
        (&change.before.rhs - change.rhs()).norm() > 1e-6
    })
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn the_first_solve_is_exact_and_takes_no_iteration(system in unfolded_systems()) {
        let rhs = system.consistent_rhs();
        let mut solver = Sr1::new(PARAMS);
        let (x, info) = solve(&mut solver, &mut dense(&system.matrix, &rhs));
        prop_assert_eq!((info.status, info.iterations, info.refreshed), (Status::Converged, 0, true));
        let n = rhs.len();
        let h = &DMatrix::from_column_slice(n, n, solver.inverse());
        let (ah, ha) = (&system.matrix * h, h * &system.matrix);
        assert_within("x = H b", (&x - h * &rhs).norm(), SOLVED * x.norm());
        assert_within("A H A = A", (&ah * &system.matrix - &system.matrix).norm(), SOLVED * system.matrix.norm());
        assert_within("H A H = H", (&ha * h - h).norm(), SOLVED * h.norm());
        assert_within("A H symmetric", (&ah - ah.transpose()).norm(), SOLVED * ah.norm());
    }

    /// ‖A x − b‖ cannot fall below ‖Nᵀ b‖: a solve that asks for less ends without convergence, with the answer of the
    /// reference, and carries on from a fresh H.
    #[test]
    fn a_contradiction_ends_without_convergence_and_with_a_fresh_inverse(change in contradictions()) {
        let (system, truth) = (&change.before, change.pseudo_inverse(&change.matrix));
        let (rhs, bad) = (change.rhs(), &system.rhs);
        let contradiction = (bad - &rhs).norm();

        let mut solver = Sr1::new(PARAMS);
        solve(&mut solver, &mut dense(&system.matrix, &rhs));
        let (x, info) = solve(&mut solver, &mut dense(&change.matrix, bad));
        prop_assert!(matches!(info.status, Status::IterationLimit | Status::Breakdown), "{:?}", info);
        prop_assert!(info.refreshed);
        assert_within("x = A⁺ b", (x - &truth * &rhs).norm(), SOLVED * truth.norm() * bad.norm());
        assert_within("residual ‖Nᵀ b‖", (info.residual_rel - contradiction / bad.norm()).abs(), SOLVED);

        let (x, info) = solve(&mut solver, &mut dense(&change.matrix, &rhs));
        prop_assert_eq!((info.status, info.iterations, info.refreshed), (Status::Converged, 0, false));
        assert_within("x = A⁺ b", (x - &truth * &rhs).norm(), SOLVED * truth.norm() * rhs.norm());
    }
}
