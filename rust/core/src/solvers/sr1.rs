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
//! grow until rounding swallows b, and an updated residual would not notice. ε is absolute, as published; the guard's
//! relative form is a choice (the paper's text is damaged there).
//!
//! Every step is sₖ = −Hₖ rₖ and every iterate xₖ₊₁ = Hₖ b, by the secant condition. [`Sr1::solve_observed`] shows
//! them from within; which of the paper's claims about them hold is in the [crate's table](crate).
//!
//! # Where it falls short, on the paper's own example
//!
//! Every update is a multiple of (H r)(H r)ᵀ, so range(H) never leaves range(H₀). When null(A) turns, x still solves A
//! x = b but is no longer the minimum-norm solution. When b leaves range(A), ‖A x − b‖ cannot fall below ‖Nᵀb‖ and the
//! stopping test is out of reach for a small ε; further updates then come from rounding and wreck H. This file stays
//! faithful, so that both show. It only refuses to hand garbage on. The minimum-norm solution obeys ‖A⁺b‖ ≤ ‖b‖ / λ⁺,
//! with λ⁺ the smallest eigenvalue above the cut; an x beyond [`GROWTH_LIMIT`](crate::solvers::carried::GROWTH_LIMIT) times that
//! meets the residual only through eigenvalues that are zero to rounding, and counts as
//! [`Breakdown`](crate::Status::Breakdown). A solve that ends without convergence says so, recomputes H = A⁺ from an
//! eigendecomposition ([`Info::refreshed`]) and gives x = A⁺ b.

use crate::error::{Error, check_finite, check_len};
use crate::info::Info;
use crate::linalg::kernels::{axpy, dot, gemv, norm, rank_one};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::carried::{CarriedInverse, EPS_ABS, FIELDS, Iterate, check_state};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::solver::{Solver, State};

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
            eps_abs: reader.positive("eps_abs", EPS_ABS)?,
            guard: reader.fraction("guard", 1e-6)?,
            max_iterations: reader.count("max_iterations", 50)?,
            rank_cut: reader.fraction("rank_cut", RANK_CUT)?,
        })
    }
}

/// One pass of the loop as [`Sr1::solve_observed`] shows it, k = 0, 1, … up to the iterations of the solve; k = 0 is
/// the start, s₀ = x₁ = H₀ b. Borrowed from the solver's workspace: what is to outlive the pass is copied.
#[derive(Debug, Clone, Copy)]
pub struct Iteration<'a> {
    /// k.
    pub k: usize,
    /// Hₖ, `n×n`, column-major.
    pub inverse: &'a [f64],
    /// `step` of sₖ = `step` · `direction`: 1 at the start, then −αₖ₋₁; −1 where the guard skipped the update.
    pub step: f64,
    /// `direction` of sₖ, `n`: x₁ at the start, then Hₖ₋₁ rₖ.
    pub direction: &'a [f64],
    /// yₖ = A sₖ, as the difference rₖ₊₁ − rₖ that the algorithm works with, `n`.
    pub y: &'a [f64],
    /// xₖ₊₁ = xₖ + sₖ, `n`.
    pub x: &'a [f64],
    /// rₖ₊₁ = A xₖ₊₁ − b, `n`.
    pub r: &'a [f64],
}

/// Algorithm (11) with the H of the last solve.
#[derive(Clone)]
pub struct Sr1 {
    params: Sr1Params,
    carried: CarriedInverse,
    at: Iterate,
    y: Vec<f64>,
    hr: Vec<f64>,
}

impl Sr1 {
    fn sized(params: Sr1Params, n: usize) -> Self {
        Self {
            params,
            carried: CarriedInverse::new(n, params.rank_cut),
            at: Iterate::new(n),
            y: vec![0.0; n],
            hr: vec![0.0; n],
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
        check_finite("inverse", inverse)?;
        self.resize(n);
        self.carried.start_from(inverse);
        Ok(())
    }

    /// [`solve`](Solver::solve) that shows `observe` every pass, the last one included. Watching changes no
    /// number, and an observer that does nothing costs nothing. What a refresh makes of a solve that did not converge
    /// is not a pass.
    ///
    /// # Errors
    /// Those of [`solve`](Solver::solve).
    pub fn solve_observed(
        &mut self,
        problem: &mut Problem<'_>,
        x: &mut [f64],
        mut observe: impl FnMut(&Iteration<'_>),
    ) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        let Self { params, carried, at, y, hr } = self;
        at.begin(carried, problem)?;
        (at.tolerance, at.loose) = (params.eps_abs, params.eps_abs > EPS_ABS);
        at.solve_with(carried, problem);
        // y₀ = A x₁ = r₁ + b
        y.copy_from_slice(&at.r);
        axpy(1.0, problem.rhs(), y);
        let mut step = 1.0;
        let status = loop {
            observe(&Iteration {
                k: at.iterations,
                inverse: &carried.inverse,
                step,
                direction: if at.iterations == 0 { &at.x } else { hr },
                y,
                x: &at.x,
                r: &at.r,
            });
            if let Some(status) = at.verdict(carried, params.max_iterations) {
                break status;
            }
            gemv(&carried.inverse, &at.r, hr);
            let denominator = dot(hr, y);
            step = -1.0;
            if denominator.abs() > params.guard * norm(hr) * norm(y) {
                step += dot(&at.r, hr) / denominator;
                rank_one(-denominator.recip(), hr, &mut carried.inverse);
            } else {
                at.fallbacks += 1;
            }
            axpy(step, hr, &mut at.x);
            y.copy_from_slice(&at.r);
            at.residual(problem);
            for (y, r) in y.iter_mut().zip(&at.r) {
                *y = r - *y;
            }
            at.iterations += 1;
            at.products += 1;
        };
        at.finish(status, carried, problem, x)
    }

    fn resize(&mut self, n: usize) {
        if self.y.len() != n {
            *self = Self::sized(self.params, n);
        }
    }
}

impl Solver for Sr1 {
    type Params = Sr1Params;
    const SUMMARY: &'static str = "the paper's algorithm (11): SR1 carried from step to step, faithful";
    const NEEDS: Needs = Needs::Operator;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: Sr1Params) -> Self {
        Self::sized(params, 0)
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        self.solve_observed(problem, x, |_| {})
    }

    fn reset(&mut self) {
        self.carried.invalidate();
    }

    fn state(&self) -> State {
        self.carried.state(Sr1Params::SOLVER)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_state(state, Sr1Params::SOLVER, &FIELDS)?;
        if !state.fields.is_empty() {
            self.resize(state.size);
        }
        self.carried.restore(state);
        Ok(())
    }
}
