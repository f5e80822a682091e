//! The classical quasi-Newton iterations that the paper compares with: SR1 (its formula (10)), BFGS and DFP, each with an
//! exact line search, on ½ xᵀA x − bᵀx. H is carried from step to step, as in [`sr1`](crate::solvers::sr1).
//!
//! ```text
//!     H₀ = A₀⁺ (from the previous step; once, at the start, from an eigendecomposition),  x₀ = 0,  r₀ = −b
//!     p = −H r,   α = −pᵀr / pᵀA p,   s = α p,   y = α A p,   x += s,   r += y
//!     SR1     H += w wᵀ / wᵀy                                             w = s − H y;   if |wᵀy| > ε ‖w‖ ‖y‖
//!     BFGS    H += (1 + yᵀHy / sᵀy) s sᵀ / sᵀy − (H y sᵀ + s yᵀH) / sᵀy                 if sᵀy > ε ‖s‖ ‖y‖
//!     DFP     H += s sᵀ / sᵀy − H y yᵀH / yᵀHy                                          if besides yᵀHy > 0
//! ```
//!
//! Each update makes H y = s, the secant equation. Where its condition fails it is skipped, which counts as a fallback.
//! Iterations are updates, as in [`sr1`](crate::solvers::sr1): 0 when the first step along H₀ b is good enough. Three products an
//! iteration, A p, H r and H y, against two of algorithm (11). To keep it at three the residual is updated by y, and
//! computed anew only before it may count as small enough, so that an x which swallows b does not pass (see
//! [`sr1`](crate::solvers::sr1)).
//!
//! On a quadratic function all three give the same x in exact arithmetic, those of conjugate gradients preconditioned by
//! H₀, and end after at most rank(A) steps; with rounding they differ. Since p lies in range(H), range(H) never leaves
//! range(H₀): as with algorithm (11), x loses its minimum norm when null(A) turns, and ‖A x − b‖ cannot fall below ‖Nᵀb‖.
//! Breakdown and refresh are those of [`sr1`](crate::solvers::sr1) as well; pᵀA p = 0 to rounding is one more breakdown.
//!
//! Sources: C. G. Broyden, "Quasi-Newton methods and their application to function minimisation", Math. Comp. 21 (1967)
//! 368–381; J. Nocedal and S. J. Wright, *Numerical Optimization*, 2nd ed., §6.1–6.2.

use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::linalg::kernels::{axpy, dot, gemv, norm, rank_one, rank_two};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::carried::{CarriedInverse, EPS_ABS, FIELDS, Iterate, check_state};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::solver::{Solver, State};

/// A formula that makes H y = s.
pub trait Update: Copy + Default + Send + Sync + 'static {
    /// Name of its solver in the registry.
    const NAME: &'static str;
    /// One line on its solver.
    const SUMMARY: &'static str;

    /// Updates H (`inverse`, `n×n`) by s, y and H y (`n` each), or leaves it alone; whether it did. Overwrites `hy`.
    fn update(guard: f64, s: &[f64], y: &[f64], hy: &mut [f64], inverse: &mut [f64]) -> bool;
}

/// Symmetric rank one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sr1Update;

impl Update for Sr1Update {
    const NAME: &'static str = "sr1-classic";
    const SUMMARY: &'static str = "the paper's formula (10): SR1 with exact line search, carried";

    fn update(guard: f64, s: &[f64], y: &[f64], hy: &mut [f64], inverse: &mut [f64]) -> bool {
        for (entry, s) in hy.iter_mut().zip(s) {
            *entry = s - *entry;
        }
        let denominator = dot(hy, y);
        let sound = denominator.abs() > guard * norm(hy) * norm(y);
        if sound {
            rank_one(denominator.recip(), hy, inverse);
        }
        sound
    }
}

/// Broyden, Fletcher, Goldfarb, Shanno.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Bfgs;

impl Update for Bfgs {
    const NAME: &'static str = "bfgs";
    const SUMMARY: &'static str = "BFGS with exact line search, carried";

    fn update(guard: f64, s: &[f64], y: &[f64], hy: &mut [f64], inverse: &mut [f64]) -> bool {
        let curvature = dot(s, y);
        let sound = curvature > guard * norm(s) * norm(y);
        if sound {
            // The term in s sᵀ goes half to each factor of the symmetric product.
            axpy(-0.5 * (1.0 + dot(y, hy) / curvature), s, hy);
            rank_two(-curvature.recip(), hy, s, inverse);
        }
        sound
    }
}

