//! SR1 with null-space tracking: minimum norm kept while null(A) turns.
//!
//! Beside H ≈ A⁺ an orthonormal basis N of null(A) is carried ([`NullSpace`]). One solve:
//!
//! ```text
//!     N ← extrapolated                                          C = H A N: the error of N, for A H ≈ 1 on range(A)
//!     repeat N ← N − C, C = H A N, until ‖C‖ is small;          w = C is the SR1 numerator of the pair (C_old, A C_old),
//!                                                               so each repetition also improves H
//!     H ← Π H Π,  Π = 1 − N Nᵀ                                  makes H exactly A⁺ if A H A = A and H A H = H
//!     b ← Π b,  ‖Nᵀ b‖ is the inconsistency
//!     x = extrapolated, or H b;  r = Π (A x − b)
//!     while ‖r‖ > rtol ‖b‖:  s = −H r,  x += s,  r' = Π (A x − b),  y = r' − r,  w = s − H y = −H r'
//!         H += w wᵀ / (wᵀ y)  if |wᵀ y| > guard ‖w‖ ‖y‖, else a BFGS update  (sᵀ y > 0 always: A is semidefinite)
//! ```
//!
//! # Against the published algorithm
//!
//! x stays the minimum-norm least-squares solution, whatever b has outside range(A), for the stopping test looks at the
//! part that can be solved. A change of rank is noticed (N's Rayleigh quotient rises above the cut, or H grows beyond
//! its reciprocal), answered by a refresh from an eigendecomposition, and counted.
//!
//! # What was found on the way
//!
//! - The error of N is ‖H A N‖, not ‖A N‖: where loops stand open, a dropped eigenvalue of 4e-9 keeps A N away from zero
//!   for ever, and a test on it refreshes every step.
//! - The correction of N is an SR1 iteration itself. Its secant pairs cost nothing, and they keep H fresh where the
//!   predicted start leaves nothing to iterate: without them H goes stale and N fails to converge every hundredth step.
//! - Correcting without orthonormalising in between keeps the pairs exact; one Newton–Schulz step at the end repairs
//!   lengths, which are off by the square of the correction.
//! - The order of the extrapolations of N and of x is chosen by how each did lately. Runge–Kutta's stages are not
//!   equally spaced, and there the lowest order wins.
//! - A rank that drops along a direction that b does not see leaves no trace in r. After convergence x itself is
//!   probed: what H would still correct of it, x − H A x, has no curvature if it lies in a new null direction.
//! - A residual relative to b does not bound x where A is ill-conditioned: ‖H r‖ ≤ rtol ‖x‖ is asked for too.
//! - Projecting y and r, not only b, matters once x is extrapolated: the loop stagnates on r's null part otherwise.
//!
//! # What it does not do well yet
//!
//! The probe costs products where it contracts slowly (up to two dozen on the N-four-bar, where 3 are enough without
//! it), and on the boat the second stopping test takes 2.06 iterations at rtol 1e-10. Where a mechanism hangs at rest, a
//! vanishes while b does not, and accelerations good to 1e-6 need rtol 1e-10.

use crate::carried::{CarriedInverse, check_state};
use crate::eigen::RANK_CUT;
use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::kernels::{axpy, dot, gemv, norm, rank_one, rank_two};
use crate::null_space::NullSpace;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solver::{MultiplierSolver, SolverKind, State};

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: TrackedParams::SOLVER,
    summary: "SR1 with null-space tracking: minimum norm kept while null(A) moves",
    build: |options| Ok(Box::new(Tracked::new(TrackedParams::from_options(options)?))),
    options: TrackedParams::defaults,
};

/// Rounds of correction of N before a solve gives up and refreshes. Each contracts by ‖1 − H A‖, and finite termination
/// of SR1 promises the end after rank(A); beyond a handful an eigendecomposition is cheaper.
const ROUNDS: usize = 12;

/// N is good when ‖H A N‖ is below this part of rtol (or of its rounding floor): its error is the relative error of
/// the minimum norm.
const NULL_SHARE: f64 = 0.1;

/// Smallest error of N that rounding lets one see: ε times a condition of 1e3.
const NULL_FLOOR: f64 = 2e-13;

