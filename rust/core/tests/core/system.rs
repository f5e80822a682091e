//! A λ = b against an independent computation, the way back to accelerations, reuse, and every refusal of bad input.

use crate::support::{
    MOVED, Mechanism, assert_within, config, matrix_of, mechanisms, motion, numbers, rhs_of, solver,
};
use nalgebra::{DMatrix, DVector};
use oarlock_core::{ConstrainedSystem, Error, SOLVERS, StepView, Wanted};
use proptest::collection::vec;
use proptest::prelude::*;

/// M⁻¹ v by LU, where the code under test uses Cholesky.
fn divide(mass: &DMatrix<f64>, v: &DMatrix<f64>) -> DMatrix<f64> {
    mass.clone().lu().solve(v).expect("M is regular")
}

/// Everything that a system holds, through its public face: A, b, a₀, and Jᵀλ and a for λ = (1, …, 1).
fn contents(system: &mut ConstrainedSystem) -> [Vec<f64>; 5] {
    let ones = vec![1.0; system.len()];
    let (mut qfrc, mut qacc) = (vec![f64::NAN; system.nv()], vec![f64::NAN; system.nv()]);
    system.acceleration(&ones, &mut qfrc, &mut qacc).expect("matching lengths");
    let (matrix, rhs, unconstrained) =
        (&matrix_of(system), rhs_of(system), DVector::from_column_slice(system.unconstrained()));
    [matrix.as_slice().to_vec(), rhs.as_slice().to_vec(), unconstrained.as_slice().to_vec(), qfrc, qacc]
}

fn fresh(fill: impl FnOnce(&mut ConstrainedSystem) -> Result<(), Error>) -> [Vec<f64>; 5] {
    let mut system = ConstrainedSystem::new();
    fill(&mut system).expect("good input");
    contents(&mut system)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn the_system_is_that_of_the_textbook(mechanism in mechanisms()) {
        let Mechanism { mass, jacobian_t, force, aref } = &mechanism;
        let mut system = ConstrainedSystem::new();
        system.assemble(&mechanism.view()).unwrap();
        let expected = jacobian_t.tr_mul(&divide(mass, jacobian_t));
        assert_within("A = J M⁻¹ Jᵀ", (matrix_of(&system) - &expected).norm(), MOVED * expected.norm());
        prop_assert_eq!(matrix_of(&system), matrix_of(&system).transpose(), "symmetric to the last bit");
        let free = divide(mass, &DMatrix::from_columns(std::slice::from_ref(force))).column(0).into_owned();
        assert_within("a₀ = M⁻¹ f", (DVector::from_column_slice(system.unconstrained()) - &free).norm(), MOVED * free.norm());
        let rhs = aref - jacobian_t.tr_mul(&free);
        assert_within("b = aref − J M⁻¹ f", (rhs_of(&system) - &rhs).norm(), MOVED * (aref.norm() + free.norm()));
    }

    #[test]
    fn any_multipliers_give_the_acceleration_of_their_forces(
        (mechanism, multipliers) in mechanisms().prop_flat_map(|m| { let n = m.aref.len(); (Just(m), numbers(n)) }),
    ) {
        let mut system = ConstrainedSystem::new();
        system.assemble(&mechanism.view()).unwrap();
        let nv = system.nv();
        let (mut qfrc, mut qacc) = (DVector::zeros(nv), DVector::zeros(nv));
        system.acceleration(multipliers.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice()).unwrap();
        let forces = &mechanism.jacobian_t * &multipliers;
        assert_within("qfrc = Jᵀ λ", (&qfrc - &forces).norm(), MOVED * forces.norm());
        let total = &mechanism.force + &forces;
        assert_within("M a = f + Jᵀ λ", (&mechanism.mass * &qacc - &total).norm(), MOVED * total.norm());
    }

    #[test]
    fn the_solution_gives_the_rows_what_they_ask_for(mechanism in mechanisms()) {
        let moved = motion(&mut *solver("pinv"), &mechanism.view());
        let reached = mechanism.jacobian_t.tr_mul(&moved.qacc);
        let scale = mechanism.aref.norm() + moved.qacc.norm();
        assert_within("J a = aref", (reached - &mechanism.aref).norm(), MOVED * scale);
    }

    #[test]
    fn softness_is_added_to_the_diagonal_and_to_nothing_else(
        (mechanism, softness) in mechanisms().prop_flat_map(|m| { let n = m.aref.len(); (Just(m), numbers(n)) }),
    ) {
        let softness = softness.abs();
        let (mut hard, mut soft) = (ConstrainedSystem::new(), ConstrainedSystem::new());
        hard.assemble(&mechanism.view()).unwrap();
        let view = StepView { regularisation: Some(softness.as_slice()), ..mechanism.view() };
        soft.assemble(&view).unwrap();
        prop_assert_eq!(matrix_of(&soft), matrix_of(&hard) + DMatrix::from_diagonal(&softness));
        prop_assert_eq!(rhs_of(&soft), rhs_of(&hard));
    }

    /// One system through other shapes, dense input and refused steps holds what a new one would, to the last bit.
    #[test]
    fn a_reused_system_remembers_nothing(steps in vec(mechanisms(), 1..4)) {
        let mut reused = ConstrainedSystem::new();
        for step in &steps {
            let indefinite = -&step.mass;
            reused.assemble(&StepView { mass: indefinite.as_slice(), ..step.view() }).expect_err("M < 0");
            reused.assemble(&step.view()).unwrap();
            prop_assert_eq!(contents(&mut reused), fresh(|system| system.assemble(&step.view())));

            let (matrix, rhs) = (reused.full_matrix().clone(), reused.rhs().to_vec());
            reused.set_dense(&matrix, &rhs).unwrap();
            prop_assert_eq!(contents(&mut reused), fresh(|system| system.set_dense(&matrix, &rhs)));
            prop_assert_eq!((reused.full_matrix().clone(), reused.rhs().to_vec()), (matrix, rhs));
        }
    }
}

