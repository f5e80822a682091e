//! Sparse rows: spans that grow and shrink, and matrices with a narrow envelope.

use crate::support::{matrix_of, solver};
use nalgebra::{DMatrix, DVector};
use oarlock_core::{ConstrainedSystem, Info, StepView, Wanted};

const SIZE: usize = 40;

/// A chain of rows, each with its own velocity and the one before: J (n×n, row-major).
fn chain(own: f64, before: f64) -> Vec<f64> {
    let entry = |row: usize, col: usize| match row.checked_sub(col) {
        Some(0) => own,
        Some(1) => before,
        _ => 0.0,
    };
    (0..SIZE * SIZE).map(|i| entry(i / SIZE, i % SIZE)).collect()
}

fn assemble(system: &mut ConstrainedSystem, jacobian: &[f64]) -> Result<(), oarlock_core::Error> {
    let mass = DMatrix::<f64>::identity(SIZE, SIZE);
    let aref: Vec<f64> = (0..SIZE).map(|i| (i as f64).sin()).collect();
    system.assemble(&StepView {
        mass: mass.as_slice(),
        jacobian,
        force: &[0.0; SIZE],
        aref: &aref,
        regularisation: None,
    })
}

fn solve(system: &mut ConstrainedSystem, name: &str) -> (DVector<f64>, Info) {
    let mut x = DVector::zeros(SIZE);
    let info = system.solve(&mut *solver(name), Wanted::Multipliers, x.as_mut_slice()).unwrap();
    (x, info)
}

/// The same A without its envelope.
fn dense(system: &ConstrainedSystem) -> ConstrainedSystem {
    let mut dense = ConstrainedSystem::new();
    dense.set_dense(&system.full_matrix(), system.rhs()).unwrap();
    dense
}

#[test]
fn a_regular_chain_is_solved_as_a_dense_matrix_is() {
    let mut system = ConstrainedSystem::new();
    assemble(&mut system, &chain(1.0, 0.5)).unwrap();
    let (x, info) = solve(&mut system, "cholesky");
    let (expected, _) = solve(&mut dense(&system), "pinv");
    assert_eq!((info.rank, info.folded), (Some(SIZE), 0));
    assert!((x - &expected).norm() <= 1e-13 * expected.norm());
    assert!(info.residual_rel <= 1e-14, "{}", info.residual_rel);
}

/// Every pivot in the order of the rows is 1, and the least eigenvalue is about 4⁻⁴⁰.
#[test]
fn a_singular_chain_of_sound_pivots_keeps_its_rank() {
    let mut system = ConstrainedSystem::new();
    assemble(&mut system, &chain(1.0, -2.0)).unwrap();
    let (x, info) = solve(&mut system, "cholesky");
    let (expected, reference) = solve(&mut dense(&system), "pinv");
    assert_eq!((info.rank, reference.rank), (Some(SIZE - 1), Some(SIZE - 1)));
    assert!((x - &expected).norm() <= 1e-10 * expected.norm());
}

/// A system whose rows get and lose entries is to the last bit what a new one is.
#[test]
fn spans_follow_the_rows() {
    let mut far = chain(1.0, 0.5);
    far[SIZE - 1] = 0.25;
    far[20 * SIZE + 3] = -0.5;
    let mut gone = chain(1.0, 0.5);
    gone[20 * SIZE + 20] = 0.0;
    gone[30 * SIZE + 29] = -0.0;
    let mut reused = ConstrainedSystem::new();
    for jacobian in [chain(1.0, 0.5), far.clone(), chain(1.0, 0.5), gone, chain(1.0, 0.5), far] {
        assemble(&mut reused, &jacobian).unwrap();
        let mut fresh = ConstrainedSystem::new();
        assemble(&mut fresh, &jacobian).unwrap();
        assert_eq!(matrix_of(&reused), matrix_of(&fresh));
        for name in ["cholesky", "pinv"] {
            assert_eq!(solve(&mut reused, name).0, solve(&mut fresh, name).0);
        }
        let (mut forces, mut accelerations) = ([[0.0; SIZE]; 2], [[0.0; SIZE]; 2]);
        for (i, system) in [&mut reused, &mut fresh].into_iter().enumerate() {
            system.acceleration(&[1.0; SIZE], &mut forces[i], &mut accelerations[i]).unwrap();
        }
        assert_eq!((forces[0], accelerations[0]), (forces[1], accelerations[1]));
    }
}

/// Wherever it is.
#[test]
fn a_number_that_is_none_is_found() {
    for index in [5, 20 * SIZE + 20, SIZE * SIZE - 1] {
        let mut system = ConstrainedSystem::new();
        assemble(&mut system, &chain(1.0, 0.5)).unwrap();
        let mut bad = chain(1.0, 0.5);
        bad[index] = f64::NAN;
        let error = assemble(&mut system, &bad).unwrap_err().to_string();
        assert_eq!(error, format!("jacobian[{index}] = NaN, expected finite numbers"));
        assert_eq!(system.len(), SIZE, "the last step stays");
    }
}
