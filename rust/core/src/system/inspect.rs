//! A of all rows, for inspection.

use nalgebra::DMatrix;

use super::ConstrainedSystem;
use super::scale::power_of_two;

impl ConstrainedSystem {
    /// Computes A (`n×n`, symmetric, so both row-major and column-major) before folding. This is for inspection, not for a step
    /// loop.
    #[must_use]
    pub fn full_matrix(&self) -> Vec<f64> {
        let matrix = match self.nv() {
            0 => return self.given.as_slice().to_vec(),
            _ if self.mass_factor.is_empty() && !self.planning.on_tree => self.unfolded_matrix(),
            _ => self.product_matrix(),
        };
        matrix.data.into()
    }

    /// J M⁻¹ Jᵀ (+ R).
    fn product_matrix(&self) -> DMatrix<f64> {
        let mut whitened = DMatrix::zeros(self.nv(), self.len());
        for (row, column) in whitened.as_mut_slice().chunks_exact_mut(self.nv()).enumerate() {
            self.rows.scatter(row, 1.0, column);
            if self.planning.on_tree {
                self.tree.whiten(column);
            }
        }
        if !self.planning.on_tree {
            self.mass_factor.solve_lower_triangular_mut(&mut whitened);
        }
        let mut matrix = whitened.tr_mul(&whitened);
        for (i, softness) in self.softness.iter().flatten().enumerate() {
            matrix[(i, i)] += softness / power_of_two(2 * self.exponent);
        }
        matrix
    }

    /// T A Tᵀ (+ R) of the reduced A.
    fn unfolded_matrix(&self) -> DMatrix<f64> {
        let columns = &self.whitened.columns;
        let reduced = columns.tr_mul(columns) / power_of_two(2 * self.exponent);
        let shares: Vec<_> = self.fold.shares().collect();
        let mut matrix =
            DMatrix::from_fn(self.len(), self.len(), |row, col| match (shares[row], shares[col]) {
                (Some((row, share)), Some((col, other))) => share * other * reduced[(row, col)],
                _ => 0.0,
            });
        for (i, softness) in self.softness.iter().flatten().enumerate() {
            matrix[(i, i)] += softness / power_of_two(2 * self.exponent);
        }
        matrix
    }
}
