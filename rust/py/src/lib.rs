//! `oarlock._core`: the solvers of `oarlock-core` and the step loops of `oarlock-mujoco` for Python. Conversions, errors and classes; no numerics.
//!
//! Every call that computes releases the interpreter lock.

mod bench;
mod convert;
mod inequalities;
mod own_solver;
mod solver;
mod stepper;
mod stepping;
mod system;
mod time_law;

use pyo3::prelude::*;

/// The compiled core of oarlock: systems, solvers, laws of time, step loops.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::bench::{bench_sizes, bench_solvers};
    #[pymodule_export]
    use super::convert::InputError;
    #[pymodule_export]
    use super::inequalities::{Certificate, Inequalities, InequalityReport};
    #[pymodule_export]
    use super::own_solver::{python_solvers, register_solver};
    #[pymodule_export]
    use super::solver::{Info, MultiplierSolver, make_solver, solvers};
    #[pymodule_export]
    use super::stepper::Stepper;
    #[pymodule_export]
    use super::stepping::{Column, Run, Setup, advance_all, mujoco_layout, mujoco_versions, open_mujoco};
    #[pymodule_export]
    use super::system::ConstrainedSystem;
    #[pymodule_export]
    use super::time_law::TimeLaw;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let profile = if cfg!(debug_assertions) { "debug" } else { "release" };
        module.add("BUILD_PROFILE", profile)?;
        module.add("VERSION", env!("CARGO_PKG_VERSION"))
    }
}
