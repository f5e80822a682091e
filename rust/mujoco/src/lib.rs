//! The step loops of oarlock over MuJoCo's own library.

pub mod error;
pub mod library;

pub use error::Error;
