//! Input that no solver can use, before every solver of the registry; and what `make fuzz` has found, in its least form.

use crate::support::{ROUNDING, assert_within, diagonal, matrix_of, rhs_of, rows, solve};
use oarlock_core::registry::SolverKind;
use oarlock_core::{
    ConstrainedSystem, Error, Info, MultiplierSolver, Options, SOLVERS, State, Status, StepView, Wanted,
};

fn make(kind: &SolverKind) -> Box<dyn MultiplierSolver> {
    (kind.build)(&Options::new()).expect(kind.name)
}

/// A system whose rows are not folded.
fn unfolded(mass: &[f64], jacobian: &[f64], aref: &[f64]) -> Result<ConstrainedSystem, Error> {
    let mut system = ConstrainedSystem::new();
    let (force, soft) = (vec![0.0; jacobian.len() / aref.len()], vec![0.0; aref.len()]);
    let step = StepView { mass, jacobian, force: &force, aref, regularisation: Some(&soft) };
    system.assemble(&step).map(|()| system)
}

fn answer(kind: &SolverKind, system: &mut ConstrainedSystem) -> Result<(Vec<f64>, Info), Error> {
    let mut x = vec![f64::NAN; system.len()];
    system.solve(&mut *make(kind), Wanted::Multipliers, &mut x).map(|info| (x, info))
}

#[test]
fn an_indefinite_a_is_refused_with_its_eigenvalues_before_any_solver_sees_it() {
    let cases: [(&[f64], f64, f64); 8] = [
        (&[-1.0], -1.0, -1.0),
        (&[1.0, 2.0, 2.0, 1.0], -1.0, 3.0),
        // Nothing on the diagonal: no pivot to begin with.
        (&[0.0, 1.0, 1.0, 0.0], -1.0, 1.0),
        (&[-1.0, 0.0, 0.0, 0.0], -1.0, 0.0),
        (&[1.0, 0.0, 0.0, -1e-9], -1e-9, 1.0),
        (&[1e150, 0.0, 0.0, -1e150], -1e150, 1e150),
        (&[1e-150, 2e-150, 2e-150, 1e-150], -1e-150, 3e-150),
        // Every 2×2 minor is positive, and b = (1, −1, 0) has nothing along (1, 1, 1): CG would never notice.
        (&[1.0, -0.9, -0.9, -0.9, 1.0, -0.9, -0.9, -0.9, 1.0], -0.8, 1.9),
    ];
    let mut system = ConstrainedSystem::new();
    system.set_dense(&[2.0], &[5.0]).unwrap();
    for (matrix, lowest, highest) in cases {
        let n = matrix.len().isqrt();
        let error = system.set_dense(matrix, &vec![1.0; n]).unwrap_err();
        let Error::NotPositiveSemidefinite { smallest, largest } = error else { panic!("{error}") };
        let gap = (smallest - lowest).abs().max((largest - highest).abs());
        assert_within(&error.to_string(), gap, ROUNDING * highest.abs().max(lowest.abs()));
        let told =
            format!("A is not positive semidefinite: smallest eigenvalue {smallest:e}, largest {largest:e}");
        assert_eq!(error.to_string(), told);
        assert_eq!((system.full_matrix()[0], system.len()), (2.0, 1), "the last system stays");
    }
    // Within rounding of semidefinite.
    system.set_dense(&[1.0, 0.0, 0.0, -1e-11], &[1.0, 0.0]).unwrap();
    system.set_dense(&[1.0, 1.0, 1.0, 1.0 - 1e-15], &[1.0, 1.0]).unwrap();
}

#[test]
fn an_answer_that_overflows_is_no_answer_and_leaves_nothing_behind() {
    for kind in SOLVERS {
        let (mut solver, mut good) = (make(kind), diagonal(&[1.0, 2.0]));
        solve(&mut *solver, &mut good);
        let mut steep = rows([[1e-300, 0.0], [0.0, 1e-300]], [1e100; 2]);
        let mut answer = [0.0; 2];
        match steep.solve(&mut *solver, Wanted::Multipliers, &mut answer) {
            Err(error) => {
                let (told, end) = (error.to_string(), ", expected finite numbers");
                assert!(
                    told.starts_with("multipliers[0] = ") && told.ends_with(end),
                    "{}: {told}",
                    kind.name
                );
            }
            // A solver that keeps its last finite iterate must say that it is not the solution.
            Ok(info) => {
                assert_ne!(info.status, Status::Converged, "{}: {info:?}", kind.name);
                assert!(answer.iter().all(|entry| entry.is_finite()), "{}: {answer:?}", kind.name);
            }
        }
        let (x, info) = solve(&mut *solver, &mut good);
        assert_within(&format!("{}: {info:?}", kind.name), (x[0] - 1.0).hypot(x[1] - 0.5), 1e-6); // eps_abs
    }
}

