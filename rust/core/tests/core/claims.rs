//! What the paper proves of algorithm (11), claim by claim, on a range P that stands still. The crate's documentation
//! has the table of them; `claims_boat.rs` shows what becomes of them where P turns. Rows that folding takes out never
//! reach a solver, so the systems here have none.
//!
//! E is the identity on P, A₀⁺ = H₀ the start, A = A₀ + F, and a pass k leaves Hₖ, sₖ, yₖ = A sₖ, xₖ₊₁, rₖ₊₁. Where
//! a claim asks nothing of F, it is tested on changes of no sign and of any size.

use crate::support::change::{Change, PARAMS, Solved, any_changes, either_sign, semidefinite_changes};
use crate::support::trace::{Pass, Traced};
use crate::support::{ROUNDING, SOLVED, assert_within, config, orthonormal, rows, solve};
use faer::linalg::solvers::Svd;
use faer::{Mat, Side};
use nalgebra::{DMatrix, DVector};
use oarlock_core::solvers::Solver;
use proptest::collection::vec;
use proptest::prelude::*;

/// Relative error of H y = s: a step may be as small as `eps_abs`, and its y is a difference of residuals that are
/// known to rounding, 1e-16 / 1e-9. Worst of 300 000 random cases: 4e-8.
const SECANT: f64 = 1e-6;

/// Relative error of H once it has learnt all of a change: that of [`SECANT`], times the condition number of A. Worst
/// of 300 000 random cases: 1.1e-4.
const LEARNT: f64 = 1e-3;

/// The hypothesis of the theorem: F semidefinite of either sign, ‖F‖ ‖A₀⁺‖ < 1.
fn changes() -> impl Strategy<Value = Change> {
    semidefinite_changes(0.05..0.95, either_sign())
}

/// A solve and the size of its rounding errors.
struct Case {
    change: Change,
    solved: Solved,
    /// A⁺.
    truth: DMatrix<f64>,
    /// Rounding error of a residual, and with it of rₖ and yₖ: that of products with the largest xₖ on the way.
    noise: f64,
    /// The largest ‖Hₖ‖, or ‖A⁺‖: it makes an error of sₖ, or of w = sₖ − Hₖ yₖ, of one of rₖ.
    gain: f64,
}

impl Case {
    #[track_caller]
    fn new(change: Change) -> Self {
        let (solved, truth) = (change.solve(), change.pseudo_inverse(&change.matrix));
        let largest = |size: fn(&Pass) -> f64| solved.passes.iter().map(size).fold(0.0, f64::max);
        let noise = ROUNDING * (change.matrix.norm() * largest(|pass| pass.x.norm()) + change.rhs().norm());
        let gain = largest(|pass| pass.inverse.norm()).max(truth.norm());
        Self { change, solved, truth, noise, gain }
    }

    /// Every pass with the one after it.
    fn pairs(&self) -> impl Iterator<Item = (usize, &Pass, &Pass)> {
        self.solved.passes.windows(2).enumerate().map(|(k, pair)| (k, &pair[0], &pair[1]))
    }

    /// ‖v − P v‖.
    fn outside(&self, v: &DVector<f64>) -> f64 {
        let range = &self.change.before.range;
        (v - range * range.tr_mul(v)).norm()
    }

    /// x* = A⁺ b.
    fn solution(&self) -> DVector<f64> {
        &self.truth * self.change.rhs()
    }
}

/// αₖ = 1 − rₖ₊₁ᵀ Hₖ rₖ₊₁ / rₖ₊₁ᵀ Hₖ yₖ.
fn alpha(pass: &Pass) -> f64 {
    let hr = pass.hr();
    1.0 - pass.r.dot(&hr) / hr.dot(&pass.y)
}

/// Whether the guard skipped the update between the two passes.
fn skipped(pass: &Pass, next: &Pass) -> bool {
    pass.inverse == next.inverse
}

/// A + w wᵀ / wᵀv.
fn rank_one(matrix: &DMatrix<f64>, w: &DVector<f64>, v: &DVector<f64>) -> DMatrix<f64> {
    matrix + w * w.transpose() / w.dot(v)
}

