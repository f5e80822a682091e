//! The sparse direct solver of rows that are independent after folding.
//!
//! ```text
//!     A = L D Lᵀ      n×n, sparse where loops follow one another on short trees
//! ```
//!
//! A is of full rank, clearly, where A − τE has a factor with positive pivots, τ by block: every eigenvalue exceeds τ then
//! (Sylvester), and no null space has to be found. The pivots of A itself in the order of least fill would not tell: a chain with
//! pivots of 1 can be singular. Of soft rows A has R on its diagonal.
//!
//! Where an eigenvalue is near the cut, on the way through a singular pose, the same count is made at the cut itself; the vectors of a few
//! that lie below it are found and left out.

mod near;
mod plan;

use self::near::{Near, SLACK};
use self::plan::Plan;
use crate::info::Info;
use crate::linalg::kernels::norm;
use crate::problem::Problem;
use crate::problem::whitened::Sparse;
use crate::solvers::eigen::GRADED;
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
    near: Near,
    /// The largest eigenvalue, where one is near the cut.
    largest: f64,
    /// Sizes of constraints.
    sizes: Vec<f64>,
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
            near: Near::new(),
            largest: 0.0,
            sizes: none(),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Option<Info> {
        let (dropped, proved) = self.factorise(problem)?;
        let n = self.plan.ldl.len();
        self.near.drop_none();
        if dropped > 0 {
            let (near, ldl, cut) = (&mut self.near, &self.plan.ldl, problem.blocks.cut(self.rank_cut));
            near.find(n, (dropped, cut * self.largest), |v: &[f64], image: &mut [f64]| {
                image.copy_from_slice(v);
                ldl.solve(image);
            })?;
        }
        for (row, &place) in self.plan.places.iter().enumerate() {
            self.rhs[place as usize] = problem.rhs[row];
        }
        let size = norm(&self.rhs);
        let inconsistency = self.near.project(&mut self.rhs);
        let mut residual_rel = self.refine()?;
        if dropped > 0 {
            residual_rel = self.leave_out(size);
        }
        for (entry, &place) in x.iter_mut().zip(&self.plan.places) {
            *entry = self.x[place as usize];
        }
        hold_all(problem);
        let margin =
            (dropped > 0).then(|| self.near.least_kept / (problem.blocks.cut(self.rank_cut) * self.largest));
        Some(Info {
            residual_rel,
            margin,
            inconsistency: Some(inconsistency),
            rank: Some(n - dropped),
            null_residual: Some(if dropped > 0 { self.near.largest_dropped / self.largest } else { 0.0 }),
            fallbacks: usize::from(!proved),
            ..Info::trivial(0.0)
        })
    }
}

/// Holds the rank of blocks whose rows are independent.
fn hold_all(problem: &mut Problem<'_>) {
    let blocks = &mut *problem.blocks;
    for block in 0..blocks.len() {
        let rank = blocks.of(block).len();
        blocks.hold_rank(block, rank);
    }
}

impl Dual {
    /// Factorises A; gives how many of its eigenvalues lie below the cut, and whether the first count proved it.
    fn factorise(&mut self, problem: &Problem<'_>) -> Option<(usize, bool)> {
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
        let proved = self.count_below() == Some(0);
        let dropped = if proved { 0 } else { self.count_near(problem)? };
        self.plan.ldl.factorise().then_some((dropped, proved))
    }

    /// A⁻¹ (`n×n`), where no eigenvalue lies below the cut; tells whether that is proved.
    pub(crate) fn invert(&mut self, problem: &mut Problem<'_>, inverse: &mut [f64]) -> bool {
        if !matches!(self.factorise(problem), Some((0, _))) {
            return false;
        }
        let (n, places) = (self.plan.ldl.len(), &self.plan.places);
        for (col, &place) in places.iter().enumerate() {
            self.x.fill(0.0);
            self.x[place as usize] = 1.0;
            self.plan.ldl.solve(&mut self.x);
            for (row, &place) in places.iter().enumerate().skip(col) {
                inverse[col * n + row] = self.x[place as usize];
                inverse[row * n + col] = self.x[place as usize];
            }
        }
        hold_all(problem);
        true
    }

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

    /// How many eigenvalues of A τ exceeds; leaves A as it was.
    fn count_below(&mut self) -> Option<usize> {
        let ldl = &mut self.plan.ldl;
        for ((entry, shift), kept) in ldl.entries_mut().iter_mut().zip(&self.shifts).zip(&mut self.image) {
            *kept = *entry;
            *entry -= shift;
        }
        let found = ldl.factorise();
        let below = ldl.pivots().iter().filter(|pivot| **pivot <= f64::MIN_POSITIVE).count();
        ldl.entries_mut()[..self.image.len()].copy_from_slice(&self.image);
        found.then_some(below)
    }

    /// How many eigenvalues of A lie below the cut, of one block whose constraints are of one size, where all that is known of the
    /// largest says the same.
    fn count_near(&mut self, problem: &Problem<'_>) -> Option<usize> {
        let (blocks, cut) = (&*problem.blocks, problem.blocks.cut(self.rank_cut));
        let n = self.shifts.len();
        // Rows whose rank nobody holds may be redundant at every pose, which is not for this factor.
        let held = blocks.len() == 1 && blocks.holds(0);
        if !held || problem.softness.is_some() || cut <= CLEAR * n as f64 * f64::EPSILON {
            return None;
        }
        let Self { plan, sizes, .. } = self;
        let diagonal = &plan.ldl.entries_mut()[..n];
        if blocks.sizes(blocks.of(0), |row| diagonal[plan.places[row] as usize], sizes) > GRADED {
            return None;
        }
        // Where none is below that part of a bound, nothing has to be known of the largest.
        let bound = plan.ldl.bound(&mut self.residual);
        if self.count_below_all(cut * bound) == Some(0) {
            return Some(0);
        }
        let Self { plan, near, .. } = self;
        let largest = near.largest(n, |v, image| plan.ldl.multiply(v, image))?;
        let count = self.count_below_all(cut * (SLACK * largest))?;
        self.largest = largest;
        let certain = self.count_below_all(SLACK * largest)? == n
            && (count == 0 || self.count_below_all(cut * largest)? == count);
        certain.then_some(count)
    }

    fn count_below_all(&mut self, bound: f64) -> Option<usize> {
        self.shifts.fill(bound);
        self.count_below()
    }

    /// Leaves what lies below the cut out of x; gives the residual of the rest, relative to ‖b‖.
    fn leave_out(&mut self, size: f64) -> f64 {
        let Self { plan, rhs, x, residual, image, near, .. } = self;
        near.project(x);
        plan.ldl.multiply(x, image);
        for ((left, given), image) in residual.iter_mut().zip(&*rhs).zip(&*image) {
            *left = given - image;
        }
        near.project(residual);
        if size > 0.0 { norm(residual) / size } else { 0.0 }
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
