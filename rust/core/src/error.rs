//! Errors of bad input. Every message names the value and what was expected.

use crate::params::value::Value;

/// Bad input. Not converging is not an error: see [`Status`](crate::info::Status).
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The shape of an array does not fit the other arrays.
    #[error("{what} has shape {got}, expected {expected}")]
    Shape {
        /// The array's name.
        what: &'static str,
        /// The shape it should have.
        expected: String,
        /// The shape it has.
        got: String,
    },
    /// Accelerations were asked of a system that was assembled from a factored step and lacks M⁻¹.
    #[error("a system of a factored step has no accelerations, expected one of M, J and f")]
    Factored,
    /// Compressed rows do not lie one after another within their arrays, or their columns do not rise.
    #[error(
        "compressed rows of {what} do not fit together, expected one after another, columns rising, within the width"
    )]
    Pattern {
        /// The matrix's name.
        what: &'static str,
    },
    /// There are no constraint rows or no velocities.
    #[error("{what} is empty: at least one row and one velocity are needed")]
    Empty {
        /// The array's name.
        what: &'static str,
    },
    /// A number is NaN or infinite.
    #[error("{what}[{index}] = {value}, expected finite numbers")]
    NonFinite {
        /// The array's name.
        what: &'static str,
        /// Flat index in row-major order.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// A number is so large that its square would overflow, or nearly.
    #[error(
        "{what}[{index}] = {value:e}, expected numbers up to {LARGEST:e}: squares of larger ones overflow"
    )]
    TooLarge {
        /// The array's name.
        what: &'static str,
        /// Flat index in row-major order.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// A matrix that must be symmetric is not.
    #[error(
        "A[{row},{col}] and A[{col},{row}] differ by {gap:e}, expected symmetry to {tolerance:e} of the largest entry"
    )]
    NotSymmetric {
        /// Row of the worst pair.
        row: usize,
        /// Column of the worst pair.
        col: usize,
        /// Absolute difference.
        gap: f64,
        /// Relative tolerance.
        tolerance: f64,
    },
    /// A has a negative eigenvalue beyond rounding.
    #[error("A is not positive semidefinite: smallest eigenvalue {smallest:e}, largest {largest:e}")]
    NotPositiveSemidefinite {
        /// Smallest eigenvalue.
        smallest: f64,
        /// Largest eigenvalue.
        largest: f64,
    },
    /// M is not positive definite: it has no Cholesky factor.
    #[error(
        "mass matrix is not positive definite (diagonal runs from {smallest:e} to {largest:e}): \
         check that every moving body has positive mass and inertia"
    )]
    MassNotPositiveDefinite {
        /// Smallest diagonal entry.
        smallest: f64,
        /// Largest diagonal entry.
        largest: f64,
    },
    /// A softness is negative.
    #[error("regularisation[{index}] = {value}, expected a number ≥ 0")]
    NegativeRegularisation {
        /// Index of the row.
        index: usize,
        /// The offending value.
        value: f64,
    },
    /// A number of an inequality row is out of its range.
    #[error("{what}[{index}] = {value}, expected {expected}")]
    Range {
        /// The array's name.
        what: &'static str,
        /// Index of the row, or of the group of rows.
        index: usize,
        /// The value that was given.
        value: f64,
        /// The expected range.
        expected: &'static str,
    },
    /// No solver has this name.
    #[error("unknown solver '{name}', expected one of: {valid}")]
    UnknownSolver {
        /// The name that was asked for.
        name: String,
        /// The names that exist.
        valid: String,
    },
    /// The solver has no such option.
    #[error("solver '{solver}' has no option '{option}', expected one of: {valid}")]
    UnknownOption {
        /// The solver.
        solver: &'static str,
        /// The option that was asked for.
        option: String,
        /// The options that exist.
        valid: String,
    },
    /// An option is out of range.
    #[error("option {option} = {value} of solver '{solver}', expected {expected}")]
    OptionValue {
        /// The solver.
        solver: &'static str,
        /// The option.
        option: &'static str,
        /// The value that was given.
        value: Value,
        /// The expected range.
        expected: &'static str,
    },
    /// A saved state belongs to another solver or another version, or is incomplete.
    #[error("solver '{solver}' cannot take the state: {reason}")]
    State {
        /// The solver that should restore it.
        solver: &'static str,
        /// What is wrong, and what was expected.
        reason: String,
    },
    /// A solver from elsewhere did not answer, or not with what was asked for.
    #[error("solver '{solver}': {reason}")]
    Solver {
        /// The solver.
        solver: &'static str,
        /// What it did, and what was expected.
        reason: String,
    },
    /// The eigensolver did not converge, which does not happen with finite symmetric input in practice.
    #[error("symmetric eigendecomposition of an {n}×{n} matrix did not converge")]
    Eigen {
        /// Size n of the matrix.
        n: usize,
    },
}