/// What rounding makes of w wᵀ / wᵀv, for an error `noise` of w: |wᵀv| is `relative` ‖w‖ ‖v‖.
fn update_error(noise: f64, v: &DVector<f64>, relative: f64) -> f64 {
    (2.0 + 1.0 / relative) * noise / (relative * v.norm())
}

proptest! {
    #![proptest_config(config())]

    /// Lemma 1.
    #[test]
    fn lemma_1_nothing_leaves_the_range(change in changes()) {
        let case = Case::new(change);
        for (k, pass) in case.solved.passes.iter().enumerate() {
            assert_within(&format!("r_{} outside", k + 1), case.outside(&pass.r), case.noise);
            assert_within(&format!("y_{k} outside"), case.outside(&pass.y), case.noise);
            assert_within(&format!("s_{k} outside"), case.outside(&pass.s), case.gain * case.noise);
            assert_within(&format!("x_{} outside", k + 1), case.outside(&pass.x), case.gain * case.noise);
        }
    }

    /// Lemma 2, one step, nothing asked of F: update k makes Hₖ₊₁ yₖ = sₖ, and multiplies the error of an earlier
    /// H yᵢ = sᵢ by 1 + 1/δ at most, δ its relative denominator, besides its own rounding.
    #[test]
    fn lemma_2_an_update_keeps_the_secant_conditions_of_the_earlier_ones(change in any_changes()) {
        let case = Case::new(change);
        let error = case.gain * case.noise;
        for (k, pass, next) in case.pairs() {
            if skipped(pass, next) {
                continue;
            }
            let delta = pass.relative_denominator();
            let gap = |inverse: &DMatrix<f64>, pair: &Pass| (inverse * &pair.y - &pair.s).norm();
            assert_within(&format!("H_{} y_{k} = s_{k}", k + 1), gap(&next.inverse, pass), error / delta);
            for (i, pair) in case.solved.passes[..k].iter().enumerate() {
                let own = error * (1.0 + pair.y.norm() / (delta * pass.y.norm()));
                let bound = (1.0 + 1.0 / delta) * gap(&pass.inverse, pair) + own;
                assert_within(&format!("H_{} y_{i} = s_{i}", k + 1), gap(&next.inverse, pair), bound);
            }
        }
    }

    /// Lemma 2 over a whole solve, under the theorem's hypothesis: Hₖ yᵢ = sᵢ for every i < k, and with it xₖ₊₁ = Hₖ b.
    #[test]
    fn lemma_2_every_secant_condition_is_kept(change in changes()) {
        let case = Case::new(change);
        let rhs = case.change.rhs();
        for (k, pass) in case.solved.passes.iter().enumerate() {
            for (i, pair) in case.solved.passes[..k].iter().enumerate() {
                let gap = (&pass.inverse * &pair.y - &pair.s).norm();
                assert_within(&format!("H_{k} y_{i} = s_{i}"), gap, SECANT * pair.s.norm());
            }
            let gap = (&case.truth * &pass.y - &pass.s).norm();
            assert_within(&format!("A⁺ y_{k} = s_{k}"), gap, case.gain * case.noise);
            let gap = (&pass.x - &pass.inverse * &rhs).norm();
            assert_within(&format!("x_{} = H_{k} b", k + 1), gap, SECANT * pass.x.norm());
        }
    }

    /// Lemma 3: sₖ₊₁ = αₖ (E − Hₖ A) sₖ, with A applied to sₖ and not taken from yₖ. Nothing is asked of F. Where the
    /// guard skips an update, αₖ = 1.
    #[test]
    fn lemma_3_a_step_is_collinear_with_what_the_last_one_missed(change in any_changes()) {
        let case = Case::new(change);
        for (k, pass, next) in case.pairs() {
            let alpha = if skipped(pass, next) { 1.0 } else { alpha(pass) };
            let missed = &pass.s - &pass.inverse * (&case.change.matrix * &pass.s);
            let gap = (&next.s - missed * alpha).norm();
            let error = (1.0 + alpha.abs()) * case.gain * case.noise;
            assert_within(&format!("s_{} = α (E − H A) s_{k}", k + 1), gap, error);
        }
    }

    /// Lemma 4 in numbers: with t the part of sₖ₊₁ across sₖ, rₖ₊₂ = (A − Aₖ₊₁) t, Aₖ₊₁ = Hₖ₊₁⁺. A step along
    /// the last one (t = 0) therefore ends the solve; any other has t ≥ ‖rₖ₊₂‖ / ‖A − Aₖ₊₁‖.
    #[test]
    fn lemma_4_a_step_along_the_last_one_ends_the_solve(change in changes()) {
        let case = Case::new(change);
        for (k, pass, next) in case.pairs() {
            let across = &next.s - &pass.s * (pass.s.dot(&next.s) / pass.s.norm_squared());
            let direct = case.change.pseudo_inverse(&next.inverse);
            let gap = (&next.r - (&case.change.matrix - direct) * across).norm();
            assert_within(&format!("r_{} = (A − A_{}) t", k + 2, k + 1), gap, case.noise);
        }
    }

    /// Lemma 5: sₖᵀ A sᵢ = 0 for i ≤ k − 2.
    #[test]
    fn lemma_5_a_step_is_conjugate_to_all_but_the_last(change in changes()) {
        let case = Case::new(change);
        for (k, pass) in case.solved.passes.iter().enumerate() {
            for (i, pair) in case.solved.passes[..k.saturating_sub(1)].iter().enumerate() {
                let error = case.noise * pass.s.norm().max(pair.s.norm());
                assert_within(&format!("s_{k}ᵀ A s_{i}"), pass.s.dot(&pair.y).abs(), error);
            }
        }
    }

    /// Lemma 6: C positive definite, D semidefinite of rank r. C D has rank r and the eigenvalues of Lᵀ D L, C = L Lᵀ,
    /// which are real and ≥ 0. It is symmetric where C and D commute, and there only: the paper calls it so without
    /// more ado.
    #[test]
    fn lemma_6_a_product_has_the_rank_and_real_eigenvalues((c, d, rank) in products()) {
        let product = &c * &d;
        let n = product.nrows();
        let scale = product.norm();
        let faer = |matrix: &DMatrix<f64>| Mat::from_fn(n, n, |row, col| matrix[(row, col)]);

        let singular = Svd::new(faer(&product).as_ref()).expect("finite");
        let above = |value: &&f64| **value > SOLVED * scale;
        prop_assert_eq!(singular.S().column_vector().iter().filter(above).count(), rank);

        let factor = c.clone().cholesky().expect("positive definite").l();
        let like = factor.tr_mul(&(&d * &factor));
        let like = faer(&((&like + like.transpose()) * 0.5));
        let expected = like.self_adjoint_eigenvalues(Side::Lower).expect("finite");
        let mut eigenvalues = faer(&product).eigenvalues().expect("finite");
        eigenvalues.sort_by(|a, b| a.re.total_cmp(&b.re));
        for (value, expected) in eigenvalues.iter().zip(&expected) {
            assert_within("imaginary part", value.im.abs(), SOLVED * scale);
            assert_within("eigenvalue of Lᵀ D L", (value.re - expected).abs(), SOLVED * scale);
            prop_assert!(value.re > -SOLVED * scale, "{}", value);
        }
        let asymmetry = (&product - product.transpose()).norm();
        let commutator = (&product - &d * &c).norm();
        assert_within("asymmetry is the commutator", (asymmetry - commutator).abs(), ROUNDING * scale);
    }

    /// (17), (19): Hₖ₊₁ = Hₖ − (ΔH A sₖ)(ΔH A sₖ)ᵀ / sₖᵀ A ΔH A sₖ with ΔH = Hₖ − A⁺, and ΔHₖ₊₁ yₖ = 0.
    #[test]
    fn formulas_17_and_19_an_update_takes_out_the_error_along_y(change in changes()) {
        let case = Case::new(change);
        for (k, pass, next) in case.pairs() {
            let delta = pass.relative_denominator();
            let image = &case.change.matrix * &pass.s;
            let wrong = (&pass.inverse - &case.truth) * &image;
            let expected = rank_one(&pass.inverse, &wrong, &-&image);
            let error = update_error(case.gain * case.noise, &pass.y, delta);
            assert_within(&format!("H_{}", k + 1), (&next.inverse - expected).norm(), error);
            let left = ((&next.inverse - &case.truth) * &pass.y).norm();
            assert_within(&format!("ΔH_{} y_{k}", k + 1), left, case.gain * case.noise * (1.0 + 1.0 / delta));
        }
    }

    /// (20), (21): Aₖ₊₁ = Aₖ + v vᵀ / vᵀ sₖ with v = yₖ − Aₖ sₖ stays the pseudo-inverse of Hₖ₊₁, and Aₖ₊₁ sᵢ = yᵢ for
    /// every i ≤ k, with the same growth of rounding errors as in Lemma 2.
    #[test]
    fn formulas_20_and_21_the_direct_form_stays_the_pseudo_inverse(change in changes()) {
        let case = Case::new(change);
        let range = &case.change.before.range;
        let projector = range * range.transpose();
        let mut direct = case.change.before.matrix.clone();
        // A_k lies between A₀ and A, and so do its errors between those of their products.
        let size = direct.norm().max(case.change.matrix.norm());
        let longest = case.solved.passes.iter().map(|pass| pass.x.norm()).fold(0.0, f64::max);
        let noise = case.noise + ROUNDING * size * longest;
        let mut error = ROUNDING * size * case.gain;
        for (k, pass, next) in case.pairs() {
            let gap = |direct: &DMatrix<f64>, pair: &Pass| (direct * &pair.s - &pair.y).norm();
            let v = &pass.y - &direct * &pass.s;
            let (of_h, of_a) = (pass.relative_denominator(), v.dot(&pass.s).abs() / (v.norm() * pass.s.norm()));
            let earlier = case.solved.passes[..k].iter().map(|pair| gap(&direct, pair)).collect::<Vec<_>>();
            direct = rank_one(&direct, &v, &pass.s);

            error += size * update_error(case.gain * case.noise, &pass.y, of_h);
            error += case.gain * update_error(noise, &pass.s, of_a);
            let what = format!("A_{} H_{} = E", k + 1, k + 1);
            assert_within(&what, (&direct * &next.inverse - &projector).norm(), error);
            assert_within(&format!("A_{} s_{k} = y_{k}", k + 1), gap(&direct, pass), noise / of_a);
            for (i, (pair, earlier)) in case.solved.passes.iter().zip(earlier).enumerate() {
                let own = noise * (1.0 + pair.s.norm() / (of_a * pass.s.norm()));
                let bound = (1.0 + 1.0 / of_a) * earlier + own;
                assert_within(&format!("A_{} s_{i} = y_{i}", k + 1), gap(&direct, pair), bound);
            }
        }
    }

    /// Finite termination: x₁ = H₀ b and at most r₁ iterations, together the paper's r₁ + 1 steps (r + 1 for r₁ = r).
    /// While the null space stands still the solution has minimum norm, and an H that needed all of them is A⁺. What
    /// rounding leaves of the residual can cost one iteration more (1 of 400 000 random cases).
    #[test]
    fn a_change_of_rank_r1_takes_at_most_r1_iterations(change in changes()) {
        let case = Case::new(change);
        let (info, rank) = (case.solved.info, case.change.rank);
        prop_assert!(info.iterations <= rank + 1, "{} iterations for rank {}", info.iterations, rank);
        if let Some(last) = case.solved.passes.get(rank) {
            assert_within("residual after r₁", last.r.norm(), SECANT * case.change.rhs().norm());
        }
        prop_assert_eq!(info.fallbacks, 0);
        prop_assert_eq!(info.products, 2 + 2 * info.iterations, "start, and two an iteration");

        let gap = (&case.solved.x - case.solution()).norm();
        let error = case.truth.norm() * (PARAMS.eps_abs + SOLVED * case.change.rhs().norm());
        assert_within("x = A⁺ b", gap, error);
        if info.iterations == rank {
            let gap = (case.solved.inverse() - &case.truth).norm();
            assert_within("H = A⁺", gap, LEARNT * case.truth.norm());
        }
    }

    /// Finite termination where F has no sign: denominators get small, and their rounding can cost one iteration more
    /// (135 of 100 000 random cases; none took two).
    #[test]
    fn a_change_without_a_sign_takes_at_most_one_iteration_more(change in any_changes()) {
        let solved = change.solve();
        let most = change.rank + 1;
        prop_assert!(solved.info.iterations <= most, "{} iterations, rank {}", solved.info.iterations, change.rank);
    }

    /// The theorem, for F of either sign: Hₖ stays positive definite on P, ‖Fₖ‖ and ‖Hₖ − A⁺‖ fall, no denominator
    /// vanishes (they have the sign of F), and ‖xₖ − x*‖ falls by ‖F‖ ‖A₀⁺‖ < 1 a step or faster. For F ≥ 0 the rate
    /// follows from xₖ₊₂ − x* = Hₖ₊₁ Fₖ₊₁ (xₖ₊₁ − x*), ‖Hₖ‖ ≤ ‖H₀‖ and ‖Fₖ‖ ≤ ‖F‖; for F ≤ 0 it is measured.
    #[test]
    fn theorem_errors_fall_monotonically(change in changes()) {
        let case = Case::new(change);
        let f = case.change.on_range(&case.change.difference()).symmetric_eigenvalues();
        let smallest = case.change.on_range(&case.change.before.matrix).symmetric_eigenvalues().min();
        let (sign, rate) = (f.sum().signum(), f.amax() / smallest);
        prop_assert!(rate < 1.0);
        let solution = case.solution();
        let distance = |x: &DVector<f64>| (x - &solution).norm();
        let first = distance(&case.solved.passes[0].x);
        assert_within("‖x_1 − x*‖", first, rate * solution.norm() + case.gain * case.noise);
        for (k, pass, next) in case.pairs() {
            let denominator = sign * pass.hr().dot(&pass.y);
            prop_assert!(denominator > 0.0, "denominator {k}: {denominator:e}");
            let fallen = rate * distance(&pass.x) + case.gain * case.noise;
            assert_within(&format!("‖x_{} − x*‖", k + 2), distance(&next.x), fallen);
        }
        inverse_gets_better(&case);
    }

    /// For F ≥ 0 the part of the theorem that is about H needs no bound on ‖F‖.
    #[test]
    fn theorem_on_the_inverse_holds_for_positive_changes_of_any_size(
        change in semidefinite_changes(1.0..20.0, Just(1.0)),
    ) {
        inverse_gets_better(&Case::new(change));
    }
}

