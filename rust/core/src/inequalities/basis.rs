//! The frame of one block of equality rows, in which exact rows fix coordinates and soft rows are part of the metric.
//!
//! With W of the block (its velocities × its rows, whitened) = Q R, the acceleration is y = Q (η, ζ):
//!
//! ```text
//!     exact rows:   η is fixed by Rᵀ η = b in the least-squares sense, ζ is free, and ½‖y‖² = ½‖η‖² + ½‖ζ‖²
//!     soft rows:    ½‖η‖² + ½(Rᵀη − b)ᵀ D (Rᵀη − b) = ½‖T(η − η*)‖² + a constant,  TᵀT = E + R D Rᵀ
//! ```
//!
//! So a row w is (Qᵀw) with its fixed part taken into an offset, or multiplied by T⁻ᵀ, and nothing else of the equality rows is left.
//! T and η* come from one orthogonal factorisation of (√D Rᵀ; E) with heavy rows first, which does not form products whose sums
//! would lose the light ones (Powell and Reid 1969).

use crate::linalg::kernels::{dot_in_lanes, norm, widest};
use crate::linalg::packs::{self, LANES, Pack, packs_of};
use crate::linalg::reflections::{orthogonalise, reflector_of, solve_upper, triangularise};
use crate::problem::FOLD_TOLERANCE;
use crate::solvers::RANK_CUT;
use crate::system::Parts;

/// What is left of columns after this many rounding errors of the largest is nothing.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Squares of columns are summed anew where they have fallen to this part of their last sum: rounding is 1e-10 of them then.
const SURE: f64 = 1e-6;

/// The rank is clear where the smallest pivot kept is this many times the cut; see `auto`.
const CLEAR: f64 = 32.0;

/// Constraints of a block whose sizes differ by more are measured each in its own unit, as eigenvalues are.
const GRADED: f64 = 100.0;

/// A soft row that is stiffer than this against its own inertia is taken as this stiff: R is lost in A + R below ε A.
const STIFFEST: f64 = f64::EPSILON * f64::EPSILON;

/// The frame of one block and its workspace, which grows and never shrinks.
#[derive(Debug, Clone, Default)]
pub(super) struct Basis {
    /// Velocities of the block, in rising order.
    pub(super) velocities: Vec<usize>,
    /// η*, in the units of y.
    fixed: Vec<f64>,
    /// Columns of W, up to whole packs, which come to have R above the diagonal.
    factor: Vec<Pack>,
    /// Columns as long, with zeros above the diagonal.
    reflectors: Vec<Pack>,
    diagonal: Vec<f64>,
    /// Products of the first reflector with the second, of the third with the fourth …
    between: Vec<f64>,
    order: Vec<usize>,
    /// See [`pivoted`].
    left: Vec<f64>,
    known: Vec<f64>,
    /// Uᵀ of the left singular vectors of R, row by row, longest first; empty where the first rows of R are those that count.
    turns: Vec<f64>,
    /// Rows of R, turned.
    rows: Vec<f64>,
    /// Number of coordinates that exact rows fix.
    rank: usize,
    soft: bool,
    /// T and its diagonal; rows of it.
    metric: Vec<f64>,
    metric_diagonal: Vec<f64>,
    metric_rows: usize,
    sizes: Vec<f64>,
    values: Vec<f64>,
    weights: Vec<f64>,
    work: Vec<f64>,
    sorted: Vec<usize>,
    turned: Vec<Pack>,
}

impl Basis {
    /// Number of coordinates that are left.
    pub(super) fn free(&self) -> usize {
        self.velocities.len() - self.rank
    }

