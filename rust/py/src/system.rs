//! `ConstrainedSystem` for Python.

use std::time::Duration;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use oarlock_core as core;
use pyo3::prelude::*;

use crate::convert::{input_error, matrix, vector};
use crate::solver::{Info, MultiplierSolver};

/// A λ = b of one step: A = J M⁻¹ Jᵀ (+ R), b = aref − J M⁻¹ f. Make one and assemble it anew every step.
#[pyclass(module = "oarlock._core")]
#[derive(Default)]
pub struct ConstrainedSystem {
    pub inner: core::ConstrainedSystem,
}

#[pymethods]
impl ConstrainedSystem {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Forms A and b from M (nv×nv), J (n×nv), f (nv), aref (n) and, for soft rows, R (n).
    #[pyo3(signature = (mass, jacobian, force, aref, regularisation=None))]
    #[allow(clippy::needless_pass_by_value)] // extracted arguments are owned
    fn assemble(
        &mut self,
        py: Python<'_>,
        mass: PyReadonlyArray2<'_, f64>,
        jacobian: PyReadonlyArray2<'_, f64>,
        force: PyReadonlyArray1<'_, f64>,
        aref: PyReadonlyArray1<'_, f64>,
        regularisation: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<()> {
        let force = vector("force", &force)?;
        let aref = vector("aref", &aref)?;
        let step = core::StepView {
            mass: matrix("mass", &mass, [force.len(), force.len()])?,
            jacobian: matrix("jacobian", &jacobian, [aref.len(), force.len()])?,
            force,
            aref,
            regularisation: match &regularisation {
                Some(regularisation) => Some(vector("regularisation", regularisation)?),
                None => None,
            },
        };
        let inner = &mut self.inner;
        py.detach(|| inner.assemble(&step)).map_err(input_error)
    }

    /// Forms A and b where M⁻¹ = Hᵀ H is factored elsewhere: from the rows H Jᵀ (n×nv), J (n×nv), a₀ = M⁻¹ f (nv), aref (n)
    /// and, for soft rows, R (n). The way back from multipliers ends at `force`.
    #[pyo3(signature = (whitened, jacobian, unconstrained, aref, regularisation=None))]
    #[allow(clippy::needless_pass_by_value)] // extracted arguments are owned
    fn assemble_factored(
        &mut self,
        py: Python<'_>,
        whitened: PyReadonlyArray2<'_, f64>,
        jacobian: PyReadonlyArray2<'_, f64>,
        unconstrained: PyReadonlyArray1<'_, f64>,
        aref: PyReadonlyArray1<'_, f64>,
        regularisation: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<()> {
        let unconstrained = vector("unconstrained", &unconstrained)?;
        let aref = vector("aref", &aref)?;
        let (nv, shape) = (unconstrained.len(), [aref.len(), unconstrained.len()]);
        let given = matrix("whitened", &whitened, shape)?;
        let step = core::FactoredStep {
            jacobian: matrix("jacobian", &jacobian, shape)?,
            unconstrained,
            aref,
            regularisation: match &regularisation {
                Some(regularisation) => Some(vector("regularisation", regularisation)?),
                None => None,
            },
        };
        let inner = &mut self.inner;
        let mut whiten = |rows: &[usize], _: &[f64], whitened: &mut [f64]| {
            for (&row, out) in rows.iter().zip(whitened.chunks_exact_mut(nv)) {
                out.copy_from_slice(&given[row * nv..(row + 1) * nv]);
            }
        };
        py.detach(|| inner.assemble_factored(&step, &mut whiten)).map_err(input_error)
    }

    /// Says how far the rows of the next step stand open, as a part of the extent of the mechanism, and asks to hold the rank
    /// along the path; `constraints` (n) are the numbers of the constraints that its rows belong to.
    fn hold_rank(&mut self, gap: f64, constraints: Vec<usize>) {
        self.inner.hold_rank(gap);
        self.inner.set_constraints(constraints.into_iter());
    }

    /// (λ, info) by the direct solver that judges `solver`.
    fn reference<'py>(
        &mut self,
        py: Python<'py>,
        solver: &MultiplierSolver,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Info)> {
        let (multipliers, info) = self.inner.reference(&*solver.inner).map_err(input_error)?;
        Ok((PyArray1::from_slice(py, multipliers), Info::new(*info, Duration::ZERO)))
    }

    /// Jᵀ λ (nv) of λ (n).
    #[allow(clippy::needless_pass_by_value)]
    fn force<'py>(
        &mut self,
        py: Python<'py>,
        multipliers: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let multipliers = vector("multipliers", &multipliers)?;
        let mut qfrc = vec![0.0; self.inner.nv()];
        self.inner.force(multipliers, &mut qfrc).map_err(input_error)?;
        Ok(qfrc.into_pyarray(py))
    }

    /// A, n×n, before folding.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.inner.len();
        let flat = self.inner.full_matrix(); // symmetric: column-major is row-major
        flat.into_pyarray(py).reshape([n, n])
    }

    /// b, n, before folding.
    #[getter]
    fn rhs<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.inner.rhs())
    }

    /// From λ (n) to (qacc, qfrc), both nv: a₀ + M⁻¹ Jᵀ λ and Jᵀ λ.
    #[allow(clippy::needless_pass_by_value)]
    #[allow(clippy::type_complexity)] // a pair of arrays
    fn acceleration<'py>(
        &mut self,
        py: Python<'py>,
        multipliers: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
        let multipliers = vector("multipliers", &multipliers)?;
        let inner = &mut self.inner;
        let mut qacc = vec![0.0; inner.nv()];
        let mut qfrc = vec![0.0; inner.nv()];
        py.detach(|| inner.acceleration(multipliers, &mut qfrc, &mut qacc)).map_err(input_error)?;
        Ok((qacc.into_pyarray(py), qfrc.into_pyarray(py)))
    }
}
