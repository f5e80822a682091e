//! Algorithm (11) by what the paper proves of it: hereditary secant condition, errors of H that fall, range that
//! stays, finite termination. Named problems and the life of a carried H are in `sr1_carried.rs`.

mod support;

use nalgebra::{DMatrix, DVector};
use oarlock_core::sr1::{Sr1, Sr1Params};
use oarlock_core::{Info, Status};
use proptest::collection::vec;
use proptest::prelude::*;
use support::{PsdSystem, ROUNDING, SOLVED, assert_within, config, dense, orthonormal, solve, unit_systems};

/// Stopping test: far above rounding, so that it is met; far below what an unfinished iteration leaves, as a rule.
const PARAMS: Sr1Params = Sr1Params { eps_abs: 1e-9, guard: 1e-6, max_iterations: 50, rank_cut: 1e-10 };

/// Relative error of H y = s: a step may be as small as `eps_abs`, and its y is a difference of residuals that are
/// known to rounding, 1e-16 / 1e-9. Worst of 100 000 random cases: 4e-8.
const SECANT: f64 = 1e-6;

/// Relative error of H once it has learnt all of a change: that of [`SECANT`], times the condition number of A (≤ 60).
/// Worst of 100 000 random cases: 9e-6.
const LEARNT: f64 = 1e-4;

/// A₀ and A₁ = A₀ + F as the paper's theorem supposes: F of either sign with range(F) in range(A₀), and ‖F‖ below the
/// smallest nonzero eigenvalue of A₀.
#[derive(Debug, Clone)]
struct Change {
    before: PsdSystem,
    matrix: DMatrix<f64>,
    rank: usize,
}

/// Changes of every rank r₁ from 1 to r.
fn changes() -> impl Strategy<Value = Change> {
    let systems = unit_systems().prop_flat_map(|before| (1..=before.rank(), Just(before)));
    let parts = systems.prop_flat_map(|(rank, before)| {
        (orthonormal(before.rank(), rank), vec(0.3..1.0, rank), 0.05..0.5_f64, any::<bool>(), Just(before))
    });
    parts.prop_map(|(directions, weights, size, shrinks, before)| {
        let on_range = before.range.tr_mul(&(&before.matrix * &before.range));
        let size = on_range.symmetric_eigenvalues().min() * if shrinks { -size } else { size };
        let directions = &before.range * directions;
        let weights = DMatrix::from_diagonal(&DVector::from_vec(weights)) * size;
        let matrix = &before.matrix + &directions * weights * directions.transpose();
        Change { before, matrix, rank: directions.ncols() }
    })
}

/// Changes with redundant rows and a b that is not in the range.
fn contradictions() -> impl Strategy<Value = Change> {
    changes().prop_filter("rows that contradict one another", |change| {
        (&change.before.rhs - change.before.consistent_rhs()).norm() > 1e-6
    })
}

impl Change {
    /// The pseudo-inverse of a matrix on the common range, by LU of its r×r image.
    fn pseudo_inverse(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let range = &self.before.range;
        let image = range.tr_mul(&(matrix * range));
        range * image.try_inverse().expect("regular on the range") * range.transpose()
    }

    /// H₀ = A₀⁺.
    fn start(&self) -> DMatrix<f64> {
        self.pseudo_inverse(&self.before.matrix)
    }

    /// The solve of A₁ x = P b from A₀⁺.
    fn solve(&self, eps_abs: f64) -> (DMatrix<f64>, DVector<f64>, Info) {
        let mut solver = Sr1::new(Sr1Params { eps_abs, ..PARAMS });
        solver.start_from(&self.start()).expect("square");
        let rhs = self.before.consistent_rhs();
        let (x, info) = solve(&mut solver, &dense(&self.matrix, &rhs));
        assert_eq!((info.status, info.refreshed), (Status::Converged, false));
        assert_within("stopping test", info.residual_rel * rhs.norm(), eps_abs * (1.0 + ROUNDING));
        (solver.inverse().clone(), x, info)
    }

    /// H₀ and every H that an iteration leaves: each by solving anew, to just below the residual before.
    fn inverses(&self) -> Vec<DMatrix<f64>> {
        let norm = self.before.consistent_rhs().norm();
        let (mut inverses, mut eps) = (Vec::new(), f64::MAX);
        while eps > PARAMS.eps_abs {
            let (inverse, _, info) = self.solve(eps);
            inverses.push(inverse);
            eps = 0.999 * info.residual_rel * norm;
        }
        inverses
    }
}