    /// Finds the frame of a block, which `owners` has of every velocity; `squares` are the diagonal of Wᵀ W.
    pub(super) fn find(&mut self, parts: Parts<'_>, owners: &[usize], block: usize, squares: &[f64]) {
        let (nv, given) = (parts.nv, parts.blocks.of(block));
        self.velocities.clear();
        self.velocities.extend((0..nv).filter(|&velocity| owners[velocity] == block));
        self.soft = parts.softness.is_some();
        self.rank = 0;
        self.scale(parts, given, squares);
        let height = self.velocities.len();
        let stride = LANES * packs_of(height);
        self.factor.clear();
        self.factor.resize(packs_of(height) * given.len(), packs::NONE);
        let own = self.factor.as_flattened_mut().chunks_exact_mut(stride.max(1));
        for (own, (&row, &size)) in own.zip(given.iter().zip(&self.sizes)) {
            let column = &parts.whitened[row * nv..(row + 1) * nv];
            if height == nv {
                own.iter_mut().zip(column).for_each(|(entry, whitened)| *entry = whitened * size);
                continue;
            }
            for (entry, &velocity) in own.iter_mut().zip(&self.velocities) {
                *entry = column[velocity] * size;
            }
        }
        self.left.clear();
        self.left.extend(given.iter().zip(&self.sizes).map(|(&row, size)| squares[row] * size * size));
        let trace = self.left.iter().sum();
        self.order.clear();
        self.order.extend(0..given.len());
        self.triangularise(height, trace);
        self.turns.clear();
        if self.soft {
            self.weigh(parts, given, height);
        } else {
            let most = squares.iter().fold(0.0, |most: f64, &square| most.max(square));
            self.decide(parts, (block, most), height, trace);
            self.fix(parts, given, height);
        }
        self.fixed.iter_mut().for_each(|entry| *entry *= parts.unit);
    }

    /// Powers of two that bring constraints of very different size to one; exact rows only.
    fn scale(&mut self, parts: Parts<'_>, rows: &[usize], squares: &[f64]) {
        if !self.soft && parts.blocks.sizes(rows, |row| squares[row], &mut self.sizes) > GRADED {
            let near_inverse_root =
                |size: f64| if size > f64::MIN_POSITIVE { (-0.5 * size.log2()).round().exp2() } else { 1.0 };
            self.sizes.iter_mut().for_each(|size| *size = near_inverse_root(*size));
        } else {
            self.sizes.clear();
            self.sizes.resize(rows.len(), 1.0);
        }
    }

    /// W Π = Q R with the longest of the columns that are left next, until they are rounding.
    fn triangularise(&mut self, height: usize, trace: f64) {
        self.diagonal.clear();
        let least = (ROUNDING * ROUNDING * trace).max(f64::MIN_POSITIVE);
        self.known.clear();
        self.known.extend_from_slice(&self.left);
        let stride = packs_of(height);
        self.reflectors.resize(stride * height.min(self.order.len()), packs::NONE);
        self.between.clear();
        let Self { factor, reflectors, order, diagonal, left, known, between, .. } = self;
        widest(
            #[inline(always)]
            || {
                pivoted((height, least), factor, reflectors, order, diagonal, (&mut *left, &mut *known));
                for pair in reflectors[..diagonal.len() * stride].chunks_exact(2 * stride) {
                    let (one, other) = pair.split_at(stride);
                    between.push(packs::product(one, other));
                }
            },
        );
    }

    /// An entry of R, in the units of the rows.
    fn entry(&self, height: usize, row: usize, col: usize) -> f64 {
        let entry = match row.cmp(&col) {
            std::cmp::Ordering::Less => self.above(height, col)[row],
            std::cmp::Ordering::Equal => self.diagonal[row],
            std::cmp::Ordering::Greater => 0.0,
        };
        entry / self.sizes[self.order[col]]
    }

    /// Entries of R above the diagonal.
    fn above(&self, height: usize, col: usize) -> &[f64] {
        &self.factor[self.order[col] * packs_of(height)..].as_flattened()[..col.min(height)]
    }

    /// How many coordinates are fixed, and which.
    fn decide(&mut self, parts: Parts<'_>, (block, most): (usize, f64), height: usize, trace: f64) {
        let (found, count) = (self.diagonal.len(), self.order.len());
        let unit = self.sizes.iter().fold(f64::INFINITY, |unit, size| unit.min(size * size));
        // What was left after the last pivot is rounding.
        if let Some(last) = self.diagonal.last()
            && last * last > CLEAR * RANK_CUT * trace
            && trace > FOLD_TOLERANCE * most * unit
            && !parts.blocks.holds_less(block, found)
        {
            self.rank = found;
            return;
        }
        // Eigenvalues decide as they do in the solvers: of the rows each in its unit, and what they span of the rows as they are.
        // A size of 1 is exact, and so is any other power of two.
        let graded = self.sizes.iter().any(|&size| (size - 1.0).abs() > 0.0);
        self.values.clear();
        self.turn(height, true);
        for row in self.rows.chunks_exact(count.max(1)).take(found) {
            self.values.push(dot_in_lanes(row, row));
        }
        self.values.resize(count, 0.0);
        let rank = parts.blocks.rank(block, &self.values, RANK_CUT, most * unit);
        self.rank = rank.min(found);
        if graded {
            self.turn(height, false);
        }
        self.sort(count);
    }