/// Solutions kept for the extrapolated start.
const HISTORY: usize = 4;

/// Coefficients of the extrapolation of x from 1 to 4 earlier solutions at equal steps, newest first.
const EXTRAPOLATION: [&[f64]; HISTORY] = [&[1.0], &[2.0, -1.0], &[3.0, -3.0, 1.0], &[4.0, -6.0, 4.0, -1.0]];

/// Parameters of [`Tracked`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedParams {
    /// Stopping test ‖Π (A x − b)‖ ≤ rtol ‖b‖; > 0.
    pub rtol: f64,
    /// Earlier solutions that the start is extrapolated from, at most; 0 starts from H b.
    pub predict: usize,
    /// SR1 is used where |wᵀ y| > guard ‖w‖ ‖y‖; in [0, 1).
    pub guard: f64,
    /// Iterations after which a solve refreshes.
    pub max_iterations: usize,
    /// Rank cut; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for TrackedParams {
    const SOLVER: &'static str = "sr1-tracked";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            rtol: reader.positive("rtol", 1e-8)?,
            predict: reader.count_to("predict", 4, HISTORY)?,
            guard: reader.fraction("guard", 0.1)?,
            max_iterations: reader.count("max_iterations", 10)?,
            rank_cut: reader.fraction("rank_cut", RANK_CUT)?,
        })
    }
}

/// The tracked solver with what it carries.
#[derive(Clone)]
pub struct Tracked {
    params: TrackedParams,
    carried: CarriedInverse,
    null: NullSpace,
    /// Accepted solutions, newest first.
    past: [Vec<f64>; HISTORY],
    kept: usize,
    misses: [f64; HISTORY],
    b: Vec<f64>,
    x: Vec<f64>,
    r: Vec<f64>,
    hr: Vec<f64>,
    y: Vec<f64>,
    s: Vec<f64>,
    /// Whether (s, y) is a secant pair with s − H y = −H r.
    paired: bool,
    /// A N and H A N of the last round, n×d at most n×n.
    image: Vec<f64>,
    correction: Vec<f64>,
}

/// Why a solve could not go on from what was carried.
struct Lost;

/// Counters of one solve.
#[derive(Default)]
struct Count {
    iterations: usize,
    products: usize,
    fallbacks: usize,
}

impl Tracked {
    /// A solver with these parameters; its first solve starts from an eigendecomposition.
    #[must_use]
    pub fn new(params: TrackedParams) -> Self {
        Self::sized(params, 0)
    }

    fn sized(params: TrackedParams, n: usize) -> Self {
        let vector = || vec![0.0; n];
        Self {
            params,
            carried: CarriedInverse::new(n, params.rank_cut),
            null: NullSpace::new(n),
            past: std::array::from_fn(|_| vector()),
            kept: 0,
            misses: [0.0; HISTORY],
            b: vector(),
            x: vector(),
            r: vector(),
            hr: vector(),
            y: vector(),
            s: vector(),
            paired: false,
            image: vec![0.0; n * n],
            correction: vec![0.0; n * n],
        }
    }

    /// N, n×d, column-major: the basis of null(A) as the last solve left it.
    #[must_use]
    pub fn null_basis(&self) -> &[f64] {
        self.null.basis()
    }

    /// H, n×n, column-major, as the last solve left it.
    #[must_use]
    pub fn inverse(&self) -> &[f64] {
        &self.carried.inverse
    }

    fn null_tolerance(&self) -> f64 {
        (NULL_SHARE * self.params.rtol).max(NULL_FLOOR)
    }

