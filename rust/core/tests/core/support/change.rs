//! A change of A from one step to the next, on a range that stands still: the setting of the paper's proofs.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};
use oarlock_core::solvers::Solver;
use oarlock_core::solvers::sr1::Sr1Params;
use oarlock_core::{Info, Status};
use proptest::collection::vec;
use proptest::prelude::*;

use super::trace::{Pass, Traced};
use super::{PsdSystem, ROUNDING, assert_within, dense, orthonormal, solve, unfolded, unfolded_systems};

/// Stopping test: far above rounding, so that it is met; far below what an unfinished iteration leaves, as a rule.
pub const PARAMS: Sr1Params = Sr1Params { eps_abs: 1e-9, guard: 1e-6, max_iterations: 50, rank_cut: 1e-10 };

/// A₀ and A = A₀ + F with range(F) in P = range(A₀) and A positive definite on P.
#[derive(Debug, Clone)]
pub struct Change {
    /// A₀, P and b.
    pub before: PsdSystem,
    /// A, `n×n`.
    pub matrix: DMatrix<f64>,
    /// r₁ = rank F.
    pub rank: usize,
}

/// The passes of a solve that converged, and what came of it.
pub struct Solved {
    /// Pass 0 to the last.
    pub passes: Vec<Pass>,
    /// x.
    pub x: DVector<f64>,
    /// Its figures.
    pub info: Info,
}

impl Solved {
    /// H, as the solve leaves it.
    pub fn inverse(&self) -> &DMatrix<f64> {
        &self.passes.last().expect("pass 0").inverse
    }
}

impl Change {
    /// The pseudo-inverse of a matrix on P, by LU of its r×r image.
    pub fn pseudo_inverse(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let range = &self.before.range;
        let image = self.on_range(matrix).try_inverse().expect("regular on P");
        range * image * range.transpose()
    }

    /// The r×r image of a matrix on P.
    pub fn on_range(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let range = &self.before.range;
        range.tr_mul(&(matrix * range))
    }

    /// F.
    pub fn difference(&self) -> DMatrix<f64> {
        &self.matrix - &self.before.matrix
    }

    /// b, in P.
    pub fn rhs(&self) -> DVector<f64> {
        self.before.consistent_rhs()
    }

    /// Solves A x = b from H₀ = A₀⁺.
    ///
    /// # Panics
    /// If it does not converge, or says that it did and did not.
    #[track_caller]
    pub fn solve(&self) -> Solved {
        let mut traced = Traced::new(PARAMS);
        let start = self.pseudo_inverse(&self.before.matrix);
        traced.solver.start_from(start.as_slice(), self.matrix.nrows()).expect("square");
        let rhs = self.rhs();
        let (x, info) = solve(&mut traced, &mut dense(&self.matrix, &rhs));
        assert_eq!((info.status, info.refreshed), (Status::Converged, false));
        assert_within("stopping test", info.residual_rel * rhs.norm(), PARAMS.eps_abs * (1.0 + ROUNDING));
        Solved { passes: traced.passes, x, info }
    }
}

/// Changes as the theorem supposes them: F semidefinite, of rank r₁ from 1 to r, positive or negative, and
/// ‖F‖ ‖A₀⁺‖ in `sizes`, which lies in (0, 1).
pub fn semidefinite_changes(
    sizes: Range<f64>,
    signs: impl Strategy<Value = f64> + Clone,
) -> impl Strategy<Value = Change> {
    let systems = unfolded_systems().prop_flat_map(|before| (1..=before.rank(), Just(before)));
    let parts = systems.prop_flat_map(move |(rank, before)| {
        let weights = vec(0.3..1.0, rank - 1);
        (orthonormal(before.rank(), rank), weights, sizes.clone(), signs.clone(), Just(before))
    });
    let changes = parts.prop_map(|(directions, mut weights, size, sign, before)| {
        weights.push(1.0);
        let on_range = before.range.tr_mul(&(&before.matrix * &before.range));
        let smallest = on_range.symmetric_eigenvalues().min();
        let directions = &before.range * directions;
        let weights = DMatrix::from_diagonal(&DVector::from_vec(weights)) * (sign * size * smallest);
        let matrix = &before.matrix + &directions * weights * directions.transpose();
        Change { before, matrix, rank: directions.ncols() }
    });
    changes.prop_filter("rows that folding takes out", |change| unfolded(&change.matrix))
}

/// F ≥ 0 or F ≤ 0.
pub fn either_sign() -> impl Strategy<Value = f64> + Clone {
    prop_oneof![Just(1.0), Just(-1.0)]
}

/// Changes of no given sign or size: A is any other matrix with range P, with nonzero eigenvalues in [0.09, 1]. As a
/// rule F is indefinite and ‖F‖ ‖A₀⁺‖ above 1.
pub fn any_changes() -> impl Strategy<Value = Change> {
    let parts = unfolded_systems().prop_flat_map(|before| {
        let rank = before.rank();
        (orthonormal(rank, rank), vec(0.09..1.0, rank), Just(before))
    });
    let changes = parts.prop_map(|(axes, values, before)| {
        let rank = values.len();
        let axes = &before.range * axes;
        let matrix = &axes * DMatrix::from_diagonal(&DVector::from_vec(values)) * axes.transpose();
        Change { before, matrix, rank }
    });
    changes.prop_filter("rows that folding takes out", |change| unfolded(&change.matrix))
}
