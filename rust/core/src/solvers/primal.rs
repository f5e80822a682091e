//! The sparse direct solver: one factor of `JᵀJ − τM` gives the rank and, refined, the multipliers of least norm.
//!
//! ```text
//!     P = JᵀJ − τM = L D Lᵀ      nv×nv, sparse as J and M together are
//! ```
//!
//! **The rank.** `JᵀJ x = σ M x` has the positive eigenvalues of A, and nv − r zeros. So P has as many positive pivots as A has
//! eigenvalues above τ (Sylvester). Where that is the rank that is held, or all rows, or what a second, much smaller τ says
//! as well, no eigenvalue lies near the cut.
//!
//! **The multipliers.** With the acceleration δ that the rows add, and the smallest eigenvalue σ that counts,
//!
//! ```text
//!     δ ← δ + P⁻¹ (Jᵀ (b − J δ) − τ (Jᵀ x − M δ))        J δ = b, as far as it can be, and M δ in range(Jᵀ)
//!     x ← x + J P⁻¹ (M δ − Jᵀ x)                         Jᵀ x = M δ, and x in range(J)
//! ```
//!
//! lose a part of τ/(σ − τ) of the error a step, some seven digits. x in range(J) is of least norm, and Jᵀ leaves out what of b no x can
//! reach. A is never formed.
//!
//! P is the matrix of MuJoCo's own primal solver, M + Jᵀ D J, with the other sign of M. The augmented Lagrangian of Hestenes and Powell
//! (1969) has `M + JᵀJ/ε`; its sign says nothing of the rank. Redundancy that no folding takes away, which makes A singular,
//! costs nothing here, and neither does a deep tree, which makes A dense.

mod gap;
mod plan;

use self::gap::{Filter, Gap, NEGLIGIBLE, UNREACHED};
use self::plan::Plan;
use crate::info::Info;
use crate::linalg::kernels::{axpy, norm};
use crate::problem::whitened::Sparse;
use crate::problem::{Blocks, Problem};
use crate::solvers::sparse::SparseFactor;

/// τ is this many times the cut: the largest eigenvalue is found to a factor of three, from below, and a pivot's sign is
/// certain beyond rounding.
const CLEAR: f64 = 32.0;

/// Solves after which the largest eigenvalues are found anew.
const AGE: usize = 32;

/// Least τ as a part of the largest eigenvalue: M is lost to rounding in P beyond 1e-16 of this.
const LEAST: f64 = 1e-12;

/// Residual ‖b − A x‖/‖b‖ at which x is as good as rounding allows: of rows that are redundant b contradicts itself by some 1e-13.
const CLOSED: f64 = 1e-12;

/// Difference between Jᵀ x and M δ, relative to them, at which they are the same but for rounding.
const BALANCED: f64 = 1e-11;

/// Rows that stand open by no more, relative to what they turn on, give redundant rows eigenvalues of 1e-20, which do no harm. Beyond it
/// what is to be dropped comes back as σ/τ² times its part of b, which is taken out beforehand.
const CLOSED_ROWS: f64 = 1e-10;

/// Times as long that a solve of such rows takes.
const OPEN_WORK: usize = 4;

/// Size of a correction, relative to the first, that the next one is expected to have when no more are made.
const REFINED: f64 = 1e-13;

/// Of rows that contradict one another or are badly conditioned corrections may stop getting smaller at this size.
const ROUNDING: f64 = 1e-10;

/// A correction that is no smaller than this part of the one before says that τ is not small beside what counts.
const SLOW: f64 = 0.25;

/// One that is no smaller than this part is worth a factor with a smaller τ, whose rounding loses four digits of M.
const SLUGGISH: f64 = 5e-3;

/// Part of τ that it has.
const SMALLER: f64 = 1e-3;

/// What is left of rows that are closed is taken out by F² (3 − 2 F), which squares both errors.
const SQUARES: Filter = Filter { kept: 2, dropped: 2 };

/// Eigenvalues are looked for at parts of the largest that are so many times apart.
const STRIDE: f64 = 5.0;

/// Above this part of the largest nobody looks.
const MOST_PART: f64 = 1e-2;

/// Times that a filter is used at most.
const FILTERS: usize = 3;

