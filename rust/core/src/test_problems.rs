//! Problems with an answer known from outside, for tests and benchmarks that need no `MuJoCo`.
//!
//! | module | problem | what is known |
//! |---|---|---|
//! | [`boat`](mod@boat) | the paper's rowing boat | the motion, in closed form; with as many oars as wanted |
//! | [`n_four_bar`] | N four-bar loops side by side, which lose N ranks at the horizontal | the acceleration, in closed form |
//! | [`sequence`] | random slowly varying A = J Jᵀ and b | J, hence A⁺ b to any precision |

pub mod boat;
pub mod n_four_bar;
pub mod sequence;

pub use boat::{BoatStep, Galley, NV, PAPER_ITERATIONS, RANK, ROWS, boat, boat_at};
pub use n_four_bar::NFourBar;
pub use sequence::{Sequence, SequenceStep};
