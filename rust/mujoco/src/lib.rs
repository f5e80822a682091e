//! The step loops of oarlock over MuJoCo's own library.

pub mod curvature;
pub mod error;
pub mod kinematics;
pub mod library;
pub mod tendon;
pub mod vectors;

pub use error::Error;