/// Davidon, Fletcher, Powell.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Dfp;

impl Update for Dfp {
    const NAME: &'static str = "dfp";
    const SUMMARY: &'static str = "DFP with exact line search, carried";

    fn update(guard: f64, s: &[f64], y: &[f64], hy: &mut [f64], inverse: &mut [f64]) -> bool {
        let (curvature, inner) = (dot(s, y), dot(y, hy));
        let sound = curvature > guard * norm(s) * norm(y) && inner > 0.0;
        if sound {
            rank_one(curvature.recip(), s, inverse);
            rank_one(-inner.recip(), hy, inverse);
        }
        sound
    }
}

/// Parameters of [`QuasiNewton`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct QuasiNewtonParams<U> {
    /// ε of the stopping test ‖A x − b‖ ≤ max(ε, rtol ‖b‖), in the units of b (m/s² for a connect); > 0.
    pub eps_abs: f64,
    /// Relative part of the stopping test; ≥ 0.
    pub rtol: f64,
    /// ε of the guards of the updates, relative; in [0, 1).
    pub guard: f64,
    /// Iterations after which a solve gives up.
    pub max_iterations: usize,
    /// Rank cut of the eigendecomposition that gives H₀; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
    /// The formula.
    pub update: U,
}

impl<U: Update> Params for QuasiNewtonParams<U> {
    const SOLVER: &'static str = U::NAME;

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            eps_abs: reader.positive("eps_abs", EPS_ABS)?,
            rtol: reader.non_negative("rtol", 0.0)?,
            guard: reader.fraction("guard", 1e-6)?,
            max_iterations: reader.count("max_iterations", 50)?,
            rank_cut: reader.fraction("rank_cut", RANK_CUT)?,
            update: U::default(),
        })
    }
}

/// A quasi-Newton iteration with the H of the last solve.
#[derive(Clone)]
pub struct QuasiNewton<U> {
    params: QuasiNewtonParams<U>,
    carried: CarriedInverse,
    at: Iterate,
    s: Vec<f64>,
    y: Vec<f64>,
    hy: Vec<f64>,
}

impl<U: Update> QuasiNewton<U> {
    fn sized(params: QuasiNewtonParams<U>, n: usize) -> Self {
        let vector = || vec![0.0; n];
        Self {
            params,
            carried: CarriedInverse::new(n, params.rank_cut),
            at: Iterate::new(n),
            s: vector(),
            y: vector(),
            hy: vector(),
        }
    }

    fn resize(&mut self, n: usize) {
        if self.y.len() != n {
            *self = Self::sized(self.params, n);
        }
    }

    /// H, `n×n`, column-major: the pseudo-inverse as the last solve left it.
    #[must_use]
    pub fn inverse(&self) -> &[f64] {
        &self.carried.inverse
    }

    /// One exact line search along −H r; false, and nothing moved, where A has no curvature to rounding, ε ‖A‖ ‖p‖².
    fn search(&mut self, problem: &mut Problem<'_>, trace: f64) -> bool {
        let Self { carried, at, s, y, .. } = self;
        gemv(&carried.inverse, &at.r, s);
        problem.apply(s, y);
        at.products += 2;
        let curvature = dot(s, y);
        let curved = curvature > f64::EPSILON * trace * dot(s, s);
        if curved {
            // s holds H r = −p.
            let step = -dot(s, &at.r) / curvature;
            s.iter_mut().chain(y.iter_mut()).for_each(|entry| *entry *= step);
            axpy(1.0, s, &mut at.x);
            axpy(1.0, y, &mut at.r);
        }
        curved
    }

    /// Makes H y = s, or counts a fallback.
    fn update(&mut self) {
        let Self { params, carried, at, s, y, hy } = self;
        gemv(&carried.inverse, y, hy);
        at.products += 1;
        at.fallbacks += usize::from(!U::update(params.guard, s, y, hy, &mut carried.inverse));
    }
}

