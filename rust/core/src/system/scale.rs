//! Powers of two by which small systems are scaled, lest squares of their entries underflow.

use crate::linalg::kernels::largest;

/// Entries of A or b below this are scaled: squares of what is 1e-16 of them are still numbers.
const SMALL: f64 = 1e-120;

/// What is smaller counts as zero: what is made of it would overflow.
const LEAST: f64 = f64::MIN_POSITIVE;

/// k with 2ᵏ near 1/value, if the value is small and not zero; otherwise 0.
pub(super) fn exponent_of_small(value: f64) -> i32 {
    if value > LEAST && value < SMALL { exponent_of(value) } else { 0 }
}

/// The same for the entries of W, of whose squares `most` is the largest.
pub(super) fn exponent_of_factor(whitened: &[f64], most: f64) -> i32 {
    let longest = if most < SMALL { largest(whitened) } else { 0.0 };
    if longest > LEAST.sqrt() { exponent_of(longest) } else { 0 }
}

/// k with 2ᵏ near 1/value.
#[cold]
fn exponent_of(value: f64) -> i32 {
    #[allow(clippy::cast_possible_truncation)] // the exponent of a normal number
    let exponent = (-value.log2().round()) as i32;
    exponent
}

pub(super) fn power_of_two(exponent: i32) -> f64 {
    // Next to always.
    if exponent == 0 { 1.0 } else { f64::from(exponent).exp2() }
}
