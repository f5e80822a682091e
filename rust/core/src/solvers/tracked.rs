//! SR1 with null-space tracking: minimum norm kept while null(A) turns.
//!
//! Beside H ≈ A⁺ an orthonormal basis N of null(A) is carried ([`NullSpace`]), and z with A z = x. One solve:
//!
//! ```text
//!     N ← extrapolated;   z ← extrapolated, x = A z, r = A x − b      (or, without a past, x = H b)
//!     repeat C = H A N, N ← N − C                                     until its error is small enough, see below
//!     H ← Π H Π,  Π = 1 − N Nᵀ                                        makes H exactly A⁺ if A H A = A and H A H = H
//!     b ← Π b,  ‖Nᵀ b‖ is the inconsistency;   r ← Π r
//!     while ‖r‖ > rtol ‖b‖:  s = −H r,  x += s,  r' = Π (A x − b),  y = r' − r,  w = s − H y = −H r'
//!         H += w wᵀ / (wᵀ y)  if |wᵀ y| > guard ‖w‖ ‖y‖, else a BFGS update  (sᵀ y > 0 always: A is semidefinite)
//!     x −= H r                                                         H r is there: it is what the test needs
//!     z −= H Σ H r                                                     so that A z = x again, to the error of H
//! ```
//!
//! # Against the published algorithm
//!
//! x stays the minimum-norm least-squares solution, whatever b has outside range(A), for the stopping test looks at the
//! part that can be solved. A change of rank is noticed (N's Rayleigh quotient rises above the cut, H grows beyond its
//! reciprocal, or a part of b cannot be reached), answered by a refresh from an eigendecomposition, and counted.
//!
//! # What was found on the way
//!
//! - **Extrapolate z, not x.** A start x = A z lies in range(A) of *this* step, whatever z is: it has minimum norm before
//!   any null space is looked at, and it has nothing along a direction that A has just lost. An x extrapolated from earlier
//!   x has both faults; it took a probe of up to two dozen products a step to exclude the second one.
//! - **N need not be good where x is.** With a start in range(A), an error δ of N costs δ ‖H r‖ of the norm, not δ ‖x‖, and
//!   δ ‖H‖ ‖Nᵀ b‖ through the part of b that is cut off. [`NULL_SHARE`] · rtol is asked of their sum. Where the extrapolated
//!   N is as good as that it is not corrected: then Π is applied to vectors and H is left alone. Together with z that takes
//!   the boat from 27 products a step to 9; to 5 where five earlier N and z are kept instead of three and four, for a smooth N
//!   is then mostly left alone (delta, bennett: half the products; nothing is lost where steps are not equal).
//! - **The error of N is H A N**, not A N: where loops stand open, a dropped eigenvalue of 4e-9 keeps A N away from zero for
//!   ever, and a test on it refreshes every step. It is taken for [`CAUTION`] times what is left of a correction, or for the
//!   last correction itself if that is more: one direction does not speak for all. A second round shows what is left.
//! - The correction of N is an SR1 iteration itself. Its second rounds give secant pairs for nothing.
//! - Corrections lie in range(A): the basis is carried along in parallel and can be extrapolated column by column.
//! - The order of the extrapolations is chosen by how each did lately ([`History`]). Runge–Kutta's stages are not equally
//!   spaced, and there the lowest order wins.
//! - A residual relative to b does not bound x where A is ill-conditioned: ‖H r‖ ≤ rtol ‖x‖ is asked for too.
//! - Projecting y and r, not only b, matters: the loop stagnates on r's null part otherwise.
//!
//! # What it does not do
//!
//! A rank that drops along a direction that b does not see leaves x right, and the rank reported is the old one until b
//! sees it. Where a mechanism hangs at rest, a vanishes while b does not, and accelerations good to 1e-6 need rtol 1e-10.

mod correction;
mod iteration;

use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::linalg::kernels::{axpy, gemv, norm};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem, Wanted};
use crate::solvers::carried::{CarriedInverse, check_state};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::history::{History, LONGEST};
use crate::solvers::null_space::NullSpace;
use crate::solvers::solver::{Solver, State};

/// What errors of N may take from the minimum norm, as a part of rtol.
pub const NULL_SHARE: f64 = 0.1;

