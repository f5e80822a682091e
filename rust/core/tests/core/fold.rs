//! Folding changes nothing but the work: the same minimum-norm least-squares solution as without it, whatever the rows do.

use crate::support::{
    MOVED, Mechanism, ROUNDING, SOLVED, assert_within, config, dense, matrix_of, mechanisms, numbers,
    psd_systems, rhs_of, rows, scales, solve, solver,
};
use nalgebra::DVector;
use oarlock_core::problem::{FOLD_TOLERANCE, Fold};
use oarlock_core::{ConstrainedSystem, Info, MultiplierSolver, StepView};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

/// A factor between proportional rows: either sign, and not so small that the copy counts as zero.
fn factors() -> impl Strategy<Value = f64> {
    (any::<bool>(), -3.0..3.0_f64).prop_map(|(negative, exponent)| {
        let size = 10.0_f64.powf(exponent);
        if negative { -size } else { size }
    })
}

/// Mechanisms with some more proportional rows.
fn copied() -> impl Strategy<Value = (Mechanism, usize)> {
    (mechanisms(), vec((any::<Index>(), factors()), 0..4)).prop_map(|(mut mechanism, copies)| {
        for (source, factor) in &copies {
            mechanism = mechanism.with_copy(source.index(mechanism.aref.len()), *factor);
        }
        (mechanism, copies.len())
    })
}

/// Multipliers, accelerations and figures of one step.
type Solved = (DVector<f64>, DVector<f64>, Info);

fn solve_step(
    solver: &mut dyn MultiplierSolver,
    system: &mut ConstrainedSystem,
    step: &StepView<'_>,
) -> Solved {
    system.assemble(step).expect("a good step");
    let (x, info) = solve(solver, system);
    let (mut qfrc, mut qacc) = (DVector::zeros(system.nv()), DVector::zeros(system.nv()));
    system.acceleration(x.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice()).expect("matching lengths");
    (x, qacc, info)
}

/// The same by the reference and without folding: rows that are soft by nothing are not folded.
fn unfolded(step: &StepView<'_>) -> Solved {
    let softness = vec![0.0; step.aref.len()];
    let soft = StepView { regularisation: Some(&softness), ..*step };
    let solved = solve_step(&mut *solver("pinv"), &mut ConstrainedSystem::new(), &soft);
    assert_eq!(solved.2.folded, 0);
    solved
}

/// `condition`: how much a proportional row adds to the condition number on the range, Σt² of its class.
#[track_caller]
fn assert_same(what: &str, folded: &Solved, plain: &Solved, condition: f64) {
    let (x, qacc, info) = folded;
    assert_within(&format!("{what}: λ {info:?}"), (x - &plain.0).norm(), MOVED * condition * plain.0.norm());
    let scale = MOVED * condition * plain.1.norm().max(1.0);
    assert_within(&format!("{what}: a {info:?}"), (qacc - &plain.1).norm(), scale);
}

/// Largest over smallest length of the rows that are not zero, squared: bounds what scaling rows does to the condition.
fn spread(mechanism: &Mechanism) -> f64 {
    let lengths = mechanism.jacobian_t.column_iter().map(|row| row.norm()).filter(|length| *length > 0.0);
    let (smallest, largest) =
        lengths.fold((f64::INFINITY, 0.0_f64), |(low, high), length| (low.min(length), high.max(length)));
    (largest / smallest).powi(2)
}

