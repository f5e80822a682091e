//! The table of solvers side by side, for Python.

use oarlock_core::bench::{SIZES, compare};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::convert::input_error;

/// Sizes of the published table.
#[pyfunction]
pub fn bench_sizes() -> Vec<usize> {
    SIZES.to_vec()
}

/// Every solver and every library's pseudo-inverse on the recorded sequence of n rows, as dictionaries with the
/// fields of `Timing` and whether it is right. An interruption is raised between solves.
#[pyfunction]
#[allow(clippy::redundant_closure_for_method_calls)] // the method itself has too narrow a lifetime
pub fn bench_solvers(py: Python<'_>, n: usize, rounds: usize) -> PyResult<Bound<'_, PyList>> {
    let mut signal = Ok(());
    let table = py.detach(|| {
        compare(n, rounds, || {
            if signal.is_ok() {
                signal = Python::attach(|py| py.check_signals());
            }
            signal.is_err()
        })
    });
    signal?;
    let rows = PyList::empty(py);
    for row in table.map_err(input_error)? {
        let dict = PyDict::new(py);
        dict.set_item("name", &row.name)?;
        dict.set_item("n", row.n)?;
        dict.set_item("library", row.library)?;
        dict.set_item("right", row.is_right())?;
        dict.set_item("solve_ns", row.solve_ns)?;
        dict.set_item("given_ns", row.given_ns)?;
        dict.set_item("min_norm_error", row.min_norm_error)?;
        dict.set_item("contradicted_error", row.contradicted_error)?;
        dict.set_item("products", row.products)?;
        rows.append(dict)?;
    }
    Ok(rows)
}
