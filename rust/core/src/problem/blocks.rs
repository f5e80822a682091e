//! Blocks of rows that A does not couple, and the rank that each of them holds.
//!
//! **A cut per block.** Loops that share no velocity make A block diagonal. A rank that is cut against the largest eigenvalue
//! of all of A drops the rows of a slow, heavy loop beside a lead screw as redundant: their eigenvalues are 1e-11 of its. So
//! every block is cut against its own largest eigenvalue.
//!
//! **A rank that is held.** A loop that stands open by a relative gap δ gives its redundant rows eigenvalues of about δ²: no
//! number tells them from the eigenvalues of rows that count. A caller who walks along a path therefore says at each
//! step how far the rows are from closed. The rank of the first step, which is to be closed, is then held from above: an
//! eigenvalue beyond it counts only once it exceeds what the gap explains ([`DRIFT`]), which is an event. Below it the
//! cut decides as ever, for a mechanism that passes through a singular pose does lose rank.

use crate::linalg::forest::{join, root};
use crate::linalg::kernels::largest;
use crate::problem::fold::FOLD_TOLERANCE;

/// An eigenvalue of a redundant row, relative to the largest of its block, is explained by rows that stand open by a part δ of
/// the lengths that they turn on up to (DRIFT δ)². A row tilts by about that part; the links between are up to some ten times
/// shorter than the longest, and several rows add up.
pub const DRIFT: f64 = 100.0;

/// What a gap explains at most where a rank is decided for the first time, at a start that is closed as far as its rows allow:
/// rows that contradict one another stay open, and count all the same.
const AT_START: f64 = 1e-6;

/// Rows that stand open by no more explain an eigenvalue of 1e-16 at most, which is rounding: whose they are does not matter.
const CLOSED: f64 = 1e-10;

/// Blocks of rows of one system, and their ranks.
#[derive(Debug, Clone, Default)]
pub struct Blocks {
    /// Rows of each block in rising order, one block after another.
    rows: Vec<usize>,
    /// One past the last row of each block, in `rows`.
    ends: Vec<usize>,
    /// Where W has entries.
    pattern: Vec<bool>,
    /// Block of each velocity that a row touches.
    owners: Vec<Option<usize>>,
    /// Block of each row before folding; none of a zero row.
    unfolded: Vec<Option<usize>>,
    /// Rank that is held of each block, once it was decided.
    held: Vec<Option<usize>>,
    /// The last two as they were before the blocks were found, and where each of the earlier blocks has gone.
    before: (Vec<Option<usize>>, Vec<Option<usize>>),
    homes: Vec<Home>,
    /// The forest of sets of rows, and the first row that touches each velocity.
    parents: Vec<usize>,
    touching: Vec<Option<usize>>,
    /// Constraint that each row belongs to, where that is known; a row after folding and its constraint.
    constraints: Vec<usize>,
    /// Whether ranks are held.
    holding: bool,
    /// How far the rows of each block stand open, relative to the lengths that they turn on.
    gaps: Vec<f64>,
    /// Whether a held rank rose since the last [`step`](Self::step).
    risen: bool,
}

impl Blocks {
    /// Returns one block of `n` rows that holds nothing.
    #[must_use]
    pub fn whole(n: usize) -> Self {
        Self {
            rows: (0..n).collect(),
            ends: vec![n],
            unfolded: vec![Some(0); n],
            held: vec![None],
            ..Self::default()
        }
    }

    /// Begins a step whose rows before folding stand open by `gaps`, relative to the lengths that they turn on; without any
    /// nothing is held.
    pub(crate) fn step(&mut self, gaps: &[f64]) {
        self.holding = !gaps.is_empty() && gaps.len() == self.unfolded.len();
        self.risen = false;
        self.gaps.clear();
        self.gaps.resize(self.ends.len(), 0.0);
        let most = gaps.iter().fold(0.0, |most, &gap| if gap <= most { most } else { gap });
        if self.holding && (most <= CLOSED || self.len() == 1) {
            self.gaps.fill(most);
        } else if self.holding {
            for (&gap, block) in gaps.iter().zip(&self.unfolded) {
                if let Some(block) = *block {
                    // A NaN explains everything.
                    self.gaps[block] = if gap <= self.gaps[block] { self.gaps[block] } else { gap };
                }
            }
        }
    }

