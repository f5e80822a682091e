//! NumPy arrays in and out, and errors.
//!
//! Arrays are read in place: float64 and C-contiguous, or an error that says so. Copying silently would hide the cost
//! in a step loop.

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use oarlock_core::Error;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

pyo3::create_exception!(
    oarlock._core,
    InputError,
    PyValueError,
    "Bad input: the message names the value and what was expected."
);

/// An error of the core as a Python exception.
#[allow(clippy::needless_pass_by_value)] // the shape that map_err wants
pub fn input_error(error: Error) -> PyErr {
    InputError::new_err(error.to_string())
}

fn not_contiguous(what: &str) -> PyErr {
    InputError::new_err(format!(
        "{what} is not C-contiguous, expected a contiguous float64 array (numpy.ascontiguousarray makes one)"
    ))
}

/// A vector of any length.
///
/// # Errors
/// `InputError` if it is not contiguous.
pub fn vector<'a>(what: &str, array: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
    array.as_slice().map_err(|_| not_contiguous(what))
}

/// A matrix of a given shape, flat in row-major order.
///
/// # Errors
/// `InputError` if it has another shape or is not C-contiguous.
pub fn matrix<'a>(
    what: &'static str,
    array: &'a PyReadonlyArray2<'_, f64>,
    shape: [usize; 2],
) -> PyResult<&'a [f64]> {
    let got = array.shape();
    if got != shape {
        return Err(input_error(Error::Shape {
            what,
            expected: format!("{}×{}", shape[0], shape[1]),
            got: format!("{}×{}", got[0], got[1]),
        }));
    }
    if !array.is_c_contiguous() {
        return Err(not_contiguous(what));
    }
    array.as_slice().map_err(|_| not_contiguous(what))
}
