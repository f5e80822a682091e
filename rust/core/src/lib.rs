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
//! # In short
//!
//! ```
//! use oarlock_core::{ConstrainedSystem, Options, StepView, Wanted, make_solver};
//!
//! // A mass of 2 kg in a plane, held by three rods, of which two would do: three rows of rank two.
//! let step = StepView {
//!     mass: &[2.0, 0.0, 0.0, 2.0],
//!     jacobian: &[1.0, 0.0, 0.0, 1.0, 0.6, 0.8],
//!     force: &[0.0, -19.62],
//!     aref: &[0.0; 3],
//!     regularisation: None,
//! };
//! let mut system = ConstrainedSystem::new();
//! let mut solver = make_solver("auto", &Options::new())?;
//! let (mut multipliers, mut force, mut acceleration) = ([0.0; 3], [0.0; 2], [0.0; 2]);
//!
//! // Every step of a simulation does these three.
//! system.assemble(&step)?;
//! let info = system.solve(&mut *solver, Wanted::Multipliers, &mut multipliers)?;
//! system.acceleration(&multipliers, &mut force, &mut acceleration)?;
//!
//! assert_eq!(info.rank, Some(2));
//! for (got, expected) in multipliers.iter().zip([-4.7088, 13.3416, 7.848]) {
//!     assert!((got - expected).abs() < 1e-12, "the forces of least norm, N");
//! }
//! assert!((force[1] - 19.62).abs() < 1e-12 && acceleration[1].abs() < 1e-12, "it hangs still");
//! # Ok::<(), oarlock_core::Error>(())
//! ```
//!
//! # The parts, in the order that data flows
//!
//! | module | noun |
//! |---|---|
//! | [`problem`] | [`StepView`]: what one time step hands over (rows of J, M, f, aref, and R if the rows are soft), or a [`FactoredStep`] of who has M factored; [`Fold`](problem::Fold): zero and proportional rows taken out, exactly; [`Problem`]: what a solver then sees |
//! | [`system`] | [`ConstrainedSystem`]: A and b of that step, and the way back from λ to a |
//! | [`inequalities`] | [`Inequalities`]: what friction loss, limits and contacts push beside those rows |
//! | [`registry`] | [`make_solver`] and [`SOLVERS`]: solvers by name |
//! | [`solvers`] | [`MultiplierSolver`], the trait, and every solver in a file of its own |
//! | [`params`], [`info`], [`error`] | what is asked, what came out, what was wrong with the input |
//! | `bench` | all of them side by side, beside the pseudo-inverses of nalgebra and faer; with the feature `bench` |
//! | `test_problems` | the boat of the paper in closed form, and random systems, for tests and benchmarks; with the feature `bench` |
//!
//! Parameters, information and errors are three types: not converging is a [`Status`], bad input is
//! an [`Error`], a panic is a bug. After its first solve of a size no solver allocates.
//!
//! # Which solver when
//!
//! Time of a solve from the assembled step, as a ratio to the fastest pseudo-inverse by eigendecomposition that nalgebra or
//! faer offers (given A); n rows of a boat with n/6 pairs of oars, a third of them redundant (the feature
//! `bench`; `oarlock bench` measures it anew). All of them give the minimum norm, also where rows contradict one another.
//!
//! | n | 6 | 12 | 24 | 48 | 96 | 192 |
//! |---|---|---|---|---|---|---|
//! | `cholesky` (which `auto` takes) | **0.29** | **0.30** | **0.27** | **0.19** | **0.19** | **0.23** |
//! | `sr1-tracked` | 0.58 | 0.49 | 0.36 | 0.29 | 0.42 | 1.3 |
//! | `pinv` | 1.1 | 1.8 | 1.5 | 1.1 | 1.1 | 1.1 |
//! | `pinv-tracked` | 0.47 | 0.78 | 0.41 | 0.39 | 0.51 | 1.0 |
//! | `cholesky`, given A and b | 0.26 | 0.24 | 0.22 | 0.15 | 0.13 | 0.15 |
//!
//! Walks of `sr1-tracked` cost most at their beginning, before a smooth null space is left as predicted: at n = 192, where
//! these are of the first forty steps only, 227 products a step, and 65 to 105 later.
//!
//! | you want | take |
//! |---|---|
//! | the multipliers of a step, fast and minimum-norm | `auto`: direct, the same answer but for rounding whatever came before |
//! | a second opinion, or ranks near the cut | `pinv`; along a trajectory `pinv-tracked`; a third one `svd` |
//! | the paper's method as published, with its iteration counts | `sr1`; its multipliers are not the minimum-norm ones |
//! | the paper's idea with minimum norm: 0.2 to 2 iterations a step, A never formed | `sr1-tracked` |
//! | the products that a method without a carried inverse needs | `cg` or `minres`; their null space is `pinv`'s, and so is their price |
//! | what a regularising engine would give | `cholesky-regularised`: 1e-7 from minimum norm while rows agree, by a factor of 1e4 and more when they do not |
//!
//! On these problems no quasi-Newton iteration beats a blocked factorisation at any size; its merit is that A is not formed,
//! and that it shows how little changes from step to step.
//!
//! # What is promised, and by whom
//!
//! [`Status::Converged`] means that the acceleration is right, by [`ConstrainedSystem::solve`]: an answer of a solver that iterates or
//! carries something is held against that of a direct one which knows this step alone, block by block
//! ([`reference`](ConstrainedSystem::reference)). `auto` judges most, `pinv` judges `auto` and `cholesky`, `svd` judges `pinv`. Their own
//! errors, against a 60-digit oracle, on 1 200 random mechanisms (planar and spatial loops, welds, gears to 1e5, lead screws, mass
//! ratios to 1e6; conditions of A within a block up to 2e13; `tests/random_mechanisms` of the Python tests):
//!
//! | largest error of an acceleration, of its largest entry | `auto` | `pinv` | `svd` |
//! |---|---|---|---|
//! | hard rows, along MuJoCo's open path, 3 600 states | 3e-7 | 7e-8 | 1e-9 |
//! | soft rows, 3 600 states | 2e-12 | 3e-12 | 2e-12 |
//!
//! # Which claim of the paper holds where
//!
//! P = range(A₀) is the range of A in the step before, F = A − A₀ the change, r₁ its rank. While P stands still, F is
//! semidefinite (of either sign) and ‖F‖ ‖A₀⁺‖ < 1, what the paper proves of [`sr1`](solvers::sr1) holds, but for the last step in
//! Lemma 4 and a symmetry in Lemma 6. `tests/core/claims.rs` has a property test a row, which passed 100 000 random cases (n ≤ 8,
//! condition of A₀ ≤ 12). Errors of the middle column are relative to the products they come from, in units of 1e-15
//! where nothing else is said.
//!
//! | claim | under the hypothesis | beyond it |
//! |---|---|---|
//! | Lemma 1: r, y, s, x stay in P | yes, 1 | any F: yes, but small denominators multiply the error |
//! | Lemma 2: H y = s is hereditary, and x = H b | yes, to 4e-8, where steps as short as 1e-9 are learnt from | any F: an update of relative denominator δ multiplies the error by 1 + 1/δ at most |
//! | Lemma 3: the next s is α (E − H A) s | yes, 1 | any F: yes |
//! | Lemma 4: successive s are linearly independent | all but the last one, which may run along the one before (A = 2 A₀) | |
//! | Lemma 5: s is conjugate to all earlier ones but the last | yes, 5; to the last one it is not (−0.7 in the test) | |
//! | Lemma 6: C D of definite C and semidefinite D has the rank of D and real eigenvalues ≥ 0 | yes; symmetric, as the paper calls it, only where C and D commute | |
//! | (17), (19): an update takes out the error of H along y | yes, 1, times the reciprocal square of δ | |
//! | (20), (21): the direct form stays the pseudo-inverse of H | yes, 15, times the same | |
//! | at most r₁ + 1 steps, the first among them | yes; rounding costs one more in 1 of 400 000 cases | F of two signs: one more in 135 of 100 000 |
//! | H stays positive definite on P, its error and that of its inverse fall | yes | F ≥ 0 of any size: yes. Two signs: no, F = diag(1, −½) makes H indefinite at once |
//! | no denominator vanishes before the last step | yes: the smallest δ is 4e-6, and all have the sign of F | two signs: F = diag(1, −⅓) makes the first one 0 |
//! | ‖x − x*‖ falls in every step | yes, by ‖F‖ ‖A₀⁺‖ or faster | ‖F‖ ‖A₀⁺‖ = 3: x₁ is three times as far from x* as 0 |
//!
//! On the paper's own boat the hypothesis fails (`tests/core/claims_boat.rs`, 12 000 steps of 1 ms). ‖F‖ ‖A₀⁺‖ is 0.014 at
//! most, but F has two signs in every step: its extreme eigenvalues on P are −f and f to a thousandth. Up to 39 % of F
//! lies outside P, for P turns with the oars.
//!
//! | consequence on the boat | figure |
//! |---|---|
//! | denominators of both signs in one solve | 11 975 of 11 998 solves |
//! | relative denominators get small | 186 of 23 982 below 1e-2, 14 below 1e-3, the smallest 1.2e-5; none reaches the guard |
//! | H has negative eigenvalues on the way | 15 solves |
//! | a step leads away from the solution (in the norm of A) | 30 solves |
//! | x loses its minimum norm, for range(H) ⊆ range(H₀) for ever | ‖x − A⁺b‖ / ‖A⁺b‖ up to tan 60° = 1.732, with `sr1`, `sr1-classic`, `bfgs` and `dfp`; 4.3e-9 with [`sr1-tracked`](solvers::tracked) |
//! | every solve converges all the same | in 2.00 iterations at ε = 1e-6, 3 at most; the paper says 1.994 |
//!
//! ‖A x − b‖ ≤ ε is reached only while b is in range(A): the floor is ‖Nᵀb‖, N a basis of null(A), and contradicting
//! rows raise it (`tests/core/sr1.rs`). The work of whole runs is frozen in `tests/core/frozen_counts.rs`.
//!
//! # References
//!
//! V. N. Ivanov, "Iterative method of solving systems of linear algebraic equations with positive semidefinite
//! matrices" (in Russian; known by title and abstract, journal and year not verified).
//! J. Baumgarte, "Stabilization of constraints and integrals of motion in dynamical systems", CMAME 1 (1972) 1–16.

#![warn(unreachable_pub)]
// Modules speak to readers of the source, too.
#![allow(rustdoc::private_intra_doc_links)]

#[cfg(feature = "bench")]
pub mod bench;
pub mod error;
pub mod inequalities;
pub mod info;
mod linalg;
pub mod params;
pub mod problem;
pub mod registry;
pub mod solvers;
pub mod system;
#[cfg(feature = "bench")]
pub mod test_problems;

pub use error::Error;
pub use inequalities::{Group, Inequalities, InequalityReport, InequalityStep};
pub use info::{Info, Status};
pub use params::Options;
pub use problem::{FactoredStep, JacobianView, Needs, Problem, SparseStep, StepView, TreeView, Wanted};
pub use registry::{SOLVERS, make_solver};
pub use solvers::{MultiplierSolver, State};
pub use system::ConstrainedSystem;
