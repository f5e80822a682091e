//! The step loops of oarlock over MuJoCo's own library.

pub mod curvature;
pub mod drive;
pub mod error;
pub mod experiments;
pub mod force;
pub mod inertia;
pub mod kinematics;
pub mod library;
pub mod projection;
pub mod run;
pub mod state;
pub mod steps;
pub mod tendon;
pub mod vectors;
pub mod walker;

pub use error::Error;
