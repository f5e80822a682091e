//! The carried reference: the answer of an eigendecomposition to rounding, seldom by one.

use crate::support::{SOLVED, assert_within, dense, rhs_of, rows, solve, solver};
use nalgebra::{DMatrix, DVector};
use oarlock_core::ConstrainedSystem;
use oarlock_core::test_problems::boat;

/// Largest relative distance from pinv along a sequence, and how often it was decomposed anew.
fn follow(systems: impl Iterator<Item = ConstrainedSystem>) -> (f64, usize) {
    let (mut carried, mut pinv) = (solver("pinv-tracked"), solver("pinv"));
    systems.fold((0.0, 0), |(worst, anew), mut system| {
        let (expected, known) = solve(&mut *pinv, &mut system);
        let (x, info) = solve(&mut *carried, &mut system);
        assert_eq!(info.rank, known.rank, "{info:?}");
        let contradiction = known.inconsistency.expect("pinv knows");
        let gap = (info.inconsistency.expect("so does it") - contradiction).abs();
        assert_within("‖Nᵀ b‖", gap, SOLVED * rhs_of(&system).norm());
        (worst.max((&x - &expected).norm() / expected.norm()), anew + usize::from(info.refreshed))
    })
}

/// Q diag(values) Qᵀ, Q a rotation by `angle` in every plane of two neighbours.
fn turned(values: &[f64], angle: f64) -> DMatrix<f64> {
    let n = values.len();
    let mut q = DMatrix::<f64>::identity(n, n);
    for i in 1..n {
        let mut plane = DMatrix::<f64>::identity(n, n);
        let (sin, cos) = angle.sin_cos();
        (plane[(i - 1, i - 1)], plane[(i, i)]) = (cos, cos);
        (plane[(i - 1, i)], plane[(i, i - 1)]) = (-sin, sin);
        q *= plane;
    }
    &q * DMatrix::from_diagonal(&DVector::from_row_slice(values)) * q.transpose()
}

fn sequence(steps: u32, values: impl Fn(f64) -> Vec<f64>) -> impl Iterator<Item = ConstrainedSystem> {
    (0..steps).map(move |k| {
        let t = 1e-3 * f64::from(k);
        let matrix = turned(&values(t), 0.3 + t);
        dense(&matrix, &DVector::from_fn(matrix.nrows(), |i, _| (t + i as f64).cos()))
    })
}

#[test]
fn the_boat_is_followed_from_the_first_decompositions_though_three_eigenvalues_are_one() {
    let systems = (0..2000).map(|k| {
        let mut system = ConstrainedSystem::new();
        system.assemble(&boat(0.4 + 1e-3 * f64::from(k)).view()).expect("a good step");
        system
    });
    let (worst, anew) = follow(systems);
    assert_within("distance from pinv", worst, SOLVED);
    assert_eq!(anew, 1);
}

#[test]
fn eigenvalues_that_cross_or_stay_together_do_no_harm() {
    // Sizes of fixed kernels, of plain loops, of faer's.
    for n in [4, 8, 12, 30] {
        let values = |t: f64| {
            // Two that cross at t = 0.1, two that are one, two that are none, others apart.
            let mut values = vec![2.0 + t, 2.1, 0.0, 0.0];
            values.extend((4..n).map(|i| if i < 6 { 5.0 } else { 6.0 + 0.3 * f64::from(i) }));
            values
        };
        let (worst, anew) = follow(sequence(200, values));
        assert_within(&format!("n = {n}: distance from pinv"), worst, 100.0 * SOLVED);
        assert!(anew <= 20, "n = {n}: decomposed anew {anew} times");
    }
}

#[test]
fn a_rank_that_comes_and_goes_is_reported_in_the_step() {
    let values = |t: f64| vec![1.0, 2.0, if (0.05..0.1).contains(&t) { 0.0 } else { 0.5 }, 0.0];
    let (worst, anew) = follow(sequence(150, values));
    assert_within("distance from pinv", worst, 100.0 * SOLVED);
    assert_eq!(anew, 3, "the first step, and both changes");
}

#[test]
fn systems_that_have_nothing_in_common_are_decomposed() {
    let systems = [
        rows([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]], [1.0, 2.0, 3.0]),
        rows([[1.0, -0.9, 0.3], [-0.9, 5.0, 0.1], [0.3, 0.1, 0.2]], [1.0, 2.0, 3.0]),
        rows([[1.0, 0.9, -0.2], [0.9, 1.0, 0.1], [-0.2, 0.1, 9.0]], [3.0, 2.0, 1.0]),
    ];
    let (worst, anew) = follow(systems.into_iter());
    assert_within("distance from pinv", worst, SOLVED);
    assert_eq!(anew, 3);
}