/// ‖Hₖ − A⁺‖ and ‖Fₖ‖ = ‖Hₖ⁺ − A‖ fall; Hₖ stays symmetric, on P, and positive definite there.
#[track_caller]
fn inverse_gets_better(case: &Case) {
    let change = &case.change;
    let (mut of_h, mut of_f) = (f64::INFINITY, f64::INFINITY);
    for (k, pass) in case.solved.passes.iter().enumerate() {
        let inverse = &pass.inverse;
        let (next_h, next_f) =
            ((inverse - &case.truth).norm(), (change.pseudo_inverse(inverse) - &change.matrix).norm());
        assert_within(&format!("‖H_{k} − A⁺‖"), next_h, of_h + ROUNDING * case.truth.norm());
        assert_within(&format!("‖F_{k}‖"), next_f, of_f + ROUNDING * change.matrix.norm());
        (of_h, of_f) = (next_h, next_f);
        let outside = (inverse - change.before.range_part(inverse)).norm();
        assert_within(&format!("H_{k} outside the range"), outside, ROUNDING * inverse.norm());
        let asymmetry = (inverse - inverse.transpose()).norm();
        assert_within(&format!("asymmetry of H_{k}"), asymmetry, ROUNDING * inverse.norm());
        assert!(
            change.on_range(inverse).cholesky().is_some(),
            "H_{k} is not positive definite on the range: {inverse}"
        );
    }
}

