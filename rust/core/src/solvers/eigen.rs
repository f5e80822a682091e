//! A⁺ from a decomposition of every block of A, with the rank that the blocks decide: eigenvectors of A, or singular vectors of W.
//!
//! # Constraints of very different size
//!
//! Beside a gear of 1e5 or a lead screw, constraints of one block have entries on the diagonal of A that differ by 1e10, and more. Two
//! things go wrong then, and each has its own remedy.
//!
//! *The rank.* Eigenvalues of A mix what a row counts for with what it is measured in: true ones come out at 1e-13 of the
//! largest. Where the sizes of constraints differ by more than [`GRADED`], the rank is that of D A D, D the powers of two next to
//! 1/√size. The rows of one constraint are scaled together: a row that vanishes beside the others of a connect is a singular
//! pose, and not a unit. Only the rank is taken from there, for minimum norm and least squares are those of A.
//!
//! *The eigenvalues.* A method that goes by way of a tridiagonal matrix finds small ones to an error of ε times the largest.
//! Where that matters, at a condition beyond [`ILL`], Jacobi's rotations find them to ε times themselves, as far as the
//! diagonal entries are what makes them small (Demmel and Veselić, Jacobi's method is more accurate than QR, 1992).

pub(super) mod carried;
mod raw;

use std::mem;

use self::raw::Raw;
use crate::error::Error;
use crate::info::Info;
use crate::linalg::kernels::{axpy, dot, largest, norm, rank_one};
use crate::problem::{Blocks, Problem};

/// Eigenvalues of a block of A below this part of its largest count as zero, unless an option `rank_cut` says otherwise.
///
/// A = J M⁻¹ Jᵀ squares the singular values σ of J M^(−1/2), so the cut on σ is its square root, 1e-5. Rounding
/// leaves eigenvalues of about 1e-16; a row pair that closes a loop only to a drift δ (lengths of order one) leaves
/// about δ². Who asks on drifted states holds the rank: see [`blocks`](crate::problem::blocks).
pub const RANK_CUT: f64 = 1e-10;

/// An eigenvalue below minus this part of the largest means that A is not positive semidefinite. Rounding leaves n·ε,
/// whatever the rank cut; a sign that is wrong in a formula leaves order one.
pub(crate) const SEMIDEFINITE_TOLERANCE: f64 = 1e-10;

/// Ratio of the sizes of the constraints of a block from which on it is scaled before its rank is counted. Below, the scaling
/// would move an eigenvalue by no more than that.
pub(crate) const GRADED: f64 = 100.0;

/// Smallest eigenvalue that is kept, as a part of the largest, that a tridiagonal matrix gives with ten digits.
const ILL: f64 = 1e-6;

/// What is decomposed.
#[derive(Clone, Copy)]
enum Source<'a> {
    /// A, `n×n`.
    Matrix(&'a [f64]),
    /// W, `nv×n`, and R.
    Columns(&'a [f64], usize, Option<&'a [f64]>),
}

impl Source<'_> {
    /// An entry of the diagonal of A.
    fn diagonal(self, n: usize, row: usize) -> f64 {
        match self {
            Self::Matrix(matrix) => matrix[row * (n + 1)],
            Self::Columns(w, nv, softness) => {
                let column = &w[row * nv..(row + 1) * nv];
                dot(column, column) + softness.map_or(0.0, |softness| softness[row])
            }
        }
    }
}

/// A = U diag(w) Uᵀ, block by block, and the rank. Dropped vectors come first.
pub(crate) struct SymmetricEigen {
    /// U, n×n, column-major.
    vectors: Vec<f64>,
    values: Vec<f64>,
    raw: Raw,
    rank: usize,
    /// ‖A N‖ of the eigenvectors N that are dropped.
    dropped: f64,
    /// λ⁺: the smallest eigenvalue that is kept, or less; 0 without any.
    least: f64,
    /// How many times the eigenvalue nearest to the cut of its block is larger or smaller than that.
    margin: f64,
    projected: Vec<f64>,
    image: Vec<f64>,
    /// Of the block at hand: its rows, its scales D, its matrix, its vectors and values.
    rows: Vec<usize>,
    scales: Vec<f64>,
    part: Vec<f64>,
    part_vectors: Vec<f64>,
    part_values: Vec<f64>,
    /// Eigenvalues of D A D.
    scaled_values: Vec<f64>,
}

