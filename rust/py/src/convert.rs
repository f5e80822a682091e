//! Arguments in, answers out, and errors.
//!
//! What is a float64 array in C order is read in place. Other real numbers (integers, other floats, lists, other orders of
//! memory) are copied into one, and what is neither is an error that names the argument.

use std::borrow::Cow;
use std::fmt;
use std::sync::{Mutex, MutexGuard, TryLockError};

use numpy::ndarray::Dimension;
use numpy::{
    Element, Ix1, Ix2, PyArray, PyArrayDescrMethods, PyArrayMethods, PyReadonlyArray, PyUntypedArray,
    PyUntypedArrayMethods,
};
use oarlock_core::Error;
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyTypeMethods;

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

/// The numbers of an argument, in row-major order.
pub struct Numbers<'py, D: Dimension>(PyReadonlyArray<'py, f64, D>);

impl<D: Dimension> Numbers<'_, D> {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// The numbers as they lie in memory.
    ///
    /// # Errors
    /// None: [`read`] gives contiguous arrays only.
    pub fn as_slice(&self) -> PyResult<&[f64]> {
        self.0.as_slice().map_err(|error| InputError::new_err(error.to_string()))
    }
}

/// A vector of any length.
///
/// # Errors
/// `InputError` if it is none, or not of real numbers.
pub fn vector<'py>(what: &'static str, given: &Bound<'py, PyAny>) -> PyResult<Numbers<'py, Ix1>> {
    read(what, given, format_args!("a vector"))
}

/// A matrix of a given shape.
///
/// # Errors
/// `InputError` if it has another shape, or is not of real numbers.
pub fn matrix<'py>(
    what: &'static str,
    given: &Bound<'py, PyAny>,
    shape: [usize; 2],
) -> PyResult<Numbers<'py, Ix2>> {
    let numbers = read(what, given, format_args!("a {}×{} matrix", shape[0], shape[1]))?;
    if numbers.0.shape() != shape {
        let (got, expected) = (shape_of(numbers.0.shape()), shape_of(&shape));
        return Err(input_error(Error::Shape { what, expected, got }));
    }
    Ok(numbers)
}

fn shape_of(shape: &[usize]) -> String {
    shape.iter().map(ToString::to_string).collect::<Vec<_>>().join("×")
}

fn read<'py, D: Dimension>(
    what: &'static str,
    given: &Bound<'py, PyAny>,
    expected: fmt::Arguments<'_>,
) -> PyResult<Numbers<'py, D>> {
    let in_place = |array: &Bound<'py, PyArray<f64, D>>| {
        let numbers = array.readonly();
        numbers.as_slice().is_ok().then_some(Numbers(numbers))
    };
    if let Ok(array) = given.cast::<PyArray<f64, D>>()
        && is_plain(given)?
        && let Some(numbers) = in_place(array)
    {
        return Ok(numbers);
    }
    let array = real_array(what, given, expected)?;
    let Ok(array) = array.cast::<PyArray<f64, D>>() else {
        let shape = array.cast::<PyUntypedArray>()?.shape().to_vec();
        let got = match shape[..] {
            [] => "a single number".to_owned(),
            [length] => format!("a vector of {length}"),
            _ => format!("of shape {}", shape_of(&shape)),
        };
        return Err(InputError::new_err(format!("{what} is {got}, expected {expected}")));
    };
    in_place(array).ok_or_else(|| InputError::new_err(format!("{what} has no order in memory")))
}

/// Whether an array has no mask that its numbers would be read without.
fn is_plain(array: &Bound<'_, PyAny>) -> PyResult<bool> {
    let py = array.py();
    Ok(array.get_type().is(py.get_type::<PyUntypedArray>()) || !array.hasattr(intern!(py, "mask"))?)
}

/// Any real numbers as a float64 array in C order; it is the given one where that is so already.
fn real_array<'py>(
    what: &'static str,
    given: &Bound<'py, PyAny>,
    expected: fmt::Arguments<'_>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = given.py();
    let refused =
        |got: String| InputError::new_err(format!("{what} {got}, expected {expected} of real numbers"));
    let numpy = py.import(intern!(py, "numpy"))?;
    let array = match numpy.call_method1(intern!(py, "asarray"), (given,)) {
        Ok(array) => array,
        Err(error) if is_about_values(py, &error) => {
            return Err(refused(format!("is no array ({})", error.value(py))));
        }
        Err(other) => return Err(other),
    };
    let untyped = array.cast::<PyUntypedArray>()?;
    if !is_plain(given)? {
        return Err(refused("is a masked array".to_owned()));
    }
    match untyped.dtype().kind() {
        b'f' | b'i' | b'u' => {}
        b'O' if untyped.ndim() == 0 => {
            return Err(refused(format!("is of type {}", given.get_type().name()?)));
        }
        _ => return Err(refused(format!("has dtype {}", untyped.dtype().str()?))),
    }
    numpy.call_method1(intern!(py, "require"), (array, f64::get_dtype(py), intern!(py, "CA")))
}

/// Whether an exception speaks of the value that was given, rather than of the machine or of an interruption.
fn is_about_values(py: Python<'_>, error: &PyErr) -> bool {
    error.is_instance_of::<PyValueError>(py)
        || error.is_instance_of::<PyTypeError>(py)
        || error.is_instance_of::<PyOverflowError>(py)
}

/// A string.
///
/// # Errors
/// `InputError` if it is none.
pub fn text<'a>(what: &str, given: &'a Bound<'_, PyAny>) -> PyResult<Cow<'a, str>> {
    given.extract().map_err(|_| not_of_type(what, given, "a string"))
}

/// What is not of the type that it should be.
pub fn not_of_type(what: &str, given: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let got = given.get_type();
    let got = got.name().map_or_else(|_| "another type".to_owned(), |name| name.to_string());
    InputError::new_err(format!("{what} is of type {got}, expected {expected}"))
}

/// Takes a value that one thread at a time may use.
///
/// # Errors
/// `InputError` if another thread is using it.
pub fn alone<T>(what: impl FnOnce() -> String, value: &Mutex<T>) -> PyResult<MutexGuard<'_, T>> {
    match value.try_lock() {
        Ok(guard) => Ok(guard),
        // The panic has been raised in Python already.
        Err(TryLockError::Poisoned(left)) => Ok(left.into_inner()),
        Err(TryLockError::WouldBlock) => Err(InputError::new_err(format!(
            "{} is in use by another thread, expected one thread at a time (give each its own)",
            what()
        ))),
    }
}