/// C positive definite with eigenvalues in [0.1, 10], D semidefinite of rank r with nonzero ones in [0.3, 1], and r.
fn products() -> impl Strategy<Value = (DMatrix<f64>, DMatrix<f64>, usize)> {
    let shapes = (1..=8_usize).prop_flat_map(|n| (Just(n), 1..=n));
    let parts = shapes
        .prop_flat_map(|(n, r)| (orthonormal(n, n), vec(0.1..10.0, n), orthonormal(n, r), vec(0.3..1.0, r)));
    parts.prop_map(|(axes, values, range, weights)| {
        let rank = weights.len();
        let of = |axes: &DMatrix<f64>, values: Vec<f64>| {
            axes * DMatrix::from_diagonal(&DVector::from_vec(values)) * axes.transpose()
        };
        (of(&axes, values), of(&range, weights), rank)
    })
}

// What the claims leave out, on systems small enough to follow by hand.

/// The passes of A x = b from H₀ = E, and how many of its updates were skipped.
fn from_identity(matrix: [[f64; 2]; 2], rhs: [f64; 2]) -> (Vec<Pass>, usize) {
    let mut traced = Traced::new(PARAMS);
    traced.solver.start_from(&[1.0, 0.0, 0.0, 1.0], 2).expect("square");
    let (_, info) = solve(&mut traced, &mut rows(matrix, rhs));
    (traced.passes, info.fallbacks)
}

