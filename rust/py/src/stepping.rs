//! The native step loops for Python.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use numpy::{IntoPyArray, PyArray1};
use oarlock_mujoco as native;
use oarlock_mujoco::experiments;
use oarlock_mujoco::projection::Projector;
use oarlock_mujoco::run::Observed;
use oarlock_mujoco::state::{Baumgarte, Form};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

use crate::convert::{InputError, alone, vector};
use crate::solver::MultiplierSolver;
use crate::time_law::TimeLaw;

/// An error of the step loops as a Python exception: MuJoCo's own as its bindings raise them.
pub fn raised(py: Python<'_>, error: &native::Error) -> PyErr {
    let fatal = || py.import("mujoco")?.getattr("FatalError")?.call1((error.to_string(),));
    match error {
        native::Error::Mujoco(_) => fatal().map_or_else(|other| other, PyErr::from_value),
        _ => InputError::new_err(error.to_string()),
    }
}

/// A copy of an `MjModel`.
///
/// # Errors
/// `InputError` if it is none, or cannot be copied.
pub fn copied(py: Python<'_>, model: &Bound<'_, PyAny>) -> PyResult<Arc<native::library::Model>> {
    copy_of(py, model).map(Arc::new)
}

fn copy_of(py: Python<'_>, model: &Bound<'_, PyAny>) -> PyResult<native::library::Model> {
    if !model.is_instance(&py.import("mujoco")?.getattr("MjModel")?)? {
        return Err(InputError::new_err(format!("{model} is no model, expected a mujoco.MjModel")));
    }
    let address = model.getattr("_address")?.extract()?;
    // SAFETY: it is the address of a model that MuJoCo's own bindings keep, of the library that `open_mujoco` checked, and
    // the interpreter lock keeps other Python code from writing to it.
    #[allow(unsafe_code)]
    let copy = unsafe { native::library::Model::copy_of(address) };
    copy.map_err(|error| raised(py, &error))
}

fn form(name: &str) -> PyResult<Form> {
    match name {
        "matched" => Ok(Form::Matched),
        "hard" => Ok(Form::Hard),
        other => Err(InputError::new_err(format!("form = '{other}', expected one of: matched, hard"))),
    }
}

/// Resolves the native step loops from MuJoCo's library at `path`, which 'import mujoco' must have loaded.
///
/// Raises `InputError` if nothing is known of the layout of its version.
#[pyfunction]
pub fn open_mujoco(py: Python<'_>, path: &str) -> PyResult<()> {
    native::library::open(path).map_err(|error| raised(py, &error))
}

/// The versions of MuJoCo whose layouts are known, as `mj_version()` has them, oldest first.
#[pyfunction]
pub fn mujoco_versions() -> Vec<i32> {
    native::library::versions()
}

