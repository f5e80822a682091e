//! Rows of a step in coordinates z of what the equality rows leave: x = c + G z, and ½‖z‖² is all that is left of the inertia.

use super::basis::Basis;
use super::rows::InequalityStep;
use crate::error::{Error, LARGEST, check_size};
use crate::linalg::kernels::{dot_in_lanes, norm};
use crate::problem::Whiten;
use crate::system::ConstrainedSystem;

/// A row of which exact equality rows leave no more than this part is moved by no admissible motion.
///
/// Rounding of the frame is ε √cond of the block, 1e-11 at the rank cut. A gear or screw that hides a mobility of 1e-9
/// carries 1e-18 of a row's inertia.
pub const IMMOBILE: f64 = 1e-9;

/// The rows of one step in the frame of its equality rows.
#[derive(Debug, Clone, Default)]
pub(super) struct Frame {
    /// Bases by block; those of this step are `touched`.
    bases: Vec<Basis>,
    touched: Vec<usize>,
    /// Block of each velocity that an equality row touches.
    owners: Vec<Option<usize>>,
    /// First coordinate of each touched block.
    firsts: Vec<usize>,
    /// Velocities of no block that a row touches; their coordinates come last.
    loose: Vec<usize>,
    /// H Jᵀ of the rows, `m×nv`.
    whitened: Vec<f64>,
    /// Lengths of its rows.
    pub(super) lengths: Vec<f64>,
    /// Number of coordinates.
    pub(super) size: usize,
    /// G, `m×size`, row-major, and the lengths of its rows.
    pub(super) rows: Vec<f64>,
    pub(super) reaches: Vec<f64>,
    /// c.
    pub(super) offsets: Vec<f64>,
    /// What c is the sum of, in magnitude.
    pub(super) terms: Vec<f64>,
    /// Rows that no admissible motion moves.
    pub(super) immobile: Vec<bool>,
    /// ‖y*‖ of the touched blocks: what the equality rows alone make of the acceleration.
    pub(super) fixed: f64,
    counts: Vec<usize>,
    part: Vec<f64>,
    point: Vec<f64>,
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
        whiten: &mut Option<&mut Whiten<'_>>,
    ) -> Result<(), Error> {
        let (m, nv) = (step.aref.len(), system.nv());
        self.counts.clear();
        self.counts.extend(0..=m);
        self.whitened.clear();
        self.whitened.resize(m * nv, 0.0);
        apply(system, whiten, &self.counts[..m], step.jacobian, &mut self.whitened)?;
        // Squares of these are the inertia of the rows.
        check_size("inequality rows", &self.whitened)?;
        self.lengths.clear();
        self.lengths.extend(self.whitened.chunks_exact(nv).map(norm));
        self.touch(system);
        self.reduce(system, step)?;
        self.mark();
        self.check(step)
    }

    /// Which blocks and velocities the rows touch, and the bases of those blocks.
    fn touch(&mut self, system: &ConstrainedSystem) {
        let (parts, blocks) = (system.parts(), system.blocks());
        let nv = parts.nv;
        // Blocks that are held do not follow the velocities that their rows come to touch.
        self.owners.clear();
        self.owners.resize(nv, None);
        for block in 0..blocks.len() {
            for &row in blocks.of(block) {
                let column = &parts.whitened[row * nv..(row + 1) * nv];
                for (owner, _) in self.owners.iter_mut().zip(column).filter(|(_, entry)| **entry != 0.0) {
                    *owner = Some(block);
                }
            }
        }
        self.touched.clear();
        self.loose.clear();
        for velocity in 0..nv {
            if self.whitened.iter().skip(velocity).step_by(nv).all(|&entry| entry == 0.0) {
                continue;
            }
            match self.owners[velocity] {
                Some(block) => {
                    if !self.touched.contains(&block) {
                        self.touched.push(block);
                    }
                }
                None => self.loose.push(velocity),
            }
        }
        if self.bases.len() < blocks.len() {
            self.bases.resize_with(blocks.len(), Basis::default);
        }
        let columns = parts.whitened.chunks_exact(nv);
        let most = columns.map(|column| dot_in_lanes(column, column)).fold(0.0, f64::max);
        self.firsts.clear();
        let (mut first, mut square) = (0, 0.0_f64);
        for &block in &self.touched {
            let basis = &mut self.bases[block];
            basis.find(parts, &self.owners, block, most);
            self.firsts.push(first);
            first += basis.free();
            square = square.hypot(basis.size());
        }
        self.fixed = square;
        self.size = first + self.loose.len();
    }

    /// G and c.
    fn reduce(&mut self, system: &ConstrainedSystem, step: &InequalityStep<'_>) -> Result<(), Error> {
        let (nv, start) = (system.nv(), system.unconstrained());
        self.rows.clear();
        self.rows.resize(step.aref.len() * self.size, 0.0);
        self.offsets.clear();
        self.terms.clear();
        for (index, (given, aref)) in step.jacobian.chunks_exact(nv).zip(step.aref).enumerate() {
            let whitened = &self.whitened[index * nv..(index + 1) * nv];
            let row = &mut self.rows[index * self.size..(index + 1) * self.size];
            let mut offset = dot_in_lanes(given, start) - aref;
            for (&block, &first) in self.touched.iter().zip(&self.firsts) {
                let basis = &mut self.bases[block];
                self.part.clear();
                self.part.extend(basis.velocities.iter().map(|&velocity| whitened[velocity]));
                if self.part.iter().any(|&entry| entry != 0.0) {
                    offset += basis.take_row(&mut self.part, &mut row[first..first + basis.free()]);
                }
            }
            let last = self.size - self.loose.len();
            for (entry, &velocity) in row[last..].iter_mut().zip(&self.loose) {
                *entry = whitened[velocity];
            }
            self.offsets.push(offset);
            let terms = given.iter().zip(start).map(|(entry, start)| (entry * start).abs()).sum::<f64>();
            self.terms.push(terms + aref.abs() + self.lengths[index] * self.fixed);
        }
        check_size("inequality rows", &self.offsets)
    }

    /// Takes out what is left of rows that equality rows hold.
    fn mark(&mut self) {
        self.reaches.clear();
        self.immobile.clear();
        if self.size == 0 {
            self.reaches.resize(self.lengths.len(), 0.0);
            self.immobile.extend(self.lengths.iter().map(|&length| length > 0.0));
            return;
        }
        for (row, &length) in self.rows.chunks_exact_mut(self.size).zip(&self.lengths) {
            let mut reach = norm(row);
            let immobile = reach <= IMMOBILE * length && length > 0.0;
            if immobile {
                row.fill(0.0);
                reach = 0.0;
            }
            self.reaches.push(reach);
            self.immobile.push(immobile);
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

    /// The coordinates of an acceleration that the forces M a − f (`nv`) stand for.
    ///
    /// # Errors
    /// [`Error::Factored`].
    pub(super) fn take_point(
        &mut self,
        system: &ConstrainedSystem,
        forces: &[f64],
        whiten: &mut Option<&mut Whiten<'_>>,
        z: &mut [f64],
    ) -> Result<(), Error> {
        self.point.clear();
        self.point.resize(forces.len(), 0.0);
        let index = self.offsets.len();
        apply(system, whiten, &self.counts[index..=index], forces, &mut self.point)?;
        for (&block, &first) in self.touched.iter().zip(&self.firsts) {
            let basis = &mut self.bases[block];
            self.part.clear();
            self.part.extend(basis.velocities.iter().map(|&velocity| self.point[velocity]));
            basis.take_point(&mut self.part, &mut z[first..first + basis.free()]);
        }
        let last = self.size - self.loose.len();
        for (entry, &velocity) in z[last..].iter_mut().zip(&self.loose) {
            *entry = self.point[velocity];
        }
        Ok(())
    }

    /// x = c + G z.
    pub(super) fn deviations(&self, z: &[f64], x: &mut [f64]) {
        x.copy_from_slice(&self.offsets);
        if self.size > 0 {
            for (entry, row) in x.iter_mut().zip(self.rows.chunks_exact(self.size)) {
                *entry += dot_in_lanes(row, z);
            }
        }
    }

    /// A row of G.
    pub(super) fn row(&self, row: usize) -> &[f64] {
        &self.rows[row * self.size..(row + 1) * self.size]
    }
}

/// H times some rows, by the caller's factor or by the system's own.
fn apply(
    system: &ConstrainedSystem,
    whiten: &mut Option<&mut Whiten<'_>>,
    indices: &[usize],
    rows: &[f64],
    out: &mut [f64],
) -> Result<(), Error> {
    if let Some(whiten) = whiten {
        whiten(indices, rows, out);
        return Ok(());
    }
    out.copy_from_slice(rows);
    system.whiten(out)
}
