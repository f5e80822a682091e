//! Random slowly varying sequences against A⁺ b in 62 digits.

use std::fmt::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::thread;

use nalgebra::{DMatrix, DVector};
use oarlock_core::test_problems::sequence::{Random, Sequence, SequenceStep};
use oarlock_core::{ConstrainedSystem, MultiplierSolver, Options, SOLVERS, Status, Wanted, make_solver};

use crate::oracle;

/// Sequences; without optimisation the oracle takes a hundred times as long.
const SEQUENCES: u64 = if cfg!(debug_assertions) { 100 } else { 2000 };

/// The machines that run this have two cores.
const THREADS: u64 = 2;

/// Solvers that promise A⁺ b.
const EXACT: [&str; 4] = ["sr1-tracked", "cholesky", "pinv", "pinv-tracked"];

/// Relative error of A⁺ b: A is rounded to ε, which the condition of A, at most 1e8, makes 2e-8; sums of up to 60 terms
/// and a factor of A on either side of it leave no more than 1e-6.
const MINIMUM_NORM: f64 = 1e-6;

/// An x below this part of ‖b‖/λ⁺ is zero but for rounding, and measured by ‖b‖/λ⁺.
const NOTHING: f64 = 1e-12;

/// Failures of each solver that are written out.
const SHOWN: usize = 6;

/// A failed bound, with all that is needed to see it again.
struct Failure {
    solver: &'static str,
    error: f64,
    text: String,
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|entry| entry * entry).sum::<f64>().sqrt()
}

fn solver(name: &str) -> Box<dyn MultiplierSolver> {
    make_solver(name, &Options::new()).expect(name)
}

/// J.
fn factor_of(now: &SequenceStep) -> DMatrix<f64> {
    DMatrix::from_column_slice(now.rhs.len(), now.rank(), &now.factor)
}

/// ‖x − A⁺b‖ over ‖A⁺b‖.
fn relative_error(x: &[f64], now: &SequenceStep) -> f64 {
    let factor = factor_of(now);
    let right = oracle::minimum_norm(&factor, &now.rhs);
    let difference: Vec<f64> = x.iter().zip(&right).map(|(x, right)| x - right).collect();
    let smallest = factor.svd(false, false).singular_values.min();
    let natural = norm(&now.rhs) / (smallest * smallest);
    let size = norm(&right);
    let scale = if size > NOTHING * natural { size } else { natural };
    // 0/0 for b = 0, which x = 0 solves.
    if norm(&difference) == 0.0 { 0.0 } else { norm(&difference) / scale }
}

/// One solver along one sequence; gives its worst error where the oracle looked.
fn follow(name: &'static str, seed: u64, failures: &mut Vec<Failure>) -> f64 {
    let sequence = Sequence::new(seed);
    let exact = EXACT.contains(&name);
    let looked_at = Random::new(!seed).below(sequence.steps - 1);
    let (mut system, mut solver) = (ConstrainedSystem::new(), solver(name));
    let mut worst = 0.0_f64;
    let mut fail = |error: f64, step: usize, what: &str| {
        let Sequence { change, condition, consistent, turning, jump, .. } = sequence;
        let (n, r) = (sequence.size(), sequence.rank(step));
        let text = format!(
            "{name} seed {seed} step {step} n {n} r {r} change {change:.1e} cond {condition:.1e} \
             consistent {consistent} turning {turning} jump {jump:?}: {what}"
        );
        failures.push(Failure { solver: name, error, text });
    };
    for step in 0..sequence.steps {
        let now = sequence.step(step);
        let mut x = vec![f64::NAN; now.rhs.len()];
        if let Err(error) = system.set_dense(&now.matrix(), &now.rhs) {
            fail(f64::INFINITY, step, &format!("set_dense: {error}"));
            return worst;
        }
        match system.solve(&mut *solver, Wanted::Multipliers, &mut x) {
            Err(error) => fail(f64::INFINITY, step, &format!("error: {error}")),
            Ok(_) if !x.iter().all(|entry| entry.is_finite()) => fail(f64::NAN, step, "x is not finite"),
            Ok(info) if exact && info.status != Status::Converged => {
                fail(f64::NAN, step, &format!("status {}", info.status.name()));
            }
            Ok(info) if exact && (step == looked_at || step + 1 == sequence.steps) => {
                let error = relative_error(&x, &now);
                worst = worst.max(error);
                if error.is_nan() || error > MINIMUM_NORM {
                    let (residual, rank, fresh) = (info.residual_rel, info.rank, info.refreshed);
                    let what = format!(
                        "relative error {error:.2e}, residual {residual:.1e}, folded {}, rank {rank:?}, \
                         null residual {:?}, refreshed {fresh}",
                        info.folded, info.null_residual
                    );
                    fail(error, step, &what);
                }
            }
            Ok(_) => {}
        }
    }
    worst
}

