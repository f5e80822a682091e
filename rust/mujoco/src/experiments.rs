//! The experiments: calibration, lockstep, one-step, free run. The same as `oarlock.python_path`, figure for figure; and a
//! profile of the free run's steps.

mod calibration;
mod common;
mod free;
mod lockstep;
mod one_step;
mod profile;

pub use calibration::calibration;
pub use free::{bare, free_mujoco, free_solved};
pub use lockstep::{Asked, lockstep};
use oarlock_core::MultiplierSolver;
pub use one_step::one_step;
pub use profile::{Part, Profile, Spent, profile};

/// A solver of its own.
pub type Solver = Box<dyn MultiplierSolver>;