    /// Turns the rows of R, scaled or not, until they are orthogonal.
    fn turn(&mut self, height: usize, scaled: bool) {
        let (found, count) = (self.diagonal.len(), self.order.len());
        self.rows.clear();
        for row in 0..found {
            for col in 0..count {
                let size = if scaled { self.sizes[self.order[col]] } else { 1.0 };
                self.rows.push(self.entry(height, row, col) * size);
            }
        }
        self.turns.clear();
        self.turns.resize(found * found, 0.0);
        (0..found).for_each(|i| self.turns[i * found + i] = 1.0);
        orthogonalise(found, count, &mut self.rows, &mut self.turns);
    }

    /// Puts the longest rows first.
    fn sort(&mut self, count: usize) {
        let found = self.diagonal.len();
        for place in 0..found {
            let length = |row: usize| {
                let row = &self.rows[row * count..(row + 1) * count];
                dot_in_lanes(row, row)
            };
            let longest =
                (place..found).fold(place, |best, row| if length(row) > length(best) { row } else { best });
            if longest != place {
                (0..count).for_each(|col| self.rows.swap(place * count + col, longest * count + col));
                (0..found).for_each(|col| self.turns.swap(place * found + col, longest * found + col));
            }
        }
    }

    /// η* of exact rows: Rᵀ η = b in the least-squares sense.
    fn fix(&mut self, parts: Parts<'_>, given: &[usize], height: usize) {
        let (rank, count) = (self.rank, given.len());
        self.fixed.clear();
        self.work.clear();
        self.work.extend(self.order.iter().map(|&index| parts.rhs[given[index]]));
        if rank == count && self.turns.is_empty() {
            // As many as rows: forward substitution with Rᵀ.
            // In units of its size each, which is exact: both are multiplied by a power of two.
            for row in 0..rank {
                let own = self.above(height, row);
                let wanted = self.work[row] * self.sizes[self.order[row]];
                self.fixed.push((wanted - dot_in_lanes(own, &self.fixed)) / self.diagonal[row]);
            }
            return;
        }
        self.metric.clear();
        for row in 0..rank {
            for col in 0..count {
                let entry = if self.turns.is_empty() {
                    self.entry(height, row, col)
                } else {
                    self.rows[row * count + col]
                };
                self.metric.push(entry);
            }
        }
        triangularise(count, &mut self.metric, &mut self.metric_diagonal, &mut self.work);
        solve_upper(count, &self.metric, &self.metric_diagonal, &mut self.work);
        self.fixed.extend_from_slice(&self.work[..rank]);
    }

    /// T and η* of soft rows.
    fn weigh(&mut self, parts: Parts<'_>, given: &[usize], height: usize) {
        let (found, count) = (self.diagonal.len(), given.len());
        let Some(softness) = parts.softness else { return };
        self.weights.clear();
        for (col, &index) in self.order.iter().enumerate() {
            let row = given[index];
            let square: f64 = (0..found).map(|k| self.entry(height, k, col).powi(2)).sum();
            let floor = (STIFFEST * square).max(f64::MIN_POSITIVE);
            self.weights.push(softness[row].max(floor).sqrt().recip());
        }
        self.sorted.clear();
        self.sorted.extend(0..count);
        // Pivots come in falling order already: only weights are left to sort by.
        self.sorted.sort_unstable_by(|&a, &b| self.weights[b].total_cmp(&self.weights[a]).then(a.cmp(&b)));
        self.metric_rows = count + found;
        self.metric.clear();
        for k in 0..found {
            for &col in &self.sorted {
                self.metric.push(self.weights[col] * self.entry(height, k, col));
            }
            self.metric.extend((0..found).map(|other| f64::from(u8::from(other == k))));
        }
        self.work.clear();
        for &col in &self.sorted {
            self.work.push(self.weights[col] * parts.rhs[given[self.order[col]]]);
        }
        self.work.resize(count + found, 0.0);
        let rows = self.metric_rows;
        triangularise(rows, &mut self.metric, &mut self.metric_diagonal, &mut self.work);
        solve_upper(rows, &self.metric, &self.metric_diagonal, &mut self.work);
        self.fixed.clear();
        self.fixed.extend_from_slice(&self.work[..found]);
    }

