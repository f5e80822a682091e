//! Rows of a step in coordinates z of what the equality rows leave: x = c + G z, and ½‖z‖² is all that is left of the inertia.
//!
//! Rows are worked on four at once, side by side ([`packs`]).

use super::basis::Basis;
use super::rows::InequalityStep;
use crate::error::{Error, LARGEST, check_size};
use crate::linalg::kernels::{dot_in_lanes, widest};
use crate::linalg::packs::{self, LANES, Pack, add_scaled, packs_of};
use crate::problem::Whiten;
use crate::system::ConstrainedSystem;

/// A row of which exact equality rows leave no more than this part is moved by no admissible motion.
///
/// Rounding of the frame is ε √cond of the block, 1e-11 at the rank cut. A gear or screw that hides a mobility of 1e-9
/// carries 1e-18 of a row's inertia.
pub const IMMOBILE: f64 = 1e-9;

/// Whose a velocity is that no equality row touches.
const NOBODY: usize = usize::MAX;

/// The rows of one step in the frame of its equality rows. What there is of each row has zeros after the last, up to whole packs.
#[derive(Debug, Clone, Default)]
pub(super) struct Frame {
    /// Bases by block; those of this step are `touched`.
    bases: Vec<Basis>,
    touched: Vec<usize>,
    /// Block of each velocity that an equality row touches, else [`NOBODY`].
    owners: Vec<usize>,
    /// Squares of the columns of W of the equality rows.
    squares: Vec<f64>,
    /// First coordinate of each touched block.
    firsts: Vec<usize>,
    /// Velocities of no block that a row touches; their coordinates come last.
    loose: Vec<usize>,
    /// Number of rows.
    count: usize,
    /// J and W = H Jᵀ of the rows, nv packs each four.
    given: Vec<Pack>,
    whitened: Vec<Pack>,
    /// Lengths of the rows of W.
    pub(super) lengths: Vec<f64>,
    /// Number of coordinates.
    pub(super) size: usize,
    /// G, `size` packs each four rows, and the lengths of its rows.
    pub(super) rows: Vec<Pack>,
    pub(super) reaches: Vec<f64>,
    /// c.
    pub(super) offsets: Vec<f64>,
    /// What c is the sum of, in magnitude.
    pub(super) terms: Vec<f64>,
    /// Rows that no admissible motion moves.
    pub(super) immobile: Vec<bool>,
    /// Whether there are any.
    pub(super) has_immobile: bool,
    /// ‖y*‖ of the touched blocks: what the equality rows alone make of the acceleration.
    pub(super) fixed: f64,
    /// W row after row, as a caller's factor makes it.
    plain: Vec<f64>,
    indices: Vec<usize>,
    part: Vec<Pack>,
    sums: Vec<Pack>,
    sums_of: Vec<f64>,
}

impl Frame {
    /// Whitens the rows of a step and brings them into the frame of the equality rows of `system`.
    ///
    /// # Errors
    /// [`Error::Factored`] where neither has the inertia; [`Error::NonFinite`], [`Error::TooLarge`] where products overflow.
    pub(super) fn find(
        &mut self,
        system: &ConstrainedSystem,
        step: &InequalityStep<'_>,
        whiten: Option<&mut Whiten<'_>>,
    ) -> Result<(), Error> {
        self.count = step.aref.len();
        packs::gather(system.nv(), step.jacobian, &mut self.given);
        self.whiten(system, step, whiten)?;
        self.touch(system);
        self.reduce(system, step)?;
        self.check(step)
    }