/// Solves after which they are looked for anew.
const GAP_AGE: usize = 128;

/// Corrections that are made at most.
const STEPS: usize = 8;

/// The factor and its workspace. Carried from step to step are patterns and, for [`AGE`] solves, the largest eigenvalues, which place τ:
/// what came before can change last bits.
#[derive(Clone)]
pub struct Primal {
    rank_cut: f64,
    plan: Plan,
    /// By island: the rank that is expected, that of the factor, and the largest eigenvalue as it was last found.
    expected: Vec<usize>,
    positive: Vec<usize>,
    scales: Vec<f64>,
    sums: Vec<(f64, f64)>,
    /// The patterns that they were found for, and solves since then.
    scaled_for: Option<u64>,
    age: usize,
    /// τ of each velocity, and as a part of the largest eigenvalue.
    shifts: Vec<f64>,
    part: f64,
    /// Where no eigenvalue lies, as it was last found for rows that stand open.
    gap: Option<Gap>,
    /// Of rows: b without what no x can reach, what is left of it, J times something, and what passes a filter.
    target: Vec<f64>,
    residual: Vec<f64>,
    image: Vec<f64>,
    reached: Vec<f64>,
    /// Of velocities.
    force: Vec<f64>,
    motion: Vec<f64>,
    /// δ, M δ and Jᵀ x.
    acceleration: Vec<f64>,
    push: Vec<f64>,
    pull: Vec<f64>,
}

impl SparseFactor for Primal {
    const NAME: &'static str = "primal";
    const SUMMARY: &'static str =
        "sparse factor of JᵀJ − τM, refined: many loops, deep trees, any redundancy";