#[test]
fn accelerations_that_overflow_are_refused() {
    let mut system = ConstrainedSystem::new();
    let step = StepView { mass: &[1.0], jacobian: &[2.0], force: &[0.0], aref: &[1.0], regularisation: None };
    system.assemble(&step).unwrap();
    let error = system.acceleration(&[f64::MAX], &mut [0.0], &mut [0.0]).unwrap_err();
    assert_eq!(error.to_string(), "qfrc[0] = inf, expected finite numbers");
}

#[test]
fn what_solvers_would_square_has_a_largest_size() {
    let error = unfolded(&[1.0], &[1e76], &[1.0]).map(|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("A[0] = ") && error.contains("expected numbers up to 1e150"), "{error}");
    let error = unfolded(&[1.0], &[1.0], &[-2e150]).map(|_| ()).unwrap_err().to_string();
    assert_eq!(error, "b[0] = -2e150, expected numbers up to 1e150: squares of larger ones overflow");
    let softness = [1e200];
    let step = StepView {
        mass: &[1.0],
        jacobian: &[1.0],
        force: &[0.0],
        aref: &[1.0],
        regularisation: Some(&softness),
    };
    let error = ConstrainedSystem::new().assemble(&step).unwrap_err().to_string();
    assert_eq!(error, "A[0] = 1e200, expected numbers up to 1e150: squares of larger ones overflow");
}

#[test]
fn a_one_by_one_system_of_any_scale_is_solved() {
    for scale in [1e-70, 1e-8, 1.0, 1e8, 1e70] {
        for kind in SOLVERS {
            let (x, info) = answer(kind, &mut rows([[scale]], [3.0 * scale])).expect(kind.name);
            assert_eq!(info.status, Status::Converged, "{} at {scale:e}: {info:?}", kind.name);
            assert_within(&format!("{} at {scale:e}", kind.name), (x[0] - 3.0).abs(), 1e-6); // epsilon, eps_abs
        }
    }
}

fn state_of(kind: &SolverKind) -> State {
    let mut solver = make(kind);
    // Carried by a second solve: what a refresh leaves is not all there is.
    for _ in 0..2 {
        solve(&mut *solver, &mut rows([[2.0, 0.0, 2.0], [0.0, 1.0, 1.0], [2.0, 1.0, 3.0]], [1.0, 1.0, 2.0]));
    }
    solver.state()
}

#[test]
fn a_state_that_is_not_this_solvers_or_not_whole_is_refused_with_what_is_wrong() {
    for kind in SOLVERS {
        let refused = |state: &State, reason: &str| {
            let error = make(kind).restore(state).expect_err(kind.name).to_string();
            assert!(
                error.starts_with(&format!("solver '{}' cannot take the state: ", kind.name))
                    && error.contains(reason),
                "{error}, expected {reason}"
            );
        };
        let state = state_of(kind);
        let mut other = state.clone();
        other.solver = "gauss".to_owned();
        refused(&other, "it is that of solver 'gauss'");
        refused(&state.clone().with("of another version", &[1.0]), "unknown field 'of another version'");
        for name in state.fields.keys() {
            let with = |change: fn(&mut Vec<f64>)| {
                let mut state = state.clone();
                change(state.fields.get_mut(name).expect("listed"));
                state
            };
            refused(&with(|field| field.push(1.0)), "");
            if !state.field(name).is_empty() {
                refused(
                    &with(|field| field[0] = f64::NAN),
                    &format!("{name}[0] = NaN, expected finite numbers"),
                );
            }
        }
        // No size takes memory or panics, with fields or without.
        for size in [0, 1, 1 << 40, usize::MAX] {
            let mut sized = state.clone();
            sized.size = size;
            if !state.fields.is_empty() {
                refused(&sized, "");
            }
            make(kind).restore(&State::new(kind.name, size)).expect(kind.name);
        }
    }
}