    /// W, by the system's own tree, the caller's factor, or the system's.
    fn whiten(
        &mut self,
        system: &ConstrainedSystem,
        step: &InequalityStep<'_>,
        whiten: Option<&mut Whiten<'_>>,
    ) -> Result<(), Error> {
        let nv = system.nv();
        if let Some(tree) = system.tree() {
            self.whitened.clear();
            self.whitened.extend_from_slice(&self.given);
            let whitened = &mut self.whitened;
            widest(
                #[inline(always)]
                || tree.whiten_packs(whitened),
            );
        } else {
            self.plain.clear();
            self.plain.extend_from_slice(step.jacobian);
            if let Some(whiten) = whiten {
                self.indices.clear();
                self.indices.extend(0..self.count);
                whiten(&self.indices, step.jacobian, &mut self.plain);
            } else {
                system.whiten(&mut self.plain)?;
            }
            packs::gather(nv, &self.plain, &mut self.whitened);
        }
        // Squares of these are the inertia of the rows.
        let in_order = |place: usize| {
            let (pack, velocity) = (place / LANES / nv, place / LANES % nv);
            (pack * LANES + place % LANES) * nv + velocity
        };
        check_size("inequality rows", self.whitened.as_flattened()).map_err(|error| error.moved(in_order))
    }

    /// Which blocks and velocities the rows touch, and the bases of those blocks.
    fn touch(&mut self, system: &ConstrainedSystem) {
        let (parts, blocks) = (system.parts(), system.blocks());
        let nv = parts.nv;
        // Blocks that are held do not follow the velocities that their rows come to touch.
        self.owners.clear();
        self.owners.resize(nv, NOBODY);
        self.sums_of.resize(nv, 0.0);
        self.sums.clear();
        self.sums.resize(nv, packs::NONE);
        self.squares.clear();
        let Self { owners, sums_of, sums, whitened, squares, .. } = self;
        widest(
            #[inline(always)]
            || {
                // Sums of magnitudes are zero where everything is.
                for block in 0..blocks.len() {
                    sums_of.fill(0.0);
                    for &row in blocks.of(block) {
                        let column = &parts.whitened[row * nv..(row + 1) * nv];
                        for (sum, entry) in sums_of.iter_mut().zip(column) {
                            *sum += entry.abs();
                        }
                    }
                    for (owner, sum) in owners.iter_mut().zip(&*sums_of) {
                        *owner = if *sum == 0.0 { *owner } else { block };
                    }
                }
                for pack in whitened.chunks_exact(nv) {
                    sums.iter_mut().zip(pack).for_each(|(sum, entry)| *sum = packs::either(sum, entry));
                }
                for column in parts.whitened.chunks_exact(nv) {
                    squares.push(dot_in_lanes(column, column));
                }
            },
        );
        self.touched.clear();
        self.loose.clear();
        for (velocity, sum) in self.sums.iter().enumerate() {
            match self.owners[velocity] {
                _ if packs::is_zero(sum) => {}
                NOBODY => self.loose.push(velocity),
                block if self.touched.contains(&block) => {}
                block => self.touched.push(block),
            }
        }
        if self.bases.len() < blocks.len() {
            self.bases.resize_with(blocks.len(), Basis::default);
        }
        self.firsts.clear();
        let (mut first, mut square) = (0, 0.0_f64);
        for &block in &self.touched {
            let basis = &mut self.bases[block];
            basis.find(parts, &self.owners, block, &self.squares);
            self.firsts.push(first);
            first += basis.free();
            square = if square == 0.0 { basis.size() } else { square.hypot(basis.size()) };
        }
        self.fixed = square;
        self.size = first + self.loose.len();
    }

    /// G and c.
    fn reduce(&mut self, system: &ConstrainedSystem, step: &InequalityStep<'_>) -> Result<(), Error> {
        let room = self.room();
        self.rows.clear();
        self.rows.resize(packs_of(self.count) * self.size, packs::NONE);
        for vector in [&mut self.offsets, &mut self.terms, &mut self.lengths, &mut self.reaches] {
            vector.resize(room, 0.0);
        }
        self.immobile.resize(room, false);
        let start = system.unconstrained();
        widest(
            #[inline(always)]
            || self.reduce_packs(start, step.aref),
        );
        check_size("inequality rows", &self.offsets)
    }

    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn reduce_packs(&mut self, start: &[f64], aref: &[f64]) {
        self.has_immobile = false;
        let count = packs_of(self.count);
        for pack in (0..count).step_by(4) {
            match count - pack {
                1 => self.reduce_some::<1>(pack, start, aref),
                2 => self.reduce_some::<2>(pack, start, aref),
                3 => self.reduce_some::<3>(pack, start, aref),
                _ => self.reduce_some::<4>(pack, start, aref),
            }
        }
    }

