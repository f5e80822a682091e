//! Friction loss, limits and contacts beside equality rows, for Python.

use std::sync::Mutex;
use std::time::Instant;

use numpy::PyArray1;
use oarlock_core as core;
use oarlock_core::inequalities::WIDEST_CONE;
use pyo3::prelude::*;

use crate::convert::{alone, input_error, matrix, vector};
use crate::system::ConstrainedSystem;

/// The figures of one solve of the inequality rows.
#[pyclass(frozen, get_all, module = "oarlock._core")]
pub struct InequalityReport {
    /// converged, iteration-limit or breakdown.
    status: &'static str,
    /// Newton steps; 0 where the start was the answer.
    iterations: usize,
    /// Evaluations of all rows in the line searches.
    evaluations: usize,
    /// Norm of the gradient that is left, relative to the forces that it is the difference of.
    gradient: f64,
    /// Number of rows that push, all friction loss among them.
    active: usize,
    /// Whether rows that push are others than in the solve before, or lie on other pieces.
    changed: bool,
    /// Number of rows that push against equality rows alone.
    blocked: usize,
    /// Number of coordinates that equality rows leave.
    coordinates: usize,
    /// Whether the acceleration given led nearer than none.
    warm: bool,
    /// Wall time of the solve alone, in ns.
    elapsed_ns: u64,
}

#[pymethods]
impl InequalityReport {
    fn __repr__(&self) -> String {
        format!(
            "InequalityReport(status='{}', iterations={}, active={}, gradient={:.3e})",
            self.status, self.iterations, self.active, self.gradient
        )
    }
}

/// What proves an answer; every figure is relative.
#[pyclass(frozen, get_all, module = "oarlock._core")]
pub struct Certificate {
    /// Whether it is proved.
    holds: bool,
    /// How far forces are from those of the accelerations, in the norm of M⁻¹.
    gradient: f64,
    /// The part of the same that rounding explains.
    rounding: f64,
    /// Largest product of a force and its slack beside the energies of all rows.
    complementarity: f64,
    /// Duality gap beside the same.
    gap: f64,
    /// How far forces lie outside of what their rows can give.
    infeasibility: f64,
}

/// Solves the inequality rows of one step after another, and remembers which of them pushed.
#[pyclass(frozen, module = "oarlock._core")]
#[derive(Default)]
pub struct Inequalities {
    inner: Mutex<core::Inequalities>,
}

/// Groups of rows by the numbers of their rows: 0 a friction loss, 1 a unilateral row, more a cone.
fn groups(dims: &[usize], mu: &[f64], friction: &[f64]) -> Vec<core::Group> {
    let coefficients = friction.as_chunks::<{ WIDEST_CONE - 1 }>().0;
    dims.iter()
        .zip(mu)
        .zip(coefficients)
        .map(|((&dim, &mu), &friction)| match dim {
            0 => core::Group::Friction,
            1 => core::Group::Unilateral,
            dim => core::Group::Cone { dim, mu, friction },
        })
        .collect()
}

