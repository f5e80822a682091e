//! Solvers that a Python program brings along: called with A and b of every step.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use numpy::{PyArray1, PyArrayMethods};
use oarlock_core as core;
use oarlock_core::{Error, Info, MultiplierSolver, Needs, Problem};
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

use crate::convert::{InputError, not_of_type, text};

/// What was registered: its line in tables, and what is called, or makes what is called.
struct Entry {
    name: &'static str,
    summary: String,
    solver: Py<PyAny>,
}

static REGISTERED: Mutex<BTreeMap<String, Entry>> = Mutex::new(BTreeMap::new());

/// A solver of a Python program. Every one made of a class has an object of its own.
struct OwnSolver {
    name: &'static str,
    /// The function or the class.
    given: Py<PyAny>,
    /// What is called with (A, b): the function, or `solve` of an object.
    called: Py<PyAny>,
}

impl OwnSolver {
    fn new(py: Python<'_>, name: &'static str, given: &Py<PyAny>) -> PyResult<Self> {
        let given = given.clone_ref(py);
        let called = match given.bind(py).cast::<PyType>() {
            Ok(class) => class.call0()?.getattr("solve")?.unbind(),
            Err(_) => given.clone_ref(py),
        };
        Ok(Self { name, given, called })
    }

    fn failed(&self, py: Python<'_>, error: &PyErr) -> Error {
        let kind = error.get_type(py).name().map_or_else(|_| "error".to_owned(), |name| name.to_string());
        self.refused(format!("it raises {kind}: {}", error.value(py)))
    }

    fn refused(&self, reason: String) -> Error {
        Error::Solver { solver: self.name, reason }
    }

    /// x, and its own count of iterations.
    fn ask(&self, py: Python<'_>, matrix: &[f64], rhs: &[f64], x: &mut [f64]) -> Result<usize, Error> {
        let n = rhs.len();
        let answer = PyArray1::from_slice(py, matrix)
            .reshape([n, n])
            .and_then(|matrix| self.called.bind(py).call1((matrix, PyArray1::from_slice(py, rhs))))
            .map_err(|error| self.failed(py, &error))?;
        let (answer, iterations) = match answer.cast::<PyTuple>() {
            Ok(pair) => pair.extract::<(Bound<'_, PyAny>, usize)>().map_err(|_| {
                self.refused(format!("it gives {pair}, expected x, or x and a number of iterations"))
            })?,
            Err(_) => (answer, 0),
        };
        let wrong = || {
            let shape =
                answer.getattr("shape").map_or_else(|_| answer.to_string(), |shape| shape.to_string());
            self.refused(format!("it gives x of the shape {shape}, expected {n} numbers"))
        };
        let given: Vec<f64> = answer.extract().map_err(|_| wrong())?;
        if given.len() != n {
            return Err(wrong());
        }
        x.copy_from_slice(&given);
        Ok(iterations)
    }
}

impl MultiplierSolver for OwnSolver {
    fn name(&self) -> &'static str {
        self.name
    }

    fn needs(&self) -> Needs {
        Needs::Dense
    }

    fn rank_cut(&self) -> Option<f64> {
        None
    }

    fn is_direct(&self) -> bool {
        false
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        problem.matrix();
        let (matrix, rhs) = (problem.matrix().to_vec(), problem.rhs());
        let iterations = Python::attach(|py| self.ask(py, &matrix, rhs, x))?;
        let n = rhs.len();
        let norm = rhs.iter().map(|value| value * value).sum::<f64>().sqrt();
        if let Some(index) = x.iter().position(|value| !value.is_finite()) {
            return Err(self.refused(format!("it gives x[{index}] = {}, expected finite numbers", x[index])));
        }
        let left = (0..n)
            .map(|row| {
                let product = matrix[row * n..][..n].iter().zip(&*x).map(|(a, x)| a * x).sum::<f64>();
                (product - rhs[row]).powi(2)
            })
            .sum::<f64>()
            .sqrt();
        let residual_rel = if norm > 0.0 { left / norm } else { left };
        Ok(Info {
            status: core::Status::Converged,
            iterations,
            residual_rel,
            inconsistency: None,
            rank: None,
            null_residual: None,
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        // An object of its own that cannot be made anew was made once: it goes on with what it carries.
        Python::attach(|py| {
            if let Ok(fresh) = Self::new(py, self.name, &self.given) {
                *self = fresh;
            }
        });
    }

    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Python::attach(|py| {
            let copied = self.given.bind(py).cast::<PyType>().is_ok().then(|| {
                let copy = py.import("copy")?.getattr("deepcopy")?;
                copy.call1((self.called.bind(py).getattr("__self__")?,))?.getattr("solve")
            });
            let called = match copied {
                Some(Ok(copied)) => copied.unbind(),
                _ => self.called.clone_ref(py),
            };
            Box::new(Self { name: self.name, given: self.given.clone_ref(py), called })
        })
    }
}

/// Registers a solver of one's own by a name: `f(A, b) -> x`, or a class whose objects have `solve(A, b)`.
#[pyfunction]
#[pyo3(signature = (name, solver, summary="a solver of one's own, called in Python"))]
pub fn register_solver(name: &Bound<'_, PyAny>, solver: &Bound<'_, PyAny>, summary: &str) -> PyResult<()> {
    let name = text("name", name)?;
    let fits = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.');
    if name.is_empty()
        || !name.chars().all(fits)
        || name == "mujoco"
        || core::SOLVERS.iter().any(|kind| kind.name == &*name)
    {
        return Err(InputError::new_err(format!(
            "name = '{name}', expected letters, digits, '_', '-' and '.', and none of oarlock's own solvers"
        )));
    }
    if !solver.is_callable() {
        return Err(not_of_type("solver", solver, "a function of A and b, or a class with solve(A, b)"));
    }
    if let Ok(class) = solver.cast::<PyType>()
        && !class.hasattr("solve")?
    {
        return Err(InputError::new_err(format!(
            "class {} has no method 'solve', expected solve(A, b)",
            class.name()?
        )));
    }
    let mut all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    // The registry names solvers for good; another one by the same name takes its place.
    let kept =
        all.get(&*name).map_or_else(|| &*Box::leak(name.to_string().into_boxed_str()), |entry| entry.name);
    let entry = Entry { name: kept, summary: summary.to_owned(), solver: solver.clone().unbind() };
    all.insert(name.to_string(), entry);
    Ok(())
}

/// The solver of that name, if one was registered.
pub fn make_own(py: Python<'_>, name: &str) -> Option<PyResult<Box<dyn MultiplierSolver>>> {
    let (name, given) = {
        let all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = all.get(name)?;
        (entry.name, entry.solver.clone_ref(py))
    };
    let made = OwnSolver::new(py, name, &given)
        .map_err(|error| InputError::new_err(format!("solver '{name}' cannot be made: {}", error.value(py))));
    Some(made.map(|solver| Box::new(solver) as Box<dyn MultiplierSolver>))
}

/// Names of the solvers that are called in Python.
#[pyfunction]
pub fn python_solvers() -> Vec<&'static str> {
    own_solvers().into_iter().map(|(name, _)| name).collect()
}

/// Names and lines of all that were registered.
pub fn own_solvers() -> Vec<(&'static str, String)> {
    let all = REGISTERED.lock().unwrap_or_else(PoisonError::into_inner);
    all.values().map(|entry| (entry.name, entry.summary.clone())).collect()
}