proptest! {
    #![proptest_config(config())]

    /// Lemma 2: H_k y_i = s_i for every i < k. H_i − H_{i−1} is a multiple of s_i s_iᵀ, which makes the steps visible
    /// from outside, and s₀ = H₀ b.
    #[test]
    fn every_secant_condition_is_kept(change in changes()) {
        let inverses = change.inverses();
        let first = &inverses[0] * change.before.consistent_rhs();
        for (k, inverse) in inverses.iter().enumerate().skip(1) {
            let image = inverse * &change.matrix;
            assert_within(&format!("H_{k} y_0 = s_0"), (&image * &first - &first).norm(), SECANT * first.norm());
            for i in 1..k {
                let step = &inverses[i] - &inverses[i - 1];
                let gap = (&image * &step - &step).norm();
                assert_within(&format!("H_{k} y_{i} = s_{i}"), gap, SECANT * step.norm());
            }
        }
    }

    /// The theorem and Lemma 1: the error of H falls with every update; H stays positive definite on range(A), and
    /// nothing leaves it.
    #[test]
    fn the_inverse_gets_better_and_stays_positive_on_its_range(change in changes()) {
        let (range, truth) = (&change.before.range, change.pseudo_inverse(&change.matrix));
        let mut error = f64::INFINITY;
        for (k, inverse) in change.inverses().iter().enumerate() {
            let next = (inverse - &truth).norm();
            assert_within(&format!("error of H_{k}"), next, error + ROUNDING * truth.norm());
            error = next;
            let outside = (inverse - change.before.range_part(inverse)).norm();
            assert_within(&format!("H_{k} outside the range"), outside, ROUNDING * inverse.norm());
            let asymmetry = (inverse - inverse.transpose()).norm();
            assert_within(&format!("asymmetry of H_{k}"), asymmetry, ROUNDING * inverse.norm());
            let positive = range.tr_mul(&(inverse * range)).cholesky().is_some();
            prop_assert!(positive, "H_{} is not positive definite on the range", k);
        }
    }

    /// Finite termination: x₁ = H₀ b and at most r₁ iterations, together the paper's r₁ + 1 steps (r + 1 for r₁ = r).
    /// While the null space stands still the solution has minimum norm, and an H that needed all of them is A₁⁺.
    #[test]
    fn a_change_of_rank_r1_takes_at_most_r1_iterations(change in changes()) {
        let (inverse, x, info) = change.solve(PARAMS.eps_abs);
        prop_assert!(info.iterations <= change.rank, "{} iterations for rank {}", info.iterations, change.rank);
        prop_assert_eq!(info.fallbacks, 0);
        prop_assert_eq!(info.products, 2 + 2 * info.iterations + 1, "start, two an iteration, final residual");

        let rhs = change.before.consistent_rhs();
        let truth = change.pseudo_inverse(&change.matrix);
        let gap = (&x - &truth * &rhs).norm();
        assert_within("x = A⁺ b", gap, truth.norm() * (PARAMS.eps_abs + SOLVED * rhs.norm()));
        if info.iterations == change.rank {
            assert_within("H = A₁⁺", (inverse - &truth).norm(), LEARNT * truth.norm());
        }
    }

    #[test]
    fn the_first_solve_is_exact_and_takes_no_iteration(system in unit_systems()) {
        let rhs = system.consistent_rhs();
        let mut solver = Sr1::new(PARAMS);
        let (x, info) = solve(&mut solver, &dense(&system.matrix, &rhs));
        prop_assert_eq!((info.status, info.iterations, info.refreshed), (Status::Converged, 0, true));
        let h = solver.inverse();
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
        let (rhs, bad) = (system.consistent_rhs(), &system.rhs);
        let contradiction = (bad - &rhs).norm();

        let mut solver = Sr1::new(PARAMS);
        solve(&mut solver, &dense(&system.matrix, &rhs));
        let (x, info) = solve(&mut solver, &dense(&change.matrix, bad));
        prop_assert!(matches!(info.status, Status::IterationLimit | Status::Breakdown), "{:?}", info);
        prop_assert!(info.refreshed);
        assert_within("x = A⁺ b", (x - &truth * &rhs).norm(), SOLVED * truth.norm() * bad.norm());
        assert_within("residual ‖Nᵀ b‖", (info.residual_rel - contradiction / bad.norm()).abs(), SOLVED);

        let (x, info) = solve(&mut solver, &dense(&change.matrix, &rhs));
        prop_assert_eq!((info.status, info.iterations, info.refreshed), (Status::Converged, 0, false));
        assert_within("x = A⁺ b", (x - &truth * &rhs).norm(), SOLVED * truth.norm() * rhs.norm());
    }
}