proptest! {
    #![proptest_config(config())]

    /// A⁺ = T Â⁺ Tᵀ, against the pseudo-inverse on the range that the systems are made from.
    #[test]
    fn a_dense_system_has_its_minimum_norm_solution(system in psd_systems()) {
        let range = &system.range;
        let image = range.tr_mul(&(&system.matrix * range)).try_inverse().expect("regular on the range");
        let truth = range * &image * range.tr_mul(&system.rhs);
        let (x, info) = solve(&mut *solver("pinv"), &mut dense(&system.matrix, &system.rhs));
        let zeros = system.matrix.row_iter().filter(|row| row.norm() == 0.0).count();
        prop_assert!(info.folded >= zeros, "{:?}", info);
        // The truth's own error: its range is orthonormal to rounding, and b may be all contradiction but for that.
        let rounding = truth.len() as f64 * f64::EPSILON * image.norm() * system.rhs.norm();
        assert_within("x = A⁺ b", (&x - &truth).norm(), SOLVED * truth.norm() + rounding);
        let outside = (&system.rhs - system.consistent_rhs()).norm();
        let gap = (info.inconsistency.expect("pinv knows") - outside).abs();
        assert_within("‖b − P b‖", gap, SOLVED * system.rhs.norm());
    }

    #[test]
    fn a_mechanism_has_the_multipliers_and_accelerations_of_the_unfolded_one((mechanism, copies) in copied()) {
        let step = mechanism.view();
        let folded = solve_step(&mut *solver("pinv"), &mut ConstrainedSystem::new(), &step);
        prop_assert!(folded.2.folded >= copies, "{:?}", folded.2);
        assert_same("folded", &folded, &unfolded(&step), spread(&mechanism));
    }

    /// Duplicated rows that ask for different things: least squares, and the contradiction is reported in full.
    #[test]
    fn contradicting_copies_are_solved_by_least_squares_and_reported(
        (mechanism, _) in copied(),
        noise in numbers(16),
    ) {
        let mut mechanism = mechanism;
        for (aref, noise) in mechanism.aref.iter_mut().zip(&noise) {
            *aref += noise;
        }
        let step = mechanism.view();
        let (folded, plain) =
            (solve_step(&mut *solver("pinv"), &mut ConstrainedSystem::new(), &step), unfolded(&step));
        assert_same("folded", &folded, &plain, spread(&mechanism));
        let reported = |solved: &Solved| solved.2.inconsistency.expect("pinv knows");
        let gap = (reported(&folded) - reported(&plain)).abs();
        assert_within("‖b − P b‖", gap, MOVED * spread(&mechanism) * mechanism.aref.norm().max(1.0));
    }

    /// The factors are fitted anew every step; the classes are planned once.
    #[test]
    fn factors_may_move((mechanism, _) in copied(), source in any::<Index>(), moving in vec(factors(), 2..6)) {
        let source = source.index(mechanism.aref.len());
        let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
        for (k, &factor) in moving.iter().enumerate() {
            let mechanism = mechanism.with_copy(source, factor);
            let folded = solve_step(&mut *pinv, &mut system, &mechanism.view());
            prop_assert!(folded.2.folded >= 1 && !folded.2.refolded, "step {}: {:?}", k, folded.2);
            assert_same(&format!("step {k}"), &folded, &unfolded(&mechanism.view()), spread(&mechanism));
        }
        prop_assert_eq!(system.refolds(), 0);
    }

    /// A row that leaves its class costs one event, and no digit.
    #[test]
    fn classes_that_stop_holding_are_found_anew(
        (mechanism, _) in copied(),
        source in any::<Index>(),
        factor in factors(),
    ) {
        // One more velocity, which no row touches before the last one does.
        let mut together = mechanism.with_copy(source.index(mechanism.aref.len()), factor);
        let nv = together.force.len();
        together.mass = together.mass.insert_row(nv, 0.0).insert_column(nv, 0.0);
        together.mass[(nv, nv)] = 1.0;
        together.force = together.force.insert_row(nv, 1.0);
        together.jacobian_t = together.jacobian_t.insert_row(nv, 0.0);
        let mut apart = together.clone();
        let last = apart.aref.len() - 1;
        apart.jacobian_t[(nv, last)] = 1.0;
        let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
        for (k, (step, refolded)) in
            [(&together, false), (&together, false), (&apart, true), (&apart, false)].into_iter().enumerate()
        {
            let (_, _, info) = solve_step(&mut *pinv, &mut system, &step.view());
            prop_assert_eq!(info.refolded, refolded, "step {}: {:?}", k, info);
        }
        prop_assert_eq!(system.refolds(), 1);
        // A fold found anew is the fold that a new system finds.
        let mut new = ConstrainedSystem::new();
        new.assemble(&apart.view()).expect("a good step");
        prop_assert_eq!(system.fold(), new.fold());
    }

    /// TᵀT = E, and what reduce says lies outside range(T) is what expand cannot give back.
    #[test]
    fn reduce_and_expand_are_adjoint_and_orthonormal((mechanism, _) in copied(), b in numbers(16), z in numbers(16)) {
        let (n, nv) = (mechanism.aref.len(), mechanism.force.len());
        let fold = Fold::find(mechanism.jacobian_t.as_slice(), nv);
        let (b, z) = (b.rows(0, n).into_owned(), z.rows(0, fold.reduced()).into_owned());
        let (mut full, mut back, mut reduced) = (DVector::zeros(n), z.clone(), z.clone());
        fold.expand(z.as_slice(), full.as_mut_slice());
        let outside = fold.reduce(full.as_slice(), back.as_mut_slice());
        assert_within("Tᵀ T z = z", (&back - &z).norm().max(outside), ROUNDING);
        let outside = fold.reduce(b.as_slice(), reduced.as_mut_slice());
        assert_within("(Tᵀ b) · z = b · T z", (reduced.dot(&z) - b.dot(&full)).abs(), ROUNDING);
        fold.expand(reduced.as_slice(), full.as_mut_slice());
        assert_within("‖b − T Tᵀ b‖", ((&b - &full).norm() - outside).abs(), ROUNDING);
    }

    /// One unit for all rows is as good as another.
    #[test]
    fn the_fold_does_not_depend_on_the_scale((mechanism, _) in copied(), scale in scales()) {
        let nv = mechanism.force.len();
        // A power of two keeps every rounding as it is.
        let scale = scale.log2().round().exp2();
        let scaled = &mechanism.jacobian_t * scale;
        prop_assert_eq!(Fold::find(scaled.as_slice(), nv), Fold::find(mechanism.jacobian_t.as_slice(), nv));
    }

    #[test]
    fn soft_rows_are_left_alone((mechanism, _) in copied()) {
        let softness = vec![0.5; mechanism.aref.len()];
        let soft = StepView { regularisation: Some(&softness), ..mechanism.view() };
        let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
        // Whether the same system was hard before or is hard again.
        let hard = solve_step(&mut *pinv, &mut system, &mechanism.view());
        let (x, _, info) = solve_step(&mut *pinv, &mut system, &soft);
        prop_assert!(info.folded == 0 && !info.refolded && system.fold().is_identity(), "{:?}", info);
        let gap = (matrix_of(&system) * x - rhs_of(&system)).norm();
        assert_within("(A + R) x = b", gap, MOVED * spread(&mechanism) * rhs_of(&system).norm());
        let again = solve_step(&mut *pinv, &mut system, &mechanism.view());
        prop_assert_eq!(hard, again);
        prop_assert_eq!(system.refolds(), 0);
    }
}

