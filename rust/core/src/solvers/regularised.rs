//! Cholesky of A + ε E with proximal steps: what engines do that regularise their way out of redundancy.
//!
//! ```text
//!     A + ε E = L Lᵀ,   ε = epsilon · trace(A) / n
//!     x = x₀;   repeat:  x += (A + ε E)⁻¹ (b − A x)     until ‖b − A x‖ ≤ rtol ‖b‖
//! ```
//!
//! One factorisation a solve, then two triangular solves and a product with A a step. It is the proximal point iteration
//! for min ½ xᵀA x − bᵀx (R. T. Rockafellar, "Monotone operators and the proximal point algorithm", SIAM J. Control Optim.
//! 14 (1976) 877–898). Along an eigenvector of A with eigenvalue w a step multiplies the error by ε / (w + ε): one or two
//! steps where w ≫ ε, and as good as none where w ≪ ε.
//!
//! **Where b contradicts itself**, ‖b − A x‖ has the floor ‖Nᵀb‖, N a basis of null(A), and every step adds Nᵀb / ε to the
//! part of x in null(A): the residual is that of least squares, x is far from the minimum norm, and accelerations, which
//! feel A x only, lose the digits by which that part exceeds the rest. A step that takes less than a tenth off the residual
//! is not taken and ends the solve, as [`IterationLimit`](Status::IterationLimit) unless the test is met. With a consistent
//! b, x has minimum norm to rounding / ε, that is to about 1e-16 / `epsilon`, and its error along an eigenvector may exceed
//! the residual by the factor 1 / w. With `warm=1`, x₀ is the last x, and null parts add up over the steps of a run.
//!
//! An A with an eigenvalue below −ε has no factor and is refused. If rounding alone spoils the factor, ε grows by
//! [`GROWTH`] until it does not, a fallback each time.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::cholesky::llt::solve::solve_in_place;
use faer::{MatMut, MatRef, Par, Spec};

use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::linalg::kernels::{axpy, norm, vectorised};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::eigen::{RANK_CUT, SymmetricEigen};
use crate::solvers::solver::{Solver, State};

/// Factor by which ε grows when rounding spoils the factorisation.
const GROWTH: f64 = 100.0;

/// A step counts only if it leaves less than this part of the residual.
const PROGRESS: f64 = 0.9;

/// Default of the stopping test.
const RTOL: f64 = 1e-8;

/// Parameters of [`Regularised`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegularisedParams {
    /// ε in units of the mean eigenvalue, trace(A) / n; > 0.
    pub epsilon: f64,
    /// Of the stopping test ‖b − A x‖ ≤ rtol ‖b‖; > 0.
    pub rtol: f64,
    /// Proximal steps after which a solve gives up.
    pub max_iterations: usize,
    /// Whether a solve starts from the x of the last one.
    pub warm: bool,
}

impl Params for RegularisedParams {
    const SOLVER: &'static str = "cholesky-regularised";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            epsilon: reader.positive("epsilon", 1e-8)?,
            rtol: reader.positive("rtol", RTOL)?,
            max_iterations: reader.count("max_iterations", 20)?,
            warm: reader.switch("warm", false)?,
        })
    }
}

/// The factor and its workspace, and the x of the last solve.
pub struct Regularised {
    params: RegularisedParams,
    /// A + ε E, then L in its lower triangle; column-major, `n×n`.
    factor: Vec<f64>,
    scratch: MemBuffer,
    x: Vec<f64>,
    /// Whether x is that of a solve.
    kept: bool,
    /// b − A x.
    r: Vec<f64>,
    /// The next step, then x after it.
    next: Vec<f64>,
    /// b − A x after it.
    next_r: Vec<f64>,
}

impl Clone for Regularised {
    /// With the same x; the workspace is its own.
    fn clone(&self) -> Self {
        let mut copy = Self::sized(self.params, self.x.len());
        copy.x.copy_from_slice(&self.x);
        copy.kept = self.kept;
        copy
    }
}

