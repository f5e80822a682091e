//! Ugly sequences of steps for every solver of the registry, and what must hold whatever comes.
//!
//! Bytes become a [`Script`](script::Script): options, then systems of changing size, scale and rank, right and wrong,
//! with resets, copies and saved states in between. [`Session`](session::Session) plays it to one solver:
//!
//! - no panic; wrong input is an error of the kind that it calls for, right input is not;
//! - every number that comes back is finite, every figure is possible, and the residual is the true one;
//! - a copy, a restored solver and, after a reset, a new one give the same answer to the last bit.
//!
//! `make fuzz` looks for bytes that break this, with libFuzzer; a test plays a few thousand random ones.

pub mod expected;
pub mod number;
pub mod script;
pub mod session;

use arbitrary::Unstructured;
use oarlock_core::SOLVERS;

/// Plays the script that these bytes are to every solver.
///
/// # Panics
/// If a solver does what it must not.
pub fn run(data: &[u8]) {
    if let Ok(script) = script::Script::read(&mut Unstructured::new(data)) {
        for kind in SOLVERS {
            session::play(kind, &script);
        }
    }
}