#[pymethods]
impl Inequalities {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Finds the forces of inequality rows beside the equality rows of `system`, which is assembled.
    ///
    /// From H Jᵀ as rows and J (m×nv), aref, D and friction loss (m); the groups of rows by `dims` (0 friction loss, 1 unilateral, more
    /// an elliptic cone of so many rows), with `mu` (one each) and `friction` (five each); and, to start near the answer,
    /// an acceleration `near` it (nv).
    #[pyo3(signature = (system, whitened, jacobian, aref, stiffness, friction_loss, dims, mu, friction, near=None))]
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // the arrays of a step, as PyO3 hands them over
    fn solve(
        &self,
        py: Python<'_>,
        system: &ConstrainedSystem,
        whitened: &Bound<'_, PyAny>,
        jacobian: &Bound<'_, PyAny>,
        aref: &Bound<'_, PyAny>,
        stiffness: &Bound<'_, PyAny>,
        friction_loss: &Bound<'_, PyAny>,
        dims: Vec<usize>,
        mu: &Bound<'_, PyAny>,
        friction: &Bound<'_, PyAny>,
        near: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<InequalityReport> {
        let system = &mut *system.take()?;
        let nv = system.nv();
        let aref = vector("aref", aref)?;
        let shape = [aref.len(), nv];
        let (whitened, jacobian) =
            (matrix("whitened", whitened, shape)?, matrix("jacobian", jacobian, shape)?);
        let stiffness = vector("stiffness", stiffness)?;
        let friction_loss = vector("friction_loss", friction_loss)?;
        let friction = matrix("friction", friction, [dims.len(), WIDEST_CONE - 1])?;
        let mu = vector("mu", mu)?;
        if mu.len() != dims.len() {
            let (expected, got) = (dims.len().to_string(), format!("{} entries", mu.len()));
            return Err(input_error(core::Error::Shape { what: "mu", expected, got }));
        }
        let groups = groups(&dims, mu.as_slice()?, friction.as_slice()?);
        let near = near.map(|given| vector("near", given)).transpose()?;
        let near = near.as_ref().map(|near| near.as_slice()).transpose()?;
        let given = whitened.as_slice()?;
        let step = core::InequalityStep {
            jacobian: jacobian.as_slice()?,
            aref: aref.as_slice()?,
            stiffness: stiffness.as_slice()?,
            friction_loss: friction_loss.as_slice()?,
            groups: &groups,
        };
        let mut whiten = |_: &[usize], _: &[f64], out: &mut [f64]| out.copy_from_slice(given);
        let inner = &mut *alone(|| "the inequalities".to_owned(), &self.inner)?;
        let (report, elapsed) = py.detach(|| {
            let begin = Instant::now();
            let report = inner.solve(system, &step, near, Some(&mut whiten));
            (report, begin.elapsed())
        });
        let report = report.map_err(input_error)?;
        Ok(InequalityReport {
            status: report.status.name(),
            iterations: report.iterations,
            evaluations: report.evaluations,
            gradient: report.gradient,
            active: report.active,
            changed: report.changed,
            blocked: report.blocked,
            coordinates: report.coordinates,
            warm: report.warm,
            elapsed_ns: elapsed.as_nanos().try_into().unwrap_or(u64::MAX),
        })
    }

    /// Forces f (m) of the last solve.
    #[getter]
    fn forces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let inner = alone(|| "the inequalities".to_owned(), &self.inner)?;
        Ok(PyArray1::from_slice(py, inner.forces()))
    }

    /// Jᵀ f (nv) of the last solve.
    #[getter]
    fn generalised_force<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let inner = alone(|| "the inequalities".to_owned(), &self.inner)?;
        Ok(PyArray1::from_slice(py, inner.generalised_force()))
    }

    /// The piece that each row (m) lies on: 0 free, 1 a unilateral row that pushes, 2 sticking, 3 and 4 a friction loss that slips
    /// with x < 0 and x > 0, 5 a sliding contact.
    #[getter]
    fn pieces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let inner = alone(|| "the inequalities".to_owned(), &self.inner)?;
        let codes: Vec<u8> = inner.pieces().iter().map(|piece| piece.code()).collect();
        Ok(PyArray1::from_vec(py, codes))
    }

    /// Rows that push against equality rows alone.
    #[getter]
    fn blocked(&self) -> PyResult<Vec<usize>> {
        let inner = alone(|| "the inequalities".to_owned(), &self.inner)?;
        Ok(inner.blocked().to_vec())
    }

    /// What proves the forces f (m) at the acceleration (nv) of the whole answer of the last step.
    fn certify(&self, acceleration: &Bound<'_, PyAny>, forces: &Bound<'_, PyAny>) -> PyResult<Certificate> {
        let (acceleration, forces) = (vector("acceleration", acceleration)?, vector("forces", forces)?);
        let inner = &mut *alone(|| "the inequalities".to_owned(), &self.inner)?;
        let found = inner.certify(acceleration.as_slice()?, forces.as_slice()?).map_err(input_error)?;
        Ok(Certificate {
            holds: found.holds(),
            gradient: found.gradient,
            rounding: found.rounding,
            complementarity: found.complementarity,
            gap: found.gap,
            infeasibility: found.infeasibility,
        })
    }

    /// Forgets all earlier steps.
    fn reset(&self) -> PyResult<()> {
        alone(|| "the inequalities".to_owned(), &self.inner)?.reset();
        Ok(())
    }
}