    /// Asks for the blocks to be found anew; what is held stays with its rows.
    pub(crate) fn invalidate(&mut self) {
        self.pattern.clear();
        self.owners.clear();
    }

    /// Whether blocks were found of rows that touch some of `nv` velocities, and nobody asked for new ones.
    pub(crate) fn are_found(&self, nv: usize) -> bool {
        self.owners.len() == nv
    }

    /// Returns the number of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Tells whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the rows of a block, in rising order.
    #[must_use]
    pub fn of(&self, block: usize) -> &[usize] {
        let first = if block == 0 { 0 } else { self.ends[block - 1] };
        &self.rows[first..self.ends[block]]
    }

    /// Returns the block that touches a velocity; none of a system that was given as dense (A, b).
    #[must_use]
    pub fn owner(&self, velocity: usize) -> Option<usize> {
        self.owners.get(velocity).copied().flatten()
    }

    /// Returns the largest number of rows that a block has.
    #[must_use]
    pub fn largest(&self) -> usize {
        (0..self.len()).map(|block| self.of(block).len()).max().unwrap_or(0)
    }

    /// Returns the highest rank that A may have by what is held: n where nothing is.
    #[must_use]
    pub fn ceiling(&self) -> usize {
        let most = |block: usize| match self.held[block] {
            Some(rank) if self.holding => rank,
            _ => self.of(block).len(),
        };
        (0..self.len()).map(most).sum()
    }

    /// Tells whether a rank is to be held that nobody has decided yet.
    #[must_use]
    pub fn is_undecided(&self) -> bool {
        self.holding && self.held.iter().any(Option::is_none)
    }

    /// Tells whether the rank of a block is held already: then the cut decides of what is kept only, and not of what is
    /// dropped.
    #[must_use]
    pub fn holds(&self, block: usize) -> bool {
        self.holding && self.held[block].is_some()
    }

    /// Returns the rank that a block holds, if ranks are held and its own is decided.
    #[must_use]
    pub fn held_rank(&self, block: usize) -> Option<usize> {
        if self.holding { self.held[block] } else { None }
    }

    /// Whether a block is to hold less than a rank, or nobody has decided how much.
    pub(crate) fn holds_less(&self, block: usize, rank: usize) -> bool {
        self.holding && self.held[block].is_none_or(|held| held < rank)
    }

    /// Tells whether a held rank rose in this step.
    #[must_use]
    pub const fn has_risen(&self) -> bool {
        self.risen
    }

    /// Returns the part of the largest eigenvalue of a block up to which one counts as zero where its row is held to be redundant.
    #[must_use]
    pub fn explained(&self, block: usize, rank_cut: f64) -> f64 {
        let explained = self.gaps.get(block).map_or(0.0, |gap| (DRIFT * gap).powi(2));
        if explained.is_nan() { f64::INFINITY } else { rank_cut.max(explained) }
    }

    /// Returns how far the rows stand open at most, relative to the lengths that they turn on; 0 where that is not known.
    #[must_use]
    pub fn widest_gap(&self) -> f64 {
        self.gaps.iter().fold(0.0, |most, &gap| if gap <= most { most } else { gap })
    }

    /// Returns the least and the most of that over all blocks.
    #[must_use]
    pub fn explained_of_all(&self, rank_cut: f64) -> (f64, f64) {
        let all = (0..self.len()).map(|block| self.explained(block, rank_cut));
        all.fold((f64::INFINITY, rank_cut), |(least, most), part| (least.min(part), most.max(part)))
    }

    /// Tells which constraint every row after folding belongs to.
    pub(crate) fn set_constraints(&mut self, constraints: impl Iterator<Item = usize>) {
        self.constraints.clear();
        self.constraints.extend(constraints);
    }

    /// Writes the size of the constraint that each of some `rows` belongs to, its largest entry of the diagonal of A, into `sizes`; gives
    /// the ratio of the largest to the smallest, 1 where constraints are not known.
    pub(crate) fn sizes(&self, rows: &[usize], diagonal: impl Fn(usize) -> f64, sizes: &mut Vec<f64>) -> f64 {
        sizes.clear();
        if self.constraints.is_empty() {
            return 1.0;
        }
        let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
        let mut last = None;
        for &row in rows {
            // Rows of one constraint follow one another, and few are so many that looking for them costs.
            let own = self.constraints[row];
            let size = match last {
                Some((constraint, size)) if constraint == own => size,
                _ => {
                    let same = rows.iter().filter(|&&other| self.constraints[other] == own);
                    same.fold(0.0_f64, |size, &other| size.max(diagonal(other)))
                }
            };
            last = Some((own, size));
            sizes.push(size);
            if size > f64::MIN_POSITIVE {
                (least, most) = (least.min(size), most.max(size));
            }
        }
        if most > 0.0 { most / least } else { 1.0 }
    }

