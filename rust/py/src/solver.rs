//! Solvers and what they report, for Python.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use oarlock_core as core;
use oarlock_core::params::Value;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyInt};

use crate::convert::{InputError, alone, input_error, matrix, not_of_type, text, vector};
use crate::own_solver::{make_own, own_solvers};
use crate::system::ConstrainedSystem;

/// The figures of one solve; a figure that the solver cannot know is None.
#[pyclass(frozen, get_all, module = "oarlock._core")]
#[derive(Clone)]
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
    /// Residual that a test looser than the default may leave, relative to b.
    tolerance: f64,
    /// Whether a rank that was held rose.
    risen: bool,
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
    /// The same figures, as of a solve that is inaccurate.
    pub fn doubted(&self) -> Self {
        Self { status: core::Status::Inaccurate.name(), ..self.clone() }
    }

    /// The same figures, looked at again by `look` where the solve was inaccurate.
    pub fn reviewed(&self, look: impl FnOnce(&mut core::Info)) -> Self {
        let mut info = core::Info { tolerance: self.tolerance, ..core::Info::trivial(0.0) };
        info.status = core::Status::Inaccurate;
        let mut copy = self.clone();
        if copy.status == info.status.name() {
            look(&mut info);
            copy.status = info.status.name();
        }
        copy
    }

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
            tolerance: info.tolerance,
            risen: info.risen,
            refreshed: info.refreshed,
            fallbacks: info.fallbacks,
            folded: info.folded,
            refolded: info.refolded,
            elapsed_ns: elapsed.as_nanos().try_into().unwrap_or(u64::MAX),
        }
    }
}

/// Solves A λ = b one step after another, carrying what it learns. Made by `make_solver`.
#[pyclass(frozen, module = "oarlock._core")]
pub struct MultiplierSolver {
    name: &'static str,
    options: BTreeMap<String, Value>,
    carried: Mutex<Carried>,
}

/// What a solver carries from step to step.
pub struct Carried {
    pub solver: Box<dyn core::MultiplierSolver>,
    dense: core::ConstrainedSystem,
    /// The dense A (n×n) whose proportional rows are those of the fold. It is all that the next step needs of `dense`.
    folded: Vec<f64>,
}

impl Clone for Carried {
    fn clone(&self) -> Self {
        Self { solver: self.solver.clone_box(), dense: self.dense.clone(), folded: self.folded.clone() }
    }
}

impl Carried {
    /// Takes the A and b of a step.
    fn set(&mut self, matrix: &[f64], rhs: &[f64]) -> Result<(), core::Error> {
        let before = (self.dense.len(), self.dense.refolds());
        self.dense.set_dense(matrix, rhs)?;
        if before != (self.dense.len(), self.dense.refolds()) {
            self.folded = matrix.to_vec();
        }
        Ok(())
    }
}

