//! What can go wrong on the way.

use thiserror::Error as ThisError;

/// What ended a run, or kept it from beginning.
#[derive(Debug, Clone, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// The library is not in this process, lacks a function, or is of another version.
    #[error("{0}")]
    Library(String),
    /// MuJoCo reported an error: `mju_error`, which would have ended the process.
    #[error("{0}")]
    Mujoco(String),
    /// The solver refused the system of a state.
    #[error(transparent)]
    Core(#[from] oarlock_core::Error),
    /// A state or a model that the comparison does not cover; the text says what was expected.
    #[error("{0}")]
    Refused(String),
    /// A projection left rows open that count: the exact solution is lost.
    #[error(
        "the rows can no longer be closed together: the nearest pose leaves one open by more than 1e-6 m or rad, expected none"
    )]
    Lost,
    /// A law of time does not parse or names an unknown variable.
    #[error("time law '{law}': {reason}")]
    TimeLaw {
        /// Source text of the law.
        law: String,
        /// What is wrong.
        reason: String,
    },
    /// A law of the drive has no finite value.
    #[error("law {law} is {value} at t = {time} s, expected a finite control")]
    Control {
        /// Position of the law among those of the drive.
        law: usize,
        /// What it gave.
        value: f64,
        /// s.
        time: f64,
    },
}
