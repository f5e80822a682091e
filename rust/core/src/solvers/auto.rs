//! The default: the cheapest method for the structure of a step, with the reference behind it.
//!
//! | method | where |
//! |---|---|
//! | [`dual`](crate::solvers::dual), [`primal`](crate::solvers::primal) | sparse steps of more than six rows: whichever takes fewer multiplications, counted once for their patterns |
//! | [`cholesky`](crate::solvers::cholesky) | the rest, and where a sparse factor does not prove the rank |
//! | [`pinv`](crate::solvers::pinv) | where the figures of that leave open which eigenvalues lie below the cut, or what they span, or where the residual is too large |
//!
//! Each step to the next is counted as a fallback. Of dense systems from 6 to 192 rows, a third of them redundant, the
//! table of [`bench`](crate::bench) says the same at every size: rank-revealing Cholesky.

use crate::error::Error;
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::cholesky::found::Found;
use crate::solvers::cholesky::{Cholesky, CholeskyParams};
use crate::solvers::dual::Dual;
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::pinv::{Pinv, PinvParams};
use crate::solvers::primal::{Primal, is_open};
use crate::solvers::solver::{Solver, State};
use crate::solvers::sparse::SparseFactor;

/// Residual in the least-squares sense, relative to b, above which the fast solver is not believed: a direct solve of a
/// system with a condition of up to 1e8 leaves 1e-8.
const BELIEVED: f64 = 1e-7;

/// What is kept is clearly above the cut when its smallest pivot is this many times as large: of four rows a pivot exceeds
/// the least eigenvalue 31 times at most, (4ʳ + 6r − 1)/9 (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed.,
/// §8.3); of more rows 32 times are next to never seen.
const CLEAR: f64 = 32.0;

/// A null space that the factor has off by more than this is not believed. Refinement squares it.
const NEAR: f64 = 1e-5;

/// Whether the eigenvalues of every block of the matrix say the same rank by `rank_cut`, and the same null space.
///
/// The trace of what is left over bounds λᵣ₊₁ from above, in every block and also where rows are scaled, for no block is smaller
/// than the least entry of the diagonal. The largest eigenvalue lies between the first pivot and the trace. Of a rank that is
/// held the factor may leave as much as the open rows explain.
fn is_certain(found: &Found, problem: &mut Problem<'_>, rank_cut: f64) -> bool {
    let (left, trace, blocks) = (found.left(problem.len()), problem.trace(), problem.blocks());
    let zero = if is_held(problem) && found.rank == blocks.ceiling() {
        blocks.explained_of_all(rank_cut).0
    } else {
        rank_cut
    };
    found.last > CLEAR * rank_cut * trace
        && left <= zero * problem.least_diagonal()
        && left <= NEAR * found.last
}

/// Whether the ranks of all blocks are held.
fn is_held(problem: &Problem<'_>) -> bool {
    let blocks = problem.blocks();
    (0..blocks.len()).all(|block| blocks.holds(block))
}

/// How far pivots lie from the cut, as eigenvalues do in [`Info::margin`].
fn margin(found: &Found, problem: &mut Problem<'_>, rank_cut: f64) -> f64 {
    let kept = found.last / (rank_cut * problem.trace());
    let left = found.left(problem.len()).max(f64::MIN_POSITIVE);
    if is_held(problem) { kept } else { kept.min(rank_cut * problem.least_diagonal() / left) }
}

/// Parameters of [`Auto`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AutoParams {
    /// Pivots, or eigenvalues, below this part of the first count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for AutoParams {
    const SOLVER: &'static str = "auto";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// The fast solver and the one to fall back on.
#[derive(Clone)]
pub struct Auto {
    rank_cut: f64,
    fast: Cholesky,
    dual: Dual,
    primal: Primal,
    /// The cheapest for the patterns at hand.
    method: Method,
    chosen_for: (Option<u64>, bool),
    safe: Pinv,
}

/// Sizes up to this have dense code of their own, which nothing beats: its loops are unrolled.
const SMALL: usize = 6;

/// What a sparse step is solved by.
#[derive(Clone, Copy, PartialEq)]
enum Method {
    Dense,
    Dual,
    Primal,
}

impl Auto {
    /// The method that takes least work by the patterns of a step.
    fn choose(&mut self, problem: &Problem<'_>) -> Method {
        let Some(sparse) = problem.sparse.filter(|sparse| sparse.plan.is_some()) else {
            return Method::Dense;
        };
        let open = is_open(problem.blocks(), problem.len());
        if self.chosen_for != (sparse.plan, open) {
            let n = problem.len();
            let dense = n * n * (n + problem.work.len());
            self.chosen_for = (sparse.plan, open);
            self.method = Method::Dense;
            if n > SMALL {
                let primal = self.primal.work(sparse, open);
                let dual = if open { None } else { self.dual.work_up_to(sparse, primal) };
                self.method = match () {
                    () if dense < primal.min(dual.unwrap_or(primal)) => Method::Dense,
                    () if dual.is_some() => Method::Dual,
                    () => Method::Primal,
                };
            }
        }
        self.method
    }

    /// By a sparse method, where there is one and its evidence holds.
    fn solve_sparse(&mut self, method: Method, problem: &mut Problem<'_>, x: &mut [f64]) -> Option<Info> {
        match method {
            Method::Dense => None,
            Method::Dual => self.dual.solve(problem, x).or_else(|| self.primal.solve(problem, x)),
            Method::Primal => self.primal.solve(problem, x),
        }
    }
}

impl Solver for Auto {
    type Params = AutoParams;
    const SUMMARY: &'static str =
        "the default: the fastest right solver for the size, the reference where it fails";
    const NEEDS: Needs = Needs::Sparse;
    const DIRECT: bool = true;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.rank_cut)
    }

    fn new(params: AutoParams) -> Self {
        let AutoParams { rank_cut } = params;
        Self {
            rank_cut,
            fast: Cholesky::new(CholeskyParams { rank_cut }),
            dual: Dual::new(rank_cut),
            primal: Primal::new(rank_cut),
            method: Method::Dense,
            chosen_for: (None, false),
            safe: Pinv::new(PinvParams { rank_cut }),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let method = self.choose(problem);
        if let Some(info) = self.solve_sparse(method, problem, x) {
            return Ok(info);
        }
        let fallbacks = usize::from(method != Method::Dense);
        // A rank that is to be held is decided by eigenvalues.
        if problem.blocks().is_undecided() {
            return self.safe.solve(problem, x);
        }
        let info = self.fast.solve(problem, x)?;
        let found = self.fast.found();
        if is_certain(found, problem, self.rank_cut) && info.residual_rel <= BELIEVED {
            return Ok(Info { margin: Some(margin(found, problem, self.rank_cut)), fallbacks, ..info });
        }
        self.safe.solve(problem, x).map(|info| Info { fallbacks: 1 + fallbacks, ..info })
    }

    fn reset(&mut self) {
        self.primal.forget();
        self.fast.reset();
        self.safe.reset();
    }

    fn state(&self) -> State {
        self.fast.save(AutoParams::SOLVER)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.fast.load(state, AutoParams::SOLVER)
    }
}