/// Struct, field, type in C, and offset of a field.
type Place = (&'static str, &'static str, &'static str, u32);

/// The layout of a version of MuJoCo: struct, field, type in C and offset (bytes) of everything that the step loops read,
/// the bytes of an mjContact, and mjNEQDATA. None where it is not known.
#[pyfunction]
pub fn mujoco_layout(version: i32) -> Option<(Vec<Place>, usize, usize)> {
    let layout = native::library::layout(version)?;
    let places = layout.places.iter().map(|one| (one.whole, one.field, one.kind, one.offset));
    Some((places.collect(), layout.contact_size, layout.eq_data_width))
}

/// A prepared model at a consistent start, with its drive. The model is copied: later changes to it are not seen.
#[pyclass(frozen, module = "oarlock._core")]
pub struct Setup {
    inner: native::run::Setup,
}

type SolverRef<'py> = PyRef<'py, MultiplierSolver>;

#[pymethods]
#[allow(clippy::needless_pass_by_value)] // extracted arguments are owned
impl Setup {
    /// Of an `MjModel`: positions (nq), velocities (nv), activations (na), laws of actuators and of equalities by number,
    /// the timestep (s) and whether controls are held over it, Baumgarte's terms (1/s, 1/s²), what to
    /// note for an outside truth (("qpos", entry) or ("site", number)), whether to note energies, the steps whose states are
    /// kept whole, and whether MuJoCo's answers are held against the minimum that they should be.
    #[new]
    #[allow(clippy::too_many_arguments, clippy::fn_params_excessive_bools)] // keywords in Python
    #[pyo3(signature = (model, *, qpos, qvel, act, laws, switches, step_s, held, beta, k, observed, conserved, inequalities, snapshots, doubted=false))]
    fn new(
        py: Python<'_>,
        model: &Bound<'_, PyAny>,
        qpos: &Bound<'_, PyAny>,
        qvel: &Bound<'_, PyAny>,
        act: &Bound<'_, PyAny>,
        laws: Vec<(usize, PyRef<'_, TimeLaw>)>,
        switches: Vec<(usize, PyRef<'_, TimeLaw>)>,
        step_s: f64,
        held: bool,
        beta: f64,
        k: f64,
        observed: Option<(String, usize)>,
        conserved: bool,
        inequalities: bool,
        snapshots: Vec<usize>,
        doubted: bool,
    ) -> PyResult<Self> {
        let model = copy_of(py, model)?;
        let model = Arc::new(if doubted { model.doubted() } else { model });
        let observed = match observed {
            None => None,
            Some((kind, index)) if kind == "qpos" && index < model.nq() => Some(Observed::Coordinate(index)),
            Some((kind, index)) if kind == "site" && index < model.site_bodyid().len() => {
                Some(Observed::Site(index))
            }
            Some((kind, index)) => {
                return Err(InputError::new_err(format!(
                    "the model has no {kind} {index}, expected qpos or site"
                )));
            }
        };
        if let Some((actuator, _)) = laws.iter().find(|(actuator, _)| *actuator >= model.nu()) {
            return Err(InputError::new_err(format!("the model has no actuator {actuator}")));
        }
        let equalities = model.eq_type().len();
        if let Some((equality, _)) = switches.iter().find(|(equality, _)| *equality >= equalities) {
            return Err(InputError::new_err(format!("the model has no equality {equality}")));
        }
        let laws = laws.into_iter().map(|(actuator, law)| (actuator, law.inner.clone())).collect();
        let switches = switches.into_iter().map(|(equality, law)| (equality, law.inner.clone())).collect();
        let inner = native::run::Setup {
            model,
            drive: native::drive::Drive::new(laws, switches, step_s, held),
            qpos: vector("qpos", qpos)?.as_slice()?.to_vec(),
            qvel: vector("qvel", qvel)?.as_slice()?.to_vec(),
            act: vector("act", act)?.as_slice()?.to_vec(),
            baumgarte: Baumgarte { beta, k },
            observed,
            conserved,
            inequalities,
            snapshots,
        };
        Ok(Self { inner })
    }

    /// MuJoCo's own force through our stepping, against MuJoCo.
    fn calibration(&self, py: Python<'_>, steps: usize) -> PyResult<Run> {
        Run::of(py, experiments::calibration(&self.inner, steps))
    }

    /// Every question (form, solvers) along the walk of MuJoCo, or of a solver in the hard form, whose steps
    /// a projector with a solver of its own may end.
    #[pyo3(signature = (steps, questions, leader=None, projector=None))]
    fn lockstep(
        &self,
        py: Python<'_>,
        steps: usize,
        questions: Vec<(String, Vec<SolverRef<'_>>)>,
        leader: Option<SolverRef<'_>>,
        projector: Option<SolverRef<'_>>,
    ) -> PyResult<Run> {
        let projector = self.projector(projector.as_deref())?;
        let leader = leader.map(|solver| Ok::<_, PyErr>((solver.fresh()?, projector))).transpose()?;
        let asked = questions.iter().map(|(name, solvers)| {
            Ok((form(name)?, solvers.iter().map(|solver| solver.fresh()).collect::<PyResult<_>>()?))
        });
        Run::of(py, experiments::lockstep(&self.inner, leader, asked.collect::<PyResult<_>>()?, steps))
    }

    /// From each of MuJoCo's states, one step of every (form, solver).
    fn one_step(&self, py: Python<'_>, steps: usize, asked: Vec<(String, SolverRef<'_>)>) -> PyResult<Run> {
        let asked = asked.iter().map(|(name, solver)| Ok((form(name)?, solver.fresh()?)));
        Run::of(py, experiments::one_step(&self.inner, asked.collect::<PyResult<_>>()?, steps))
    }

    /// `mj_step` alone, and nothing written down.
    fn bare(&self, py: Python<'_>, steps: usize) -> PyResult<Run> {
        Run::of(py, experiments::bare(&self.inner, steps))
    }

    /// MuJoCo walks alone.
    fn free_mujoco(&self, py: Python<'_>, steps: usize) -> PyResult<Run> {
        Run::of(py, experiments::free_mujoco(&self.inner, steps))
    }

    /// A solver walks in a form; a projector may end its steps, and a solver may walk beside it with half the timestep,
    /// which tells its error. Where it is judged, MuJoCo as configured walks beside it, and another solver says the
    /// minimum-norm multipliers.
    #[pyo3(signature = (steps, form_name, solver, projector=None, beside=None, judged=true))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn free_solved(
        &self,
        py: Python<'_>,
        steps: usize,
        form_name: &str,
        solver: SolverRef<'_>,
        projector: Option<SolverRef<'_>>,
        beside: Option<SolverRef<'_>>,
        judged: bool,
    ) -> PyResult<Run> {
        let beside = beside.map(|solver| solver.fresh()).transpose()?;
        let (form, projector) = (form(form_name)?, self.projector(projector.as_deref())?);
        Run::of(
            py,
            experiments::free_solved(&self.inner, form, solver.fresh()?, projector, beside, judged, steps),
        )
    }

    /// Where the time of a free run on exact constraints goes, as a dictionary: parts, by the order of a step, {part: (time in
    /// ns, looks at the clock in it)}; `whole_ns`; `look_ns`, what a look costs; solves, unconverged, iterations, products and
    /// refreshes of the walk; rows and `folded_rows` of its last step; state, as that of a `Run`, at its end.
    fn profile<'py>(
        &self,
        py: Python<'py>,
        steps: usize,
        solver: SolverRef<'_>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let solver = solver.fresh()?;
        let walked = py.detach(|| experiments::profile(&self.inner, solver, steps));
        let profile = walked.map_err(|error| raised(py, &error))?;
        let parts = PyDict::new(py);
        for (part, spent) in experiments::Part::ALL.iter().zip(&profile.spent) {
            parts.set_item(part.name(), (nanoseconds(spent.time), spent.looks))?;
        }
        let (dict, tally) = (PyDict::new(py), profile.tally);
        dict.set_item("parts", parts)?;
        dict.set_item("whole_ns", nanoseconds(profile.whole))?;
        dict.set_item("look_ns", profile.look_ns)?;
        dict.set_item("solves", tally.solves)?;
        dict.set_item("unconverged", tally.unconverged)?;
        dict.set_item("iterations", tally.iterations)?;
        dict.set_item("products", tally.products)?;
        dict.set_item("refreshes", tally.refreshes)?;
        dict.set_item("rows", profile.rows[0])?;
        dict.set_item("folded_rows", profile.rows[1])?;
        dict.set_item("state", state_of(py, &profile.data))?;
        Ok(dict)
    }
}

impl Setup {
    fn projector(&self, solver: Option<&MultiplierSolver>) -> PyResult<Option<Projector>> {
        let Some(solver) = solver else { return Ok(None) };
        let left = self.inner.left().map_err(|error| InputError::new_err(error.to_string()))?;
        Ok(Some(Projector::new(&self.inner.model, solver.fresh()?).leaving(left)))
    }
}

/// Goes on with many runs by so many steps each, on as many threads as there are cores (or `RAYON_NUM_THREADS`); gives the
/// number of steps that each took.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)] // extracted arguments are owned
pub fn advance_all(py: Python<'_>, runs: Vec<PyRef<'_, Run>>, steps: usize) -> PyResult<Vec<usize>> {
    let mut taken = Vec::new();
    for (index, run) in runs.iter().enumerate() {
        if runs[..index].iter().any(|other| std::ptr::eq(&raw const **other, &raw const **run)) {
            return Err(InputError::new_err(format!("runs[{index}] is there twice, expected each run once")));
        }
        taken.push(run.take()?);
    }
    let mut inner: Vec<_> = taken.iter_mut().map(|run| &mut **run).collect();
    Ok(py.detach(|| native::run::advance_all(&mut inner, steps)))
}

/// A column of a run's table.
#[pyclass(frozen, module = "oarlock._core")]
pub struct Column {
    /// "float", "int", "text" or "list".
    #[pyo3(get)]
    kind: &'static str,
    /// float, int: a number a row; text: a place among `words` a row; list: the numbers of all rows.
    #[pyo3(get)]
    values: Py<PyAny>,
    /// float, int: where a row has nothing, if that may be; else None.
    #[pyo3(get)]
    missing: Option<Py<PyArray1<bool>>>,
    /// text: the different words; else none.
    #[pyo3(get)]
    words: Vec<&'static str>,
    /// list: how many numbers each row has; else None.
    #[pyo3(get)]
    lengths: Option<Py<PyArray1<usize>>>,
}

impl Column {
    fn of(py: Python<'_>, column: native::steps::Column) -> Self {
        use native::steps::{Column as Native, NOTHING};
        let missing = |flags: Vec<bool>| flags.into_pyarray(py).unbind();
        let (kind, values, missing, words, lengths) = match column {
            Native::Float { values, nullable } => {
                let missing = nullable.then(|| missing(values.iter().map(|value| value.is_nan()).collect()));
                ("float", values.into_pyarray(py).into_any(), missing, Vec::new(), None)
            }
            Native::Int { values, nullable } => {
                let missing =
                    nullable.then(|| missing(values.iter().map(|&value| value == NOTHING).collect()));
                ("int", values.into_pyarray(py).into_any(), missing, Vec::new(), None)
            }
            Native::Text { words, codes } => ("text", codes.into_pyarray(py).into_any(), None, words, None),
            Native::List { values, lengths } => {
                let lengths = lengths.into_pyarray(py).unbind();
                ("list", values.into_pyarray(py).into_any(), None, Vec::new(), Some(lengths))
            }
        };
        Self { kind, values: values.unbind(), missing, words, lengths }
    }
}

/// A run on its way, made by a `Setup`.
#[pyclass(frozen, module = "oarlock._core")]
pub struct Run {
    inner: Mutex<native::run::Run>,
}

type State<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, f64);
fn state_of<'py>(py: Python<'py>, data: &native::library::Data) -> State<'py> {
    (data.qpos().to_vec().into_pyarray(py), data.qvel().to_vec().into_pyarray(py), data.time())
}