    /// Returns the part of the largest eigenvalue below which one counts as zero for who decides by numbers alone: more than the cut
    /// only where a rank is to be held and nobody has decided it.
    #[must_use]
    pub fn cut(&self, rank_cut: f64) -> f64 {
        let at_start = AT_START.max(rank_cut);
        if self.is_undecided() { self.explained_of_all(rank_cut).1.min(at_start) } else { rank_cut }
    }

    /// Decides the rank of a block from all its eigenvalues, in any order. `most` is the largest entry of all of A: a block that
    /// is no more than the square of what counts as a zero row beside it is rounding. Rows come apart by an exact zero
    /// where a mechanism passes through a singular pose, too.
    pub fn decide(&mut self, block: usize, values: &[f64], rank_cut: f64, most: f64) -> usize {
        let rank = self.rank(block, values, rank_cut, most);
        if self.holding {
            let held = self.held[block];
            if held.is_none_or(|held| rank > held) {
                self.risen |= held.is_some();
                self.held[block] = Some(rank);
            }
        }
        rank
    }

    /// Holds a rank that nobody has decided and that was found without eigenvalues.
    pub(crate) fn hold_rank(&mut self, block: usize, rank: usize) {
        if self.holding && self.held[block].is_none() {
            self.held[block] = Some(rank);
        }
    }

    /// The rank that [`decide`](Self::decide) would decide, without holding it.
    #[must_use]
    pub fn rank(&self, block: usize, values: &[f64], rank_cut: f64, most: f64) -> usize {
        let scale = largest(values);
        let nothing = (FOLD_TOLERANCE * FOLD_TOLERANCE * most).max(f64::MIN_POSITIVE);
        let above = |part: f64| {
            let cut = (part * scale).max(nothing);
            values.iter().filter(|&&value| value > cut).count()
        };
        let rank = above(rank_cut);
        if !self.holding {
            return rank;
        }
        match self.held[block] {
            Some(held) if rank <= held => rank,
            held => {
                let explained = self.explained(block, rank_cut);
                let at_start = AT_START.max(rank_cut);
                let standing = above(if held.is_none() { explained.min(at_start) } else { explained });
                standing.max(held.unwrap_or(0))
            }
        }
    }

    /// Whether the blocks are still those of the columns of W (`nv` entries each). Along a path whose rank is held, blocks
    /// that once met stay together, and their rank with them.
    pub(crate) fn hold(&self, columns: &[f64], nv: usize, held: bool) -> bool {
        if self.pattern.len() != columns.len() || self.owners.len() != nv {
            return false;
        }
        if !held {
            return self.pattern.iter().zip(columns).all(|(&present, &entry)| present == (entry != 0.0));
        }
        self.len() == 1
            || (0..self.len()).all(|block| {
                self.of(block).iter().all(|&row| {
                    let column = &columns[row * nv..(row + 1) * nv];
                    column
                        .iter()
                        .zip(&self.owners)
                        .all(|(&entry, &owner)| entry == 0.0 || owner == Some(block))
                })
            })
    }

    /// Finds the blocks of the columns of W (`nv` entries each); two of them meet where both touch a velocity.
    /// `classes` gives the column of every row before folding. What was held stays with its rows.
    pub(crate) fn find(&mut self, columns: &[f64], nv: usize, classes: impl Iterator<Item = Option<usize>>) {
        let rows = columns.chunks_exact(nv.max(1)).map(|column| {
            column.iter().enumerate().filter(|(_, entry)| **entry != 0.0).map(|(velocity, _)| velocity)
        });
        self.find_touched(rows, nv, classes);
        self.pattern.extend(columns.iter().map(|&entry| entry != 0.0));
    }

