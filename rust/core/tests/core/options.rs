//! Solvers and their options by name: everything listed works, everything else is refused with what is valid.

use std::collections::BTreeSet;
use std::marker::PhantomData;

use crate::support::{assert_within, diagonal, solve};
use oarlock_core::params::{Params, Value};
use oarlock_core::registry::find_solver;
use oarlock_core::solvers::krylov::KrylovParams;
use oarlock_core::solvers::minres::Minres;
use oarlock_core::solvers::pinv::PinvParams;
use oarlock_core::solvers::quasi_newton::{Bfgs, QuasiNewtonParams};
use oarlock_core::solvers::regularised::RegularisedParams;
use oarlock_core::solvers::sr1::Sr1Params;
use oarlock_core::{Options, SOLVERS, make_solver};

/// The message of a solver that must not build.
fn refusal(name: &str, options: &Options) -> String {
    match make_solver(name, options) {
        Ok(_) => panic!("{name} accepts {options:?}"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn the_registry_is_complete_and_its_names_are_unique() {
    let names = SOLVERS.iter().map(|kind| kind.name).collect::<BTreeSet<_>>();
    assert_eq!(names.len(), SOLVERS.len(), "{names:?}");
    let expected = ["sr1", "sr1-classic", "bfgs", "dfp", "pinv", "cholesky-regularised", "cg", "minres"];
    assert!(names.is_superset(&BTreeSet::from(expected)), "{names:?}");
    assert!(SOLVERS.iter().all(|kind| !kind.summary.is_empty()));
}

#[test]
fn every_solver_builds_from_its_listed_defaults_and_solves() {
    for kind in SOLVERS {
        let listed = (kind.options)();
        assert!(!listed.is_empty(), "{} lists no options", kind.name);
        let options = listed.iter().fold(Options::new(), |options, &(name, value)| options.with(name, value));
        let mut solver = make_solver(kind.name, &options).expect(kind.name);
        assert_eq!(solver.name(), kind.name);
        assert_eq!(find_solver(kind.name).unwrap().summary, kind.summary);
        let (x, _) = solve(&mut *solver, &mut diagonal(&[2.0, 4.0]));
        assert_within(kind.name, (x[0] - 0.5).abs().max((x[1] - 0.25).abs()), 1e-6); // sr1 stops at eps_abs = 1e-6
    }
}

#[test]
fn an_unknown_solver_is_refused_with_the_names_there_are() {
    let names = SOLVERS.iter().map(|kind| kind.name).collect::<Vec<_>>().join(", ");
    for name in ["sr2", "", "SR1"] {
        assert_eq!(
            refusal(name, &Options::new()),
            format!("unknown solver '{name}', expected one of: {names}")
        );
    }
}

#[test]
fn an_unknown_option_is_refused_with_the_names_there_are() {
    for kind in SOLVERS {
        let names = (kind.options)().iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        for option in ["tolerence", ""] {
            let expected =
                format!("solver '{}' has no option '{option}', expected one of: {names}", kind.name);
            assert_eq!(refusal(kind.name, &Options::new().with(option, 1.0)), expected);
        }
    }
}

#[test]
fn no_option_takes_a_number_that_is_not_finite_or_negative() {
    for kind in SOLVERS {
        for (option, _) in (kind.options)() {
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.5] {
                let message = refusal(kind.name, &Options::new().with(option, value));
                let start = format!("option {option} = {value} of solver '{}', expected a ", kind.name);
                assert!(message.starts_with(&start), "{message}");
            }
        }
    }
}

#[test]
fn the_ranges_end_where_they_say() {
    let (positive, fraction, count) =
        ("a finite number > 0", "a number in [0, 1)", "a whole number from 1 to 1000000");
    let (non_negative, switch) = ("a finite number ≥ 0", "a switch: 0 or 1");
    for (solver, option, inside, outside, range) in [
        ("sr1", "eps_abs", [f64::MIN_POSITIVE, 1e300], [0.0, -1e-300], positive),
        ("sr1", "guard", [0.0, 0.999], [1.0, -1e-300], fraction),
        ("sr1", "rank_cut", [0.0, 0.999], [1.0, 2.0], fraction),
        ("sr1", "max_iterations", [1.0, 1e6], [0.0, 1_000_001.0], count),
        ("sr1", "max_iterations", [2.0, 50.0], [0.5, 2.5], count),
        ("bfgs", "rtol", [0.0, 1e300], [-1e-300, f64::INFINITY], non_negative),
        ("cg", "warm", [0.0, 1.0], [0.5, 2.0], switch),
    ] {
        for value in inside {
            assert!(make_solver(solver, &Options::new().with(option, value)).is_ok(), "{option} = {value}");
        }
        for value in outside {
            let message = refusal(solver, &Options::new().with(option, value));
            assert_eq!(message, format!("option {option} = {value} of solver '{solver}', expected {range}"));
        }
    }
}

#[test]
fn defaults_say_what_kind_an_option_is_of() {
    let of = |solver: &str| (find_solver(solver).expect("registered").options)();
    assert_eq!(
        of("cg"),
        [
            ("rtol", Value::Float(1e-10)),
            ("max_iterations", Value::Integer(500)),
            ("warm", Value::Switch(true)),
            ("rank_cut", Value::Float(1e-10))
        ]
    );
    assert!(of("sr1-tracked").contains(&("predict", Value::Integer(5))));
}

#[test]
fn a_number_may_be_written_as_another_kind_and_a_switch_is_none() {
    let cg = |option: &str, value: Value| {
        KrylovParams::<Minres>::from_options(&Options::new().with(option, value))
            .map_err(|error| error.to_string())
    };
    let expected = |max_iterations, warm| {
        Ok(KrylovParams { rtol: 1e-10, max_iterations, warm, rank_cut: 1e-10, method: PhantomData })
    };
    for value in [Value::Integer(7), Value::Float(7.0)] {
        assert_eq!(cg("max_iterations", value), expected(7, true));
    }
    for value in [Value::Switch(false), Value::Integer(0), Value::Float(0.0)] {
        assert_eq!(cg("warm", value), expected(500, false));
    }
    for value in [Value::Switch(true), Value::Integer(1), Value::Float(1.0)] {
        assert_eq!(cg("warm", value), expected(500, true));
    }
    assert_eq!(cg("rtol", Value::Integer(2)).map(|params| params.rtol), Ok(2.0));
    for (option, value, range) in [
        ("rtol", Value::Switch(true), "true of solver 'minres', expected a finite number > 0"),
        (
            "max_iterations",
            Value::Switch(true),
            "true of solver 'minres', expected a whole number from 1 to 1000000",
        ),
        (
            "max_iterations",
            Value::Integer(i64::MAX),
            "9223372036854775807 of solver 'minres', expected a whole number from 1 to 1000000",
        ),
        ("warm", Value::Integer(2), "2 of solver 'minres', expected a switch: 0 or 1"),
    ] {
        assert_eq!(cg(option, value), Err(format!("option {option} = {range}")));
    }
}

#[test]
fn every_option_reaches_its_parameter_and_the_last_value_counts() {
    let options = Options::new()
        .with("eps_abs", 1.0)
        .with("eps_abs", 1e-3)
        .with("guard", 0.25)
        .with("max_iterations", 7)
        .with("rank_cut", 0.125);
    let expected = Sr1Params { eps_abs: 1e-3, guard: 0.25, max_iterations: 7, rank_cut: 0.125 };
    assert_eq!(Sr1Params::from_options(&options), Ok(expected));
    let options = Options::new().with("rank_cut", 0.125);
    assert_eq!(PinvParams::from_options(&options), Ok(PinvParams { rank_cut: 0.125 }));
    let options = Options::new()
        .with("eps_abs", 1e-3)
        .with("rtol", 0.5)
        .with("guard", 0.25)
        .with("max_iterations", 7)
        .with("rank_cut", 0.125);
    let expected = QuasiNewtonParams {
        eps_abs: 1e-3,
        rtol: 0.5,
        guard: 0.25,
        max_iterations: 7,
        rank_cut: 0.125,
        update: Bfgs,
    };
    assert_eq!(QuasiNewtonParams::from_options(&options), Ok(expected));
    let options = Options::new().with("rtol", 0.5).with("max_iterations", 7).with("warm", false);
    let expected = KrylovParams {
        rtol: 0.5,
        max_iterations: 7,
        warm: false,
        rank_cut: 1e-10,
        method: PhantomData::<Minres>,
    };
    assert_eq!(KrylovParams::from_options(&options), Ok(expected));
    let options = options.with("epsilon", 1e-3).with("warm", true);
    let expected = RegularisedParams { epsilon: 1e-3, rtol: 0.5, max_iterations: 7, warm: true };
    assert_eq!(RegularisedParams::from_options(&options), Ok(expected));
}
