//! The reference solver, by the properties that define A⁺ b.

use crate::support::{
    MOVED, PsdSystem, ROUNDING, SOLVED, assert_within, config, dense, diagonal, mechanisms, motion,
    psd_systems, rhs_of, rows, solve, solver,
};
use nalgebra::{DMatrix, DVector};
use oarlock_core::solvers::Solver;
use oarlock_core::solvers::pinv::{Pinv, PinvParams};
use oarlock_core::test_problems::{NV, RANK, ROWS, boat};
use oarlock_core::{ConstrainedSystem, Error, Status, Wanted};
use proptest::prelude::*;

/// A⁺, column by column: the solutions for the unit vectors.
fn pseudo_inverse(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    let mut pinv = solver("pinv");
    let n = matrix.nrows();
    let columns = (0..n).map(|i| {
        let mut unit = DVector::zeros(n);
        unit[i] = 1.0;
        solve(&mut *pinv, &mut dense(matrix, &unit)).0
    });
    DMatrix::from_columns(&columns.collect::<Vec<_>>())
}

/// What comes of a solve that must be refused.
fn refusal(system: &mut ConstrainedSystem, x: &mut [f64]) -> Error {
    system.solve(&mut *solver("pinv"), Wanted::Multipliers, x).expect_err("bad input")
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn solutions_obey_the_four_moore_penrose_conditions(system in psd_systems()) {
        let PsdSystem { matrix: a, .. } = &system;
        let p = pseudo_inverse(a);
        let (ap, pa) = (a * &p, &p * a);
        assert_within("A P A = A", (&ap * a - a).norm(), SOLVED * a.norm());
        assert_within("P A P = P", (&pa * &p - &p).norm(), SOLVED * p.norm());
        assert_within("A P symmetric", (&ap - ap.transpose()).norm(), SOLVED * ap.norm());
        assert_within("P A symmetric", (&pa - pa.transpose()).norm(), SOLVED * pa.norm());
    }

    #[test]
    fn a_contradiction_is_solved_by_least_squares_with_minimum_norm_and_reported(system in psd_systems()) {
        let PsdSystem { matrix, range, rhs } = &system;
        let (x, info) = solve(&mut *solver("pinv"), &mut dense(matrix, rhs));
        prop_assert_eq!(info.status, Status::Converged);
        prop_assert_eq!(info.rank, Some(system.rank()));

        let null_part = &x - range * range.tr_mul(&x);
        assert_within("minimum norm: x without null part", null_part.norm(), ROUNDING * x.norm());
        let reachable = range.tr_mul(&(matrix * &x - rhs));
        assert_within("least squares: residual without range part", reachable.norm(), SOLVED * rhs.norm());
        assert_within("reported residual", info.residual_rel, SOLVED);

        let contradiction = (rhs - system.consistent_rhs()).norm();
        let reported = info.inconsistency.expect("pinv knows the null space");
        assert_within("inconsistency = ‖Nᵀ b‖", (reported - contradiction).abs(), SOLVED * rhs.norm());
        assert_within("‖A N‖ / ‖A‖", info.null_residual.expect("pinv knows the null space"), ROUNDING);
    }

    /// λ of the rows changes, what the mechanism feels of it does not.
    #[test]
    fn forces_and_accelerations_ignore_duplicated_and_rescaled_rows(
        mechanism in mechanisms(),
        pick in any::<prop::sample::Index>(),
        factor in prop_oneof![Just(1.0), Just(-1.0), 0.1..10.0],
    ) {
        let row = pick.index(mechanism.aref.len());
        let plain = motion(&mut *solver("pinv"), &mechanism.view());
        for (what, other) in [
            ("duplicated", mechanism.with_copy(row, factor)),
            ("rescaled", mechanism.with_scaled(row, factor)),
        ] {
            let other = motion(&mut *solver("pinv"), &other.view());
            assert_within(what, (&other.qfrc - &plain.qfrc).norm(), MOVED * plain.qfrc.norm().max(1.0));
            assert_within(what, (&other.qacc - &plain.qacc).norm(), MOVED * plain.qacc.norm().max(1.0));
        }
    }
}

#[test]
fn a_duplicated_row_shares_its_multiplier_evenly() {
    let (x, _) = solve(&mut *solver("pinv"), &mut rows([[2.0, 2.0], [2.0, 2.0]], [6.0, 6.0]));
    assert_within("2 λ = 6, half of λ each", (x - DVector::from_element(2, 1.5)).norm(), ROUNDING);
}

#[test]
fn the_zero_matrix_has_rank_zero_and_the_zero_solution() {
    let (x, info) = solve(&mut *solver("pinv"), &mut rows([[0.0; 2]; 2], [3.0, -4.0]));
    assert_eq!((x.norm(), info.status, info.rank), (0.0, Status::Converged, Some(0)));
    assert_within("all of b contradicts", (info.inconsistency.unwrap() - 5.0).abs(), 5.0 * ROUNDING);
    assert_eq!((info.residual_rel, info.null_residual), (0.0, Some(0.0)));
}

/// These eigenvalues in one block: a reflection of their diagonal.
fn turned(eigenvalues: &[f64; 4]) -> ConstrainedSystem {
    let normal = DVector::from_row_slice(&[1.0, 2.0, 3.0, 4.0]).normalize();
    let mirror = DMatrix::<f64>::identity(4, 4) - 2.0 * &normal * normal.transpose();
    let values = DMatrix::from_diagonal(&DVector::from_row_slice(eigenvalues));
    let matrix: DMatrix<f64> = &mirror * values * &mirror;
    let symmetric = 0.5 * (&matrix + matrix.transpose());
    dense(&symmetric, &DVector::from_element(4, 1.0))
}

#[test]
fn the_rank_cut_is_relative_to_the_largest_eigenvalue_of_a_block() {
    // Just above and just below the default cut of 1e-10.
    let eigenvalues = [1.0, 2e-10, 0.5e-10, 0.0];
    for (scale, rank_cut, rank) in
        [(1.0, 1e-10, 2), (1e8, 1e-10, 2), (1e-8, 1e-10, 2), (1.0, 1e-11, 3), (1.0, 1e-3, 1)]
    {
        let mut system = turned(&eigenvalues.map(|value| value * scale));
        let (_, info) = solve(&mut Pinv::new(PinvParams { rank_cut }), &mut system);
        assert_eq!(info.rank, Some(rank), "scale {scale:e}, cut {rank_cut:e}");
        let mut apart = diagonal(&eigenvalues.map(|value| value * scale));
        let (_, info) = solve(&mut Pinv::new(PinvParams { rank_cut }), &mut apart);
        assert_eq!(info.rank, Some(3), "a block each: only what is zero is dropped");
    }
}

#[test]
fn the_boat_has_rank_four_and_no_contradiction_in_every_pose() {
    let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
    for pose in 0..120 {
        let t = 0.1 * f64::from(pose);
        let step = boat(t);
        system.assemble(&step.view()).unwrap();
        let (x, info) = solve(&mut *pinv, &mut system);
        assert_eq!((info.rank, x.len(), system.nv()), (Some(RANK), ROWS, NV), "t = {t}");
        assert_within(
            &format!("‖Nᵀ b‖ at t = {t}"),
            info.inconsistency.unwrap(),
            ROUNDING * rhs_of(&system).norm(),
        );
    }
}

#[test]
fn a_solution_of_another_length_is_refused() {
    let message = refusal(&mut diagonal(&[1.0; 3]), &mut [0.0; 2]).to_string();
    assert_eq!(message, "multipliers has shape 2 entries, expected 3");
}