impl<U: Update> Solver for QuasiNewton<U> {
    type Params = QuasiNewtonParams<U>;
    const SUMMARY: &'static str = U::SUMMARY;
    const NEEDS: Needs = Needs::Operator;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: QuasiNewtonParams<U>) -> Self {
        Self::sized(params, 0)
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        self.at.begin(&mut self.carried, problem)?;
        self.at.x.fill(0.0);
        self.at.r.fill(0.0);
        axpy(-1.0, problem.rhs(), &mut self.at.r);
        let trace = problem.trace();
        self.at.tolerance = self.params.eps_abs.max(self.params.rtol * self.at.b_norm);
        self.at.loose = self.at.tolerance > EPS_ABS;
        let status = loop {
            if !self.search(problem, trace) {
                break if norm(&self.at.r) <= self.at.tolerance {
                    Status::Converged
                } else {
                    Status::Breakdown
                };
            }
            let verdict = |at: &Iterate| at.verdict(&self.carried, self.params.max_iterations);
            let mut status = verdict(&self.at);
            if status == Some(Status::Converged) {
                self.at.residual(problem);
                status = verdict(&self.at);
            }
            if let Some(status) = status {
                break status;
            }
            self.update();
            self.at.iterations += 1;
        };
        self.at.finish(status, &mut self.carried, problem, x)
    }

    fn reset(&mut self) {
        self.carried.invalidate();
    }

    fn state(&self) -> State {
        self.carried.state(U::NAME)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        check_state(state, U::NAME, &FIELDS)?;
        if !state.fields.is_empty() {
            self.resize(state.size);
        }
        self.carried.restore(state);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_problems::{RANK, ROWS, boat};
    use crate::{ConstrainedSystem, Options, Wanted, make_solver};

    #[test]
    fn an_update_satisfies_the_secant_equation_and_keeps_the_symmetry() {
        type Formula = fn(f64, &[f64], &[f64], &mut [f64], &mut [f64]) -> bool;
        let formulas: [(&str, Formula); 3] =
            [("sr1", Sr1Update::update), ("bfgs", Bfgs::update), ("dfp", Dfp::update)];
        let start = [2.0, 0.5, 0.0, 0.5, 1.0, 0.25, 0.0, 0.25, 3.0];
        let (s, y) = ([1.0, -2.0, 0.5], [0.75, -1.0, 2.0]);
        for (name, update) in formulas {
            let (mut inverse, mut hy) = (start, [0.0; 3]);
            gemv(&inverse, &y, &mut hy);
            assert!(update(1e-6, &s, &y, &mut hy, &mut inverse), "{name}");
            gemv(&inverse, &y, &mut hy);
            let gap = hy.iter().zip(s).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(gap < 1e-14, "{name}: H y − s = {gap:e}");
            for (row, col) in [(0, 1), (0, 2), (1, 2)] {
                let gap = (inverse[row * 3 + col] - inverse[col * 3 + row]).abs();
                assert!(gap < 1e-14, "{name}: asymmetry {gap:e}");
            }
            // s = H y leaves SR1 nothing to divide by, and y = 0 none of them.
            assert!(!update(1e-6, &[0.0; 3], &[0.0; 3], &mut [0.0; 3], &mut inverse), "{name}");
        }
    }

    #[test]
    fn the_boat_is_solved_to_either_tolerance_in_no_more_updates_than_its_rank() {
        for name in [Sr1Update::NAME, Bfgs::NAME, Dfp::NAME] {
            for (rtol, bound) in [(0.0, 1e-6), (1e-3, 1e-3)] {
                let mut solver = make_solver(name, &Options::new().with("rtol", rtol)).unwrap();
                let (mut system, mut x) = (ConstrainedSystem::new(), [0.0; ROWS]);
                for k in 0..500 {
                    system.assemble(&boat(0.01 * f64::from(k)).view()).unwrap();
                    let info = system.solve(&mut *solver, Wanted::Multipliers, &mut x).unwrap();
                    let scale = if rtol > 0.0 { 1.0 } else { norm(system.rhs()) };
                    assert_eq!(info.status, Status::Converged, "{name} at {k}: {info:?}");
                    assert!(info.residual_rel * scale <= bound, "{name} at {k}: {info:?}");
                    assert!(info.iterations <= RANK && info.refreshed == (k <= 1), "{name} at {k}: {info:?}");
                    assert!(info.products <= 5 + 3 * info.iterations + 3, "{name} at {k}: {info:?}");
                }
            }
        }
    }
}
