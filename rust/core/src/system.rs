//! A λ = b of one step, and the way back from λ to accelerations.

use std::mem;

use nalgebra::{Cholesky, DMatrix, DVector};

use crate::error::{Error, check_finite, check_len};
use crate::step::StepView;

/// Symmetry asked of a dense A that a caller hands over, relative to its largest entry. `A = J M⁻¹ Jᵀ` formed in
/// floating point by any sensible route is symmetric to a few rounding errors; 1e-10 leaves room for large sums and
/// still catches a wrong matrix.
pub const SYMMETRY_TOLERANCE: f64 = 1e-10;

/// The linear system of one step. Made once, assembled anew every step; allocates only when the shape changes.
///
/// With `M = L Lᵀ` and `W = L⁻¹ Jᵀ` (nv×n): `A = Wᵀ W (+ R)`, which is symmetric to the last bit, and
/// `a = a₀ + L⁻ᵀ W λ`, where `a₀ = M⁻¹ f` is the acceleration without constraints.
#[derive(Debug, Clone, Default)]
pub struct ConstrainedSystem {
    matrix: DMatrix<f64>,
    rhs: DVector<f64>,
    mass_factor: DMatrix<f64>,
    jacobian_t: DMatrix<f64>,
    whitened: DMatrix<f64>,
    unconstrained: DVector<f64>,
    work: DVector<f64>,
}

impl ConstrainedSystem {
    /// An empty system; [`assemble`](Self::assemble) or [`set_dense`](Self::set_dense) fills it.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of rows n.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rhs.len()
    }

    /// Whether nothing has been assembled yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rhs.is_empty()
    }

    /// Number of velocities nv; 0 for a system given as dense (A, b).
    #[must_use]
    pub fn nv(&self) -> usize {
        self.unconstrained.len()
    }

    /// A, `n×n`.
    #[must_use]
    pub const fn matrix(&self) -> &DMatrix<f64> {
        &self.matrix
    }

    /// b, `n`.
    #[must_use]
    pub const fn rhs(&self) -> &DVector<f64> {
        &self.rhs
    }

    /// a₀ = M⁻¹ f, `nv`.
    #[must_use]
    pub const fn unconstrained(&self) -> &DVector<f64> {
        &self.unconstrained
    }

    fn resize(&mut self, n: usize, nv: usize) {
        if (self.len(), self.nv()) == (n, nv) {
            return;
        }
        *self = Self {
            matrix: DMatrix::zeros(n, n),
            rhs: DVector::zeros(n),
            mass_factor: DMatrix::zeros(nv, nv),
            jacobian_t: DMatrix::zeros(nv, n),
            whitened: DMatrix::zeros(nv, n),
            unconstrained: DVector::zeros(nv),
            work: DVector::zeros(nv),
        };
    }

    /// Forms A and b of one step.
    ///
    /// # Errors
    /// Those of [`StepView::check`], which leave the last step in place; [`Error::MassNotPositiveDefinite`], and
    /// [`Error::NonFinite`] if A or b overflow, which leave the system empty.
    pub fn assemble(&mut self, step: &StepView<'_>) -> Result<(), Error> {
        step.check()?;
        let (n, nv) = step.shape();
        self.resize(n, nv);

        // A symmetric row-major M is its own column-major form, and row-major J is column-major Jᵀ.
        let mut factor = mem::take(&mut self.mass_factor);
        factor.copy_from_slice(step.mass);
        let Some(factor) = Cholesky::new(factor) else {
            // The old factor went with the attempt: without it there is no way back to accelerations.
            *self = Self::default();
            let diagonal = (0..nv).map(|i| step.mass[i * nv + i]);
            return Err(Error::MassNotPositiveDefinite {
                smallest: diagonal.clone().fold(f64::INFINITY, f64::min),
                largest: diagonal.fold(f64::NEG_INFINITY, f64::max),
            });
        };
        self.mass_factor = factor.unpack_dirty();

        self.jacobian_t.copy_from_slice(step.jacobian);
        self.whitened.copy_from(&self.jacobian_t);
        self.mass_factor.solve_lower_triangular_mut(&mut self.whitened);
        self.matrix.gemm_tr(1.0, &self.whitened, &self.whitened, 0.0);
        if let Some(regularisation) = step.regularisation {
            for (i, value) in regularisation.iter().enumerate() {
                self.matrix[(i, i)] += value;
            }
        }

        self.unconstrained.copy_from_slice(step.force);
        self.mass_factor.solve_lower_triangular_mut(&mut self.unconstrained);
        self.mass_factor.tr_solve_lower_triangular_mut(&mut self.unconstrained);
        self.rhs.copy_from_slice(step.aref);
        self.rhs.gemv_tr(-1.0, &self.jacobian_t, &self.unconstrained, 1.0);
        // Finite input can still overflow.
        let finite =
            check_finite("A", self.matrix.as_slice()).and_then(|()| check_finite("b", self.rhs.as_slice()));
        finite.inspect_err(|_| *self = Self::default())
    }

    /// Takes A (`n×n`, row-major, symmetric) and b (`n`) as they are; there is no way back to accelerations then.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Shape`], [`Error::NonFinite`], [`Error::NotSymmetric`].
    pub fn set_dense(&mut self, matrix: &[f64], rhs: &[f64]) -> Result<(), Error> {
        let n = rhs.len();
        if n == 0 {
            return Err(Error::Empty { what: "b" });
        }
        check_len("A", matrix.len(), &[n, n])?;
        check_finite("A", matrix)?;
        check_finite("b", rhs)?;
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
        self.resize(n, 0);
        for row in 0..n {
            for col in 0..n {
                self.matrix[(row, col)] = 0.5 * matrix[row * n + col] + 0.5 * matrix[col * n + row];
            }
        }
        self.rhs.copy_from_slice(rhs);
        Ok(())
    }

    /// `qfrc = Jᵀ λ` and `qacc = a₀ + M⁻¹ Jᵀ λ`, both `nv`.
    ///
    /// # Errors
    /// [`Error::Shape`], also for a system given as dense (A, b), which has no accelerations.
    pub fn acceleration(
        &mut self,
        multipliers: &[f64],
        qfrc: &mut [f64],
        qacc: &mut [f64],
    ) -> Result<(), Error> {
        check_len("multipliers", multipliers.len(), &[self.len()])?;
        check_len("qfrc", qfrc.len(), &[self.nv()])?;
        check_len("qacc", qacc.len(), &[self.nv()])?;
        self.work.fill(0.0);
        for (column, &multiplier) in self.jacobian_t.column_iter().zip(multipliers) {
            self.work.axpy(multiplier, &column, 1.0);
        }
        qfrc.copy_from_slice(self.work.as_slice());
        self.mass_factor.solve_lower_triangular_mut(&mut self.work);
        self.mass_factor.tr_solve_lower_triangular_mut(&mut self.work);
        self.work += &self.unconstrained;
        qacc.copy_from_slice(self.work.as_slice());
        Ok(())
    }
}