impl Regularised {
    fn sized(params: RegularisedParams, n: usize) -> Self {
        let vector = || vec![0.0; n];
        Self {
            params,
            factor: vec![0.0; n * n],
            scratch: MemBuffer::new(cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default())),
            x: vector(),
            kept: false,
            r: vector(),
            next: vector(),
            next_r: vector(),
        }
    }

    fn resize(&mut self, n: usize) {
        if self.x.len() != n {
            *self = Self::sized(self.params, n);
        }
    }

    /// L of A + ε E; gives how often ε had to grow.
    ///
    /// # Errors
    /// [`Error::NotPositiveSemidefinite`], [`Error::Eigen`].
    fn factorise(&mut self, problem: &mut Problem<'_>) -> Result<usize, Error> {
        let n = self.x.len();
        let mut epsilon = (self.params.epsilon * problem.trace() / n as f64).max(f64::MIN_POSITIVE);
        let mut grown = 0;
        loop {
            self.factor.copy_from_slice(problem.matrix());
            for i in 0..n {
                self.factor[i * n + i] += epsilon;
            }
            let matrix = MatMut::from_column_major_slice_mut(&mut self.factor, n, n);
            let stack = MemStack::new(&mut self.scratch);
            let regularisation = LltRegularization::default();
            if vectorised(|| cholesky_in_place(matrix, regularisation, Par::Seq, stack, Spec::default()))
                .is_ok()
            {
                return Ok(grown);
            }
            // On this rare path, and nowhere else, memory is taken: indefinite, or positive semidefinite to rounding?
            if grown == 0 {
                SymmetricEigen::new(n).decompose_alone(problem.matrix(), RANK_CUT)?;
            }
            epsilon *= GROWTH;
            grown += 1;
            if !epsilon.is_finite() {
                return Err(Error::NonFinite { what: "epsilon", index: 0, value: epsilon });
            }
        }
    }

    /// One proximal step into `next`, with its residual.
    fn step(&mut self, problem: &mut Problem<'_>) {
        let n = self.x.len();
        self.next.copy_from_slice(&self.r);
        vectorised(|| {
            solve_in_place(
                MatRef::from_column_major_slice(&self.factor, n, n),
                MatMut::from_column_major_slice_mut(&mut self.next, n, 1),
                Par::Seq,
                MemStack::new(&mut self.scratch),
            );
        });
        axpy(1.0, &self.x, &mut self.next);
        residual(problem, &self.next, &mut self.next_r);
    }
}

/// r = b − A x.
fn residual(problem: &mut Problem<'_>, x: &[f64], r: &mut [f64]) {
    problem.apply(x, r);
    for (r, b) in r.iter_mut().zip(problem.rhs()) {
        *r = b - *r;
    }
}

impl Solver for Regularised {
    type Params = RegularisedParams;
    const SUMMARY: &'static str = "Cholesky of A + ε E with proximal steps, as regularising engines do";
    const NEEDS: Needs = Needs::Dense;

