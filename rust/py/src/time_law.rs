//! `TimeLaw` for Python.

use std::collections::BTreeMap;

use oarlock_mujoco as native;
use pyo3::prelude::*;

use crate::convert::{InputError, vector};

/// A scalar law of time, parsed once: arithmetic, functions, PI, the time t and named constants.
#[pyclass(module = "oarlock._core")]
pub struct TimeLaw {
    pub inner: native::TimeLaw,
}

#[pymethods]
impl TimeLaw {
    #[new]
    #[pyo3(signature = (source, constants=BTreeMap::new()))]
    #[allow(clippy::needless_pass_by_value)]
    fn new(source: &str, constants: BTreeMap<String, f64>) -> PyResult<Self> {
        let inner = native::TimeLaw::parse(source, &constants)
            .map_err(|error| InputError::new_err(error.to_string()))?;
        Ok(Self { inner })
    }

    /// The law of a log, called by a name: each value holds from its time (s) until the next one, the first also before.
    #[staticmethod]
    fn sampled(name: &str, times: &Bound<'_, PyAny>, values: &Bound<'_, PyAny>) -> PyResult<Self> {
        let (times, values) = (vector("times", times)?, vector("values", values)?);
        let inner = native::TimeLaw::sampled(name, times.as_slice()?, values.as_slice()?)
            .map_err(|error| InputError::new_err(error.to_string()))?;
        Ok(Self { inner })
    }

    /// The value at time t in seconds; NaN outside the law's domain.
    fn at(&mut self, t: f64) -> f64 {
        self.inner.at(t)
    }

    /// Whether it does not depend on t.
    #[getter]
    fn is_constant(&self) -> bool {
        self.inner.is_constant()
    }

    fn __repr__(&self) -> String {
        format!("TimeLaw('{}')", self.inner)
    }
}
