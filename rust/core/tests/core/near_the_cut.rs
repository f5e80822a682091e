//! `auto` beside eigenvalues: where a redundant row is one only nearly, and where the cut runs through what is left.

use nalgebra::{DMatrix, DVector};
use oarlock_core::{ConstrainedSystem, Info, Options, Wanted, make_solver};

const RANK_CUT: f64 = 1e-6;

/// A symmetric matrix of these eigenvalues, with eigenvectors that no axis has.
fn matrix(eigenvalues: &[f64]) -> DMatrix<f64> {
    let n = eigenvalues.len();
    let mixed = DMatrix::from_fn(n, n, |row, col| ((1 + row * n + col) as f64 * 0.7).sin());
    let basis = mixed.qr().q();
    let scaled =
        &basis * DMatrix::from_diagonal(&DVector::from_column_slice(eigenvalues)) * basis.transpose();
    (&scaled + scaled.transpose()) * 0.5
}

fn solve(name: &str, matrix: &DMatrix<f64>) -> (DVector<f64>, Info) {
    let n = matrix.nrows();
    let rhs: Vec<f64> = (0..n).map(|i| (1.3 * i as f64).cos()).collect();
    let mut system = ConstrainedSystem::new();
    system.set_dense(matrix.as_slice(), &rhs).expect("a good system");
    let mut solver = make_solver(name, &Options::new().with("rank_cut", RANK_CUT)).expect(name);
    let mut x = vec![f64::NAN; n];
    let info = system.solve(&mut *solver, Wanted::Multipliers, &mut x).expect("good input");
    (DVector::from_vec(x), info)
}

/// Kept ones of order one, and two that are dropped.
fn spectrum(n: usize, dropped: f64) -> Vec<f64> {
    (0..n).map(|i| if i < 2 { dropped * (1.0 + i as f64) } else { 0.1 + i as f64 / n as f64 }).collect()
}

/// The null space of the factor alone is off by about 1e-8 here, and so would x be.
#[test]
fn a_null_space_that_is_one_only_nearly_is_that_of_the_eigenvectors() {
    for n in [4, 6, 8, 12, 30] {
        let matrix = matrix(&spectrum(n, 1e-9));
        let (reference, known) = solve("pinv", &matrix);
        for name in ["cholesky", "auto"] {
            let (x, info) = solve(name, &matrix);
            let error = (&x - &reference).norm() / reference.norm();
            assert!(error < 1e-13, "{name}, n = {n}: {error:e}");
            assert_eq!((info.rank, info.fallbacks), (known.rank, 0), "{name}, n = {n}");
            let (inside, expected) =
                (info.inconsistency.expect("known"), known.inconsistency.expect("known"));
            assert!(
                (inside - expected).abs() < 1e-13 * reference.norm(),
                "{name}, n = {n}: {inside} {expected}"
            );
        }
    }
}

#[test]
fn where_pivots_leave_the_rank_open_eigenvalues_are_asked() {
    for n in [4, 6, 8, 12, 30] {
        for dropped in [0.3, 0.7, 1.5, 5.0].map(|part| part * RANK_CUT) {
            let matrix = matrix(&spectrum(n, dropped));
            let (reference, known) = solve("pinv", &matrix);
            let (x, info) = solve("auto", &matrix);
            assert_eq!((info.rank, info.fallbacks), (known.rank, 1), "n = {n}, {dropped:e}");
            assert!((&x - &reference).norm() <= 1e-12 * reference.norm(), "n = {n}, {dropped:e}");
        }
    }
}
