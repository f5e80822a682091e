//! The solvers, one file each, and the trait that they share.
//!
//! | module | solver |
//! |---|---|
//! | [`auto`] | `auto`, the default: the fastest accurate solver, with the reference behind it |
//! | [`sr1`] | `sr1`: the paper's algorithm (11), an SR1 iteration that carries A⁺ from step to step |
//! | [`tracked`] | `sr1-tracked`: the same with its null space tracked, so that the minimum norm survives |
//! | [`quasi_newton`] | `sr1-classic`, `bfgs`, `dfp`: what the paper compares with, carried the same way |
//! | [`pinv`] | `pinv`: the reference, a pseudo-inverse from a symmetric eigendecomposition |
//! | [`pinv_tracked`] | `pinv-tracked`: the same to rounding, from eigenvectors refined from step to step |
//! | [`svd`] | `svd`: a second reference, from the singular values of L⁻¹Jᵀ |
//! | [`cholesky`] | `cholesky`: rank-revealing, minimum norm through a basis of the null space |
//! | [`dual`] | `dual`: a sparse factor of A, where it is clearly of full rank, in the frame of [`sparse`] |
//! | [`primal`] | `primal`: a sparse factor of `JᵀJ − τM`, refined; the rank from its inertia |
//! | [`regularised`] | `cholesky-regularised`: Cholesky of A + ε E with proximal steps |
//! | [`cg`], [`minres`] | `cg`, `minres`: conjugate gradients and minimum residuals, in the frame of [`krylov`] |
//!
//! A solver implements [`Solver`]; [`MultiplierSolver`], the interface that callers hold as a trait object, follows from it.

pub mod auto;
pub(crate) mod carried;
pub mod cg;
pub mod cholesky;
pub mod dual;
pub(crate) mod eigen;
pub(crate) mod history;
pub mod krylov;
pub mod minres;
pub(crate) mod null_space;
pub mod pinv;
pub mod pinv_tracked;
pub mod primal;
pub mod quasi_newton;
pub mod regularised;
pub mod solver;
pub mod sparse;
pub mod sr1;
pub mod svd;
pub mod tracked;

pub use eigen::RANK_CUT;
pub use solver::{MultiplierSolver, Solver, State};