    /// Corrects the extrapolated N, improving H on the way; gives ‖H A N‖.
    fn track(&mut self, problem: &mut Problem<'_>, count: &mut Count) -> Result<f64, Lost> {
        let (n, d) = (self.x.len(), self.null.dim());
        if d == 0 {
            return Ok(0.0);
        }
        self.null.predict();
        let tolerance = self.null_tolerance();
        let scale = problem.trace();
        let mut last = f64::INFINITY;
        for round in 0..ROUNDS {
            let mut squared = 0.0;
            let mut rayleigh = 0.0_f64;
            for j in 0..d {
                let at = j * n..(j + 1) * n;
                let (image, correction) = (&mut self.image[at.clone()], &mut self.correction[at]);
                problem.apply(self.null.column_mut(j), &mut self.s);
                if round == 0 {
                    image.copy_from_slice(&self.s);
                    gemv(&self.carried.inverse, image, correction);
                } else {
                    // The pair (C, A C) of the last correction: y = A N_old − A N_new, and w = C − H y = H A N_new.
                    for ((y, image), new) in self.y.iter_mut().zip(image.iter_mut()).zip(&self.s) {
                        *y = *image - new;
                        *image = *new;
                    }
                    gemv(&self.carried.inverse, image, correction);
                    let product = dot(correction, &self.y);
                    let size = norm(correction);
                    if size > tolerance && product.abs() > self.params.guard * size * norm(&self.y) {
                        self.hr.copy_from_slice(correction);
                        let along = dot(&self.hr, image) / product;
                        rank_one(product.recip(), &self.hr, &mut self.carried.inverse);
                        axpy(along, &self.hr, correction);
                    }
                }
                count.products += 2;
                squared += dot(correction, correction);
                rayleigh = rayleigh.max(dot(self.null.column_mut(j), image).abs());
            }
            let size = squared.sqrt();
            if size.is_nan() {
                return Err(Lost);
            }
            let settled = size <= tolerance;
            // Once N is settled its Rayleigh quotient is a dropped eigenvalue, or one that is no longer to be dropped.
            if settled && rayleigh > self.params.rank_cut * scale {
                return Err(Lost);
            }
            // A verified basis is corrected all the same: the correction is there.
            for j in 0..d {
                axpy(-1.0, &self.correction[j * n..(j + 1) * n], self.null.column_mut(j));
            }
            if settled {
                return if self.null.accept() { Ok(size) } else { Err(Lost) };
            }
            if size > 1e-2 && round > 0 && size > last {
                return Err(Lost);
            }
            last = size;
        }
        Err(Lost)
    }

    /// H ← Π H Π.
    fn project_inverse(&mut self) {
        let n = self.x.len();
        for j in 0..self.null.dim() {
            let column = &self.null.basis()[j * n..(j + 1) * n];
            gemv(&self.carried.inverse, column, &mut self.hr);
            // One column after another: each is orthogonal to the others, so Π is the product of their projectors.
            axpy(-0.5 * dot(column, &self.hr), column, &mut self.hr);
            rank_two(-1.0, column, &self.hr, &mut self.carried.inverse);
        }
    }

    /// x and r = Π (A x − b) to begin with.
    fn begin(&mut self, problem: &mut Problem<'_>, b_norm: f64, count: &mut Count) {
        self.paired = false;
        let orders = self.kept.min(self.params.predict);
        if orders > 0 {
            let order = (0..orders).rev().fold(orders - 1, |best, order| {
                if self.misses[order] < self.misses[best] { order } else { best }
            });
            extrapolate(EXTRAPOLATION[order], &self.past, &mut self.x);
            self.null.project(&mut self.x);
            self.residual(problem);
            count.products += 1;
            if norm(&self.r) <= 0.5 * b_norm {
                return;
            }
        }
        // The pair (H b, A H b) is one that H can learn from.
        gemv(&self.carried.inverse, &self.b, &mut self.x);
        self.residual(problem);
        self.s.copy_from_slice(&self.x);
        self.y.copy_from_slice(&self.r);
        axpy(1.0, &self.b, &mut self.y);
        self.paired = true;
        count.products += 2;
    }

    fn residual(&mut self, problem: &mut Problem<'_>) {
        problem.apply(&self.x, &mut self.r);
        axpy(-1.0, &self.b, &mut self.r);
        self.null.project(&mut self.r);
    }