impl Error {
    /// The same of an array that has its entries in other places.
    pub(crate) fn moved(mut self, place: impl Fn(usize) -> usize) -> Self {
        if let Self::NonFinite { index, .. } | Self::TooLarge { index, .. } = &mut self {
            *index = place(*index);
        }
        self
    }
}

/// Largest magnitude of an entry of A or b, because solvers form squares and sums of squares.
pub const LARGEST: f64 = 1e150;

/// Checks that every entry is finite and no larger than [`LARGEST`].
///
/// # Errors
/// [`Error::NonFinite`], [`Error::TooLarge`] with the first offending entry.
pub(crate) fn check_size(what: &'static str, values: &[f64]) -> Result<(), Error> {
    // Where all squares together are no larger than that of the largest, none is.
    if in_lanes(values, |value| value * value) <= LARGEST * LARGEST {
        return Ok(());
    }
    check_finite(what, values)?;
    match values.iter().position(|value| value.abs() > LARGEST) {
        None => Ok(()),
        Some(index) => Err(Error::TooLarge { what, index, value: values[index] }),
    }
}

/// Σ of something of all values, in lanes: a loop without a way out which waits for no sum is several times as fast.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn in_lanes(values: &[f64], of: impl Fn(f64) -> f64) -> f64 {
    let (chunks, rest) = values.as_chunks::<8>();
    let mut lanes = [[0.0; 4]; 2];
    for chunk in chunks {
        for (lane, &value) in lanes.as_flattened_mut().iter_mut().zip(chunk) {
            *lane += of(value);
        }
    }
    let (four, rest) = rest.as_chunks::<4>();
    for chunk in four {
        for (lane, &value) in lanes[0].iter_mut().zip(chunk) {
            *lane += of(value);
        }
    }
    let [one, other] = &mut lanes;
    one.iter_mut().zip(other).for_each(|(one, other)| *one += *other);
    for (lane, &value) in lanes[0].iter_mut().zip(rest) {
        *lane += of(value);
    }
    (lanes[0][0] + lanes[0][2]) + (lanes[0][1] + lanes[0][3])
}

/// Whether all values are finite.
#[inline]
pub(crate) fn are_finite(values: &[f64]) -> bool {
    // 0 of what is finite, else none.
    in_lanes(values, |value| 0.0 * value) == 0.0
}

/// Checks that every entry is finite.
///
/// # Errors
/// [`Error::NonFinite`] with the first offending entry.
pub(crate) fn check_finite(what: &'static str, values: &[f64]) -> Result<(), Error> {
    if are_finite(values) {
        return Ok(());
    }
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(index) => Err(Error::NonFinite { what, index, value: values[index] }),
    }
}

/// Checks the length of an array that is given flat.
///
/// # Errors
/// [`Error::Shape`] with both lengths.
pub(crate) fn check_len(what: &'static str, got: usize, shape: &[usize]) -> Result<(), Error> {
    if got == shape.iter().product::<usize>() {
        return Ok(());
    }
    let expected = shape.iter().map(ToString::to_string).collect::<Vec<_>>().join("×");
    Err(Error::Shape { what, expected, got: format!("{got} entries") })
}