#[test]
fn a_state_without_a_past_in_its_null_space_is_refused() {
    let kind = SOLVERS.iter().find(|kind| kind.name == "sr1-tracked").expect("registered");
    let mut state = state_of(kind);
    state.fields.get_mut("null_differences_track").expect("saved")[0] = 0.0;
    let error = make(kind).restore(&state).unwrap_err().to_string();
    let reason = "a count is 0, expected a whole number from 1 to 5";
    assert_eq!(error, format!("solver 'sr1-tracked' cannot take the state: {reason}"));
}

#[test]
fn a_state_without_fields_makes_a_solver_forget() {
    for kind in SOLVERS {
        let (mut solver, mut system) = (make(kind), diagonal(&[1.0, 2.0, 3.0]));
        solve(&mut *solver, &mut system);
        solver.restore(&make(kind).state()).expect(kind.name);
        assert_eq!(solver.state().fields, make(kind).state().fields, "{}", kind.name);
        assert_eq!(solve(&mut *solver, &mut system), solve(&mut *make(kind), &mut system), "{}", kind.name);
    }
}

#[test]
fn a_restored_solver_knows_when_x_grows_beyond_bounds() {
    // λ⁺ is carried with H: without it the original breaks down on the second system, and the restored one does not.
    for name in ["sr1", "sr1-classic", "bfgs", "dfp"] {
        let kind = SOLVERS.iter().find(|kind| kind.name == name).expect("registered");
        let mut original = make(kind);
        solve(&mut *original, &mut rows([[1.0, 0.5], [0.5, 1.0]], [1.0, 1.0]));
        let mut restored = make(kind);
        restored.restore(&original.state()).expect("its own state");
        let steep = || rows([[1e-4, 5e-5], [5e-5, 1e-4]], [1.0, 1.0]);
        let expected = solve(&mut *original, &mut steep());
        assert_eq!(expected.1.status, Status::Breakdown, "{name}: {:?}", expected.1);
        assert_eq!(solve(&mut *restored, &mut steep()), expected, "{name}");
    }
}

/// The order of the pivots begins with that of the last step, and decides the last bits.
#[test]
fn the_order_of_the_pivots_is_carried_saved_and_forgotten() {
    let matrix = [[12.75, 0.75, -11.75], [0.75, 17.25, 5.75], [-11.75, 5.75, 24.75]];
    for name in ["cholesky", "auto"] {
        let kind = SOLVERS.iter().find(|kind| kind.name == name).expect("registered");
        let mut system = rows(matrix, [-3.0, -3.5, -2.5]);
        let first = solve(&mut *make(kind), &mut system);
        let mut original = make(kind);
        solve(
            &mut *original,
            &mut rows([[0.0, 0.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 3.0]], [0.0, 1.0, 1.0]),
        );
        solve(
            &mut *original,
            &mut rows([[1e-4, 0.0, 0.0], [0.0, 2.0, 1.0], [0.0, 1.0, 3.0]], [0.0, 1.0, 1.0]),
        );
        let state = original.state();
        assert!(!state.fields.is_empty(), "{name}: pivots in the order of the rows show nothing");
        let (mut copy, mut restored) = (original.clone_box(), make(kind));
        restored.restore(&state).expect("its own state");
        let expected = solve(&mut *original, &mut system);
        assert_ne!(expected.0, first.0, "{name}: the order does not matter here, so the rest shows nothing");
        assert_eq!(solve(&mut *copy, &mut system), expected, "{name}");
        assert_eq!(solve(&mut *restored, &mut system), expected, "{name}");
        original.reset();
        assert_eq!(solve(&mut *original, &mut system), first, "{name}");
        let mut twice = state.clone();
        twice.fields.get_mut("order").expect("saved").fill(1.0);
        let error = make(kind).restore(&twice).unwrap_err().to_string();
        assert_eq!(error, format!("solver '{name}' cannot take the state: field 'order' has row 1 twice"));
    }
}

/// The null direction (1, −1, 0, 0) comes to have curvature, and b has no part in it.
#[test]
fn a_rank_that_rises_where_b_does_not_see_it_is_noticed() {
    for kind in SOLVERS {
        let (mut solver, mut system) = (make(kind), ConstrainedSystem::new());
        for soft in [0.0, 0.0, 0.0, 0.0, 0.0, 16.0] {
            let step = StepView {
                mass: &[1.0, 0.0, 0.0, 1.0],
                jacobian: &[4.0; 8],
                force: &[4.0; 2],
                aref: &[0.0; 4],
                regularisation: Some(&[soft, 0.0, 2.0, 4.0]),
            };
            system.assemble(&step).expect("good");
            let (x, info) = solve(&mut *solver, &mut system);
            let miss = (matrix_of(&system) * x - rhs_of(&system)).norm();
            assert_within(&format!("{} with {soft}: {info:?}", kind.name), miss, 1e-6); // eps_abs
        }
    }
}