    /// Brings vectors of the block's velocities into the frame, Qᵀ w; their first coordinates are η's.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn turn_into<const N: usize>(&mut self, w: &mut [[Pack; N]]) {
        let (stride, found) = (LANES * packs_of(w.len()), self.diagonal.len());
        let reflectors = self.reflectors.as_flattened();
        for (&between, col) in self.between.iter().zip((0..found).step_by(2)) {
            let (one, other) = reflectors[col * stride..(col + 2) * stride].split_at(stride);
            packs::reflect_twice(&one[col..], &other[col..], between, &mut w[col..]);
        }
        if !found.is_multiple_of(2) {
            let col = found - 1;
            packs::reflect(&reflectors[col * stride + col..(col + 1) * stride], &mut w[col..]);
        }
        if !self.turns.is_empty() {
            self.turned.clear();
            self.turned.extend_from_slice(w[..found].as_flattened());
            let turned = self.turned.as_chunks().0;
            for (entry, turn) in w.iter_mut().zip(self.turns.chunks_exact(found)) {
                *entry = packs::dots(turned, turn);
            }
        }
    }

    /// Brings rows into the frame, `w` (the block's velocities), whose last entries are those of the coordinates that are left; gives
    /// their offsets w · y*.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(super) fn take_rows<const N: usize>(&mut self, w: &mut [[Pack; N]]) -> [Pack; N] {
        self.turn_into(w);
        let offsets = packs::dots(&w[..self.fixed.len()], &self.fixed);
        if self.soft {
            // T⁻ᵀ
            let rows = self.metric_rows;
            for (col, diagonal) in self.metric_diagonal.iter().enumerate() {
                let part = packs::dots(&w[..col], &self.metric[col * rows..col * rows + col]);
                for (w, part) in w[col].iter_mut().zip(&part) {
                    w.iter_mut().zip(part).for_each(|(w, part)| *w = (*w - part) / diagonal);
                }
            }
        }
        offsets
    }

    /// ‖y*‖.
    pub(super) fn size(&self) -> f64 {
        norm(&self.fixed)
    }
}

/// Reflects columns of `height` entries, the longest of those that are left next, until the square of its length is below `least`.
/// Squares of what is left of them are taken down by each entry of R, and summed anew where that would leave them rounding: those
/// left, and those that were summed last.
#[allow(clippy::inline_always)]
#[inline(always)]
fn pivoted(
    (height, least): (usize, f64),
    factor: &mut [Pack],
    reflectors: &mut [Pack],
    order: &mut [usize],
    diagonal: &mut Vec<f64>,
    (left, known): (&mut [f64], &mut [f64]),
) {
    let (count, stride) = (order.len(), packs_of(height));
    for step in 0..height.min(count) {
        let longer =
            |best: usize, place: usize| if left[order[place]] > left[order[best]] { place } else { best };
        let longest = (step..count).fold(step, longer);
        let most = left[order[longest]];
        if most <= least || most.is_nan() {
            break;
        }
        order.swap(step, longest);
        let own = &factor[order[step] * stride..][..stride];
        // Whole packs: zeros above the diagonal cost less than loops of other lengths.
        let (from, lane) = (step / LANES, step % LANES);
        let v = &mut reflectors[step * stride..(step + 1) * stride];
        v[..from].fill(packs::NONE);
        v[from..].copy_from_slice(&own[from..]);
        v[from][..lane].fill(0.0);
        let v = &mut v[from..];
        diagonal.push(reflector_of(v, lane));
        for &col in &order[step + 1..] {
            let other = &mut factor[col * stride + from..(col + 1) * stride];
            let (left, known) = (&mut left[col], &mut known[col]);
            packs::add_multiple(-packs::product(v, other), v, other);
            let entry = other[0][lane];
            *left -= entry * entry;
            if *left <= SURE * *known {
                let below = &other.as_flattened()[lane + 1..];
                *left = dot_in_lanes(below, below);
                *known = *left;
            }
        }
    }
}