#[test]
fn zero_rows_and_signs_are_folded_as_written() {
    // Rows 0, 2 and 4 are 1 : −2 : ½; row 1 is zero; row 3 stands alone.
    let jacobian = [1.0, 2.0, 0.0, 0.0, -2.0, -4.0, 3.0, 1.0, 0.5, 1.0];
    let fold = Fold::find(&jacobian, 2);
    assert_eq!((fold.rows(), fold.reduced(), fold.is_identity()), (5, 2, false));
    assert_eq!(fold.classes().collect::<Vec<_>>(), [(0, 5.25_f64.sqrt()), (3, 1.0)]);
    let mut full = [f64::NAN; 5];
    fold.expand(&[5.25_f64.sqrt(), 7.0], &mut full);
    for (entry, expected) in full.into_iter().zip([1.0, 0.0, -2.0, 7.0, 0.5]) {
        assert_within("T z", (entry - expected).abs(), ROUNDING);
    }
    // A zero row that asks for something, and copies that do not agree.
    let mut reduced = [0.0; 2];
    let outside = fold.reduce(&[1.0, 3.0, 2.0, 0.0, 0.0], &mut reduced);
    assert_within("Tᵀ b", (reduced[0] + 3.0 / 5.25_f64.sqrt()).abs().max(reduced[1].abs()), ROUNDING);
    assert_within("b − T Tᵀ b", (outside - (14.0 - 9.0 / 5.25_f64).sqrt()).abs(), ROUNDING);
}

