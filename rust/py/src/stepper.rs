//! Exact steps on data of a Python program, for Python.

use std::sync::{Arc, Mutex, MutexGuard};

use numpy::{IntoPyArray, PyArray1, PyArray3, PyArrayMethods, PyReadonlyArray3};
use oarlock_mujoco as native;
use oarlock_mujoco::library::{Data, Options};
use oarlock_mujoco::state::Baumgarte;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{InputError, alone};
use crate::solver::{Info, MultiplierSolver};
use crate::stepping::{copied, raised};

/// Takes steps of exact constraints on mjData that belong to others. The model is copied: later changes to it are not seen.
#[pyclass(frozen, module = "oarlock._core")]
pub struct Stepper {
    inner: Mutex<native::stepper::Stepper>,
    /// The data of the last step, which was found to be one of this model, and its address: a look at both costs as much as
    /// a stage of a small model.
    known: Mutex<Option<(Py<PyAny>, usize)>>,
    require: Py<PyAny>,
    /// The model that was given, kept for its address, and its options then.
    given: (Py<PyAny>, usize, Options),
}

type States<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

#[pymethods]
#[allow(clippy::needless_pass_by_value)] // extracted arguments are owned
impl Stepper {
    /// Of an `MjModel`: the one `given` that it is a copy of, whose options are to stay what they are, who solves, who
    /// projects at the end of a step, Baumgarte's terms (1/s, 1/s²), whether it has mocap bodies, and what is called with an
    /// `MjData` to make sure that it is one of this model.
    #[new]
    #[pyo3(signature = (model, *, given, solver, projector, beta, k, sensors, energy, mocaps, require))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn new(
        py: Python<'_>,
        model: &Bound<'_, PyAny>,
        given: &Bound<'_, PyAny>,
        solver: PyRef<'_, MultiplierSolver>,
        projector: Option<PyRef<'_, MultiplierSolver>>,
        beta: f64,
        k: f64,
        sensors: bool,
        energy: bool,
        mocaps: bool,
        require: Py<PyAny>,
    ) -> PyResult<Self> {
        let address = given.getattr("_address")?.extract()?;
        // SAFETY: the address is that of a model, and the interpreter lock keeps other Python code from writing.
        #[allow(unsafe_code)]
        let given = (given.clone().unbind(), address, unsafe { Options::at(address) });
        let projector = projector.map(|solver| solver.fresh()).transpose()?;
        let made = native::stepper::Stepper::new(
            &*copied(py, model)?,
            Baumgarte { beta, k },
            solver.fresh()?,
            projector,
            native::stepper::Noted { sensors, energy },
            mocaps,
        );
        made.map(|inner| Self { inner: Mutex::new(inner), known: Mutex::default(), require, given })
            .map_err(|error| raised(py, &error))
    }

    /// Takes a step with an `MjData`.
    fn step(&self, py: Python<'_>, data: &Bound<'_, PyAny>) -> PyResult<()> {
        let stepper = &mut *self.take()?;
        self.unchanged()?;
        let known = &mut *self.known.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let address = match known {
            Some((object, address)) if object.is(data) => *address,
            _ => {
                self.require.call1(py, (data,))?;
                let address = data.getattr("_address")?.extract()?;
                *known = Some((data.clone().unbind(), address));
                address
            }
        };
        let data = borrowed(stepper.model(), address)?;
        py.detach(|| stepper.step(data)).map_err(|error| raised(py, &error))
    }

    /// Takes steps with each of the mjData at some addresses, on all cores; gives positions (data × steps × nq) and velocities
    /// (data × steps × nv) at the end of each step. `ctrl` (data × steps × nu) is written before each; None leaves controls.
    #[pyo3(signature = (addresses, steps, ctrl=None))]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        addresses: Vec<usize>,
        steps: usize,
        ctrl: Option<PyReadonlyArray3<'py, f64>>,
    ) -> PyResult<States<'py>> {
        let stepper = &mut *self.take()?;
        let model = Arc::clone(stepper.model());
        self.unchanged()?;
        let data =
            addresses.iter().map(|&address| borrowed(&model, address)).collect::<PyResult<Vec<_>>>()?;
        let (nq, nv, nu, count) = (model.nq(), model.nv(), model.nu(), addresses.len());
        let controls = ctrl.as_ref().map(|given| given.as_slice()).transpose()?;
        if controls.is_some_and(|given| given.len() != count * steps * nu) {
            return Err(InputError::new_err(format!(
                "ctrl is of another shape, expected {count}×{steps}×{nu}"
            )));
        }
        let kept: Vec<_> =
            (0..count).map(|_| Mutex::new((vec![0.0; steps * nq], vec![0.0; steps * nv]))).collect();
        let keep = |lane: usize, step: usize, data: &Data| {
            let mut kept = kept[lane].lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            kept.0[step * nq..][..nq].copy_from_slice(data.qpos());
            kept.1[step * nv..][..nv].copy_from_slice(data.qvel());
        };
        let look = |lane: usize, step: usize, data: &mut Data| {
            if step > 0 {
                keep(lane, step - 1, data);
            }
            if let Some(given) = controls {
                data.ctrl_mut().copy_from_slice(&given[(lane * steps + step) * nu..][..nu]);
            }
        };
        py.detach(|| stepper.step_all(data, steps, look)).map_err(|(lane, error)| {
            match raised(py, &error) {
                said if said.is_instance_of::<InputError>(py) => {
                    InputError::new_err(format!("data[{lane}]: {}", said.value(py)))
                }
                other => other,
            }
        })?;
        let mut qpos = Vec::with_capacity(count * steps * nq);
        let mut qvel = Vec::with_capacity(count * steps * nv);
        for (lane, &address) in addresses.iter().enumerate() {
            if steps > 0 {
                keep(lane, steps - 1, &borrowed(&model, address)?);
            }
        }
        for lane in kept {
            let (positions, velocities) =
                lane.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
            qpos.extend(positions);
            qvel.extend(velocities);
        }
        Ok((
            qpos.into_pyarray(py).reshape([count, steps, nq])?,
            qvel.into_pyarray(py).reshape([count, steps, nv])?,
        ))
    }

    /// What the last step of a lane did, as a dictionary; None of one that took none.
    fn figures<'py>(&self, py: Python<'py>, lane: usize) -> PyResult<Option<Bound<'py, PyDict>>> {
        let stepper = self.take()?;
        let Some(found) = stepper.figures(lane) else { return Ok(None) };
        let (figures, tally) = (PyDict::new(py), found.tally);
        let multipliers: Bound<'py, PyArray1<f64>> = found.multipliers.to_vec().into_pyarray(py);
        figures.set_item("info", Info::new(*found.info, std::time::Duration::ZERO))?;
        figures.set_item("status", tally.status.map(oarlock_core::Status::name))?;
        figures.set_item("solves", tally.solves)?;
        figures.set_item("iterations", tally.iterations)?;
        figures.set_item("multipliers", multipliers)?;
        figures.set_item("drift", found.drift)?;
        figures.set_item("active", found.pushing.map(|pushing| pushing.0))?;
        figures.set_item("blocked", found.pushing.map(|pushing| pushing.1))?;
        let projection = found.projection;
        figures.set_item("projection", projection.map(|one| one.landing.name()))?;
        figures.set_item("rounds", projection.map(|one| one.rounds))?;
        figures.set_item("moved", projection.map(|one| one.moved))?;
        Ok(Some(figures))
    }

    /// Forgets all earlier steps.
    fn reset(&self) -> PyResult<()> {
        self.take()?.forget();
        Ok(())
    }
}

impl Stepper {
    fn take(&self) -> PyResult<MutexGuard<'_, native::stepper::Stepper>> {
        alone(|| "the stepper".to_owned(), &self.inner)
    }

    /// Refuses where the options of the model that was given are no longer what they were.
    fn unchanged(&self) -> PyResult<()> {
        let (_, address, then) = &self.given;
        // SAFETY: as where they were taken; the model is kept.
        #[allow(unsafe_code)]
        let now = unsafe { Options::at(*address) };
        if now == *then {
            return Ok(());
        }
        Err(InputError::new_err(
            "the model's options (timestep, gravity, integrator, …) changed after the stepper was made of it, expected a \
             new Stepper",
        ))
    }
}

fn borrowed(model: &Arc<native::library::Model>, address: usize) -> PyResult<Data> {
    if address == 0 {
        return Err(InputError::new_err("address = 0, expected that of an mjData"));
    }
    // SAFETY: the caller's, who gets it from MuJoCo's own bindings and keeps the object while it is used.
    #[allow(unsafe_code)]
    Ok(unsafe { Data::borrowed(model, address) })
}
