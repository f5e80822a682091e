//! The paper's algorithm (11): SR1 with a fixed step length, carried from step to step.
//!
//! ```text
//!     H₀ = A₀⁺ (from the previous step; once, at the start, from an eigendecomposition)
//!     s₀ = x₁ = H₀ b,  y₀ = A x₁,  r₁ = y₀ − b,  k = 0
//!     while r_{k+1}ᵀ r_{k+1} > ε²:
//!         if |r_{k+1}ᵀ H_k y_k| > ε ‖H_k r_{k+1}‖ ‖y_k‖:                                      (guard)
//!             H_{k+1} = H_k − (H_k r_{k+1})(H_k r_{k+1})ᵀ / (r_{k+1}ᵀ H_k y_k)
//!             s_{k+1} = −(1 − r_{k+1}ᵀ H_k r_{k+1} / (r_{k+1}ᵀ H_k y_k)) H_k r_{k+1}
//!         else:
//!             H_{k+1} = H_k,  s_{k+1} = −H_k r_{k+1}
//!         k = k + 1;  x_{k+1} = x_k + s_k;  r_{k+1} = A x_{k+1} − b;  y_k = r_{k+1} − r_k
//! ```
//!
//! Two products an iteration, H r and A x. The residual is computed, not updated by A s: when H is wrecked, x can
//! grow until rounding swallows b, and an updated residual would not notice. ε is absolute, as published; the guard's relative form is a choice (the
//! paper's text is damaged there).
//!
//! # Where it falls short, on the paper's own example
//!
//! Every update is a multiple of (H r)(H r)ᵀ, so range(H) never leaves range(H₀). When null(A) turns, x still solves
//! A x = b but is no longer the minimum-norm solution. When b leaves range(A), ‖A x − b‖ cannot fall below ‖Nᵀb‖ and
//! the stopping test is out of reach for a small ε; further updates then come from rounding and wreck H. This file
//! stays faithful, so that both show. It only refuses to hand garbage on. The minimum-norm solution obeys
//! ‖A⁺b‖ ≤ ‖b‖ / λ⁺, with λ⁺ the smallest eigenvalue above the cut; an x beyond [`GROWTH_LIMIT`](crate::carried::GROWTH_LIMIT) times that meets the
//! residual only through eigenvalues that are zero to rounding, and counts as [`Status::Breakdown`]. A solve that ends
//! without convergence says so, recomputes H = A⁺ from an eigendecomposition ([`Info::refreshed`]) and gives x = A⁺ b.

use crate::carried::{CarriedInverse, check_state};
use crate::eigen::RANK_CUT;
use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::kernels::{axpy, dot, gemv, norm, rank_one};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solver::{MultiplierSolver, SolverKind, State};

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: Sr1Params::SOLVER,
    summary: "the paper's algorithm (11): SR1 carried from step to step, faithful",
    build: |options| Ok(Box::new(Sr1::new(Sr1Params::from_options(options)?))),
    options: Sr1Params::defaults,
};

/// Parameters of [`Sr1`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sr1Params {
    /// ε of the stopping test ‖A x − b‖ ≤ ε, in the units of b (m/s² for a connect); > 0.
    pub eps_abs: f64,
    /// ε of the guard of the denominator, relative; in [0, 1).
    pub guard: f64,
    /// Iterations after which a solve gives up. Finite termination promises r + 1; what lies far beyond is noise.
    pub max_iterations: usize,
    /// Rank cut of the eigendecomposition that gives H₀; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for Sr1Params {
    const SOLVER: &'static str = "sr1";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            eps_abs: reader.positive("eps_abs", 1e-6)?,
            guard: reader.fraction("guard", 1e-6)?,
            max_iterations: reader.count("max_iterations", 50)?,
            rank_cut: reader.fraction("rank_cut", RANK_CUT)?,
        })
    }
}

/// Algorithm (11) with the H of the last solve.
#[derive(Clone)]
pub struct Sr1 {
    params: Sr1Params,
    carried: CarriedInverse,
    x: Vec<f64>,
    y: Vec<f64>,
    r: Vec<f64>,
    hr: Vec<f64>,
}