    fn new(rank_cut: f64) -> Self {
        let none = Vec::new;
        Self {
            rank_cut,
            plan: Plan::default(),
            expected: Vec::new(),
            positive: Vec::new(),
            scales: none(),
            sums: Vec::new(),
            scaled_for: None,
            age: 0,
            shifts: none(),
            part: 0.0,
            gap: None,
            target: none(),
            residual: none(),
            image: none(),
            reached: none(),
            force: none(),
            motion: none(),
            acceleration: none(),
            push: none(),
            pull: none(),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Option<Info> {
        let sparse = problem.sparse.filter(|sparse| sparse.plan.is_some() && problem.softness.is_none())?;
        self.plan.take(sparse);
        let (n, nv) = (self.plan.rows(), self.plan.ldl.len());
        for vector in [&mut self.target, &mut self.residual, &mut self.image, &mut self.reached] {
            vector.resize(n, 0.0);
        }
        let Self { shifts, force, motion, acceleration, push, pull, .. } = self;
        for vector in [shifts, force, motion, acceleration, push, pull] {
            vector.resize(nv, 0.0);
        }
        self.age += 1;
        if self.scales.is_empty() || self.scaled_for != sparse.plan || self.age >= AGE {
            self.find_scales(sparse);
            self.gap = self.gap.filter(|_| self.scaled_for == sparse.plan);
            (self.scaled_for, self.age) = (sparse.plan, 0);
        }
        if !is_open(problem.blocks, problem.rhs.len()) {
            let rank = self.find_rank(problem)?;
            self.target.copy_from_slice(problem.rhs);
            let info = self.refine(problem.rhs, x, false)?;
            return Some(Info { rank: Some(rank), ..info });
        }
        self.solve_open(problem, x).or_else(|| {
            // What is dropped may have come near τ since its place was found.
            let gap = self.gap.as_mut().filter(|gap| gap.age > 0)?;
            gap.age = GAP_AGE;
            self.solve_open(problem, x)
        })
    }

    fn forget(&mut self) {
        self.scales.clear();
        self.gap = None;
    }
}

impl Primal {
    /// Multiplications that a solve of this step takes, about; what filters of `open` rows take is counted by what dense code does in
    /// that time.
    pub(crate) fn work(&mut self, sparse: Sparse<'_>, open: bool) -> usize {
        self.plan.plan(sparse);
        if open { OPEN_WORK * self.plan.work() } else { self.plan.work() }
    }

    /// The largest eigenvalue of A by island, from below: two steps of the power method from rows that push one way or the
    /// other, as the bits of their numbers say.
    fn find_scales(&mut self, sparse: Sparse<'_>) {
        let Self { plan, scales, sums, image, force, motion, .. } = self;
        for (row, entry) in image.iter_mut().enumerate() {
            *entry = if (row.wrapping_mul(0x9E37_79B9) >> 16) & 1 == 0 { 1.0 } else { -1.0 };
        }
        scales.clear();
        scales.resize(plan.count, 0.0);
        for _ in 0..2 {
            plan.transposed_times(image, force);
            motion.copy_from_slice(force);
            plan.solve_mass(sparse, motion);
            plan.times(motion, image);
            sums.clear();
            sums.resize(plan.count, (0.0, 0.0));
            for (entry, &island) in image.iter().zip(&plan.island_of_row) {
                sums[island].0 += entry * entry;
            }
            for ((force, motion), &island) in force.iter().zip(&*motion).zip(&plan.islands) {
                sums[island].1 += force * motion;
            }
            for (scale, &(square, energy)) in scales.iter_mut().zip(&*sums) {
                if energy > 0.0 {
                    *scale = scale.max(square / energy);
                }
            }
        }
    }

    /// Positive pivots by island, with τ a part of the largest eigenvalue.
    fn count(&mut self, part: f64) -> Option<()> {
        self.part = part.max(LEAST);
        for (shift, &island) in self.shifts.iter_mut().zip(&self.plan.islands) {
            let scale = self.scales[island];
            // Velocities that no row touches have P = −M.
            *shift = if scale > 0.0 { self.part * scale } else { 1.0 };
        }
        if !self.plan.factorise(&self.shifts) {
            return None;
        }
        self.positive.clear();
        self.positive.resize(self.plan.count, 0);
        for (pivot, &island) in self.plan.ldl.pivots().iter().zip(&self.plan.islands) {
            self.positive[island] += usize::from(*pivot > 0.0);
        }
        Some(())
    }

    /// Takes the ranks that are held, or else the numbers of rows, as those that are expected; tells whether all are held.
    fn expect(&mut self, blocks: &Blocks) -> bool {
        self.expected.clear();
        self.expected.resize(self.plan.count, 0);
        let mut known = true;
        for block in 0..blocks.len() {
            let Some(&row) = blocks.of(block).first() else { continue };
            let most = blocks.held_rank(block);
            known &= most.is_some();
            self.expected[self.plan.island_of_row[row]] += most.unwrap_or(blocks.of(block).len());
        }
        known
    }

    /// The rank of A where nothing near the cut leaves it open; the factor is that of τ above it then.
    fn find_rank(&mut self, problem: &mut Problem<'_>) -> Option<usize> {
        let blocks = &mut *problem.blocks;
        let cut = blocks.cut(self.rank_cut);
        let known = self.expect(blocks);
        if blocks.is_undecided()
            && (blocks.len() != self.islands_with_rows() || blocks.explained_of_all(cut).1 > cut)
        {
            return None;
        }
        self.count(CLEAR * cut)?;
        let total = self.positive.iter().sum();
        if self.positive == self.expected {
            self.hold(blocks);
            return Some(total);
        }
        // Less than what is held is a singular pose, which its eigenvalues decide; of rows whose rank nobody holds
        // what is left may be clearly nothing.
        if known {
            return None;
        }
        self.expected.copy_from_slice(&self.positive);
        let same = self.count(cut / CLEAR).is_some() && self.positive == self.expected;
        if !same || self.count(CLEAR * cut).is_none() {
            return None;
        }
        self.hold(blocks);
        Some(total)
    }

    fn islands_with_rows(&self) -> usize {
        self.scales.iter().filter(|scale| **scale > 0.0).count()
    }

    /// Holds ranks that nobody has decided: blocks are islands there.
    fn hold(&self, blocks: &mut Blocks) {
        if blocks.is_undecided() {
            for block in 0..blocks.len() {
                let island = self.plan.island_of_row[blocks.of(block)[0]];
                blocks.hold_rank(block, self.positive[island]);
            }
        }
    }

    /// x = A⁺ b by refinement from 0; `open`: redundant rows stand open.
    fn refine(&mut self, rhs: &[f64], x: &mut [f64], open: bool) -> Option<Info> {
        let size = norm(rhs);
        for vector in [&mut *x, &mut self.acceleration, &mut self.push, &mut self.pull] {
            vector.fill(0.0);
        }
        if size == 0.0 {
            return Some(Info::trivial(0.0));
        }
        self.residual.copy_from_slice(&self.target);
        let (mut first, mut before, mut left_before, mut smaller) = (0.0, f64::INFINITY, size, false);
        for step in 0..STEPS {
            let correction = self.correct(x);
            if open && step == 0 {
                self.drop_again(x);
            }
            let Self { target, residual, image, push, pull, .. } = self;
            for ((entry, wanted), image) in residual.iter_mut().zip(&*target).zip(&*image) {
                *entry = wanted - image;
            }
            let mut left = norm(residual);
            let mut balanced = distance(pull, push) <= BALANCED * norm(push);
            // The first δ has rounding in it along motions that rows admit, which the second one takes out.
            if !balanced && step > 0 && left <= CLOSED * size {
                balanced = self.follow(x) <= BALANCED;
            }
            if balanced && left <= CLOSED * size {
                return Some(self.figures(rhs, left / size));
            }
            if step == 0 {
                first = correction;
            }
            let ratio = correction / before;
            let done = step > 0 && correction * ratio <= REFINED * first;
            let stuck = step > 0 && (ratio >= SLOW || ratio.is_nan());
            if balanced && (done || (stuck && correction <= ROUNDING * first)) {
                left = self.leave_out(SQUARES);
                return Some(self.figures(rhs, left / size));
            }
            if (stuck && correction > ROUNDING * first) || !left.is_finite() {
                return None;
            }
            if step > 0 && ratio > SLUGGISH && !smaller {
                smaller = true;
                self.expected.copy_from_slice(&self.positive);
                if self.count(SMALLER * self.part).is_none() || self.positive != self.expected {
                    return None;
                }
            }
            // What no x can reach stands beside what is left, and its rounding is 1/τ times as large in an acceleration.
            if left >= SLOW * left_before {
                left = self.leave_out(SQUARES);
            }
            (before, left_before) = (correction, left);
        }
        None
    }

    /// One refinement of δ and x, with `image` = J δ after it; gives how far δ has gone, in the norm of M.
    fn correct(&mut self, x: &mut [f64]) -> f64 {
        let Self { plan, shifts, residual, image, force, motion, acceleration, push, pull, .. } = self;
        plan.transposed_times(residual, force);
        for ((force, shift), (pull, push)) in force.iter_mut().zip(&*shifts).zip(pull.iter().zip(&*push)) {
            *force -= shift * (pull - push);
        }
        plan.ldl.solve(force);
        for (entry, change) in acceleration.iter_mut().zip(&*force) {
            *entry += change;
        }
        plan.mass_times(acceleration, motion);
        let moved =
            force.iter().zip(motion.iter().zip(&*push)).map(|(change, (new, old))| change * (new - old));
        let correction = moved.sum::<f64>().max(0.0).sqrt();
        push.copy_from_slice(motion);
        for (entry, pull) in motion.iter_mut().zip(&*pull) {
            *entry -= pull;
        }
        plan.ldl.solve(motion);
        plan.add_and_transpose(motion, x, pull);
        plan.times(acceleration, image);
        correction
    }

    /// One refinement of x alone, where δ is as good as it gets; gives the difference between Jᵀ x and M δ, relative to them.
    fn follow(&mut self, x: &mut [f64]) -> f64 {
        let Self { plan, motion, push, pull, .. } = self;
        for (entry, (push, pull)) in motion.iter_mut().zip(push.iter().zip(&*pull)) {
            *entry = push - pull;
        }
        plan.ldl.solve(motion);
        plan.add_and_transpose(motion, x, pull);
        distance(pull, push) / norm(push)
    }

    /// Takes what no x can reach out of b and of the residual; gives the norm of the rest.
    ///
    /// F = J P⁻¹ Jᵀ is 1 + τ/σ where an eigenvalue counts, and −σ/τ of one that does not.
    fn leave_out(&mut self, filter: Filter) -> f64 {
        let Self { plan, target, residual, image, reached, force, .. } = self;
        image.copy_from_slice(residual);
        reached.fill(0.0);
        let coefficients = filter.coefficients();
        for power in 1..filter.dropped + filter.kept {
            plan.transposed_times(image, force);
            plan.ldl.solve(force);
            plan.times(force, image);
            if power >= filter.dropped {
                axpy(coefficients[power - filter.dropped], image, reached);
            }
        }
        for ((wanted, residual), reached) in target.iter_mut().zip(&mut *residual).zip(&*reached) {
            *wanted -= *residual - reached;
            *residual = *reached;
        }
        norm(residual)
    }

    /// The rank of A where it is that which is held, of rows that stand open; the factor is that of τ between what counts and what
    /// is dropped.
    fn find_rank_between(&mut self, blocks: &Blocks) -> Option<usize> {
        if !self.expect(blocks) {
            return None;
        }
        let open = blocks.widest_gap();
        // Beyond what open rows explain a rank rises.
        let (least, most) = (CLEAR * self.rank_cut, CLEAR * blocks.explained_of_all(self.rank_cut).0);
        let before = self.gap.take();
        if let Some(mut gap) = before
            && gap.age < GAP_AGE
            && gap.widen(open, least, most)
            && self.counts(gap.part)
        {
            gap.age += 1;
            self.gap = Some(gap);
            return Some(self.positive.iter().sum());
        }
        let unreached = before.map_or(UNREACHED, |gap| gap.unreached);
        if !self.counts(least) {
            return None;
        }
        let (mut lower, mut upper) = (self.part, self.part);
        while upper * STRIDE <= MOST_PART && self.counts(upper * STRIDE) {
            upper *= STRIDE;
        }
        while lower > LEAST && self.counts(lower / STRIDE) {
            lower = self.part;
        }
        let (part, filter) = (self.part, Filter { kept: 1, dropped: 1 });
        let mut gap = Gap { lower, upper, open, unreached, reckoned: 0.0, age: 0, part, filter };
        gap.place(least, most)?;
        self.gap = Some(gap);
        self.counts(gap.part).then(|| self.positive.iter().sum())
    }

    /// Whether as many eigenvalues as are expected exceed a part of the largest.
    fn counts(&mut self, part: f64) -> bool {
        self.count(part).is_some() && self.positive == self.expected
    }

    /// x = A⁺ b of rows that stand open, with the rank that is held.
    fn solve_open(&mut self, problem: &Problem<'_>, x: &mut [f64]) -> Option<Info> {
        let rank = self.find_rank_between(problem.blocks)?;
        self.target.copy_from_slice(problem.rhs);
        self.leave_out_beforehand(problem.rhs)?;
        let info = self.refine(problem.rhs, x, true)?;
        Some(Info { rank: Some(rank), ..info })
    }

    /// Takes what no x can reach out of b, until next to nothing of x comes of what is left of it.
    fn leave_out_beforehand(&mut self, rhs: &[f64]) -> Option<()> {
        let mut gap = self.gap?;
        let mut comes_back = f64::INFINITY;
        for time in 1..=FILTERS {
            self.residual.copy_from_slice(&self.target);
            let reached = self.leave_out(gap.filter);
            gap.unreached = distance(rhs, &self.target) / reached;
            comes_back = gap.comes_back(time);
            if comes_back <= NEGLIGIBLE {
                break;
            }
        }
        self.gap = Some(gap);
        (comes_back <= NEGLIGIBLE).then_some(())
    }

    /// x ← F x, as often as rounding makes it necessary; later corrections put right what this changes of what counts.
    fn drop_again(&mut self, x: &mut [f64]) {
        let Self { plan, pull, force, gap, .. } = self;
        for _ in 0..gap.map_or(1, Gap::drops) {
            plan.ldl.solve(pull);
            x.fill(0.0);
            plan.add_and_transpose(pull, x, force);
            std::mem::swap(pull, force);
        }
    }

    fn figures(&self, rhs: &[f64], residual_rel: f64) -> Info {
        Info { residual_rel, inconsistency: Some(distance(rhs, &self.target)), ..Info::trivial(0.0) }
    }
}

/// Whether redundant ones among so many rows stand open by more than what is rounding.
pub(crate) fn is_open(blocks: &Blocks, rows: usize) -> bool {
    blocks.ceiling() < rows && blocks.widest_gap() > CLOSED_ROWS
}

fn distance(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
}
