//! Shared by the integration tests: random systems whose rank and null space are known, tolerances with their
//! causes, and the few steps that every test takes.

#![allow(dead_code)] // each test file uses its own part

pub mod change;
pub mod contacts;
pub mod trace;
pub mod tree;

use std::iter::repeat_n;

use nalgebra::{DMatrix, DVector};
use oarlock_core::problem::Fold;
use oarlock_core::{ConstrainedSystem, Info, MultiplierSolver, Options, StepView, Wanted, make_solver};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::FileFailurePersistence;

/// Relative error of one product or one backward-stable factorisation: n·ε with n ≤ 12, and room for the norms of
/// intermediate sums. Worst of 100 000 random cases: 6e-15.
pub const ROUNDING: f64 = 1e-13;

/// Relative error of x = A⁺ b: n·ε times the condition number, which [`psd_systems`] keeps below 60 (12·ε·60 = 2e-13).
/// Worst of 100 000 random cases: 8e-15.
pub const SOLVED: f64 = 1e-12;

/// Relative error of accelerations and forces: as [`SOLVED`], but the condition number of M (≤ 100) enters as well,
/// through A = J M⁻¹ Jᵀ and on the way back. Worst of 100 000 random cases: 8e-13.
pub const MOVED: f64 = 1e-11;

/// proptest's defaults (256 cases, or `PROPTEST_CASES`); failing cases are kept beside the test file, to be committed.
#[must_use]
pub fn config() -> ProptestConfig {
    let file = FileFailurePersistence::WithSource("proptest-regressions");
    ProptestConfig { failure_persistence: Some(Box::new(file)), ..ProptestConfig::default() }
}

/// Fails, with both numbers, unless `value` ≤ `bound`; a NaN fails.
#[track_caller]
pub fn assert_within(what: &str, value: f64, bound: f64) {
    assert!(value <= bound, "{what}: {value:e}, expected at most {bound:e}");
}

/// The solver of that name with its defaults.
///
/// # Panics
/// If there is none.
#[must_use]
pub fn solver(name: &str) -> Box<dyn MultiplierSolver> {
    make_solver(name, &Options::new()).expect(name)
}

/// One solve for the minimum-norm multipliers.
///
/// # Panics
/// If the input is refused, or a NaN or an infinity comes back.
#[track_caller]
pub fn solve(solver: &mut dyn MultiplierSolver, system: &mut ConstrainedSystem) -> (DVector<f64>, Info) {
    let mut x = DVector::from_element(system.len(), f64::NAN);
    let info = system.solve(solver, Wanted::Multipliers, x.as_mut_slice()).expect("good input");
    assert!(x.iter().all(|entry| entry.is_finite()), "{}: {x}", solver.name());
    assert!(info.residual_rel.is_finite(), "{}: {info:?}", solver.name());
    (x, info)
}

/// A dense system; A is symmetrised first, which only takes its rounding away.
///
/// # Panics
/// If the input is refused.
#[track_caller]
#[must_use]
pub fn dense(matrix: &DMatrix<f64>, rhs: &DVector<f64>) -> ConstrainedSystem {
    let mut system = ConstrainedSystem::new();
    let symmetric = (matrix + matrix.transpose()) * 0.5;
    system.set_dense(symmetric.as_slice(), rhs.as_slice()).expect("a good system");
    system
}

/// A dense system written out.
///
/// # Panics
/// If the input is refused.
#[track_caller]
#[must_use]
pub fn rows<const N: usize>(matrix: [[f64; N]; N], rhs: [f64; N]) -> ConstrainedSystem {
    let mut system = ConstrainedSystem::new();
    system.set_dense(matrix.as_flattened(), &rhs).expect("a good system");
    system
}

/// A diagonal A, b of ones.
#[must_use]
pub fn diagonal(entries: &[f64]) -> ConstrainedSystem {
    let ones = DVector::from_element(entries.len(), 1.0);
    dense(&DMatrix::from_diagonal(&DVector::from_column_slice(entries)), &ones)
}

/// A of a system, before folding.
#[must_use]
pub fn matrix_of(system: &ConstrainedSystem) -> DMatrix<f64> {
    DMatrix::from_vec(system.len(), system.len(), system.full_matrix())
}

/// b of a system, before folding.
#[must_use]
pub fn rhs_of(system: &ConstrainedSystem) -> DVector<f64> {
    DVector::from_column_slice(system.rhs())
}