impl Clone for SymmetricEigen {
    /// A workspace with the same decomposition; the scratch memory is its own.
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len());
        copy.vectors.copy_from_slice(&self.vectors);
        copy.values.copy_from_slice(&self.values);
        (copy.rank, copy.dropped, copy.least) = (self.rank, self.dropped, self.least);
        copy.margin = self.margin;
        copy
    }
}

impl SymmetricEigen {
    /// A workspace for `n×n` matrices.
    #[must_use]
    pub(crate) fn new(n: usize) -> Self {
        Self {
            vectors: vec![0.0; n * n],
            values: vec![0.0; n],
            raw: Raw::new(n),
            rank: 0,
            dropped: 0.0,
            least: 0.0,
            margin: f64::INFINITY,
            projected: vec![0.0; n],
            image: vec![0.0; n],
            rows: Vec::with_capacity(n),
            scales: Vec::with_capacity(n),
            part: Vec::with_capacity(n * n),
            part_vectors: vec![0.0; n * n],
            part_values: vec![0.0; n],
            scaled_values: vec![0.0; n],
        }
    }

    /// The size it was made for.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.projected.len()
    }

    /// Decomposes `matrix` (`n×n`, column-major, lower triangle read) and lets its blocks decide their ranks by `rank_cut`.
    ///
    /// # Errors
    /// [`Error::NotPositiveSemidefinite`] by [`SEMIDEFINITE_TOLERANCE`], [`Error::Eigen`].
    pub(crate) fn decompose(
        &mut self,
        matrix: &[f64],
        rank_cut: f64,
        blocks: &mut Blocks,
    ) -> Result<(), Error> {
        self.decompose_source(Source::Matrix(matrix), rank_cut, blocks)
    }

    /// The same of one block whose rank nobody holds.
    ///
    /// # Errors
    /// Those of [`decompose`](Self::decompose).
    pub(crate) fn decompose_alone(&mut self, matrix: &[f64], rank_cut: f64) -> Result<(), Error> {
        self.decompose(matrix, rank_cut, &mut Blocks::whole(self.len()))
    }

    /// The same from the singular values of W, where the problem has one: no squares are taken.
    ///
    /// # Errors
    /// Those of [`decompose`](Self::decompose).
    pub(crate) fn decompose_factor(&mut self, problem: &mut Problem<'_>, rank_cut: f64) -> Result<(), Error> {
        let nv = problem.work.len();
        if nv == 0 {
            let (matrix, blocks) = problem.matrix_and_blocks();
            return self.decompose(matrix, rank_cut, blocks);
        }
        problem.whiten();
        let source = Source::Columns(problem.whitened.columns.as_slice(), nv, problem.softness);
        self.decompose_source(source, rank_cut, problem.blocks)
    }

    fn decompose_source(
        &mut self,
        source: Source<'_>,
        rank_cut: f64,
        blocks: &mut Blocks,
    ) -> Result<(), Error> {
        let n = self.len();
        (self.margin, self.least) = (f64::INFINITY, 0.0);
        if let (Source::Matrix(matrix), 1) = (source, blocks.len())
            && blocks.sizes(blocks.of(0), |row| matrix[row * (n + 1)], &mut self.scales) <= GRADED
        {
            self.raw.symmetric(n, matrix, &mut self.vectors, &mut self.values)?;
            check_semidefinite(&self.values)?;
            let held = blocks.holds(0);
            self.rank = blocks.decide(0, &self.values, rank_cut, 0.0);
            let null = n - self.rank;
            if self.rank == 0 || self.values[null] > ILL * self.values[n - 1] {
                self.dropped = largest(&self.values[..null]);
                self.least = self.values.get(null).copied().unwrap_or(0.0);
                self.margin = margin(&self.values, null, rank_cut, held);
                return Ok(());
            }
        }
        self.vectors.fill(0.0);
        let most = (0..n).fold(0.0_f64, |most, row| most.max(source.diagonal(n, row)));
        let (mut left, mut right, mut dropped) = (0, n, 0.0_f64);
        for block in 0..blocks.len() {
            self.rows.clear();
            self.rows.extend_from_slice(blocks.of(block));
            let size = self.rows.len();
            let (rank, margin) = self.decide_part(source, rank_cut, blocks, (block, most))?;
            self.margin = self.margin.min(margin);
            self.gather(source, false);
            let (vectors, values) = (&mut self.part_vectors[..size * size], &mut self.part_values[..size]);
            match source {
                Source::Matrix(_) => self.raw.accurate(size, &mut self.part, vectors, values)?,
                Source::Columns(..) => self.raw.singular(size, &mut self.part, vectors, values)?,
            }
            check_semidefinite(values)?;
            let null = size - rank;
            let scale = largest(values);
            if scale > 0.0 {
                dropped = dropped.max(largest(&values[..null]) / scale);
            }
            if let Some(&least) = values.get(null) {
                self.least = if self.least == 0.0 { least } else { self.least.min(least) };
            }
            right -= rank;
            self.take_part(left, null, right);
            left += null;
        }
        self.rank = n - left;
        self.dropped = dropped * largest(&self.values);
        Ok(())
    }

    /// The rank of the rows at hand, from D A D, and its margin.
    fn decide_part(
        &mut self,
        source: Source<'_>,
        rank_cut: f64,
        blocks: &mut Blocks,
        (block, most): (usize, f64),
    ) -> Result<(usize, f64), Error> {
        let (n, size) = (self.len(), self.rows.len());
        if blocks.sizes(&self.rows, |row| source.diagonal(n, row), &mut self.scales) > GRADED {
            self.scales.iter_mut().for_each(|size| *size = power_of_two_near_inverse_root(*size));
        } else {
            self.scales.clear();
            self.scales.resize(size, 1.0);
        }
        self.gather(source, true);
        let (vectors, values) = (&mut self.part_vectors[..size * size], &mut self.scaled_values[..size]);
        match source {
            Source::Matrix(_) => self.raw.symmetric(size, &self.part, vectors, values)?,
            Source::Columns(..) => self.raw.singular(size, &mut self.part, vectors, values)?,
        }
        // A block that is scaled is measured in its own units.
        let unit = self.scales.iter().fold(f64::INFINITY, |unit, scale| unit.min(scale * scale));
        let held = blocks.holds(block);
        let rank = blocks.decide(block, values, rank_cut, most * unit);
        Ok((rank, margin(values, size - rank, rank_cut, held)))
    }

    /// Gathers the rows at hand of A, or of W with R below it, into `part`, scaled by D or as they are.
    fn gather(&mut self, source: Source<'_>, scaled: bool) {
        let (n, size, rows) = (self.len(), self.rows.len(), &self.rows);
        let scale = |index: usize| if scaled { self.scales[index] } else { 1.0 };
        self.part.clear();
        match source {
            Source::Matrix(matrix) => {
                for (index, &col) in rows.iter().enumerate() {
                    let entry =
                        |(other, &row): (usize, &usize)| matrix[col * n + row] * scale(index) * scale(other);
                    self.part.extend(rows.iter().enumerate().map(entry));
                }
            }
            Source::Columns(w, nv, softness) => {
                for (index, &row) in rows.iter().enumerate() {
                    self.part.extend(w[row * nv..(row + 1) * nv].iter().map(|entry| entry * scale(index)));
                    if let Some(softness) = softness {
                        let root = softness[row].sqrt() * scale(index);
                        self.part.extend((0..size).map(|other| if other == index { root } else { 0.0 }));
                    }
                }
            }
        }
    }

    /// Takes the vectors of the rows at hand: those dropped from column `left` on, those kept from `right` on.
    fn take_part(&mut self, left: usize, null: usize, right: usize) {
        let (n, size) = (self.len(), self.rows.len());
        for k in 0..size {
            let column = if k < null { left + k } else { right + k - null };
            self.values[column] = self.part_values[k];
            for (&row, &entry) in self.rows.iter().zip(&self.part_vectors[k * size..(k + 1) * size]) {
                self.vectors[column * n + row] = entry;
            }
        }
    }

    /// Number of eigenvalues above the cut.
    #[must_use]
    pub(crate) const fn rank(&self) -> usize {
        self.rank
    }

    /// λ⁺: the smallest eigenvalue that is kept, or less; 0 without any.
    #[must_use]
    pub(crate) const fn least(&self) -> f64 {
        self.least
    }

    /// How many times the eigenvalue nearest to the cut of its block is larger or smaller than that.
    #[must_use]
    pub(crate) const fn margin(&self) -> f64 {
        self.margin
    }

    /// v ← Π v; gives ‖Nᵀ v‖.
    pub(crate) fn project(&self, v: &mut [f64]) -> f64 {
        let n = self.len();
        let mut square = 0.0;
        for vector in self.vectors[..(n - self.rank) * n].chunks_exact(n.max(1)) {
            let part = dot(vector, v);
            square += part * part;
            axpy(-part, vector, v);
        }
        square.sqrt()
    }

    /// The i-th eigenvalue; those dropped come first.
    #[must_use]
    pub(crate) fn value(&self, i: usize) -> f64 {
        self.values[i]
    }

    /// x = A⁺ b; gives ‖Nᵀ b‖, the part of b outside range(A).
    ///
    /// # Panics
    /// If b or x are not of the size decomposed.
    pub(crate) fn solve(&mut self, rhs: &[f64], x: &mut [f64]) -> f64 {
        let n = self.len();
        assert_eq!((rhs.len(), x.len()), (n, n));
        for i in 0..n {
            self.projected[i] = dot(self.vector(i), rhs);
        }
        let null = n - self.rank;
        x.fill(0.0);
        for i in null..n {
            axpy(self.projected[i] / self.values[i], self.vector(i), x);
        }
        norm(&self.projected[..null])
    }

    /// x = A⁺ b of the problem that was decomposed, with its figures.
    ///
    /// # Panics
    /// As [`solve`](Self::solve).
    pub(crate) fn answer(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Info {
        let inconsistency = self.solve(problem.rhs(), x);
        Info {
            residual_rel: self.residual_rel(problem, x),
            inconsistency: Some(inconsistency),
            rank: Some(self.rank),
            null_residual: Some(self.null_residual()),
            margin: Some(self.margin),
            ..Info::trivial(0.0)
        }
    }

    /// ‖Π (A x − b)‖ / ‖b‖ for an x in range(A), Π the projector onto range(A); 0 when b = 0.
    ///
    /// # Panics
    /// If the system or x are not of the size decomposed.
    fn residual_rel(&mut self, problem: &mut Problem<'_>, x: &[f64]) -> f64 {
        let n = self.len();
        assert_eq!((problem.len(), x.len()), (n, n));
        // With A itself rather than its decomposition, so that a wrong one shows.
        let mut image = mem::take(&mut self.image);
        problem.apply(x, &mut image);
        axpy(-1.0, problem.rhs(), &mut image);
        self.project(&mut image);
        let (left, b_norm) = (norm(&image), norm(problem.rhs()));
        self.image = image;
        if b_norm == 0.0 { 0.0 } else { left / b_norm }
    }

    /// ‖A N‖ / ‖A‖ of the null-space basis, the eigenvectors that are dropped; 0 without any.
    #[must_use]
    pub(crate) fn null_residual(&self) -> f64 {
        let most = largest(&self.values);
        if most == 0.0 { 0.0 } else { self.dropped / most }
    }

    /// The i-th eigenvector, `n`.
    #[must_use]
    pub(crate) fn vector(&self, i: usize) -> &[f64] {
        &self.vectors[i * self.len()..(i + 1) * self.len()]
    }

    /// Writes A⁺ into `inverse` (`n×n`, column-major).
    pub(crate) fn pseudo_inverse(&self, inverse: &mut [f64]) {
        inverse.fill(0.0);
        for i in self.len() - self.rank..self.len() {
            rank_one(self.values[i].recip(), self.vector(i), inverse);
        }
    }
}

