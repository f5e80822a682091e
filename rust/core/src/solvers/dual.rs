//! The sparse direct solver of rows that are independent after folding.
//!
//! ```text
//!     A = L D Lᵀ      n×n, sparse where loops follow one another on short trees
//! ```
//!
//! A is of full rank, clearly, where A − τE has a factor with positive pivots, τ by block: every eigenvalue exceeds τ then
//! (Sylvester), and no null space has to be found. The pivots of A itself in the order of least fill would not tell: a chain with
//! pivots of 1 can be singular. Of soft rows A has R on its diagonal.

mod plan;

use self::plan::Plan;
use crate::info::Info;
use crate::linalg::kernels::norm;
use crate::problem::Problem;
use crate::problem::whitened::Sparse;
use crate::solvers::sparse::SparseFactor;

/// τ is this many times the cut, as a part of the largest entry of the diagonal: the largest eigenvalue of a block exceeds it by a
/// factor that grows with how many rows meet, not with how many there are.
const CLEAR: f64 = 16.0;

/// Residual ‖b − A x‖/‖b‖ at which x is as good as rounding allows; one solve leaves 1e-15 as a rule.
const CLOSED: f64 = 1e-14;

/// The largest that is taken where refinement gets no further.
const ACCEPTED: f64 = 1e-10;

/// Refinements that are made at most.
const STEPS: usize = 8;

/// The factor and its workspace; nothing is carried from step to step but patterns.
#[derive(Clone)]
pub struct Dual {
    rank_cut: f64,
    plan: Plan,
    /// τ of each row, in the order of elimination, as all vectors here.
    shifts: Vec<f64>,
    rhs: Vec<f64>,
    x: Vec<f64>,
    residual: Vec<f64>,
    image: Vec<f64>,
}

impl SparseFactor for Dual {
    const NAME: &'static str = "dual";
    const SUMMARY: &'static str = "sparse Cholesky: many independent loops on short trees";

    fn new(rank_cut: f64) -> Self {
        let none = Vec::new;
        Self {
            rank_cut,
            plan: Plan::default(),
            shifts: none(),
            rhs: none(),
            x: none(),
            residual: none(),
            image: none(),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Option<Info> {
        let sparse = problem.sparse.filter(|sparse| sparse.plan.is_some())?;
        if problem.blocks.ceiling() < problem.rhs.len() {
            return None;
        }
        self.plan.plan(sparse);
        let n = self.plan.ldl.len();
        for vector in [&mut self.shifts, &mut self.rhs, &mut self.x, &mut self.residual, &mut self.image] {
            vector.resize(n, 0.0);
        }
        self.plan.fill(sparse, problem.softness);
        self.find_shifts(problem);
        if !(self.proves() && self.plan.ldl.factorise()) {
            return None;
        }
        for (row, &place) in self.plan.places.iter().enumerate() {
            self.rhs[place as usize] = problem.rhs[row];
        }
        let residual_rel = self.refine()?;
        for (entry, &place) in x.iter_mut().zip(&self.plan.places) {
            *entry = self.x[place as usize];
        }
        let blocks = &mut *problem.blocks;
        for block in 0..blocks.len() {
            let rank = blocks.of(block).len();
            blocks.hold_rank(block, rank);
        }
        Some(Info {
            residual_rel,
            inconsistency: Some(0.0),
            rank: Some(n),
            null_residual: Some(0.0),
            ..Info::trivial(0.0)
        })
    }
}

impl Dual {
    /// Multiplications that a solve of this step takes, about; `None` where they are more than `most`.
    pub(crate) fn work_up_to(&mut self, sparse: Sparse<'_>, most: usize) -> Option<usize> {
        if Plan::least_work(sparse) > most {
            return None;
        }
        self.plan.plan(sparse);
        Some(self.plan.work()).filter(|work| *work <= most)
    }

    /// τ of each row.
    fn find_shifts(&mut self, problem: &Problem<'_>) {
        let (blocks, diagonal) = (&*problem.blocks, self.plan.ldl.entries_mut());
        let cut = blocks.cut(self.rank_cut).max(self.shifts.len() as f64 * f64::EPSILON);
        for block in 0..blocks.len() {
            let places = || blocks.of(block).iter().map(|&row| self.plan.places[row] as usize);
            let largest = places().fold(0.0_f64, |most, place| most.max(diagonal[place]));
            for place in places() {
                self.shifts[place] = CLEAR * cut * largest;
            }
        }
    }

    /// Whether A − τE is positive definite; leaves A as it was.
    fn proves(&mut self) -> bool {
        let ldl = &mut self.plan.ldl;
        for ((entry, shift), kept) in ldl.entries_mut().iter_mut().zip(&self.shifts).zip(&mut self.image) {
            *kept = *entry;
            *entry -= shift;
        }
        let definite = ldl.factorise() && ldl.pivots().iter().all(|pivot| *pivot > f64::MIN_POSITIVE);
        ldl.entries_mut()[..self.image.len()].copy_from_slice(&self.image);
        definite
    }

    /// x = A⁻¹ b; gives its relative residual.
    fn refine(&mut self) -> Option<f64> {
        let Self { plan, rhs, x, residual, image, .. } = self;
        let size = norm(rhs);
        x.fill(0.0);
        if size == 0.0 {
            return Some(0.0);
        }
        residual.copy_from_slice(rhs);
        let mut before = f64::INFINITY;
        for _ in 0..STEPS {
            plan.ldl.solve(residual);
            for (entry, change) in x.iter_mut().zip(&*residual) {
                *entry += change;
            }
            plan.ldl.multiply(x, image);
            for ((left, given), image) in residual.iter_mut().zip(&*rhs).zip(&*image) {
                *left = given - image;
            }
            let left = norm(residual) / size;
            if left <= CLOSED {
                return Some(left);
            }
            // A NaN gets no further, either.
            if left >= 0.5 * before || left.is_nan() {
                return (left <= ACCEPTED).then_some(left);
            }
            before = left;
        }
        (before <= ACCEPTED).then_some(before)
    }
}
