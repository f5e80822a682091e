//! What every solver of the registry owes: finite numbers on ugly systems, the right answer on the good one that follows,
//! and a saved state that goes on as the solver would have.

use crate::support::{
    assert_within, config, dense, diagonal, matrix_of, rhs_of, rows, solve, solver, unfolded_systems,
};
use nalgebra::{DMatrix, DVector};
use oarlock_core::registry::SolverKind;
use oarlock_core::test_problems::{NV, ROWS, boat};
use oarlock_core::{ConstrainedSystem, MultiplierSolver, Options, SOLVERS, StepView};
use proptest::prelude::*;

/// Residual that every solver reaches by default on well-conditioned systems with b of order one: `eps_abs` of the
/// quasi-Newton solvers.
const SOLVED_BY_ALL: f64 = 1e-6;

fn make(kind: &SolverKind) -> Box<dyn MultiplierSolver> {
    (kind.build)(&Options::new()).expect(kind.name)
}

/// Soft rows are not folded: with R = 0 they bring duplicated and zero rows before the solver.
fn unfolded(jacobian: &[f64], aref: &[f64]) -> ConstrainedSystem {
    let nv = jacobian.len() / aref.len();
    let mut system = ConstrainedSystem::new();
    system
        .assemble(&StepView {
            mass: DMatrix::<f64>::identity(nv, nv).as_slice(),
            jacobian,
            force: &vec![0.0; nv],
            aref,
            regularisation: Some(&vec![0.0; aref.len()]),
        })
        .expect("a good step");
    system
}

fn ugly() -> Vec<(&'static str, ConstrainedSystem)> {
    let sum = [[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 2.0]];
    let scaled = |scale: f64, b: f64| {
        dense(&DMatrix::from_diagonal_element(3, 3, scale), &DVector::from_element(3, b))
    };
    vec![
        ("b = 0", rows(sum, [0.0; 3])),
        ("redundant rows", rows(sum, [1.0, 1.0, 2.0])),
        ("redundant rows that contradict", rows(sum, [1.0, 1.0, 0.0])),
        ("A = 0", unfolded(&[0.0; 6], &[1.0, 2.0, 3.0])),
        ("A = 0, b = 0", unfolded(&[0.0; 6], &[0.0; 3])),
        ("a zero row that asks for something", unfolded(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0], &[1.0, 1.0, 1.0])),
        ("duplicated rows", unfolded(&[1.0, 2.0, 1.0, 2.0, 3.0, 1.0], &[1.0, 1.0, 1.0])),
        ("duplicated rows that contradict", unfolded(&[1.0, 2.0, 1.0, 2.0, 3.0, 1.0], &[1.0, -1.0, 1.0])),
        ("nearly singular", diagonal(&[1.0, 1e-8, 1e-13])),
        ("huge A", scaled(1e100, 1.0)),
        ("tiny A", scaled(1e-100, 1.0)),
        ("huge b", scaled(1.0, 1e100)),
        ("tiny b", scaled(1.0, 1e-100)),
        ("huge both", scaled(1e70, 1e70)),
        ("tiny both", scaled(1e-70, 1e-70)),
    ]
}

#[test]
fn ugly_systems_give_finite_numbers_and_do_no_lasting_harm() {
    for kind in SOLVERS {
        for (name, mut system) in ugly() {
            let (mut solver, mut good) = (make(kind), diagonal(&[1.0, 2.0, 3.0]));
            solve(&mut *solver, &mut good);
            // `solve` refuses anything that is not finite.
            for _ in 0..3 {
                solve(&mut *solver, &mut system);
            }
            for round in 0..2 {
                let (x, info) = solve(&mut *solver, &mut good);
                let gap = (matrix_of(&good) * x - rhs_of(&good)).norm();
                assert_within(&format!("{} after {name}, {round}: {info:?}", kind.name), gap, SOLVED_BY_ALL);
            }
        }
    }
}