impl Sr1 {
    /// A solver with these parameters; its first solve takes H₀ from an eigendecomposition.
    #[must_use]
    pub fn new(params: Sr1Params) -> Self {
        Self {
            params,
            carried: CarriedInverse::new(0, params.rank_cut),
            x: Vec::new(),
            y: Vec::new(),
            r: Vec::new(),
            hr: Vec::new(),
        }
    }

    /// H, `n×n`, column-major: the pseudo-inverse as the last solve left it.
    #[must_use]
    pub fn inverse(&self) -> &[f64] {
        &self.carried.inverse
    }

    /// Sets H₀ (`n×n`, column-major) for the next solve, instead of an eigendecomposition of its A.
    ///
    /// # Errors
    /// [`Error::Shape`] if `inverse` is not n×n, [`Error::Empty`] if n = 0.
    pub fn start_from(&mut self, inverse: &[f64], n: usize) -> Result<(), Error> {
        if n == 0 {
            return Err(Error::Empty { what: "inverse" });
        }
        check_len("inverse", inverse.len(), &[n, n])?;
        self.resize(n);
        self.carried.start_from(inverse);
        Ok(())
    }

    fn resize(&mut self, n: usize) {
        if self.x.len() == n {
            return;
        }
        let vector = || vec![0.0; n];
        *self = Self {
            params: self.params,
            carried: CarriedInverse::new(n, self.params.rank_cut),
            x: vector(),
            y: vector(),
            r: vector(),
            hr: vector(),
        };
    }

    /// r = A x − b.
    fn residual(&mut self, problem: &mut Problem<'_>) {
        problem.apply(&self.x, &mut self.r);
        axpy(-1.0, problem.rhs(), &mut self.r);
    }
}

impl MultiplierSolver for Sr1 {
    fn name(&self) -> &'static str {
        Sr1Params::SOLVER
    }

    fn needs(&self) -> Needs {
        Needs::Operator
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        let b_norm = norm(problem.rhs());
        let mut refreshed = self.carried.is_stale();
        if refreshed {
            self.carried.refresh(problem)?;
        }

        gemv(&self.carried.inverse, problem.rhs(), &mut self.x);
        self.residual(problem);
        // y₀ = A x₁ = r₁ + b
        self.y.copy_from_slice(&self.r);
        axpy(1.0, problem.rhs(), &mut self.y);
        let (mut iterations, mut products, mut fallbacks) = (0, 2, 0);
        let status = loop {
            let r_norm = norm(&self.r);
            if !r_norm.is_finite() || self.carried.too_large(norm(&self.x), b_norm) {
                break Status::Breakdown;
            }
            if r_norm <= self.params.eps_abs {
                break Status::Converged;
            }
            if iterations == self.params.max_iterations {
                break Status::IterationLimit;
            }
            gemv(&self.carried.inverse, &self.r, &mut self.hr);
            let denominator = dot(&self.hr, &self.y);
            let mut step = -1.0;
            if denominator.abs() > self.params.guard * norm(&self.hr) * norm(&self.y) {
                step += dot(&self.r, &self.hr) / denominator;
                rank_one(-denominator.recip(), &self.hr, &mut self.carried.inverse);
            } else {
                fallbacks += 1;
            }
            axpy(step, &self.hr, &mut self.x);
            self.y.copy_from_slice(&self.r);
            self.residual(problem);
            for (y, r) in self.y.iter_mut().zip(&self.r) {
                *y = r - *y;
            }
            iterations += 1;
            products += 2;
        };

        if status != Status::Converged {
            self.carried.refresh(problem)?;
            refreshed = true;
            gemv(&self.carried.inverse, problem.rhs(), &mut self.x);
            self.residual(problem);
            products += 2;
        }
        x.copy_from_slice(&self.x);
        Ok(Info {
            status,
            iterations,
            products,
            residual_rel: if b_norm == 0.0 { 0.0 } else { norm(&self.r) / b_norm },
            inconsistency: None,
            rank: None,
            null_residual: None,
            refreshed,
            fallbacks,
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        self.carried.invalidate();
    }

    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Box::new(self.clone())
    }

    fn state(&self) -> State {
        self.carried.state(self.name())
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_state(state, Sr1Params::SOLVER)?;
        self.resize(state.size);
        self.carried.restore(state);
        Ok(())
    }
}