/// x is finite, but A⁺ x, from which the next step is extrapolated, is not.
#[test]
fn a_state_is_whole_where_what_it_extrapolates_would_overflow() {
    for kind in SOLVERS {
        let mut solver = make(kind);
        solve(&mut *solver, &mut rows([[1e-140, 0.0], [0.0, 2e-140]], [1e60, 1e60]));
        make(kind).restore(&solver.state()).expect(kind.name);
    }
}

/// The representative of both rows is the first, and 1e-22 is rounding next to 83; it used to stand for all of A.
#[test]
fn the_fold_of_a_dense_matrix_takes_no_rounding_for_the_whole() {
    let matrix = [[1.072e-21, 2.946_762_838_623_197_3e-10], [2.946_762_838_623_197_3e-10, 83.25]];
    for kind in SOLVERS {
        let (x, info) = answer(kind, &mut rows(matrix, [0.0, 83.25])).expect(kind.name);
        assert_eq!(info.folded, 1, "{}", kind.name);
        assert_within(kind.name, (x[1] - 1.0).abs(), 1e-6); // eps_abs, epsilon
    }
}

/// r is not in null(A) when a loose test ends the solve, and taking it out of x changes A x.
#[test]
fn the_residual_of_minres_is_that_of_its_x() {
    let options = Options::new().with("rtol", 0.5);
    let mut minres = oarlock_core::make_solver("minres", &options).unwrap();
    let b = [-2.5, -1.5, -2.5, -4.0];
    let matrix = [
        [14.75, -1.0, 15.0, -3.0],
        [-1.0, 24.5, -11.75, -13.25],
        [15.0, -11.75, 23.5, 4.0],
        [-3.0, -13.25, 4.0, 22.75],
    ];
    let mut system = rows(matrix, b);
    let (x, info) = solve(&mut *minres, &mut system);
    let residual = (matrix_of(&system) * x - rhs_of(&system)).norm() / rhs_of(&system).norm();
    assert_within(&format!("{info:?}, {residual:e}"), (info.residual_rel - residual).abs(), ROUNDING);
}

/// 7 rows of rank 3, and every pivot but rounding used up: what was left came out as −45.
#[test]
fn cholesky_without_a_rank_cut_does_not_divide_by_rounding() {
    let factor = [
        [-1.0, 3.5, 0.0],
        [-1.0, -4.0, -1.0],
        [-3.5, 1.5, -4.0],
        [-0.5, -1.5, 0.5],
        [-3.0, 0.5, 2.5],
        [-0.5, -4.0, 1.5],
        [0.5, 2.5, 4.0],
    ];
    let matrix: [[f64; 7]; 7] = std::array::from_fn(|row| {
        std::array::from_fn(|col| factor[row].iter().zip(factor[col]).map(|(a, b)| a * b).sum())
    });
    let options = Options::new().with("rank_cut", 0.0);
    for name in ["cholesky", "pinv"] {
        let mut solver = oarlock_core::make_solver(name, &options).unwrap();
        solve(&mut *solver, &mut rows(matrix, [-1.0, -2.5, 2.5, -2.5, -4.0, 0.0, -2.0]));
    }
}

/// The eigensolver gives up on subnormal numbers.
#[test]
fn a_subnormal_matrix_counts_as_zero() {
    for kind in SOLVERS {
        let mut system = unfolded(&[2.5], &[1e-154, 0.0, 0.0], &[0.0; 3]).expect("good");
        let (x, info) = answer(kind, &mut system).expect(kind.name);
        assert_eq!((x, info.residual_rel), (vec![0.0; 3], 0.0), "{}", kind.name);
    }
}

#[test]
fn zero_rows_that_ask_for_too_much_are_refused() {
    let mut system = ConstrainedSystem::new();
    let error = system.set_dense(&[0.0], &[1e300]).unwrap_err().to_string();
    assert_eq!(error, "b[0] = 1e300, expected numbers up to 1e150: squares of larger ones overflow");
}
