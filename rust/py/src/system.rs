//! `ConstrainedSystem` for Python.

use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use numpy::{IntoPyArray, Ix1, Ix2, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use oarlock_core as core;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::convert::{Numbers, alone, input_error, matrix, vector};
use crate::solver::{Info, MultiplierSolver};

type Indices<'py> = PyReadonlyArray1<'py, i32>;

/// J as it is given.
enum Jacobian<'py> {
    Dense(Numbers<'py, Ix2>),
    Compressed([Indices<'py>; 3], Numbers<'py, Ix1>),
}

impl<'py> Jacobian<'py> {
    fn read(given: &Bound<'py, PyAny>, shape: [usize; 2]) -> PyResult<Self> {
        if !given.is_instance_of::<PyTuple>() {
            return Ok(Self::Dense(matrix("jacobian", given, shape)?));
        }
        let (lengths, starts, columns, values): (_, _, _, Bound<'py, PyAny>) = given.extract()?;
        Ok(Self::Compressed([lengths, starts, columns], vector("jacobian", &values)?))
    }

    fn view(&self) -> PyResult<core::JacobianView<'_>> {
        Ok(match self {
            Self::Dense(entries) => core::JacobianView::Dense(entries.as_slice()?),
            Self::Compressed([lengths, starts, columns], values) => core::JacobianView::Compressed {
                lengths: lengths.as_slice()?,
                starts: starts.as_slice()?,
                columns: columns.as_slice()?,
                values: values.as_slice()?,
            },
        })
    }
}

/// `M_rownnz`, `M_rowadr`, `M_colind`, `M`, `qLD` and `qLDiagInv`.
type Inertia<'py> =
    (Indices<'py>, Indices<'py>, Indices<'py>, Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>);

/// A λ = b of one step: A = J M⁻¹ Jᵀ (+ R), b = aref − J M⁻¹ f. Make one and assemble it anew every step.
#[pyclass(frozen, module = "oarlock._core")]
#[derive(Default)]
pub struct ConstrainedSystem {
    inner: Mutex<core::ConstrainedSystem>,
}

impl ConstrainedSystem {
    /// The system, for one thread.
    ///
    /// # Errors
    /// `InputError` if another thread is using it.
    pub fn take(&self) -> PyResult<MutexGuard<'_, core::ConstrainedSystem>> {
        alone(|| "the system".to_owned(), &self.inner)
    }
}

#[pymethods]
impl ConstrainedSystem {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Forms A and b from M (nv×nv), J (n×nv), f (nv), aref (n) and, for soft rows, R (n).
    #[pyo3(signature = (mass, jacobian, force, aref, regularisation=None))]
    fn assemble(
        &self,
        py: Python<'_>,
        mass: &Bound<'_, PyAny>,
        jacobian: &Bound<'_, PyAny>,
        force: &Bound<'_, PyAny>,
        aref: &Bound<'_, PyAny>,
        regularisation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (force, aref) = (vector("force", force)?, vector("aref", aref)?);
        let (n, nv) = (aref.len(), force.len());
        let mass = matrix("mass", mass, [nv, nv])?;
        let jacobian = matrix("jacobian", jacobian, [n, nv])?;
        let softness = regularisation.map(|given| vector("regularisation", given)).transpose()?;
        let step = core::StepView {
            mass: mass.as_slice()?,
            jacobian: jacobian.as_slice()?,
            force: force.as_slice()?,
            aref: aref.as_slice()?,
            regularisation: softness.as_ref().map(Numbers::as_slice).transpose()?,
        };
        let inner = &mut *self.take()?;
        py.detach(|| inner.assemble(&step)).map_err(input_error)
    }

    /// Forms A and b where M⁻¹ = Hᵀ H is factored elsewhere: from the rows H Jᵀ (n×nv), J (n×nv), a₀ = M⁻¹ f (nv), aref (n)
    /// and, for soft rows, R (n). The way back from multipliers ends at `force`.
    #[pyo3(signature = (whitened, jacobian, unconstrained, aref, regularisation=None))]
    fn assemble_factored(
        &self,
        py: Python<'_>,
        whitened: &Bound<'_, PyAny>,
        jacobian: &Bound<'_, PyAny>,
        unconstrained: &Bound<'_, PyAny>,
        aref: &Bound<'_, PyAny>,
        regularisation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (unconstrained, aref) = (vector("unconstrained", unconstrained)?, vector("aref", aref)?);
        let nv = unconstrained.len();
        let shape = [aref.len(), nv];
        let whitened = matrix("whitened", whitened, shape)?;
        let jacobian = matrix("jacobian", jacobian, shape)?;
        let softness = regularisation.map(|given| vector("regularisation", given)).transpose()?;
        let given = whitened.as_slice()?;
        let step = core::FactoredStep {
            jacobian: jacobian.as_slice()?,
            unconstrained: unconstrained.as_slice()?,
            aref: aref.as_slice()?,
            regularisation: softness.as_ref().map(Numbers::as_slice).transpose()?,
        };
        let inner = &mut *self.take()?;
        let mut whiten = |rows: &[usize], _: &[f64], whitened: &mut [f64]| {
            for (&row, out) in rows.iter().zip(whitened.chunks_exact_mut(nv)) {
                out.copy_from_slice(&given[row * nv..(row + 1) * nv]);
            }
        };
        py.detach(|| inner.assemble_factored(&step, &mut whiten)).map_err(input_error)
    }

    /// Forms A and b of a mechanism whose inertia lies along a kinematic tree: from J (n×nv, or its lengths, starts, columns and values as
    /// MuJoCo compresses it), M as MuJoCo keeps it, a₀ = M⁻¹ f (nv), aref (n) and, for soft rows, R (n). `inertia` has `M_rownnz`, `M_rowadr`, `M_colind`, `M`, `qLD` and `qLDiagInv`.
    #[pyo3(signature = (jacobian, inertia, unconstrained, aref, regularisation=None))]
    fn assemble_sparse(
        &self,
        py: Python<'_>,
        jacobian: &Bound<'_, PyAny>,
        inertia: Inertia<'_>,
        unconstrained: &Bound<'_, PyAny>,
        aref: &Bound<'_, PyAny>,
        regularisation: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let (unconstrained, aref) = (vector("unconstrained", unconstrained)?, vector("aref", aref)?);
        let rows = Jacobian::read(jacobian, [aref.len(), unconstrained.len()])?;
        let softness = regularisation.map(|given| vector("regularisation", given)).transpose()?;
        let (lengths, starts, columns, mass, factor, inverse_diagonal) = inertia;
        let (mass, factor) = (vector("mass", &mass)?, vector("factor of M", &factor)?);
        let inverse_diagonal = vector("inverse diagonal", &inverse_diagonal)?;
        let step = core::SparseStep {
            jacobian: rows.view()?,
            inertia: core::TreeView {
                lengths: lengths.as_slice()?,
                starts: starts.as_slice()?,
                columns: columns.as_slice()?,
                mass: mass.as_slice()?,
                factor: factor.as_slice()?,
                inverse_diagonal: inverse_diagonal.as_slice()?,
            },
            unconstrained: unconstrained.as_slice()?,
            aref: aref.as_slice()?,
            regularisation: softness.as_ref().map(Numbers::as_slice).transpose()?,
        };
        let inner = &mut *self.take()?;
        py.detach(|| inner.assemble_sparse(&step)).map_err(input_error)
    }

    /// Says how far each row of the next step stands open, as a part of the length that it turns on, and asks to hold the rank
    /// along the path; `constraints` (n) are the numbers of the constraints that its rows belong to.
    fn hold_rank(&self, gaps: &Bound<'_, PyAny>, constraints: Vec<usize>) -> PyResult<()> {
        let gaps = vector("gaps", gaps)?;
        let inner = &mut *self.take()?;
        inner.hold_rank(gaps.as_slice()?);
        inner.set_constraints(constraints.into_iter());
        Ok(())
    }

    /// Asks the same rows again from another a₀ (nv), as other smooth forces give it: b = aref − J a₀, and A as it is.
    fn renew(&self, unconstrained: &Bound<'_, PyAny>, aref: &Bound<'_, PyAny>) -> PyResult<()> {
        let (unconstrained, aref) = (vector("unconstrained", unconstrained)?, vector("aref", aref)?);
        let inner = &mut *self.take()?;
        inner.renew(unconstrained.as_slice()?, aref.as_slice()?).map_err(input_error)
    }

    /// (λ, info) by the direct solver that judges `solver`.
    fn reference<'py>(
        &self,
        py: Python<'py>,
        solver: &MultiplierSolver,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Info)> {
        let (inner, judged) = (&mut *self.take()?, solver.take()?);
        let (multipliers, info) = inner.reference(&*judged.solver).map_err(input_error)?;
        Ok((PyArray1::from_slice(py, multipliers), Info::new(*info, Duration::ZERO)))
    }

    /// The figures of a solve that is inaccurate in the norm of M, as converged where every entry of its acceleration (nv) is
    /// within the promise of the reference's.
    fn confirm(&self, info: &Info, qacc: &Bound<'_, PyAny>, reference: &Bound<'_, PyAny>) -> PyResult<Info> {
        let (qacc, reference) = (vector("qacc", qacc)?, vector("reference", reference)?);
        let (system, qacc, reference) = (self.take()?, qacc.as_slice()?, reference.as_slice()?);
        Ok(info.reviewed(|info| system.confirm(qacc, reference, info)))
    }

    /// The figures of a solve that converged, as inaccurate: what goes with it is not proved.
    #[allow(clippy::unused_self)] // beside `confirm`, which says the contrary
    fn doubt(&self, info: &Info) -> Info {
        info.doubted()
    }

    /// Jᵀ λ (nv) of λ (n).
    fn force<'py>(
        &self,
        py: Python<'py>,
        multipliers: &Bound<'_, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let multipliers = vector("multipliers", multipliers)?;
        let inner = &mut *self.take()?;
        let mut qfrc = vec![0.0; inner.nv()];
        inner.force(multipliers.as_slice()?, &mut qfrc).map_err(input_error)?;
        Ok(qfrc.into_pyarray(py))
    }

    /// A, n×n, before folding.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let inner = self.take()?;
        let (n, flat) = (inner.len(), inner.full_matrix()); // symmetric: column-major is row-major
        flat.into_pyarray(py).reshape([n, n])
    }

    /// b, n, before folding.
    #[getter]
    fn rhs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_slice(py, self.take()?.rhs()))
    }

    /// From λ (n) to (qacc, qfrc), both nv: a₀ + M⁻¹ Jᵀ λ and Jᵀ λ.
    #[allow(clippy::type_complexity)] // a pair of arrays
    fn acceleration<'py>(
        &self,
        py: Python<'py>,
        multipliers: &Bound<'_, PyAny>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
        let multipliers = vector("multipliers", multipliers)?;
        let multipliers = multipliers.as_slice()?;
        let inner = &mut *self.take()?;
        let mut qacc = vec![0.0; inner.nv()];
        let mut qfrc = vec![0.0; inner.nv()];
        py.detach(|| inner.acceleration(multipliers, &mut qfrc, &mut qacc)).map_err(input_error)?;
        Ok((qacc.into_pyarray(py), qfrc.into_pyarray(py)))
    }

    fn __copy__(&self) -> PyResult<Self> {
        Ok(Self { inner: Mutex::new(self.take()?.clone()) })
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__()
    }

    #[allow(clippy::unused_self)] // a method to Python
    fn __reduce__(&self) -> PyResult<()> {
        Err(PyTypeError::new_err(
            "a ConstrainedSystem cannot be pickled, expected the arrays of its step: assemble it anew from them",
        ))
    }
}