#[track_caller]
fn assert_near(what: &str, value: &DVector<f64>, expected: [f64; 2]) {
    let gap = (value - DVector::from_column_slice(&expected)).norm();
    assert_within(what, gap, ROUNDING);
}

/// Lemma 4 excepts no step, but the last one may well run along the one before it.
#[test]
fn lemma_4_does_not_hold_for_the_last_step() {
    let (passes, _) = from_identity([[2.0, 0.0], [0.0, 2.0]], [1.0, 3.0]);
    assert_eq!(passes.len(), 2);
    assert_near("s_0", &passes[0].s, [1.0, 3.0]);
    assert_near("s_1 = −s_0 / 2", &passes[1].s, [-0.5, -1.5]);
}

/// sₖ₊₁ᵀ A sₖ = rₖ₊₁ᵀ Hₖ rₖ₊₁ − rₖ₊₁ᵀ Hₖ yₖ: 0.29 − 0.99 here.
#[test]
fn lemma_5_does_not_hold_for_the_last_step_but_one() {
    let (passes, _) = from_identity([[1.5, 0.0], [0.0, 1.2]], [1.0, 1.0]);
    assert_within("s_1ᵀ A s_0 + 0.7", (passes[1].s.dot(&passes[0].y) + 0.7).abs(), ROUNDING);
}