    fn iterate(&mut self, problem: &mut Problem<'_>, target: f64, count: &mut Count) -> Result<(), Lost> {
        loop {
            let r_norm = norm(&self.r);
            if r_norm <= target {
                gemv(&self.carried.inverse, &self.r, &mut self.hr);
                if r_norm == 0.0 || norm(&self.hr) <= self.params.rtol * norm(&self.x) {
                    return Ok(());
                }
            }
            if count.iterations == self.params.max_iterations || !r_norm.is_finite() {
                return Err(Lost);
            }
            gemv(&self.carried.inverse, &self.r, &mut self.hr);
            count.products += 2;
            if self.paired {
                self.update(count);
            }
            for (s, hr) in self.s.iter_mut().zip(&self.hr) {
                *s = -hr;
            }
            axpy(1.0, &self.s, &mut self.x);
            self.y.copy_from_slice(&self.r);
            self.residual(problem);
            for (y, r) in self.y.iter_mut().zip(&self.r) {
                *y = r - *y;
            }
            self.paired = true;
            count.iterations += 1;
        }
    }

    /// Improves H by the pair (s, y), for which s − H y = −H r, and makes hr = H r again.
    fn update(&mut self, count: &mut Count) {
        let product = -dot(&self.hr, &self.y);
        if product.abs() > self.params.guard * norm(&self.hr) * norm(&self.y) {
            let along = dot(&self.hr, &self.r) / product;
            rank_one(product.recip(), &self.hr, &mut self.carried.inverse);
            self.hr.iter_mut().for_each(|entry| *entry *= 1.0 + along);
        } else {
            count.fallbacks += 1;
            self.bfgs();
            gemv(&self.carried.inverse, &self.r, &mut self.hr);
            count.products += 1;
        }
    }

    /// H += (1 + yᵀHy ρ) ρ s sᵀ − ρ (H y sᵀ + s yᵀ H), ρ = 1/(sᵀ y), with H y = hr + s.
    fn bfgs(&mut self) {
        let product = dot(&self.s, &self.y);
        if product <= f64::EPSILON * norm(&self.s) * norm(&self.y) {
            return;
        }
        axpy(1.0, &self.s, &mut self.hr);
        let rho = product.recip();
        let curvature = dot(&self.y, &self.hr);
        rank_one((1.0 + curvature * rho) * rho, &self.s, &mut self.carried.inverse);
        rank_two(-rho, &self.hr, &self.s, &mut self.carried.inverse);
    }

    /// One solve from what is carried; gives ‖Nᵀ b‖ and ‖H A N‖.
    fn advance(&mut self, problem: &mut Problem<'_>, count: &mut Count) -> Result<(f64, f64), Lost> {
        let null_error = self.track(problem, count)?;
        self.project_inverse();
        self.b.copy_from_slice(problem.rhs());
        let inconsistency = self.null.project(&mut self.b).sqrt();
        let b_norm = norm(problem.rhs());
        self.begin(problem, b_norm, count);
        self.iterate(problem, self.params.rtol * b_norm, count)?;
        // Probe: s = x - H A x is what H would still correct. Curvature of s below the cut: the rank has dropped.
        self.y.copy_from_slice(&self.b);
        axpy(1.0, &self.r, &mut self.y);
        gemv(&self.carried.inverse, &self.y, &mut self.hr);
        for ((s, x), h) in self.s.iter_mut().zip(&self.x).zip(&self.hr) {
            *s = x - h;
        }
        self.null.project(&mut self.s);
        count.products += 1;
        for _ in 0..ROUNDS {
            let size = norm(&self.s);
            if size <= self.params.rtol * norm(&self.x) {
                break;
            }
            problem.apply(&self.s, &mut self.y);
            count.products += 2;
            if dot(&self.s, &self.y) <= self.params.rank_cut * problem.trace() * size * size {
                return Err(Lost);
            }
            gemv(&self.carried.inverse, &self.y, &mut self.hr);
            axpy(-1.0, &self.hr, &mut self.s);
            self.null.project(&mut self.s);
        }
        let n = self.x.len();
        let trace: f64 = (0..n).map(|i| self.carried.inverse[i * n + i]).sum();
        let growth = trace * problem.trace() * self.params.rank_cut;
        // The trace of A⁺ is at most r / λ⁺, and that of A at most r times its largest eigenvalue.
        #[allow(clippy::suboptimal_flops)]
        if !growth.is_finite() || growth > (n * n) as f64 || self.carried.too_large(norm(&self.x), b_norm) {
            return Err(Lost);
        }
        Ok((inconsistency, null_error))
    }