    /// The same of N packs, which share the way through the frame.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn reduce_some<const N: usize>(&mut self, first_pack: usize, start: &[f64], aref: &[f64]) {
        let (nv, size) = (start.len(), self.size);
        let mut held = [packs::NONE; N];
        for (&block, &first) in self.touched.iter().zip(&self.firsts) {
            let basis = &mut self.bases[block];
            self.part.clear();
            for &velocity in &basis.velocities {
                let of = |pack| self.whitened[(first_pack + pack) * nv + velocity];
                self.part.extend_from_slice(&std::array::from_fn::<_, N, _>(of));
            }
            if self.part.iter().all(packs::is_zero) {
                continue;
            }
            let part: &mut [[Pack; N]] = self.part.as_chunks_mut().0;
            let offsets = basis.take_rows(part);
            held.iter_mut().zip(&offsets).for_each(|(held, offset)| add_scaled(1.0, offset, held));
            let left = &part[part.len() - basis.free()..];
            for pack in 0..N {
                let rows = &mut self.rows[(first_pack + pack) * size + first..][..left.len()];
                rows.iter_mut().zip(left).for_each(|(row, left)| *row = left[pack]);
            }
        }
        for (pack, held) in (first_pack..).zip(&held) {
            let (given, whitened) = (&self.given[pack * nv..][..nv], &self.whitened[pack * nv..][..nv]);
            let rows = &mut self.rows[pack * size..][..size];
            let (mut offsets, mut terms) = (*held, packs::NONE);
            for (entry, start) in given.iter().zip(start) {
                for lane in 0..LANES {
                    let product = entry[lane] * start;
                    offsets[lane] += product;
                    terms[lane] += product.abs();
                }
            }
            let last = size - self.loose.len();
            for (entry, &velocity) in rows[last..].iter_mut().zip(&self.loose) {
                *entry = whitened[velocity];
            }
            let (lengths, mut reaches) = (packs::norms(whitened), packs::norms(rows));
            for lane in 0..LANES {
                let (row, length) = (pack * LANES + lane, lengths[lane]);
                let aref = aref.get(row).copied().unwrap_or(0.0);
                // What equality rows hold is taken out.
                let immobile = reaches[lane] <= IMMOBILE * length && length > 0.0;
                if immobile {
                    self.has_immobile = true;
                    for entry in &mut *rows {
                        entry[lane] = 0.0;
                    }
                    reaches[lane] = 0.0;
                }
                self.offsets[row] = offsets[lane] - aref;
                self.terms[row] = terms[lane] + aref.abs() + length * self.fixed;
                self.lengths[row] = length;
                self.reaches[row] = reaches[lane];
                self.immobile[row] = immobile;
            }
        }
    }

    /// Refuses what would overflow later.
    fn check(&self, step: &InequalityStep<'_>) -> Result<(), Error> {
        for (index, (&stiffness, (&offset, &reach))) in
            step.stiffness.iter().zip(self.offsets.iter().zip(&self.reaches)).enumerate()
        {
            let value = stiffness * (reach * reach).max(offset.abs()).max(offset * offset);
            if value > LARGEST || value.is_nan() {
                return Err(Error::TooLarge { what: "stiffness of inequality rows", index, value });
            }
        }
        Ok(())
    }

    /// Number of rows and of those that are not there, up to whole packs.
    pub(super) const fn room(&self) -> usize {
        packs_of(self.count) * LANES
    }

    /// J a of an acceleration (`nv`).
    pub(super) fn rates(&self, acceleration: &[f64], rates: &mut [f64]) {
        rates.fill(0.0);
        packs::multiply(&self.given, acceleration, rates);
    }

    /// x = c + G z.
    pub(super) fn deviations(&self, z: &[f64], x: &mut [f64]) {
        x.copy_from_slice(&self.offsets);
        packs::multiply(&self.rows, z, x);
    }

    /// `force` = Jᵀ f (`nv`).
    pub(super) fn combine(&mut self, f: &[f64], force: &mut [f64]) {
        force.fill(0.0);
        packs::multiply_tr(&self.given, f, &mut self.sums, force);
    }
}