#[test]
fn a_restored_solver_and_a_copy_go_on_as_the_original() {
    for kind in SOLVERS {
        let mut original = make(kind);
        let mut system = ConstrainedSystem::new();
        let mut step = |k: u32, solver: &mut dyn MultiplierSolver| {
            system.assemble(&boat(0.05 + 1e-3 * f64::from(k)).view()).expect("a good step");
            solve(solver, &mut system)
        };
        for k in 0..5 {
            step(k, &mut *original);
        }
        let (mut copy, mut restored) = (original.clone_box(), make(kind));
        restored.restore(&original.state()).expect("its own state");
        for k in 5..10 {
            let expected = step(k, &mut *original);
            assert_eq!(step(k, &mut *copy), expected, "copy of {} at {k}", kind.name);
            let got = step(k, &mut *restored);
            assert_eq!(got.1.refreshed, expected.1.refreshed, "{} at {k}: {:?}", kind.name, got.1);
            assert_within(&format!("{} at {k}", kind.name), (got.0 - expected.0).norm(), SOLVED_BY_ALL);
        }
    }
}

#[test]
fn a_state_of_another_solver_or_with_a_field_cut_off_is_refused() {
    for kind in SOLVERS {
        let mut original = make(kind);
        solve(&mut *original, &mut diagonal(&[1.0, 2.0, 3.0]));
        let state = original.state();
        for other in SOLVERS.iter().filter(|other| other.name != kind.name) {
            assert!(make(other).restore(&state).is_err(), "{} takes the state of {}", other.name, kind.name);
        }
        for field in state.fields.keys() {
            let mut cut = state.clone();
            let values = cut.fields.get_mut(field).expect("listed");
            if values.pop().is_none() {
                values.push(0.0);
            }
            assert!(make(kind).restore(&cut).is_err(), "{} takes a state with {field} cut off", kind.name);
        }
        let mut empty = make(kind);
        empty.restore(&make(kind).state()).expect("the state of a new solver");
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn every_solver_solves_consistent_systems_one_after_another(
        systems in proptest::collection::vec(unfolded_systems(), 1..4),
    ) {
        for kind in SOLVERS {
            let mut solver = make(kind);
            for system in &systems {
                let rhs = system.consistent_rhs();
                let (x, info) = solve(&mut *solver, &mut dense(&system.matrix, &rhs));
                let what = format!("{}: {info:?}", kind.name);
                assert_within(&what, (&system.matrix * x - &rhs).norm(), SOLVED_BY_ALL);
            }
        }
    }
}

#[test]
fn the_reference_agrees_on_accelerations_with_every_solver_along_the_boat() {
    let mut solvers = SOLVERS.iter().map(|kind| make(kind)).collect::<Vec<_>>();
    let (mut pinv, mut system) = (solver("pinv"), ConstrainedSystem::new());
    for k in 0..200 {
        system.assemble(&boat(0.03 * f64::from(k)).view()).expect("a good step");
        let mut moved = |solver: &mut dyn MultiplierSolver| {
            let (x, _) = solve(solver, &mut system);
            let (mut qfrc, mut qacc) = (DVector::zeros(NV), DVector::zeros(NV));
            system
                .acceleration(x.as_slice(), qfrc.as_mut_slice(), qacc.as_mut_slice())
                .expect("matching lengths");
            qacc
        };
        let reference = moved(&mut *pinv);
        for solver in &mut solvers {
            let gap = (moved(&mut **solver) - &reference).norm();
            assert_within(&format!("{} at {k}", solver.name()), gap, SOLVED_BY_ALL * ROWS as f64);
        }
    }
}

/// A null space that has stood still is predicted to stand still for ever, with an expected error of zero. A step aside of
/// 1e-3 must be noticed all the same, though its Rayleigh quotient is the square of that and less.
#[test]
fn a_null_space_that_steps_aside_after_a_standstill_is_noticed() {
    let step = |turn: f64| {
        let (sin, cos) = turn.sin_cos();
        // No two rows are proportional, and the third is a sum of the others; b contradicts that.
        let factor = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.0, cos, 0.5, sin]);
        dense(&(&factor * factor.transpose()), &DVector::from_row_slice(&[1.0, 2.0, 5.0]))
    };
    for name in ["sr1-tracked", "cholesky", "auto"] {
        for turn in [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.5] {
            let (mut tried, mut pinv) = (solver(name), solver("pinv"));
            for _ in 0..8 {
                solve(&mut *tried, &mut step(0.3));
            }
            let (x, info) = solve(&mut *tried, &mut step(0.3 + turn));
            let (truth, _) = solve(&mut *pinv, &mut step(0.3 + turn));
            assert_within(
                &format!("{name} after {turn}: {info:?}"),
                (&x - &truth).norm(),
                1e-7 * truth.norm(),
            );
        }
    }
}