    /// The same of rows of W that touch these of `nv` velocities.
    pub(crate) fn find_touched(
        &mut self,
        rows: impl Iterator<Item = impl IntoIterator<Item = usize>>,
        nv: usize,
        classes: impl Iterator<Item = Option<usize>>,
    ) {
        self.parents.clear();
        self.touching.clear();
        self.touching.resize(nv, None);
        for (row, touched) in rows.enumerate() {
            self.parents.push(row);
            for velocity in touched {
                let first = *self.touching[velocity].get_or_insert(row);
                join(&mut self.parents, row, first);
            }
        }
        self.pattern.clear();
        self.take(classes);
        // A root has become the number of its block.
        self.owners.clear();
        self.owners.extend(self.touching.iter().map(|row| row.map(|row| self.parents[row])));
    }

    /// The same of a dense A (`n×n`): two rows meet where its entry is not zero.
    pub(crate) fn find_dense(
        &mut self,
        matrix: &[f64],
        n: usize,
        classes: impl Iterator<Item = Option<usize>>,
    ) {
        self.parents.clear();
        self.parents.extend(0..n);
        for row in 0..n {
            for col in 0..row {
                if matrix[row * n + col] != 0.0 {
                    join(&mut self.parents, row, col);
                }
            }
        }
        self.take(classes);
        self.owners.clear();
    }

    /// Takes the sets of the forest as blocks; leaves the block of every row in its place.
    fn take(&mut self, classes: impl Iterator<Item = Option<usize>>) {
        let n = self.parents.len();
        for row in 0..n {
            self.parents[row] = root(&mut self.parents, row);
        }
        self.rows.clear();
        self.ends.clear();
        for first in 0..n {
            if self.parents[first] == first {
                self.rows.extend((first..n).filter(|&row| self.parents[row] == first));
                self.ends.push(self.rows.len());
            }
        }
        let mut start = 0;
        for (block, &end) in self.ends.iter().enumerate() {
            self.rows[start..end].iter().for_each(|&row| self.parents[row] = block);
            start = end;
        }
        std::mem::swap(&mut self.unfolded, &mut self.before.0);
        std::mem::swap(&mut self.held, &mut self.before.1);
        self.unfolded.clear();
        self.unfolded.extend(classes.map(|class| class.map(|class| self.parents[class])));
        self.inherit();
    }

    /// Holds of each block the sum of what was held of the blocks that it is made of, if it is made of whole ones.
    fn inherit(&mut self) {
        let (unfolded, held) = (&self.before.0, &self.before.1);
        self.homes.clear();
        self.homes.resize(held.len(), Home::Nowhere);
        for (&earlier, &now) in unfolded.iter().zip(&self.unfolded) {
            if let Some(earlier) = earlier {
                self.homes[earlier] = match (&self.homes[earlier], now) {
                    (Home::Nowhere, Some(block)) => Home::Block(block),
                    (Home::Block(home), Some(block)) if *home == block => Home::Block(block),
                    _ => Home::Several,
                };
            }
        }
        self.held.clear();
        self.held.resize(self.ends.len(), (unfolded.len() == self.unfolded.len()).then_some(0));
        for (&earlier, &now) in unfolded.iter().zip(&self.unfolded) {
            let Some(block) = now else { continue };
            // Rows that were zero belonged to no block; what they bring is not held.
            let whole = earlier.is_some_and(|earlier| {
                matches!(self.homes[earlier], Home::Block(_)) && held[earlier].is_some()
            });
            if !whole {
                self.held[block] = None;
            }
        }
        for (home, rank) in self.homes.iter().zip(held) {
            if let (&Home::Block(block), &Some(rank)) = (home, rank) {
                self.held[block] = self.held[block].map(|sum| sum + rank);
            }
        }
    }
}

/// Where the rows of an earlier block are now.
#[derive(Debug, Clone)]
enum Home {
    Nowhere,
    Block(usize),
    Several,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two columns on velocities 0 and 1, one on 2, a fourth one on nothing.
    const COLUMNS: [f64; 12] = [1.0, 2.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0];

    fn found() -> Blocks {
        let mut blocks = Blocks::default();
        blocks.find(&COLUMNS, 3, (0..4).map(Some));
        blocks
    }

