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
//! ‖A⁺b‖ ≤ ‖b‖ / λ⁺, with λ⁺ the smallest eigenvalue above the cut; an x beyond [`GROWTH_LIMIT`] times that meets the
//! residual only through eigenvalues that are zero to rounding, and counts as [`Status::Breakdown`]. A solve that ends
//! without convergence says so, recomputes H = A⁺ from an eigendecomposition ([`Info::refreshed`]) and gives x = A⁺ b.

use nalgebra::{DMatrix, DVector};

use crate::eigen::{RANK_CUT, SymmetricEigen};
use crate::error::{Error, check_finite, check_len};
use crate::info::{Info, Status};
use crate::params::{Params, Reader};
use crate::solver::{MultiplierSolver, SolverKind};
use crate::system::ConstrainedSystem;

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: Sr1Params::SOLVER,
    summary: "the paper's algorithm (11): SR1 carried from step to step, faithful",
    build: |options| Ok(Box::new(Sr1::new(Sr1Params::from_options(options)?))),
    options: Sr1Params::defaults,
};

/// How far ‖x‖ may exceed the bound ‖b‖ / λ⁺ of the minimum-norm solution before a solve counts as broken down. A
/// turning null space alone doubles ‖x‖ on the boat; 100 leaves room for λ⁺ to have changed since it was computed.
pub const GROWTH_LIMIT: f64 = 100.0;

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
pub struct Sr1 {
    params: Sr1Params,
    eigen: SymmetricEigen,
    inverse: DMatrix<f64>,
    /// Whether `inverse` must be recomputed before the next solve.
    stale: bool,
    /// `GROWTH_LIMIT` / λ⁺ of the last eigendecomposition; infinite if H₀ was handed in.
    largest_gain: f64,
    x: DVector<f64>,
    s: DVector<f64>,
    y: DVector<f64>,
    r: DVector<f64>,
    hr: DVector<f64>,
}

impl Sr1 {
    /// A solver with these parameters; its first solve takes H₀ from an eigendecomposition.
    #[must_use]
    pub fn new(params: Sr1Params) -> Self {
        Self {
            params,
            eigen: SymmetricEigen::new(0),
            inverse: DMatrix::zeros(0, 0),
            stale: true,
            largest_gain: f64::INFINITY,
            x: DVector::zeros(0),
            s: DVector::zeros(0),
            y: DVector::zeros(0),
            r: DVector::zeros(0),
            hr: DVector::zeros(0),
        }
    }

    /// H, `n×n`: the pseudo-inverse as the last solve left it.
    #[must_use]
    pub const fn inverse(&self) -> &DMatrix<f64> {
        &self.inverse
    }

    /// Sets H₀ for the next solve, instead of an eigendecomposition of its A.
    ///
    /// # Errors
    /// [`Error::Shape`] if `inverse` is not square, [`Error::Empty`] if it has no rows, [`Error::NonFinite`].
    pub fn start_from(&mut self, inverse: &DMatrix<f64>) -> Result<(), Error> {
        let n = inverse.nrows();
        if n == 0 {
            return Err(Error::Empty { what: "inverse" });
        }
        check_len("inverse", inverse.len(), &[n, n])?;
        check_finite("inverse", inverse.as_slice())?;
        self.resize(n);
        self.inverse.copy_from(inverse);
        self.largest_gain = f64::INFINITY;
        self.stale = false;
        Ok(())
    }

    /// H = A⁺ from an eigendecomposition.
    fn refresh(&mut self, matrix: &DMatrix<f64>) -> Result<(), Error> {
        self.stale = true; // until it has worked
        self.eigen.decompose(matrix, self.params.rank_cut)?;
        self.eigen.pseudo_inverse(&mut self.inverse);
        self.largest_gain = match self.eigen.rank() {
            0 => f64::INFINITY,
            rank => GROWTH_LIMIT / self.eigen.value(self.eigen.len() - rank),
        };
        self.stale = false;
        Ok(())
    }

    fn resize(&mut self, n: usize) {
        if self.x.len() == n {
            return;
        }
        *self = Self {
            params: self.params,
            eigen: SymmetricEigen::new(n),
            inverse: DMatrix::zeros(n, n),
            stale: true,
            largest_gain: f64::INFINITY,
            x: DVector::zeros(n),
            s: DVector::zeros(n),
            y: DVector::zeros(n),
            r: DVector::zeros(n),
            hr: DVector::zeros(n),
        };
    }
}

impl MultiplierSolver for Sr1 {
    fn name(&self) -> &'static str {
        Sr1Params::SOLVER
    }

    fn solve(&mut self, system: &ConstrainedSystem, x: &mut [f64]) -> Result<Info, Error> {
        let n = system.len();
        if n == 0 {
            return Err(Error::Empty { what: "system" });
        }
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        let (matrix, rhs) = (system.matrix(), system.rhs());
        let eps_squared = self.params.eps_abs.powi(2);
        let mut refreshed = self.stale;
        if refreshed {
            self.refresh(matrix)?;
        }

        self.x.gemv(1.0, &self.inverse, rhs, 0.0);
        self.y.gemv(1.0, matrix, &self.x, 0.0);
        self.r.copy_from(&self.y);
        self.r -= rhs;
        let (mut iterations, mut products, mut fallbacks) = (0, 2, 0);
        let mut squared = self.r.norm_squared();

        let status = loop {
            if !squared.is_finite() || self.x.norm() > self.largest_gain * rhs.norm() {
                break Status::Breakdown;
            }
            if squared <= eps_squared {
                break Status::Converged;
            }
            if iterations == self.params.max_iterations {
                break Status::IterationLimit;
            }
            self.hr.gemv(1.0, &self.inverse, &self.r, 0.0);
            let denominator = self.hr.dot(&self.y);
            let mut step = -1.0;
            if denominator.abs() > self.params.guard * self.hr.norm() * self.y.norm() {
                step += self.r.dot(&self.hr) / denominator;
                self.inverse.ger(-1.0 / denominator, &self.hr, &self.hr, 1.0);
            } else {
                fallbacks += 1;
            }
            self.s.copy_from(&self.hr);
            self.s *= step;
            self.x += &self.s;
            self.y.copy_from(&self.r);
            self.r.copy_from(rhs);
            self.r.gemv(1.0, matrix, &self.x, -1.0);
            self.y.neg_mut();
            self.y += &self.r;
            squared = self.r.norm_squared();
            iterations += 1;
            products += 2;
        };

        if status != Status::Converged {
            self.refresh(matrix)?;
            refreshed = true;
            self.x.gemv(1.0, &self.inverse, rhs, 0.0);
            products += 1;
        }
        x.copy_from_slice(self.x.as_slice());
        self.r.copy_from(rhs);
        self.r.gemv(1.0, matrix, &self.x, -1.0);
        products += 1;
        let norm = rhs.norm();
        Ok(Info {
            status,
            iterations,
            products,
            residual_rel: if norm == 0.0 { 0.0 } else { self.r.norm() / norm },
            inconsistency: None,
            rank: None,
            null_residual: None,
            refreshed,
            fallbacks,
        })
    }

    fn reset(&mut self) {
        self.stale = true;
    }
}