/// Smallest error of N that rounding lets one see: ε times a condition of 1e3.
const NULL_FLOOR: f64 = 2e-13;

/// What 1 − H A leaves of any direction is taken for this many times what it was seen to leave of one.
const CAUTION: f64 = 10.0;

/// A predicted start that leaves more than this part of b is not used.
const POOR_START: f64 = 0.5;

/// Fields of a saved state.
const FIELDS: [&str; 8] = [
    "inverse",
    "least",
    "differences",
    "differences_track",
    "null",
    "null_dim",
    "null_differences",
    "null_differences_track",
];

/// Default of the stopping test.
const RTOL: f64 = 1e-8;

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
            rtol: reader.positive("rtol", RTOL)?,
            predict: reader.count_to("predict", 5, LONGEST)?,
            guard: reader.fraction("guard", 0.01)?,
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
    /// z of accepted solutions, A z = x.
    past: History,
    /// Eigenvalues up to this part of the trace are zero, or explained by rows that stand open.
    explained: f64,
    /// Rank that was held at the last refresh.
    ceiling: usize,
    /// trace(A), a bound of ‖A‖.
    trace: f64,
    /// What 1 − H A may leave of a direction in this solve: all of it, or more if that was seen.
    staleness: f64,
    /// Π b.
    b: Vec<f64>,
    x: Vec<f64>,
    z: Vec<f64>,
    /// x where it was in range(A) for certain, then what it has moved since, and u with A u = that.
    moved: Vec<f64>,
    u: Vec<f64>,
    r: Vec<f64>,
    hr: Vec<f64>,
    y: Vec<f64>,
    s: Vec<f64>,
    /// Whether (s, y) is a secant pair with s − H y = −H r.
    paired: bool,
    /// ‖Nᵀ (A x − b)‖ where r was computed last.
    leak: f64,
    /// Whether H = Π H Π for the N of now.
    projected: bool,
    /// A N and H A N of the last round, and A N of the one before; n×d at most n×n.
    image: Vec<f64>,
    correction: Vec<f64>,
    earlier: Vec<f64>,
    gram: Vec<f64>,
    scratch: Vec<f64>,
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
    fn sized(params: TrackedParams, n: usize) -> Self {
        let vector = || vec![0.0; n];
        let square = || Vec::with_capacity(n * n);
        Self {
            params,
            carried: CarriedInverse::new(n, params.rank_cut),
            null: NullSpace::new(n),
            past: History::new(params.predict, n),
            explained: params.rank_cut,
            ceiling: n,
            trace: 0.0,
            staleness: 1.0,
            b: vector(),
            x: vector(),
            z: vector(),
            moved: vector(),
            u: vector(),
            r: vector(),
            hr: vector(),
            y: vector(),
            s: vector(),
            paired: false,
            leak: 0.0,
            projected: true,
            image: square(),
            correction: square(),
            earlier: square(),
            gram: square(),
            scratch: Vec::new(),
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

    /// trace(H), a bound of ‖A⁺‖.
    fn inverse_trace(&self) -> f64 {
        let n = self.x.len();
        (0..n).map(|i| self.carried.inverse[i * n + i]).sum()
    }

    /// Room for n×d, once N is known.
    fn make_room(&mut self) {
        let d = self.null.dim();
        let size = self.x.len() * d;
        self.image.resize(size, 0.0);
        self.correction.resize(size, 0.0);
        self.earlier.resize(size, 0.0);
        self.gram.resize(d * d, 0.0);
    }

    fn saw_staleness(&mut self, after: f64, before: f64) {
        if before > 0.0 {
            self.staleness = self.staleness.max(CAUTION * after / before).min(f64::MAX);
        }
    }

    /// x = A z and r = A x − b to begin with, not yet projected; whether they come from the past and are of use.
    fn predict(&mut self, problem: &mut Problem<'_>, b_norm: f64, count: &mut Count) -> bool {
        if self.past.is_empty() {
            return false;
        }
        self.past.advance();
        self.past.predict(&mut self.z);
        // Eigenvalues below the cut are not zero: without this, x would hold what z has collected along them.
        self.null.project(&mut self.z);
        problem.apply(&self.z, &mut self.x);
        problem.apply(&self.x, &mut self.r);
        axpy(-1.0, problem.rhs(), &mut self.r);
        count.products += 2;
        self.s.copy_from_slice(&self.r);
        self.null.project(&mut self.s);
        norm(&self.s) <= POOR_START * b_norm
    }

    /// The error of N that x can bear, and at most rtol: ‖Nᵀ b‖ is reported to rtol ‖b‖, as ‖r‖ is. `left` is ‖Π (A x − b)‖
    /// of a predicted start.
    fn null_tolerance(&self, wanted: Wanted, left: Option<f64>, inconsistency: f64) -> f64 {
        let weight = match left {
            None => 1.0,
            Some(left) => {
                // Of x = 0 nothing can be borne: the weight is infinite.
                let gain = self.inverse_trace().max(f64::MIN_POSITIVE) / norm(&self.x);
                let moved = if wanted == Wanted::Acceleration { 0.0 } else { (gain * left).min(1.0) };
                moved + gain * inconsistency
            }
        };
        (NULL_SHARE * self.params.rtol / weight).min(self.params.rtol).max(NULL_FLOOR)
    }

    /// One solve from what is carried; gives ‖Nᵀ b‖, the error of N and ‖r‖.
    fn advance(&mut self, problem: &mut Problem<'_>, count: &mut Count) -> Result<[f64; 3], Lost> {
        self.trace = problem.trace();
        self.staleness = 1.0;
        self.paired = false;
        let n = self.x.len();
        let b_norm = norm(problem.rhs());
        let miss = self.null.predict();
        let predicted = self.predict(problem, b_norm, count);
        self.b.copy_from_slice(problem.rhs());
        let inconsistency = self.null.project(&mut self.b).sqrt();
        let left = predicted.then(|| norm(&self.s));
        let tolerance = self.null_tolerance(problem.wanted, left, inconsistency);

        let good_enough = CAUTION * miss <= tolerance
            && self.cuts_off_what_is_null(problem, tolerance, inconsistency, count);
        self.projected = !good_enough;
        let null_error = if self.projected {
            let error = self.track(problem, tolerance, count)?;
            self.project_inverse();
            error
        } else {
            miss
        };
        let inconsistency = self.project_rhs(problem);
        let (rhs, mut x) = (std::mem::take(&mut self.b), std::mem::take(&mut self.x));
        if predicted {
            self.moved.copy_from_slice(&x);
            self.leak = self.null.project(&mut self.r).sqrt();
        } else {
            self.moved.fill(0.0);
            self.start(problem, &rhs, &mut x, count);
        }
        let target = self.params.rtol * b_norm;
        let solved = self.iterate(problem, (&rhs, target), (&mut x, 0.0), count);
        (self.b, self.x) = (rhs, x);
        let (r_norm, steps) = solved?;
        count.iterations += steps;
        // What the projected residual hides: all that may be left along N is the contradiction in b, and what an error of N
        // that x can bear makes of the rest. If there is more, A has come to see what N takes for null.
        let rounding = NULL_FLOOR * self.trace * norm(&self.x);
        if self.leak > inconsistency + target + tolerance * b_norm + rounding {
            return Err(Lost);
        }
        self.stay_in_range(problem, predicted, count)?;
        // The trace of A⁺ is at most r / λ⁺, and that of A at most r times its largest eigenvalue.
        let growth = self.inverse_trace() * self.trace * self.params.rank_cut;
        if !growth.is_finite() || growth > (n * n) as f64 || self.carried.too_large(norm(&self.x), b_norm) {
            return Err(Lost);
        }
        Ok([inconsistency, null_error, r_norm])
    }

    /// b ← Π b; gives ‖Nᵀ b‖.
    fn project_rhs(&mut self, problem: &Problem<'_>) -> f64 {
        self.b.copy_from_slice(problem.rhs());
        self.null.project(&mut self.b).sqrt()
    }

    /// Solves A u = what x has moved since it was in range(A) for certain: what A cannot reach of that is a direction that
    /// A has lost and H has not. Then z, with A z = x, is known too.
    fn stay_in_range(
        &mut self,
        problem: &mut Problem<'_>,
        predicted: bool,
        count: &mut Count,
    ) -> Result<(), Lost> {
        let scale = norm(&self.x);
        let target = self.params.rtol * scale;
        for (moved, x) in self.moved.iter_mut().zip(&self.x) {
            *moved = x - *moved;
        }
        let (rhs, mut u) = (std::mem::take(&mut self.moved), std::mem::take(&mut self.u));
        let sure = problem.wanted == Wanted::Acceleration || norm(&rhs) <= target;
        let solved = if sure {
            gemv(&self.carried.inverse, &rhs, &mut u);
            count.products += 1;
            Ok(())
        } else {
            self.start(problem, &rhs, &mut u, count);
            self.iterate(problem, (&rhs, target), (&mut u, f64::INFINITY), count).map(|_| ())
        };
        (self.moved, self.u) = (rhs, u);
        solved?;
        if predicted {
            axpy(1.0, &self.u, &mut self.z);
        } else {
            self.z.copy_from_slice(&self.u);
        }
        if !self.z.iter().all(|entry| entry.is_finite()) {
            return Err(Lost);
        }
        self.past.push(&self.z);
        Ok(())
    }

    /// Starts anew; gives ‖Nᵀ b‖ and ‖r‖.
    fn refresh(&mut self, problem: &mut Problem<'_>, count: &mut Count) -> Result<[f64; 2], Error> {
        self.carried.refresh(problem)?;
        self.projected = true;
        self.null.restart(self.carried.null_vectors());
        self.make_room();
        let inconsistency = self.project_rhs(problem);
        gemv(&self.carried.inverse, &self.b, &mut self.x);
        problem.apply(&self.x, &mut self.r);
        axpy(-1.0, &self.b, &mut self.r);
        self.null.project(&mut self.r);
        gemv(&self.carried.inverse, &self.x, &mut self.z);
        count.products += 3;
        self.past.restart(self.x.len());
        // z = A⁺ x = A⁺ A⁺ b overflows before x does, and is no past then.
        if self.z.iter().all(|entry| entry.is_finite()) {
            self.past.push(&self.z);
        }
        Ok([inconsistency, norm(&self.r)])
    }
}

impl Solver for Tracked {
    type Params = TrackedParams;
    const SUMMARY: &'static str = "SR1 with null-space tracking: minimum norm kept while null(A) moves";
    const NEEDS: Needs = Needs::Operator;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: TrackedParams) -> Self {
        Self::sized(params, 0)
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        if self.x.len() != n {
            *self = Self::sized(self.params, n);
        }
        let mut count = Count::default();
        self.explained = problem.blocks().explained_of_all(self.params.rank_cut).1;
        let stale = self.carried.is_stale() || self.ceiling != problem.blocks().ceiling();
        let advanced = if stale { Err(Lost) } else { self.advance(problem, &mut count) };
        let refreshed = advanced.is_err();
        let [inconsistency, null_residual, r_norm] = if let Ok(figures) = advanced {
            figures
        } else {
            let [inconsistency, r_norm] = self.refresh(problem, &mut count)?;
            self.ceiling = problem.blocks().ceiling();
            [inconsistency, self.carried.null_residual(), r_norm]
        };
        x.copy_from_slice(&self.x);
        let b_norm = norm(problem.rhs());
        Ok(Info {
            status: Status::Converged,
            iterations: count.iterations,
            products: count.products,
            residual_rel: if b_norm == 0.0 { 0.0 } else { r_norm / b_norm },
            inconsistency: Some(inconsistency),
            rank: Some(n - self.null.dim()),
            null_residual: Some(null_residual),
            tolerance: if self.params.rtol > RTOL { self.params.rtol } else { 0.0 },
            refreshed,
            fallbacks: count.fallbacks,
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        self.carried.invalidate();
    }

    fn state(&self) -> State {
        let state = self.carried.state(TrackedParams::SOLVER);
        if self.carried.is_stale() {
            return state;
        }
        self.null.save(self.past.save(state, "differences"))
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_state(state, TrackedParams::SOLVER, &FIELDS)?;
        let n = if state.fields.is_empty() { 0 } else { state.size };
        let mut restored = Self::sized(self.params, n);
        if n > 0 {
            restored.carried.restore(state);
            restored.null.load(state, TrackedParams::SOLVER)?;
            restored.past.load(state, "differences", (n, 0), TrackedParams::SOLVER)?;
            restored.make_room();
        }
        *self = restored;
        Ok(())
    }
}
