//! Successive over-relaxation, as a solver of one's own for `oarlock-core`.
//!
//! ```text
//!     x_i += ω (b_i − A_i x) / A_ii        over the rows i with A_ii > 0, sweep after sweep, until ‖A x − b‖ ≤ rtol ‖b‖
//! ```
//!
//! With 0 < ω < 2 it converges on positive semidefinite A where b is in range(A) (H. B. Keller, "On the solution of singular and
//! semidefinite linear systems by iteration", SIAM J. Numer. Anal. 2 (1965) 281–290), to a solution that depends on where it
//! began: not to the minimum norm. It begins with the last x.

use oarlock_core::info::{Info, Status};
use oarlock_core::params::{Params, Reader};
use oarlock_core::problem::{Needs, Problem};
use oarlock_core::solvers::Solver;
use oarlock_core::{Error, State};

/// Parameters of [`Sor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SorParams {
    /// ω, in (0, 2).
    pub omega: f64,
    /// Of the stopping test; > 0.
    pub rtol: f64,
    /// Sweeps after which a solve gives up.
    pub max_iterations: usize,
}

impl Params for SorParams {
    const SOLVER: &'static str = "sor";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            omega: 2.0 * reader.fraction("half_omega", 0.6)?,
            rtol: reader.positive("rtol", 1e-10)?,
            max_iterations: reader.count("max_iterations", 10_000)?,
        })
    }
}

/// Successive over-relaxation with the x of the last solve.
#[derive(Debug, Clone)]
pub struct Sor {
    params: SorParams,
    x: Vec<f64>,
}

impl Solver for Sor {
    type Params = SorParams;
    const SUMMARY: &'static str = "successive over-relaxation, from the last solution";
    const NEEDS: Needs = Needs::Dense;

    fn new(params: SorParams) -> Self {
        Self { params, x: Vec::new() }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let b = problem.rhs().to_vec();
        if self.x.len() != b.len() {
            self.x = vec![0.0; b.len()];
        }
        let size = norm(&b);
        let matrix = problem.matrix();
        let (mut iterations, mut residual) = (0, residual(matrix, &self.x, &b));
        while residual > self.params.rtol * size && iterations < self.params.max_iterations {
            sweep(matrix, &b, self.params.omega, &mut self.x);
            iterations += 1;
            residual = self::residual(matrix, &self.x, &b);
        }
        x.copy_from_slice(&self.x);
        let converged = residual <= self.params.rtol * size;
        Ok(Info {
            status: if converged { Status::Converged } else { Status::IterationLimit },
            iterations,
            products: 2 * iterations + 1,
            residual_rel: if size > 0.0 { residual / size } else { 0.0 },
            inconsistency: None,
            rank: None,
            null_residual: None,
            ..Info::trivial(size)
        })
    }

    fn reset(&mut self) {
        self.x.clear();
    }

    fn state(&self) -> State {
        State::new(SorParams::SOLVER, self.x.len()).with("x", &self.x)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        state.check(SorParams::SOLVER, &[("x", state.size)])?;
        state.check_names(SorParams::SOLVER, &["x"])?;
        self.x = state.field("x").to_vec();
        Ok(())
    }
}

/// One sweep over the rows of A (`n×n`).
fn sweep(matrix: &[f64], b: &[f64], omega: f64, x: &mut [f64]) {
    for (i, row) in matrix.chunks_exact(b.len()).enumerate() {
        if row[i] > 0.0 {
            x[i] += omega * (b[i] - dot(row, x)) / row[i];
        }
    }
}

fn residual(matrix: &[f64], x: &[f64], b: &[f64]) -> f64 {
    let gaps: Vec<f64> = matrix.chunks_exact(b.len()).zip(b).map(|(row, b)| dot(row, x) - b).collect();
    norm(&gaps)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