/// A step that is lost is not answered with another one's accelerations.
#[test]
fn a_refused_mass_matrix_or_an_overflow_leaves_the_system_empty() {
    let refused = [
        (StepView { mass: &[-4.0], ..GOOD }, "mass matrix is not positive definite"),
        (StepView { jacobian: &[1.0, 1e200], ..GOOD }, "A[3] = inf, expected finite numbers"),
        (StepView { force: &[f64::MAX], mass: &[1e-9], ..GOOD }, "b[0] = -inf, expected finite numbers"),
    ];
    let mut system = ConstrainedSystem::new();
    for (step, message) in refused {
        system.assemble(&GOOD).unwrap();
        let error = system.assemble(&step).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
        assert!(system.is_empty(), "{message}");
        system.acceleration(&[1.0, 1.0], &mut [0.0], &mut [0.0]).expect_err("nothing to go back with");
    }
    for name in SOLVERS.iter().map(|kind| kind.name) {
        let mut empty = ConstrainedSystem::new();
        let error = empty.solve(&mut *solver(name), Wanted::Multipliers, &mut []).unwrap_err();
        assert_eq!(
            error.to_string(),
            "system is empty: at least one row and one velocity are needed",
            "{name}"
        );
    }
}

#[test]
fn of_the_mass_matrix_the_upper_triangle_is_read() {
    let step = |mass: &'static [f64]| StepView {
        mass,
        jacobian: &[1.0, 0.0],
        force: &[1.0, 2.0],
        aref: &[1.0],
        regularisation: None,
    };
    let (whole, upper) = (step(&[2.0, 1.0, 1.0, 3.0]), step(&[2.0, 1.0, 9.0, 3.0]));
    assert_eq!(fresh(|system| system.assemble(&upper)), fresh(|system| system.assemble(&whole)));
}

/// Two rows on one velocity.
const GOOD: StepView<'static> = StepView {
    mass: &[4.0],
    jacobian: &[1.0, 2.0],
    force: &[8.0],
    aref: &[3.0, 6.0],
    regularisation: Some(&[0.0, 0.5]),
};

#[test]
fn bad_steps_are_refused_with_the_value_and_leave_the_last_step_alone() {
    let (nan, inf) = (f64::NAN, f64::INFINITY);
    let cases = [
        (StepView { aref: &[], ..GOOD }, "aref is empty: at least one row and one velocity are needed"),
        (StepView { force: &[], ..GOOD }, "force is empty: at least one row and one velocity are needed"),
        (StepView { mass: &[4.0, 0.0], ..GOOD }, "mass has shape 2 entries, expected 1×1"),
        (StepView { jacobian: &[1.0], ..GOOD }, "jacobian has shape 1 entries, expected 2×1"),
        (StepView { regularisation: Some(&[0.0]), ..GOOD }, "regularisation has shape 1 entries, expected 2"),
        (StepView { mass: &[nan], ..GOOD }, "mass[0] = NaN, expected finite numbers"),
        (StepView { jacobian: &[1.0, inf], ..GOOD }, "jacobian[1] = inf, expected finite numbers"),
        (StepView { force: &[-inf], ..GOOD }, "force[0] = -inf, expected finite numbers"),
        (StepView { aref: &[3.0, nan], ..GOOD }, "aref[1] = NaN, expected finite numbers"),
        (
            StepView { regularisation: Some(&[0.0, inf]), ..GOOD },
            "regularisation[1] = inf, expected finite numbers",
        ),
        (
            StepView { regularisation: Some(&[0.0, -0.25]), ..GOOD },
            "regularisation[1] = -0.25, expected a number ≥ 0",
        ),
    ];
    let mut system = ConstrainedSystem::new();
    system.assemble(&GOOD).unwrap();
    let before = contents(&mut system);
    for (step, message) in cases {
        assert_eq!(system.assemble(&step).unwrap_err().to_string(), message);
        assert_eq!(contents(&mut system), before, "{message}");
    }
}