/// Every sequence with these solvers on two threads; gives the worst error of all, and the failures.
fn run(names: &[&'static str]) -> (f64, Vec<Failure>) {
    let part = |first: u64| {
        let (mut worst, mut failures) = (0.0_f64, Vec::new());
        for seed in (first..SEQUENCES).step_by(usize::try_from(THREADS).expect("few threads")) {
            for &name in names {
                let followed = catch_unwind(AssertUnwindSafe(|| follow(name, seed, &mut failures)));
                match followed {
                    Ok(error) => worst = worst.max(error),
                    Err(_) => failures.push(Failure {
                        solver: name,
                        error: f64::INFINITY,
                        text: format!("{name} seed {seed}: panic"),
                    }),
                }
            }
        }
        (worst, failures)
    };
    let parts = thread::scope(|scope| {
        let threads: Vec<_> = (0..THREADS).map(|first| scope.spawn(move || part(first))).collect();
        threads.into_iter().map(|thread| thread.join().expect("caught")).collect::<Vec<_>>()
    });
    parts.into_iter().fold((0.0, Vec::new()), |(worst, mut all), (error, failures)| {
        all.extend(failures);
        (error.max(worst), all)
    })
}

/// Fails with how many failed of each solver, and the worst of them.
fn assert_none(names: &[&str], mut failures: Vec<Failure>) {
    let mut report = String::new();
    failures.sort_by(|a, b| b.error.total_cmp(&a.error));
    for name in names {
        let of_it: Vec<_> = failures.iter().filter(|failure| failure.solver == *name).collect();
        if !of_it.is_empty() {
            writeln!(report, "{name}: {} failures in {SEQUENCES} sequences", of_it.len()).expect("a string");
        }
        for failure in of_it.iter().take(SHOWN) {
            writeln!(report, "    {}", failure.text).expect("a string");
        }
    }
    assert!(failures.is_empty(), "\n{report}");
}

fn assert_exact(name: &'static str) {
    let (worst, failures) = run(&[name]);
    assert_none(&[name], failures);
    assert!(worst <= MINIMUM_NORM, "{name}: {worst:e}");
}

#[test]
fn tracked_gives_the_minimum_norm() {
    assert_exact("sr1-tracked");
}

#[test]
fn cholesky_gives_the_minimum_norm() {
    assert_exact("cholesky");
}

#[test]
fn pinv_gives_the_minimum_norm() {
    assert_exact("pinv");
}

#[test]
fn pinv_tracked_gives_the_minimum_norm() {
    assert_exact("pinv-tracked");
}

#[test]
fn every_solver_ends_with_a_status() {
    let names: Vec<_> = SOLVERS.iter().map(|kind| kind.name).filter(|name| !EXACT.contains(name)).collect();
    let (_, failures) = run(&names);
    assert_none(&names, failures);
}

#[test]
fn oracle_has_its_digits() {
    use crate::oracle::Quad;
    let quad = |value: f64| Quad::from(value);
    let third = quad(1.0) / quad(3.0);
    let rest = third * quad(3.0) - quad(1.0);
    assert!(rest.value().abs() < 1e-62, "{:e}", rest.value());
    // (a + b)² − a² − 2ab − b² with parts 1e30 apart.
    let (a, b) = (third * quad(1e15), third / quad(7e15));
    let rest = (a + b) * (a + b) - a * a - quad(2.0) * a * b - b * b;
    assert!(rest.value().abs() < 1e30 * 1e-60, "{:e}", rest.value());
    // Jᵀx = (JᵀJ)⁻¹ Jᵀb, so J JᵀJ Jᵀ x = J Jᵀ b.
    let now = Sequence::new(3).step(0);
    let factor = factor_of(&now);
    let x = DVector::from_vec(oracle::minimum_norm(&factor, &now.rhs));
    let matrix = DMatrix::from_vec(now.rhs.len(), now.rhs.len(), now.matrix());
    let normal = factor.tr_mul(&(matrix * &x - DVector::from_column_slice(&now.rhs)));
    assert!(normal.norm() < 1e-12 * factor.norm() * norm(&now.rhs), "{normal}");
}
