//! The experiments: calibration, lockstep, one-step, free run. The same as `oarlock.python_path`, figure for figure.

mod calibration;
mod common;
mod free;
mod lockstep;
mod one_step;

pub use calibration::calibration;
pub use free::{bare, free_mujoco, free_solved};
pub use lockstep::{Asked, lockstep};
use oarlock_core::MultiplierSolver;
pub use one_step::one_step;

/// A solver of its own.
pub type Solver = Box<dyn MultiplierSolver>;