#[test]
fn a_mass_matrix_without_cholesky_factor_is_refused_with_its_diagonal() {
    let step = |mass: &'static [f64]| StepView {
        mass,
        jacobian: &[1.0, 0.0],
        force: &[0.0, 0.0],
        aref: &[1.0],
        regularisation: None,
    };
    for (mass, range) in [
        (&[2.0, 0.0, 0.0, -1.0], "-1e0 to 2e0"),
        (&[0.5, 0.0, 0.0, 0.0], "0e0 to 5e-1"),
        (&[1.0, 3.0, 3.0, 4.0], "1e0 to 4e0"),
        // Singular, and its last pivot rounds to 4e-16.
        (&[3.0, 0.1, 0.1, 0.1 * 0.1 / 3.0 + 1e-18], "3.333333333333335e-3 to 3e0"),
    ] {
        let message = ConstrainedSystem::new().assemble(&step(mass)).unwrap_err().to_string();
        let expected = format!(
            "mass matrix is not positive definite (diagonal runs from {range}): \
             check that every moving body has positive mass and inertia"
        );
        assert_eq!(message, expected);
    }
}

#[test]
fn bad_dense_systems_are_refused_with_the_value_and_leave_the_last_one_alone() {
    let cases: [(&[f64], &[f64], &str); 7] = [
        (&[], &[], "b is empty: at least one row and one velocity are needed"),
        (&[1.0, 2.0], &[1.0, 1.0], "A has shape 2 entries, expected 2×2"),
        (&[1.0, f64::NAN, 0.0, 1.0], &[1.0, 1.0], "A[1] = NaN, expected finite numbers"),
        (&[1.0, 0.0, 0.0, 1.0], &[1.0, f64::INFINITY], "b[1] = inf, expected finite numbers"),
        (
            &[1e4, 0.0, 0.5, 1.0],
            &[1.0, 1.0],
            "A[1,0] and A[0,1] differ by 5e-1, expected symmetry to 1e-10 of the largest entry",
        ),
        (
            // The worst of two pairs.
            &[1.0, 0.25, 0.0, 0.0, 1.0, 0.0, 0.5, 0.0, 1.0],
            &[1.0, 1.0, 1.0],
            "A[2,0] and A[0,2] differ by 5e-1, expected symmetry to 1e-10 of the largest entry",
        ),
        (
            // Just beyond the tolerance.
            &[1.0, 0.0, 2e-10, 1.0],
            &[1.0, 1.0],
            "A[1,0] and A[0,1] differ by 2e-10, expected symmetry to 1e-10 of the largest entry",
        ),
    ];
    let mut system = ConstrainedSystem::new();
    system.set_dense(&[2.0], &[5.0]).unwrap();
    for (matrix, rhs, message) in cases {
        assert_eq!(system.set_dense(matrix, rhs).unwrap_err().to_string(), message);
        assert_eq!((system.full_matrix()[0], system.rhs()[0], system.len()), (2.0, 5.0, 1), "{message}");
    }
    // Within it, relative to the largest entry, the mean of both entries counts.
    system.set_dense(&[1e4, 0.0, 5e-7, 1.0], &[1.0, 1.0]).unwrap();
    assert_eq!(system.full_matrix(), [1e4, 2.5e-7, 2.5e-7, 1.0]);
    let error = system.set_dense(&[f64::MAX], &[1.0]).unwrap_err().to_string();
    let expected =
        "A[0] = 1.7976931348623157e308, expected numbers up to 1e150: squares of larger ones overflow";
    assert_eq!(error, expected);
    system.set_dense(&[1e150], &[-1e150]).unwrap();
    assert_eq!((system.full_matrix()[0], system.rhs()[0]), (1e150, -1e150));
}

#[test]
fn accelerations_of_other_lengths_or_of_dense_systems_are_refused() {
    let mut system = ConstrainedSystem::new();
    assert!(system.is_empty());
    system.assemble(&GOOD).unwrap();
    assert_eq!((system.is_empty(), system.len(), system.nv()), (false, 2, 1));
    for ((multipliers, qfrc, qacc), message) in [
        ((1, 1, 1), "multipliers has shape 1 entries, expected 2"),
        ((2, 2, 1), "qfrc has shape 2 entries, expected 1"),
        ((2, 1, 0), "qacc has shape 0 entries, expected 1"),
    ] {
        let (mut qfrc, mut qacc) = (vec![0.0; qfrc], vec![0.0; qacc]);
        let error = system.acceleration(&vec![1.0; multipliers], &mut qfrc, &mut qacc).unwrap_err();
        assert_eq!(error.to_string(), message);
    }
    system.set_dense(&[2.0], &[5.0]).unwrap();
    let error = system.acceleration(&[1.0], &mut [0.0], &mut [0.0]).unwrap_err();
    assert_eq!(error.to_string(), "qfrc has shape 1 entries, expected 0");
}