fn nanoseconds(time: Duration) -> f64 {
    1e9 * time.as_secs_f64()
}

type Snapshot<'py> = (usize, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl Run {
    /// Goes on by so many steps and gives the number of steps taken; fewer than asked for: it has ended.
    fn advance(&self, py: Python<'_>, steps: usize) -> PyResult<usize> {
        let run = &mut *self.take()?;
        Ok(py.detach(|| run.advance(steps)))
    }

    /// Takes all steps that are left without writing anything down: what the walk itself costs, with MuJoCo's timers standing
    /// still or running.
    #[pyo3(signature = (timers=false))]
    fn walk(&self, py: Python<'_>, timers: bool) -> PyResult<()> {
        let run = &mut *self.take()?;
        py.detach(|| if timers { run.walk_timed() } else { run.walk() }).map_err(|error| raised(py, &error))
    }

    /// What ended it before its last step: its step, time (s), and why, as (kind, message) with kind "not-finite",
    /// "control" or "refused". None if nothing did. Raises what MuJoCo raised.
    #[getter]
    fn end(&self, py: Python<'_>) -> PyResult<Option<(usize, f64, &'static str, String)>> {
        let run = self.take()?;
        let Some(end) = run.end() else { return Ok(None) };
        let (kind, message) = match &end.error {
            None => ("not-finite", String::new()),
            Some(error @ native::Error::Mujoco(_)) => return Err(raised(py, error)),
            // MuJoCo's integrators are asked at their stages, not at the time of the state.
            Some(error @ native::Error::Control { time, .. }) => {
                return Ok(Some((end.step, *time, "control", error.to_string())));
            }
            Some(error) => ("refused", error.to_string()),
        };
        Ok(Some((end.step, end.time, kind, message)))
    }

    /// Positions (nq), velocities (nv) and time (s) of the walker.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<State<'py>> {
        Ok(state_of(py, self.take()?.data()))
    }

    /// The rows since the last call: {name: column} for each who answers.
    fn tables<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let tables = PyList::empty(py);
        for columns in self.take()?.take_tables() {
            let table = PyDict::new(py);
            for (name, column) in columns {
                table.set_item(name, Column::of(py, column))?;
            }
            tables.append(table)?;
        }
        Ok(tables)
    }

    /// The states kept whole since the last call: (step, qpos, qvel, multipliers).
    fn snapshots<'py>(&self, py: Python<'py>) -> PyResult<Vec<Snapshot<'py>>> {
        let taken = self.take()?.take_snapshots().into_iter();
        Ok(taken
            .map(|kept| {
                let arrays = (
                    kept.qpos.into_pyarray(py),
                    kept.qvel.into_pyarray(py),
                    kept.multipliers.into_pyarray(py),
                );
                (kept.step, arrays.0, arrays.1, arrays.2)
            })
            .collect())
    }
}

impl Run {
    fn of(py: Python<'_>, made: Result<native::run::Run, native::Error>) -> PyResult<Self> {
        made.map(|inner| Self { inner: Mutex::new(inner) }).map_err(|error| raised(py, &error))
    }

    /// The run, for one thread.
    fn take(&self) -> PyResult<MutexGuard<'_, native::run::Run>> {
        alone(|| "the run".to_owned(), &self.inner)
    }
}