#[test]
fn every_way_for_a_class_to_stop_holding_is_noticed() {
    let cases: [(&str, [f64; 6], [f64; 6]); 4] = [
        ("a copy turns away", [1.0, 2.0, 2.0, 4.0, 1.0, 0.0], [1.0, 2.0, 2.0, 4.1, 1.0, 0.0]),
        ("a zero row comes to life", [1.0, 2.0, 0.0, 0.0, 1.0, 0.0], [1.0, 2.0, 3.0, 1.0, 1.0, 0.0]),
        ("a representative vanishes", [1.0, 2.0, 2.0, 4.0, 1.0, 0.0], [0.0, 0.0, 2.0, 4.0, 1.0, 0.0]),
        ("everything vanishes", [1.0, 2.0, 2.0, 4.0, 1.0, 0.0], [0.0; 6]),
    ];
    for (name, before, after) in cases {
        let step = |jacobian: &'static [f64]| StepView {
            mass: &[1.0, 0.0, 0.0, 1.0],
            jacobian,
            force: &[0.0, 0.0],
            aref: &[1.0, 2.0, 3.0],
            regularisation: None,
        };
        let (before, after) = (step(Box::leak(Box::new(before))), step(Box::leak(Box::new(after))));
        let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
        assert!(!solve_step(&mut *pinv, &mut system, &before).2.refolded, "{name}");
        let folded = solve_step(&mut *pinv, &mut system, &after);
        assert!(folded.2.refolded, "{name}");
        assert_same(name, &folded, &unfolded(&after), 100.0);
        assert!(!solve_step(&mut *pinv, &mut system, &after).2.refolded, "{name}");
        assert_eq!(system.refolds(), 1, "{name}");
    }
}

#[test]
fn a_shrunken_copy_keeps_its_class_and_a_vanished_one_too() {
    // t = 0 is a factor like any other; only a representative has to be there.
    let jacobian = |t: f64| [1.0, 2.0, t, 2.0 * t];
    let mut fold = Fold::find(&jacobian(1.0), 2);
    for t in [0.1, -1e-3, 1e-9, 0.0, 1.0] {
        assert!(fold.refit(&jacobian(t), 2), "t = {t}");
        let (_, scale) = fold.classes().next().expect("one class");
        assert_within(&format!("√Σt² at t = {t}"), (scale - (1.0 + t * t).sqrt()).abs(), ROUNDING);
    }
    assert!(!fold.refit(&[0.0, 0.0, 1.0, 2.0], 2), "the representative is gone");
    assert!(!fold.refit(&[1.0, 2.0], 2), "another shape");
}

#[test]
fn the_tolerance_separates_rounding_from_a_real_difference() {
    let turned = |by: f64| Fold::find(&[1.0, 0.0, 2.0, 2.0 * by], 2).reduced();
    assert_eq!((turned(0.5 * FOLD_TOLERANCE), turned(2.0 * FOLD_TOLERANCE)), (1, 2));
    let short = |length: f64| Fold::find(&[1.0, 0.0, 0.0, length], 2).reduced();
    assert_eq!((short(0.5 * FOLD_TOLERANCE), short(2.0 * FOLD_TOLERANCE)), (1, 2));
}

#[test]
fn sizes_whose_squares_overflow_are_not_mistaken_for_zero_or_for_one_another() {
    for size in [1e-200, 1e200] {
        let fold = Fold::find(&[size, 0.0, 0.0, size, 0.0, 0.0], 2);
        assert_eq!((fold.reduced(), fold.rows()), (2, 3), "{size:e}");
    }
}

#[test]
fn a_dense_contradiction_between_copies_is_reported_in_full() {
    // Row 1 is −2 times row 0, and b is not.
    let (x, info) = solve(&mut *solver("pinv"), &mut rows([[1.0, -2.0], [-2.0, 4.0]], [1.0, 1.0]));
    // A = 5 u uᵀ, u = (1, −2)/√5: x = u (u·b) / 5, and of b the part along (2, 1)/√5 is left.
    assert_eq!((info.folded, info.rank), (1, Some(1)));
    assert_within("x", (x[0] + 0.04).abs().max((x[1] - 0.08).abs()), ROUNDING);
    assert_within(
        "‖b − P b‖",
        (info.inconsistency.expect("pinv knows") - 3.0 / 5.0_f64.sqrt()).abs(),
        ROUNDING,
    );
}
