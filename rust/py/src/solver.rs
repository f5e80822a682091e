//! Solvers and what they report, for Python.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use oarlock_core as core;
use oarlock_core::params::Value;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyInt};

use crate::convert::{InputError, input_error, matrix, vector};
use crate::system::ConstrainedSystem;

/// The figures of one solve; a figure that the solver cannot know is None.
#[pyclass(frozen, get_all, module = "oarlock._core")]
pub struct Info {
    /// converged, iteration-limit, breakdown or inaccurate.
    status: &'static str,
    /// Iterations, in the solver's own count; 0 for a direct solver.
    iterations: usize,
    /// Products with A or with the carried inverse.
    products: usize,
    /// ‖A x − b‖ / ‖b‖, in the least-squares sense where the solver knows range(A).
    residual_rel: f64,
    /// ‖Nᵀ b‖, N a basis of null(A).
    inconsistency: Option<f64>,
    /// Rank of A.
    rank: Option<usize>,
    /// ‖A N‖ / ‖A‖.
    null_residual: Option<f64>,
    /// How many times the eigenvalue nearest to the rank cut is larger or smaller than that.
    margin: Option<f64>,
    /// Whether the carried pseudo-inverse was recomputed.
    refreshed: bool,
    /// Updates skipped or replaced.
    fallbacks: usize,
    /// Rows that folding took out: zero rows and all but one of proportional ones.
    folded: usize,
    /// Whether the fold of earlier steps did not hold any more and was found anew.
    refolded: bool,
    /// Wall time of the solve alone, in ns.
    elapsed_ns: u64,
}

#[pymethods]
impl Info {
    fn __repr__(&self) -> String {
        format!(
            "Info(status='{}', iterations={}, residual_rel={:.3e}, refreshed={})",
            self.status,
            self.iterations,
            self.residual_rel,
            if self.refreshed { "True" } else { "False" }
        )
    }
}

impl Info {
    pub fn new(info: core::Info, elapsed: Duration) -> Self {
        Self {
            status: info.status.name(),
            iterations: info.iterations,
            products: info.products,
            residual_rel: info.residual_rel,
            inconsistency: info.inconsistency,
            rank: info.rank,
            null_residual: info.null_residual,
            margin: info.margin,
            refreshed: info.refreshed,
            fallbacks: info.fallbacks,
            folded: info.folded,
            refolded: info.refolded,
            elapsed_ns: elapsed.as_nanos().try_into().unwrap_or(u64::MAX),
        }
    }
}

/// Solves A λ = b one step after another, carrying what it learns. Made by `make_solver`.
#[pyclass(module = "oarlock._core")]
pub struct MultiplierSolver {
    pub inner: Box<dyn core::MultiplierSolver>,
    dense: core::ConstrainedSystem,
}

type Solution<'py> = (Bound<'py, PyArray1<f64>>, Info);

fn solve<'py>(
    py: Python<'py>,
    solver: &mut dyn core::MultiplierSolver,
    system: &mut core::ConstrainedSystem,
    wanted: core::Wanted,
) -> PyResult<Solution<'py>> {
    let mut x = vec![0.0; system.len()];
    let (info, elapsed) = py.detach(|| {
        let start = Instant::now();
        let solved = system.solve_unchecked(solver, wanted, &mut x);
        let elapsed = start.elapsed();
        let checked = solved.and_then(|mut info| system.check(solver, &x, &mut info).map(|()| info));
        (checked, elapsed)
    });
    Ok((x.into_pyarray(py), Info::new(info.map_err(input_error)?, elapsed)))
}