    #[test]
    fn rows_that_share_a_velocity_are_a_block_and_stay_one() {
        let blocks = found();
        assert_eq!((blocks.len(), blocks.largest()), (3, 2));
        assert_eq!([blocks.of(0), blocks.of(1), blocks.of(2)], [&[0, 1][..], &[2], &[3]]);
        assert!(blocks.hold(&COLUMNS, 3, true) && blocks.hold(&COLUMNS, 3, false));
        let mut coupled = COLUMNS;
        coupled[7] = 1.0;
        assert!(!blocks.hold(&coupled, 3, true), "the third column now touches the second velocity");
        let mut apart = COLUMNS;
        apart[4] = 0.0;
        assert!(
            blocks.hold(&apart, 3, true) && !blocks.hold(&apart, 3, false),
            "nothing couples the first two"
        );
        let mut other = Blocks::default();
        other.find_dense(&[1.0, 0.0, 2.0, 0.0, 1.0, 0.0, 2.0, 0.0, 5.0], 3, (0..3).map(Some));
        assert_eq!([other.of(0), other.of(1)], [&[0, 2][..], &[1]]);
    }

    #[test]
    fn each_block_is_cut_against_its_own_largest_eigenvalue() {
        let mut blocks = found();
        assert_eq!(blocks.decide(0, &[1e9, 1e-3], 1e-10, 1e9), 1);
        assert_eq!(blocks.decide(1, &[1e-3], 1e-10, 1e9), 1);
        assert_eq!(blocks.decide(1, &[1e-16], 1e-10, 1e9), 0, "rounding of the others, squared");
        assert_eq!(blocks.decide(2, &[0.0], 1e-10, 1.0), 0);
    }

    #[test]
    fn a_rank_is_held_until_more_stands_than_the_gap_explains() {
        let mut blocks = found();
        blocks.step(&[1e-14; 4]);
        assert!(blocks.is_undecided());
        assert_eq!(blocks.decide(0, &[1.0, 1e-16], 1e-10, 1.0), 1, "the closed start");
        assert_eq!((blocks.decide(1, &[1.0], 1e-10, 1.0), blocks.decide(2, &[0.0], 1e-10, 1.0)), (1, 0));
        assert!(!blocks.is_undecided());
        assert_eq!(blocks.ceiling(), 2);
        blocks.step(&[1e-4, 0.0, 0.0, 0.0]);
        assert_eq!(blocks.decide(0, &[1.0, 1e-8], 1e-10, 1.0), 1, "open by 1e-4");
        assert!(!blocks.has_risen());
        blocks.step(&[1e-14; 4]);
        assert_eq!(blocks.decide(0, &[1.0, 1e-8], 1e-10, 1.0), 2, "closed, and there all the same");
        assert!(blocks.has_risen());
        blocks.step(&[1e-14; 4]);
        assert_eq!(blocks.decide(0, &[1.0, 1e-12], 1e-10, 1.0), 1, "a singular pose");
        assert!(!blocks.has_risen());
        assert_eq!(blocks.decide(0, &[1.0, 1e-8], 1e-10, 1.0), 2);
        assert!(!blocks.has_risen(), "a rank that comes back is no event");
        blocks.step(&[]);
        assert_eq!(blocks.ceiling(), 4);
    }

    #[test]
    fn what_is_held_stays_with_its_rows_when_blocks_meet_and_folds_open() {
        let mut blocks = found();
        blocks.step(&[0.0; 4]);
        let ranks = [blocks.decide(0, &[1.0, 0.0], 1e-10, 1.0), blocks.decide(1, &[1.0], 1e-10, 1.0)];
        assert_eq!((ranks, blocks.decide(2, &[0.0], 1e-10, 1.0)), ([1, 1], 0));
        let mut coupled = COLUMNS;
        coupled[7] = 1.0;
        blocks.find(&coupled, 3, (0..4).map(Some));
        blocks.step(&[0.0; 4]);
        assert_eq!((blocks.len(), blocks.ceiling()), (2, 2));
        // The first two rows had been proportional.
        let mut blocks = Blocks::default();
        blocks.find(&[1.0, 2.0], 2, [Some(0), Some(0)].into_iter());
        blocks.step(&[0.0; 2]);
        assert_eq!(blocks.decide(0, &[5.0], 1e-10, 1.0), 1);
        blocks.find(&[1.0, 2.0, 1.0, 2.0 + 1e-9], 2, [Some(0), Some(1)].into_iter());
        blocks.step(&[1e-9; 2]);
        assert_eq!(blocks.ceiling(), 1);
    }
}