/// A PSD system with what is known about it by construction.
#[derive(Debug, Clone)]
pub struct PsdSystem {
    /// A, `n×n`; nonzero eigenvalues within a factor of 60.
    pub matrix: DMatrix<f64>,
    /// Orthonormal basis of range(A), `n×r`.
    pub range: DMatrix<f64>,
    /// b, `n`, anywhere: in general not in range(A).
    pub rhs: DVector<f64>,
}

impl PsdSystem {
    /// r.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.range.ncols()
    }

    /// The part of v (or of each column of it) in range(A).
    #[must_use]
    pub fn range_part(&self, v: &DMatrix<f64>) -> DMatrix<f64> {
        &self.range * self.range.tr_mul(v)
    }

    /// P b: a right-hand side that the rows agree on.
    #[must_use]
    pub fn consistent_rhs(&self) -> DVector<f64> {
        &self.range * self.range.tr_mul(&self.rhs)
    }
}

/// A mechanism of one step: nv velocities, n rows of which some are redundant, and an aref that they agree on.
#[derive(Debug, Clone)]
pub struct Mechanism {
    /// M, `nv×nv`, exactly symmetric; eigenvalues in [0.1, 10].
    pub mass: DMatrix<f64>,
    /// Jᵀ, `nv×n`, so that its column-major data are J row-major.
    pub jacobian_t: DMatrix<f64>,
    /// f, `nv`.
    pub force: DVector<f64>,
    /// aref = J a for some a, `n`.
    pub aref: DVector<f64>,
}

impl Mechanism {
    /// As the solvers see it, without softness.
    #[must_use]
    pub fn view(&self) -> StepView<'_> {
        StepView {
            mass: self.mass.as_slice(),
            jacobian: self.jacobian_t.as_slice(),
            force: self.force.as_slice(),
            aref: self.aref.as_slice(),
            regularisation: None,
        }
    }

    /// With row `source` once more at the end, times `factor`.
    #[must_use]
    pub fn with_copy(&self, source: usize, factor: f64) -> Self {
        let n = self.aref.len();
        let mut copy = self.clone();
        copy.jacobian_t = copy.jacobian_t.insert_column(n, 0.0);
        copy.jacobian_t.set_column(n, &(factor * self.jacobian_t.column(source)));
        copy.aref = copy.aref.insert_row(n, factor * self.aref[source]);
        copy
    }

    /// With row `row` times `factor`: the same constraint in another unit.
    #[must_use]
    pub fn with_scaled(&self, row: usize, factor: f64) -> Self {
        let mut scaled = self.clone();
        scaled.jacobian_t.column_mut(row).scale_mut(factor);
        scaled.aref[row] *= factor;
        scaled
    }
}

/// What a solver makes of a step: Jᵀλ and the acceleration.
pub struct Motion {
    /// λ, `n`.
    pub multipliers: DVector<f64>,
    /// Jᵀλ, `nv`.
    pub qfrc: DVector<f64>,
    /// a, `nv`.
    pub qacc: DVector<f64>,
}

/// Assembles, solves and goes back to accelerations.
///
/// # Panics
/// If the input is refused.
#[track_caller]
pub fn motion(solver: &mut dyn MultiplierSolver, step: &StepView<'_>) -> Motion {
    let mut system = ConstrainedSystem::new();
    system.assemble(step).expect("a good step");
    let (multipliers, _) = solve(solver, &mut system);
    let (mut qfrc, mut qacc) = (DVector::zeros(system.nv()), DVector::zeros(system.nv()));
    system
        .acceleration(multipliers.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice())
        .expect("matching lengths");
    Motion { multipliers, qfrc, qacc }
}

/// `len` numbers in [−1, 1].
pub fn numbers(len: usize) -> impl Strategy<Value = DVector<f64>> {
    vec(-1.0..1.0, len).prop_map(DVector::from_vec)
}

/// n×r with orthonormal columns, r ≤ n.
pub fn orthonormal(n: usize, r: usize) -> impl Strategy<Value = DMatrix<f64>> {
    numbers(n * r).prop_map(move |entries| DMatrix::from_column_slice(n, r, entries.as_slice()).qr().q())
}

/// A power of ten with a whole exponent in [−8, 8].
pub fn scales() -> impl Strategy<Value = f64> {
    (-8..=8).prop_map(|exponent| 10.0_f64.powi(exponent))
}