    fn new(params: RegularisedParams) -> Self {
        Self::sized(params, 0)
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        let b_norm = norm(problem.rhs());
        let tolerance = self.params.rtol * b_norm;
        let (mut iterations, mut products, mut fallbacks) = (0, 0, 0);
        let mut r_norm = b_norm;
        if self.params.warm && self.kept {
            residual(problem, &self.x, &mut self.r);
            r_norm = norm(&self.r);
            products += 1;
        }
        if !(self.params.warm && self.kept && r_norm < b_norm) {
            self.x.fill(0.0);
            self.r.copy_from_slice(problem.rhs());
            r_norm = b_norm;
        }
        if r_norm > tolerance {
            fallbacks = self.factorise(problem)?;
        }
        while r_norm > tolerance && iterations < self.params.max_iterations {
            self.step(problem);
            iterations += 1;
            products += 2;
            let next = norm(&self.next_r);
            if next >= PROGRESS * r_norm || next.is_nan() {
                break;
            }
            std::mem::swap(&mut self.x, &mut self.next);
            std::mem::swap(&mut self.r, &mut self.next_r);
            r_norm = next;
        }
        self.kept = true;
        x.copy_from_slice(&self.x);
        Ok(Info {
            status: if r_norm <= tolerance { Status::Converged } else { Status::IterationLimit },
            iterations,
            products,
            residual_rel: if b_norm == 0.0 { 0.0 } else { r_norm / b_norm },
            inconsistency: None,
            rank: None,
            null_residual: None,
            tolerance: if self.params.rtol > RTOL { self.params.rtol } else { 0.0 },
            fallbacks,
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        self.kept = false;
    }

    fn state(&self) -> State {
        let state = State::new(RegularisedParams::SOLVER, self.x.len());
        if self.kept && self.params.warm { state.with("x", &self.x) } else { state }
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        let last = state.last_x(RegularisedParams::SOLVER)?;
        if let Some(x) = last {
            self.resize(x.len());
            self.x.copy_from_slice(x);
        }
        self.kept = last.is_some();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_problems::{ROWS, boat};
    use crate::{ConstrainedSystem, Options, Wanted, make_solver};

    /// The third row is the sum of the others.
    const SUM: [f64; 9] = [2.0, 0.0, 2.0, 0.0, 1.0, 1.0, 2.0, 1.0, 3.0];

    fn solve(options: &Options, matrix: &[f64; 9], rhs: &[f64; 3]) -> Result<([f64; 3], Info), Error> {
        let (mut system, mut x) = (ConstrainedSystem::new(), [0.0; 3]);
        system.set_dense(matrix, rhs)?;
        let info = system.solve(
            &mut *make_solver(RegularisedParams::SOLVER, options)?,
            Wanted::Multipliers,
            &mut x,
        )?;
        Ok((x, info))
    }

    #[test]
    fn the_boat_is_solved_in_two_steps() {
        let mut solver = Regularised::new(RegularisedParams::from_options(&Options::new()).unwrap());
        let (mut system, mut x) = (ConstrainedSystem::new(), [0.0; ROWS]);
        for k in 0..500 {
            system.assemble(&boat(0.01 * f64::from(k)).view()).unwrap();
            let info = system.solve(&mut solver, Wanted::Multipliers, &mut x).unwrap();
            assert_eq!((info.status, info.fallbacks), (Status::Converged, 0), "at {k}: {info:?}");
            assert!(info.iterations <= 2 && info.residual_rel <= 1e-8, "at {k}: {info:?}");
        }
    }

    #[test]
    fn a_contradiction_ends_at_the_least_squares_residual_with_a_null_part_of_its_size_over_epsilon() {
        let (x, info) = solve(&Options::new(), &SUM, &[1.0, 1.0, 0.0]).unwrap();
        assert_eq!(info.status, Status::IterationLimit, "{info:?}");
        assert!(info.iterations <= 3, "{info:?}");
        assert!((info.residual_rel - (2.0_f64 / 3.0).sqrt()).abs() < 1e-7, "{info:?}");
        // ‖Nᵀb‖ = 2/√3 a step; trace(A) / n = 2.
        let steps = norm(&x) / (2.0 / 3.0_f64.sqrt() / 2e-8);
        assert!((steps - 1.0).abs() < 1e-6, "{steps}");
    }

    #[test]
    fn epsilon_grows_where_rounding_spoils_the_factor_and_an_indefinite_matrix_is_refused() {
        let tiny = Options::new().with("epsilon", 1e-19);
        // The third row is 0.1 times the first plus 0.7 times the second, but for a rounding error to the wrong side.
        let spoilt = [1.0, 0.0, 0.1, 0.0, 1.0, 0.7, 0.1, 0.7, 0.5 - 1e-15];
        let (x, info) = solve(&tiny, &spoilt, &[1.1, 1.7, 1.3]).unwrap();
        assert_eq!(info.status, Status::Converged, "{info:?}");
        let reached: f64 = (x[0] + 0.1 * x[2] - 1.1).abs();
        assert!(info.fallbacks > 0 && reached < 1e-7, "{x:?} {info:?}");

        let indefinite = [1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let Err(Error::NotPositiveSemidefinite { smallest, largest }) =
            solve(&Options::new(), &indefinite, &[1.0; 3])
        else {
            panic!("indefinite");
        };
        assert!((smallest + 1.0).abs() < 1e-12 && (largest - 3.0).abs() < 1e-12, "{smallest} {largest}");
    }
}