#[test]
fn lemma_6_says_nothing_of_symmetry() {
    let (c, d) = (DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 2.0]), DMatrix::from_element(2, 2, 1.0));
    assert_eq!(&c * &d, DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 2.0, 2.0]));
}

/// F = diag(3, 0), ‖F‖ ‖A₀⁺‖ = 3: x₁ is three times as far from x* as x₀ = 0.
#[test]
fn theorem_needs_its_bound_for_the_solution_to_get_nearer() {
    let (passes, _) = from_identity([[4.0, 0.0], [0.0, 1.0]], [4.0, 0.0]);
    assert_near("x_1, x* = (1, 0)", &passes[0].x, [4.0, 0.0]);
}

/// F = diag(1, −½) is within the bound, but has two signs: H₁ is no longer positive definite, and x₂ lies farther from
/// x* = (½, 4) than x₁.
#[test]
fn theorem_needs_a_sign() {
    let (passes, _) = from_identity([[2.0, 0.0], [0.0, 0.5]], [1.0, 2.0]);
    let swap = DMatrix::from_row_slice(2, 2, &[0.0, 1.0, 1.0, 0.0]);
    assert_within("H_1", (&passes[1].inverse - swap).norm(), ROUNDING);
    assert_near("x_1", &passes[0].x, [1.0, 2.0]);
    assert_near("x_2", &passes[1].x, [2.0, 1.0]);
}

/// F = diag(1, −⅓): r₁ᵀ H₀ y₀ = 0 in the first iteration of three, which the guard answers by skipping the update.
#[test]
fn theorem_needs_a_sign_for_the_denominators_too() {
    let (passes, fallbacks) = from_identity([[2.0, 0.0], [0.0, 2.0 / 3.0]], [1.0, 3.0]);
    assert_near("r_1", &passes[0].r, [1.0, -1.0]);
    assert_near("y_0", &passes[0].y, [2.0, 2.0]);
    assert_eq!((passes.len() - 1, fallbacks), (3, 1));
}