/// B (n×r) of full column rank: the rows of a matrix with singular values in [0.3, 1], up to three of them twice and
/// up to two zero rows besides, in any order. B Bᵀ then has rank r and a condition number below 4 / 0.3² on its range.
fn row_factors(base: usize, r: usize) -> impl Strategy<Value = DMatrix<f64>> {
    let rows = (vec(0..base, 0..=3), 0..=2_usize)
        .prop_map(move |(copies, zeros)| {
            let sources = (0..base).chain(copies).map(Some);
            sources.chain(repeat_n(None, zeros)).collect::<Vec<Option<usize>>>()
        })
        .prop_shuffle();
    (orthonormal(base, r), vec(0.3..1.0, r), rows).prop_map(move |(directions, singular, rows)| {
        DMatrix::from_fn(rows.len(), r, |row, col| {
            rows[row].map_or(0.0, |source| directions[(source, col)] * singular[col])
        })
    })
}

/// PSD systems with n ≤ 11 and 1 ≤ r ≤ 6: redundant, duplicated and zero rows, A times `matrix_scale`, b times
/// `rhs_scale`.
fn scaled_systems(
    matrix_scale: impl Strategy<Value = f64>,
    rhs_scale: impl Strategy<Value = f64>,
) -> impl Strategy<Value = PsdSystem> {
    let factors = (1..=6_usize).prop_flat_map(|base| (1..=base).prop_flat_map(move |r| row_factors(base, r)));
    let with_rhs = factors.prop_flat_map(|factor| {
        let n = factor.nrows();
        (Just(factor), numbers(n))
    });
    (with_rhs, matrix_scale, rhs_scale).prop_map(|((factor, rhs), matrix_scale, rhs_scale)| PsdSystem {
        matrix: &factor * factor.transpose() * matrix_scale,
        range: factor.qr().q(),
        rhs: rhs * rhs_scale,
    })
}

/// PSD systems of every scale from 1e-8 to 1e8, of A and of b.
pub fn psd_systems() -> impl Strategy<Value = PsdSystem> {
    scaled_systems(scales(), scales())
}

/// PSD systems with A and b of order one, for stopping tests that are absolute.
pub fn unit_systems() -> impl Strategy<Value = PsdSystem> {
    scaled_systems(Just(1.0), Just(1.0))
}

/// Whether folding leaves this A alone, so that a solver sees it as it is.
pub fn unfolded(matrix: &DMatrix<f64>) -> bool {
    Fold::find(matrix.as_slice(), matrix.nrows()).is_identity()
}

/// As [`unit_systems`], but redundant only in ways that folding cannot see: no zero rows, no proportional ones.
pub fn unfolded_systems() -> impl Strategy<Value = PsdSystem> {
    let shapes = (1..=8_usize).prop_flat_map(|n| (Just(n), if n == 1 { 1..=1 } else { 2..=n.min(6) }));
    let parts = shapes.prop_flat_map(|(n, r)| (orthonormal(n, r), vec(0.3..1.0, r), numbers(n)));
    let systems = parts.prop_map(|(directions, singular, rhs)| {
        let factor = &directions * DMatrix::from_diagonal(&DVector::from_vec(singular));
        PsdSystem { matrix: &factor * factor.transpose(), range: directions, rhs }
    });
    systems.prop_filter("rows that folding takes out", |system| unfolded(&system.matrix))
}

/// Mechanisms with up to 6 independent rows of up to 11, and up to 9 velocities.
pub fn mechanisms() -> impl Strategy<Value = Mechanism> {
    let shapes = (1..=6_usize).prop_flat_map(|base| (Just(base), 1..=base, 0..=3_usize));
    let parts = shapes.prop_flat_map(|(base, r, free)| {
        let nv = r + free;
        let masses = vec(0.1..10.0, nv).prop_map(DVector::from_vec);
        (row_factors(base, r), orthonormal(nv, r), orthonormal(nv, nv), masses, numbers(nv), numbers(nv))
    });
    parts.prop_map(|(rows, columns, axes, masses, force, acceleration)| {
        let mass = &axes * DMatrix::from_diagonal(&masses) * axes.transpose();
        let jacobian_t = columns * rows.transpose();
        let aref = jacobian_t.tr_mul(&acceleration) * 10.0;
        Mechanism { mass: (&mass + mass.transpose()) * 0.5, jacobian_t, force: force * 10.0, aref }
    })
}
