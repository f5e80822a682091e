//! Systems that are given as dense A and b.

use std::mem;

use nalgebra::{Cholesky, DMatrix};

use super::scale::{exponent_of_small, power_of_two};
use super::{ConstrainedSystem, SYMMETRY_TOLERANCE};
use crate::error::{Error, check_len, check_size};
use crate::solvers::eigen::{SEMIDEFINITE_TOLERANCE, SymmetricEigen};

impl ConstrainedSystem {
    /// Sets A (`n×n`, row-major, symmetric) and b (`n`). Such a system has no accelerations.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Shape`], [`Error::NonFinite`], [`Error::TooLarge`], [`Error::NotSymmetric`],
    /// [`Error::NotPositiveSemidefinite`]; all of them leave the last system in place.
    pub fn set_dense(&mut self, matrix: &[f64], rhs: &[f64]) -> Result<(), Error> {
        let n = rhs.len();
        if n == 0 {
            return Err(Error::Empty { what: "b" });
        }
        check_len("A", matrix.len(), &[n, n])?;
        check_size("A", matrix)?;
        check_size("b", rhs)?;
        let largest = matrix.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
        let (mut worst, mut gap) = ((0, 0), 0.0);
        for row in 0..n {
            for col in 0..row {
                let next = (matrix[row * n + col] - matrix[col * n + row]).abs();
                if next > gap {
                    (worst, gap) = ((row, col), next);
                }
            }
        }
        if gap > SYMMETRY_TOLERANCE * largest {
            let (row, col) = worst;
            return Err(Error::NotSymmetric { row, col, gap, tolerance: SYMMETRY_TOLERANCE });
        }
        let mean = |row: usize, col: usize| 0.5 * matrix[row * n + col] + 0.5 * matrix[col * n + row];
        self.check_semidefinite(n, largest, mean)?;
        let shifted = mem::take(&mut self.shifted);
        self.resize(n, 0);
        self.shifted = shifted;
        if self.given.nrows() != n {
            self.given = DMatrix::zeros(n, n);
        }
        for row in 0..n {
            for col in 0..n {
                self.given[(row, col)] = mean(row, col);
            }
        }
        self.rhs.copy_from_slice(rhs);
        self.planning.leave_tree();
        self.refold(true);
        // Tᵀ A T, not the representatives' entries: those of a small row are rounding next to its large ones.
        self.dense.fill(0.0);
        for (col, share) in self.fold.shares().enumerate() {
            let Some((col_class, col_entry)) = share else { continue };
            for (row, share) in self.fold.shares().enumerate() {
                let Some((row_class, row_entry)) = share else { continue };
                self.dense[(row_class, col_class)] += row_entry * col_entry * self.given[(row, col)];
            }
        }
        self.formed = true;
        // An even power, as that of W.
        self.exponent = exponent_of_small(self.dense.amax()) / 2;
        if self.exponent != 0 {
            self.dense *= power_of_two(self.exponent);
            self.dense *= power_of_two(self.exponent);
        }
        let classes = self.fold.shares().map(|share| share.map(|(class, _)| class));
        self.blocks.find_dense(self.dense.as_slice(), self.dense.nrows(), classes);
        self.blocks.step(&self.gaps);
        self.gaps.clear();
        self.reduce_rhs();
        Ok(())
    }

    /// Refuses an A (`n×n`) by [`SEMIDEFINITE_TOLERANCE`]. No solver but those that decompose A would notice.
    fn check_semidefinite(
        &mut self,
        n: usize,
        largest: f64,
        entry: impl Fn(usize, usize) -> f64,
    ) -> Result<(), Error> {
        if largest == 0.0 {
            return Ok(());
        }
        // Quick: no eigenvalue lies below −tolerance if A / largest + tolerance · E has a Cholesky factor.
        let mut shifted = mem::take(&mut self.shifted);
        if shifted.nrows() != n {
            shifted = DMatrix::zeros(n, n);
        }
        let fill = |matrix: &mut DMatrix<f64>, shift: f64| {
            for col in 0..n {
                for row in 0..n {
                    matrix[(row, col)] = entry(row, col) / largest;
                }
                matrix[(col, col)] += shift;
            }
        };
        fill(&mut shifted, SEMIDEFINITE_TOLERANCE);
        if let Some(factor) = Cholesky::new(shifted) {
            self.shifted = factor.unpack_dirty();
            return Ok(());
        }
        let mut scaled = DMatrix::zeros(n, n);
        fill(&mut scaled, 0.0);
        SymmetricEigen::new(n).decompose_alone(scaled.as_slice(), 0.0).map_err(|error| match error {
            Error::NotPositiveSemidefinite { smallest, largest: most } => {
                Error::NotPositiveSemidefinite { smallest: smallest * largest, largest: most * largest }
            }
            other => other,
        })
    }
}
