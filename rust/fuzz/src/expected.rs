//! What the input calls for, found without the code under test.

use oarlock_core::system::SYMMETRY_TOLERANCE;
use oarlock_core::{Error, StepView};

use crate::script::{Dense, Input, Step};

/// Entries of a size from which no product of a few of them overflows or underflows.
const TAME: std::ops::RangeInclusive<f64> = 1e-30..=1e30;

/// Entries of M.
const NEAR_ONE: std::ops::RangeInclusive<f64> = 1e-4..=1e4;

/// A 2×2 minor with an eigenvalue below minus this part of the largest entry makes A indefinite beyond any tolerance.
const CLEARLY: f64 = 1e-6;

/// Whether every entry is zero or of a tame size.
pub fn tame<'a>(entries: impl IntoIterator<Item = &'a f64>) -> bool {
    entries.into_iter().all(|entry| *entry == 0.0 || TAME.contains(&entry.abs()))
}

/// Whether every entry of every array is, and M, by which A is divided, is near one in size. Rows count as zero next to
/// rows 10¹² times as large, whatever M makes of them.
#[must_use]
pub fn tame_input(input: &Input) -> bool {
    match input {
        Input::Step(step) => {
            let near = |entry: &f64| *entry == 0.0 || NEAR_ONE.contains(&entry.abs());
            step.mass.iter().all(near) && tame(entries(step))
        }
        Input::Dense(dense) => tame(dense.matrix.iter().chain(&dense.rhs)),
    }
}

fn entries(step: &Step) -> impl Iterator<Item = &f64> {
    let hard = step.mass.iter().chain(&step.jacobian).chain(&step.force).chain(&step.aref);
    hard.chain(step.softness.iter().flatten())
}

/// The arrays as they are handed over.
#[must_use]
pub fn view(step: &Step) -> StepView<'_> {
    StepView {
        mass: &step.mass,
        jacobian: &step.jacobian,
        force: &step.force,
        aref: &step.aref,
        regularisation: step.softness.as_deref(),
    }
}

/// Whether this is what the step calls for.
#[must_use]
pub fn of_step(step: &Step, got: &Result<(), Error>) -> bool {
    let (n, nv) = (step.aref.len(), step.force.len());
    let softness = step.softness.as_deref();
    let flaws = flaws([
        (Flaw::Empty, n == 0 || nv == 0),
        (Flaw::Shape, step.mass.len() != nv * nv || step.jacobian.len() != n * nv),
        (Flaw::Shape, softness.is_some_and(|softness| softness.len() != n)),
        (Flaw::Infinite, !entries(step).all(|entry| entry.is_finite())),
        (Flaw::Negative, softness.is_some_and(|softness| softness.iter().any(|&entry| entry < 0.0))),
    ]);
    if !flaws.is_empty() {
        return got.as_ref().is_err_and(|error| account_for(&flaws, error));
    }
    match got {
        Ok(()) => true,
        Err(Error::MassNotPositiveDefinite { .. }) => !is_positive_diagonal(&step.mass, nv),
        Err(Error::NonFinite { .. } | Error::TooLarge { .. }) => !tame(entries(step)),
        Err(_) => false,
    }
}

/// Whether this is what A and b call for.
#[must_use]
pub fn of_dense(dense: &Dense, got: &Result<(), Error>) -> bool {
    let (n, matrix) = (dense.rhs.len(), &dense.matrix);
    let shape = matrix.len() != n * n;
    let largest = matrix.iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
    let gap = |at: usize| (matrix[at] - matrix[at % n * n + at / n]).abs();
    let gentle = tame(matrix.iter().chain(&dense.rhs));
    let flaws = flaws([
        (Flaw::Empty, n == 0),
        (Flaw::Shape, shape),
        (Flaw::Infinite, !matrix.iter().chain(&dense.rhs).all(|entry| entry.is_finite())),
        (Flaw::Asymmetric, !shape && (0..n * n).any(|at| gap(at) > SYMMETRY_TOLERANCE * largest)),
    ]);
    if let Err(Error::TooLarge { value, .. }) = got {
        return !gentle && value.is_finite();
    }
    if !flaws.is_empty() {
        return got.as_ref().is_err_and(|error| account_for(&flaws, error));
    }
    match got {
        Ok(()) => !clearly_indefinite(matrix, n),
        Err(Error::NotPositiveSemidefinite { smallest, largest }) => {
            !dense.is_gram() && *smallest < 0.0 && smallest <= largest
        }
        Err(_) => false,
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flaw {
    Empty,
    Shape,
    Infinite,
    Negative,
    Asymmetric,
}

/// Those that are there.
fn flaws<const N: usize>(found: [(Flaw, bool); N]) -> Vec<Flaw> {
    found.into_iter().filter_map(|(flaw, there)| there.then_some(flaw)).collect()
}

/// Whether the error is about one of them.
fn account_for(flaws: &[Flaw], error: &Error) -> bool {
    let flaw = match error {
        Error::Empty { .. } => Flaw::Empty,
        Error::Shape { .. } => Flaw::Shape,
        Error::NonFinite { .. } => Flaw::Infinite,
        Error::NegativeRegularisation { .. } => Flaw::Negative,
        Error::NotSymmetric { .. } => Flaw::Asymmetric,
        _ => return false,
    };
    flaws.contains(&flaw)
}

fn is_positive_diagonal(mass: &[f64], nv: usize) -> bool {
    let on_diagonal = |at: usize| at % nv == at / nv;
    let right = |(at, entry): (usize, &f64)| {
        if on_diagonal(at) { TAME.contains(entry) } else { *entry == 0.0 }
    };
    mass.iter().enumerate().all(right)
}

/// Whether some 2×2 minor says so.
fn clearly_indefinite(matrix: &[f64], n: usize) -> bool {
    if !tame(matrix) {
        return false;
    }
    let largest = matrix.iter().fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
    (0..n * n).any(|at| {
        let (row, col) = (at / n, at % n);
        let (p, q, off) = (matrix[row * n + row], matrix[col * n + col], matrix[at]);
        let smaller = if row == col { p } else { 0.5 * (p + q) - (0.5 * (p - q)).hypot(off) };
        smaller < -CLEARLY * largest
    })
}
