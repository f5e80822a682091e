//! Exact constraint multipliers for closed-chain mechanisms.
//!
//! # The problem
//!
//! A mechanism with `nv` velocities and `n` constraint rows moves by
//!
//! ```text
//!     M a = f + Jᵀ λ        M: nv×nv symmetric positive definite (mass matrix), f: nv (all smooth forces)
//!     J a = aref            J: n×nv of rank r ≤ n,  aref: n (−J̇v, and Baumgarte's terms)
//! ```
//!
//! Eliminating the acceleration `a` (nv) leaves the multipliers `λ` (n) as the solution of
//!
//! ```text
//!     A λ = b,    A = J M⁻¹ Jᵀ  (n×n, symmetric positive semidefinite, rank r),    b = aref − J M⁻¹ f.
//! ```
//!
//! Closed chains have redundant rows, so `r < n` is the rule: `A` is singular, `λ` is not unique, `a` and `Jᵀλ`
//! are. The solution wanted is the *minimum-norm least-squares* one, `λ = A⁺ b`.
//!
//! Signs are MuJoCo's. The paper that the method comes from writes `M a = f − Gᵀ μ` and `b = G M⁻¹ f − h`; its
//! multiplier is `μ = −λ` and its right-hand side `−b`, which changes no iteration count and no norm.
//!
//! # The parts, in the order that data flows
//!
//! | module | noun |
//! |---|---|
//! | [`step`] | [`StepView`](step::StepView): what one time step hands over (rows of J, M, f, aref, and R if the rows are soft) |
//! | [`system`] | [`ConstrainedSystem`](system::ConstrainedSystem): A and b of that step, and the way back from λ to a |
//! | [`solver`] | [`MultiplierSolver`](solver::MultiplierSolver): the trait, and the registry of names |
//! | [`sr1`] | the paper's algorithm (11): an SR1 iteration that carries A⁺ from step to step |
//! | [`quasi_newton`] | what the paper compares with: SR1, BFGS and DFP with line search, carried the same way |
//! | [`pinv`] | the reference: pseudo-inverse from a symmetric eigendecomposition |
//! | [`regularised`] | Cholesky of A + ε E with proximal steps: what regularising engines do |
//! | [`cg`], [`minres`] | conjugate gradients and minimum residuals, in the frame of [`krylov`] |
//! | [`eigen`] | the eigendecomposition behind both, with its rank cut |
//! | [`params`], [`info`], [`error`] | what is asked, what came out, what was wrong with the input |
//! | [`time_law`] | scalar laws of time, for drives |
//! | [`test_problems`] | the boat of the paper in closed form, and random systems, for tests and benchmarks |
//!
//! Parameters, information and errors are three types: not converging is a [`Status`](info::Status), bad input is
//! an [`Error`](error::Error), a panic is a bug. After its first solve of a size no solver allocates.
//!
//! # Which claim of the paper holds where
//!
//! Measured in `tests/sr1.rs` and, along the boat's trajectory, by the harness:
//!
//! | claim | holds |
//! |---|---|
//! | secant condition H y = s is hereditary (Lemma 2) | yes, to rounding |
//! | all r, y, s stay in range(A₀) when range(A) does not move (Lemma 1) | yes |
//! | at most r₁ + 1 iterations after a change of A of rank r₁ | yes |
//! | x is the minimum-norm solution | only while null(A) stands still: range(H) ⊆ range(H₀) for ever |
//! | ‖Ax − b‖ ≤ ε is reached | only while b is in range(A): the floor is ‖Nᵀb‖, N a basis of null(A) |
//!
//! # References
//!
//! V. N. Ivanov, "Iterative method of solving systems of linear algebraic equations with positive semidefinite
//! matrices" (in Russian; known by title and abstract, journal and year not verified).
//! J. Baumgarte, "Stabilization of constraints and integrals of motion in dynamical systems", CMAME 1 (1972) 1–16.

pub mod auto;
pub mod bench;
pub mod carried;
pub mod cg;
pub mod cholesky;
pub mod eigen;
pub mod error;
pub mod fold;
pub mod history;
pub mod info;
mod kernels;
pub mod krylov;
pub mod minres;
pub mod null_space;
pub mod params;
pub mod pinv;
pub mod problem;
pub mod quasi_newton;
pub mod regularised;
mod small;
pub mod solver;
pub mod sr1;
pub mod step;
pub mod system;
pub mod test_problems;
pub mod time_law;
pub mod tracked;

pub use error::Error;
pub use info::{Info, Status};
pub use params::Options;
pub use problem::{Needs, Problem, Wanted};
pub use solver::{MultiplierSolver, SOLVERS, State, make_solver};
pub use step::StepView;
pub use system::ConstrainedSystem;
pub use time_law::TimeLaw;