#[pymethods]
impl MultiplierSolver {
    /// Name in the registry.
    #[getter]
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    /// (x, info) of a dense A (n×n, symmetric positive semidefinite) and b (n).
    #[allow(clippy::needless_pass_by_value)]
    #[pyo3(signature = (A, b))]
    #[allow(non_snake_case)]
    fn solve<'py>(
        &mut self,
        py: Python<'py>,
        A: PyReadonlyArray2<'_, f64>,
        b: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Solution<'py>> {
        let b = vector("b", &b)?;
        self.dense.set_dense(matrix("A", &A, [b.len(), b.len()])?, b).map_err(input_error)?;
        solve(py, &mut *self.inner, &mut self.dense, core::Wanted::Multipliers)
    }

    /// (x, info) of the system of one step. With wanted="acceleration" any multipliers that give the right
    /// accelerations will do; "multipliers" asks for the minimum-norm ones.
    #[pyo3(signature = (system, wanted="multipliers"))]
    fn solve_system<'py>(
        &mut self,
        py: Python<'py>,
        system: &mut ConstrainedSystem,
        wanted: &str,
    ) -> PyResult<Solution<'py>> {
        let wanted = match wanted {
            "multipliers" => core::Wanted::Multipliers,
            "acceleration" => core::Wanted::Acceleration,
            other => {
                return Err(InputError::new_err(format!(
                    "wanted = '{other}', expected one of: multipliers, acceleration"
                )));
            }
        };
        solve(py, &mut *self.inner, &mut system.inner, wanted)
    }

    /// A copy with everything it carries.
    fn clone(&self) -> Self {
        Self { inner: self.inner.clone_box(), dense: self.dense.clone() }
    }

    /// What it carries between steps, as {"solver": name, "size": n, "fields": {name: [numbers]}}.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = self.inner.state();
        let dict = PyDict::new(py);
        dict.set_item("solver", state.solver)?;
        dict.set_item("size", state.size)?;
        dict.set_item("fields", state.fields)?;
        Ok(dict)
    }

    /// Goes on from a saved state.
    fn restore(&mut self, state: &Bound<'_, PyDict>) -> PyResult<()> {
        let parts = core::State {
            solver: part(state, "solver", "the name of a solver")?,
            size: part(state, "size", "a whole number ≥ 0")?,
            fields: part(state, "fields", "lists of numbers by name")?,
        };
        if state.len() > 3 {
            return Err(InputError::new_err(format!(
                "state has the keys {}, expected 'solver', 'size' and 'fields'",
                state.keys()
            )));
        }
        self.inner.restore(&parts).map_err(input_error)
    }

    /// Forgets all earlier steps.
    fn reset(&mut self) {
        self.inner.reset();
    }

    fn __repr__(&self) -> String {
        format!("<MultiplierSolver {}>", self.inner.name())
    }
}

/// One entry of a saved state.
fn part<T>(state: &Bound<'_, PyDict>, key: &str, expected: &str) -> PyResult<T>
where
    T: for<'a, 'py> FromPyObject<'a, 'py>,
{
    let value = state
        .get_item(key)?
        .ok_or_else(|| InputError::new_err(format!("state has no '{key}', expected {expected}")))?;
    value.extract().map_err(|_| InputError::new_err(format!("state['{key}'] = {value}, expected {expected}")))
}

/// The value of an option, as Python has it: a bool, an int, or whatever makes a float.
pub struct OptionValue(Value);

impl<'a, 'py> FromPyObject<'a, 'py> for OptionValue {
    type Error = PyErr;

    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let value = if let Ok(switch) = given.cast::<PyBool>() {
            Value::Switch(switch.is_true())
        } else if let (true, Ok(integer)) = (given.is_instance_of::<PyInt>(), given.extract()) {
            Value::Integer(integer)
        } else {
            Value::Float(given.extract()?)
        };
        Ok(Self(value))
    }
}

/// Makes a solver by its name, with options as numbers and switches: `make_solver("sr1", eps_abs=1e-7)`.
#[pyfunction]
#[pyo3(signature = (name, **options))]
pub fn make_solver(name: &str, options: Option<BTreeMap<String, OptionValue>>) -> PyResult<MultiplierSolver> {
    let options = options
        .unwrap_or_default()
        .iter()
        .fold(core::Options::new(), |options, (name, value)| options.with(name, value.0));
    let inner = core::make_solver(name, &options).map_err(input_error)?;
    Ok(MultiplierSolver { inner, dense: core::ConstrainedSystem::new() })
}

/// Every solver: {name: (summary, {option: default})}, a default as the float, int or bool that it is.
#[pyfunction]
pub fn solvers(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let all = PyDict::new(py);
    for kind in core::SOLVERS {
        let mut defaults = (kind.options)();
        defaults.sort_by_key(|&(option, _)| option);
        let options = PyDict::new(py);
        for (option, default) in defaults {
            match default {
                Value::Float(value) => options.set_item(option, value)?,
                Value::Integer(value) => options.set_item(option, value)?,
                Value::Switch(value) => options.set_item(option, value)?,
            }
        }
        all.set_item(kind.name, (kind.summary, options))?;
    }
    Ok(all)
}