    /// Starts anew from an eigendecomposition; gives ‖Nᵀ b‖.
    fn refresh(&mut self, problem: &mut Problem<'_>) -> Result<f64, Error> {
        self.kept = 0;
        self.misses = [0.0; HISTORY];
        // What is not kept is saved all the same, and may have overflowed.
        self.past.iter_mut().for_each(|past| past.fill(0.0));
        self.carried.refresh(problem)?;
        let eigen = self.carried.eigen();
        self.null.restart((0..eigen.len() - eigen.rank()).map(|i| eigen.vector(i)));
        self.b.copy_from_slice(problem.rhs());
        let inconsistency = self.null.project(&mut self.b).sqrt();
        gemv(&self.carried.inverse, &self.b, &mut self.x);
        self.residual(problem);
        Ok(inconsistency)
    }

    fn keep(&mut self) {
        for (order, coefficients) in EXTRAPOLATION.iter().enumerate().take(self.kept) {
            extrapolate(coefficients, &self.past, &mut self.y);
            axpy(-1.0, &self.x, &mut self.y);
            self.misses[order] = norm(&self.y).max(0.5 * self.misses[order]).min(f64::MAX);
        }
        self.past.rotate_right(1);
        self.past[0].copy_from_slice(&self.x);
        self.kept = (self.kept + 1).min(HISTORY);
    }
}

fn extrapolate(coefficients: &[f64], past: &[Vec<f64>], out: &mut [f64]) {
    out.fill(0.0);
    for (&coefficient, past) in coefficients.iter().zip(past) {
        axpy(coefficient, past, out);
    }
}

impl MultiplierSolver for Tracked {
    fn name(&self) -> &'static str {
        TrackedParams::SOLVER
    }

    fn needs(&self) -> Needs {
        Needs::Operator
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        if self.x.len() != n {
            *self = Self::sized(self.params, n);
        }
        let mut count = Count::default();
        let advanced = if self.carried.is_stale() { Err(Lost) } else { self.advance(problem, &mut count) };
        let (inconsistency, null_residual, refreshed) = match advanced {
            Ok((inconsistency, null_error)) => (inconsistency, null_error, false),
            Err(Lost) => (self.refresh(problem)?, self.carried.eigen().null_residual(), true),
        };
        self.keep();
        x.copy_from_slice(&self.x);
        let b_norm = norm(problem.rhs());
        Ok(Info {
            status: Status::Converged,
            iterations: count.iterations,
            products: count.products,
            residual_rel: if b_norm == 0.0 { 0.0 } else { norm(&self.r) / b_norm },
            inconsistency: Some(inconsistency),
            rank: Some(n - self.null.dim()),
            null_residual: Some(null_residual),
            refreshed,
            fallbacks: count.fallbacks,
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
        let state = self.carried.state(self.name());
        if self.carried.is_stale() {
            return state;
        }
        let mut track = vec![self.kept as f64];
        track.extend_from_slice(&self.misses);
        let state = state.with("past", &self.past.concat()).with("track", &track);
        self.null.save(state)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_state(state, TrackedParams::SOLVER)?;
        state.check_names(
            TrackedParams::SOLVER,
            &["inverse", "least", "past", "track", "null", "null_past", "null_track"],
        )?;
        let n = if state.fields.is_empty() { 0 } else { state.size };
        let mut restored = Self::sized(self.params, n);
        if n > 0 {
            state.check(TrackedParams::SOLVER, &[("past", HISTORY * n), ("track", 1 + HISTORY)])?;
            restored.carried.restore(state);
            restored.null.load(state)?;
            let (kept, misses) = state.field("track").split_at(1);
            restored.kept = State::count(kept[0], 0..=HISTORY, TrackedParams::SOLVER)?;
            restored.misses.copy_from_slice(misses);
            for (past, saved) in restored.past.iter_mut().zip(state.field("past").chunks_exact(n)) {
                past.copy_from_slice(saved);
            }
        }
        *self = restored;
        Ok(())
    }
}