impl MultiplierSolver {
    /// What it carries, for one thread.
    pub fn take(&self) -> PyResult<MutexGuard<'_, Carried>> {
        alone(|| format!("solver '{}'", self.name), &self.carried)
    }

    /// The same solver before its first step.
    ///
    /// # Errors
    /// `InputError` if another thread is using it.
    pub fn fresh(&self) -> PyResult<Box<dyn core::MultiplierSolver>> {
        let mut solver = self.take()?.solver.clone_box();
        solver.reset();
        Ok(solver)
    }
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
    const fn name(&self) -> &'static str {
        self.name
    }

    /// (x, info) of a dense A (n×n, symmetric positive semidefinite) and b (n).
    #[pyo3(signature = (A, b))]
    #[allow(non_snake_case)]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        A: &Bound<'_, PyAny>,
        b: &Bound<'_, PyAny>,
    ) -> PyResult<Solution<'py>> {
        let b = vector("b", b)?;
        let b = b.as_slice()?;
        let matrix = matrix("A", A, [b.len(), b.len()])?;
        let carried = &mut *self.take()?;
        carried.set(matrix.as_slice()?, b).map_err(input_error)?;
        solve(py, &mut *carried.solver, &mut carried.dense, core::Wanted::Multipliers)
    }

    /// (x, info) of the system of one step. With wanted="acceleration" any multipliers that give the right
    /// accelerations will do; "multipliers" asks for the minimum-norm ones.
    #[pyo3(signature = (system, wanted=None), text_signature = "($self, system, wanted='multipliers')")]
    fn solve_system<'py>(
        &self,
        py: Python<'py>,
        system: &Bound<'py, PyAny>,
        wanted: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Solution<'py>> {
        let Ok(system) = system.cast::<ConstrainedSystem>() else {
            return Err(not_of_type("system", system, "a ConstrainedSystem"));
        };
        let wanted = wanted.map_or(Ok("multipliers".into()), |given| text("wanted", given))?;
        let wanted = match &*wanted {
            "multipliers" => core::Wanted::Multipliers,
            "acceleration" => core::Wanted::Acceleration,
            other => {
                return Err(InputError::new_err(format!(
                    "wanted = '{other}', expected one of: multipliers, acceleration"
                )));
            }
        };
        solve(py, &mut *self.take()?.solver, &mut *system.get().take()?, wanted)
    }

    /// A copy with everything it carries.
    fn clone(&self) -> PyResult<Self> {
        let carried = Mutex::new(self.take()?.clone());
        Ok(Self { name: self.name, options: self.options.clone(), carried })
    }

    /// What it carries between steps, as {"solver": name, "size": n, "fields": {name: [numbers]}}.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = self.take()?.solver.state();
        let dict = PyDict::new(py);
        dict.set_item("solver", state.solver)?;
        dict.set_item("size", state.size)?;
        dict.set_item("fields", state.fields)?;
        Ok(dict)
    }

    /// Goes on from a saved state.
    fn restore(&self, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let Ok(state) = state.cast::<PyDict>() else {
            return Err(not_of_type("state", state, "a dictionary with 'solver', 'size' and 'fields'"));
        };
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
        self.take()?.solver.restore(&parts).map_err(input_error)
    }

    /// Forgets all earlier steps.
    fn reset(&self) -> PyResult<()> {
        self.take()?.solver.reset();
        Ok(())
    }

    fn __copy__(&self) -> PyResult<Self> {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.clone()
    }

    /// Pickles it as `make_solver` of its name and options, and what `__setstate__` takes: its state, and the A of its fold.
    #[allow(clippy::type_complexity)] // what pickle wants
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (), (Bound<'py, PyDict>, Bound<'py, PyArray2<f64>>))> {
        let options = PyDict::new(py);
        for (option, &value) in &self.options {
            set_value(&options, option, value)?;
        }
        let make = py.import("oarlock._core")?.getattr("make_solver")?;
        let make = py.import("functools")?.getattr("partial")?.call((make, self.name), Some(&options))?;
        let state = self.state(py)?;
        let carried = self.take()?;
        let n = carried.dense.len();
        let folded = carried.folded.clone().into_pyarray(py).reshape([n, n])?;
        Ok((make, (), (state, folded)))
    }

    fn __setstate__(&self, state: (Bound<'_, PyAny>, Bound<'_, PyAny>)) -> PyResult<()> {
        let (state, folded) = state;
        self.restore(&state)?;
        let n = folded.len()?;
        if n > 0 {
            let matrix = matrix("A of the fold", &folded, [n, n])?;
            let carried = &mut *self.take()?;
            carried.dense = core::ConstrainedSystem::new();
            carried.set(matrix.as_slice()?, &vec![0.0; n]).map_err(input_error)?;
        }
        Ok(())
    }

    fn __repr__(&self) -> String {
        format!("<MultiplierSolver {}>", self.name)
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
fn option_value(solver: &str, option: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(switch) = given.cast::<PyBool>() {
        return Ok(Value::Switch(switch.is_true()));
    }
    if let (true, Ok(integer)) = (given.is_instance_of::<PyInt>(), given.extract()) {
        return Ok(Value::Integer(integer));
    }
    given.extract().map(Value::Float).map_err(|_| {
        let got = given.repr().map_or_else(|_| "?".to_owned(), |text| text.to_string());
        InputError::new_err(format!(
            "option {option} = {got} of solver '{solver}', expected a number or a switch"
        ))
    })
}

fn set_value(options: &Bound<'_, PyDict>, option: &str, value: Value) -> PyResult<()> {
    match value {
        Value::Float(value) => options.set_item(option, value),
        Value::Integer(value) => options.set_item(option, value),
        Value::Switch(value) => options.set_item(option, value),
    }
}

/// Makes a solver by its name, with options as numbers and switches: `make_solver("sr1", eps_abs=1e-7)`.
#[pyfunction]
#[pyo3(signature = (name, **options))]
pub fn make_solver(
    py: Python<'_>,
    name: &Bound<'_, PyAny>,
    options: Option<BTreeMap<String, Bound<'_, PyAny>>>,
) -> PyResult<MultiplierSolver> {
    let name = text("name", name)?;
    let read = |(option, given): (String, Bound<'_, PyAny>)| {
        let value = option_value(&name, &option, &given)?;
        Ok((option, value))
    };
    let options: BTreeMap<_, _> = options.into_iter().flatten().map(read).collect::<PyResult<_>>()?;
    let given =
        options.iter().fold(core::Options::new(), |given, (option, &value)| given.with(option, value));
    let solver = match make_own(py, &name) {
        Some(own) if options.is_empty() => own?,
        Some(_) => {
            return Err(InputError::new_err(format!(
                "solver '{name}' has no options, for it is not oarlock's own"
            )));
        }
        None => core::make_solver(&name, &given).map_err(|error| match error {
            core::Error::UnknownSolver { name, valid } => {
                let own = own_solvers().into_iter().fold(String::new(), |told, (name, _)| told + ", " + name);
                input_error(core::Error::UnknownSolver { name, valid: valid + &own })
            }
            error => input_error(error),
        })?,
    };
    let name = solver.name();
    let carried = Carried { solver, dense: core::ConstrainedSystem::new(), folded: Vec::new() };
    Ok(MultiplierSolver { name, options, carried: Mutex::new(carried) })
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
            set_value(&options, option, default)?;
        }
        all.set_item(kind.name, (kind.summary, options))?;
    }
    for (name, summary) in own_solvers() {
        all.set_item(name, (summary, PyDict::new(py)))?;
    }
    Ok(all)
}