fn power_of_two_near_inverse_root(entry: f64) -> f64 {
    if entry > f64::MIN_POSITIVE { (-0.5 * entry.log2()).round().exp2() } else { 1.0 }
}

/// How many times the value nearest to the cut is larger or smaller than that, of those that the cut decides of: the first `null`
/// are dropped, by what is held or by the cut.
fn margin(values: &[f64], null: usize, rank_cut: f64, held: bool) -> f64 {
    let cut = rank_cut * largest(values);
    let kept = values[null..].iter().fold(f64::INFINITY, |least, value| least.min(value / cut));
    let dropped = values[..null].iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value / cut));
    if held { kept } else { kept.min(dropped.recip()) }
}

fn check_semidefinite(values: &[f64]) -> Result<(), Error> {
    let fold =
        |start: f64, of: fn(f64, f64) -> f64| values.iter().fold(start, |found, &value| of(found, value));
    let (smallest, largest) = (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max));
    // Subnormal eigenvalues count as zero, and their sign says nothing.
    let scale = largest.abs().max(smallest.abs());
    if smallest < -(SEMIDEFINITE_TOLERANCE * scale).max(f64::MIN_POSITIVE) {
        return Err(Error::NotPositiveSemidefinite { smallest, largest });
    }
    Ok(())
}
