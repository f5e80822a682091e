//! What one step hands over of its inequality rows.

use crate::error::{Error, check_finite, check_len};

/// How far the stiffness of the friction rows of a cone may lie from what makes its cost smooth, relative.
///
/// MuJoCo computes R of a friction row from R of the normal row with three products, 1e-15; what is wrong by a sign or a factor is
/// off by order one.
pub const CONE_TOLERANCE: f64 = 1e-6;

/// Largest number of rows of a cone.
pub const WIDEST_CONE: usize = 6;

/// What the next rows of a step are, one or several together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Group {
    /// A row of friction loss.
    Friction,
    /// A limit, a frictionless contact, or an edge of a pyramidal contact: one row that pushes only.
    Unilateral,
    /// An elliptic contact: its normal row, then its friction rows.
    Cone {
        /// Number of rows, 2 to 6.
        dim: usize,
        /// μ of the regularised cone, MuJoCo's `contact.mu`.
        mu: f64,
        /// Friction coefficients of the friction rows, MuJoCo's `contact.friction`; the first dim − 1 count.
        friction: [f64; WIDEST_CONE - 1],
    },
}

impl Group {
    /// Returns the number of its rows.
    #[must_use]
    pub const fn rows(&self) -> usize {
        match self {
            Self::Friction | Self::Unilateral => 1,
            Self::Cone { dim, .. } => *dim,
        }
    }
}

/// A borrowed view of the inequality rows of one step. Matrices are dense and row-major.
#[derive(Debug, Clone, Copy)]
pub struct InequalityStep<'a> {
    /// J (`m×nv`).
    pub jacobian: &'a [f64],
    /// aref (`m`): the acceleration that the rows ask for.
    pub aref: &'a [f64],
    /// D = 1/R (`m`, > 0).
    pub stiffness: &'a [f64],
    /// η (`m`, ≥ 0): the largest friction force of a row of friction loss; of other rows it is not read.
    pub friction_loss: &'a [f64],
    /// What the rows are, in their order.
    pub groups: &'a [Group],
}

impl InequalityStep<'_> {
    /// Checks that the shapes fit beside `nv` velocities and that every number is finite and in its range.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NonFinite`], [`Error::Range`].
    pub fn check(&self, nv: usize) -> Result<(), Error> {
        self.check_beside_jacobian(nv)?;
        check_finite("inequality jacobian", self.jacobian)
    }

    /// The same but for the entries of J.
    pub(super) fn check_beside_jacobian(&self, nv: usize) -> Result<(), Error> {
        let m = self.aref.len();
        check_len("inequality jacobian", self.jacobian.len(), &[m, nv])?;
        check_len("stiffness", self.stiffness.len(), &[m])?;
        check_len("friction_loss", self.friction_loss.len(), &[m])?;
        // Before anything is summed: a dim of usize::MAX is only a wrong number.
        for (index, group) in self.groups.iter().enumerate() {
            if let Group::Cone { dim, .. } = group
                && !(2..=WIDEST_CONE).contains(dim)
            {
                return Err(range("dim", index, *dim as f64, "2 to 6 rows of a cone"));
            }
        }
        check_len("rows of the groups", self.groups.iter().map(Group::rows).sum(), &[m])?;
        check_finite("inequality aref", self.aref)?;
        check_finite("stiffness", self.stiffness)?;
        if let Some(index) = self.stiffness.iter().position(|&value| value <= 0.0) {
            return Err(range("stiffness", index, self.stiffness[index], "a number > 0"));
        }
        let mut row = 0;
        for (index, group) in self.groups.iter().enumerate() {
            match *group {
                Group::Friction => {
                    let loss = self.friction_loss[row];
                    if !(loss.is_finite() && loss >= 0.0) {
                        return Err(range("friction_loss", row, loss, "a finite number ≥ 0"));
                    }
                }
                Group::Unilateral => {}
                Group::Cone { dim, mu, friction } => self.check_cone(index, row, dim, mu, &friction)?,
            }
            row += group.rows();
        }
        Ok(())
    }

    fn check_cone(
        &self,
        index: usize,
        row: usize,
        dim: usize,
        mu: f64,
        friction: &[f64],
    ) -> Result<(), Error> {
        if !(mu.is_finite() && mu > 0.0) {
            return Err(range("mu", index, mu, "a finite number > 0"));
        }
        for (offset, &coefficient) in friction[..dim - 1].iter().enumerate() {
            if !(coefficient.is_finite() && coefficient > 0.0) {
                return Err(range("friction", index, coefficient, "finite numbers > 0"));
            }
            let expected = self.stiffness[row] * (coefficient / mu).powi(2);
            let at = row + 1 + offset;
            let given = self.stiffness[at];
            let off = (given - expected).abs();
            if off > CONE_TOLERANCE * expected || expected.is_nan() {
                return Err(range(
                    "stiffness",
                    at,
                    given,
                    "D friction² / mu² of its cone, D of its normal row",
                ));
            }
        }
        Ok(())
    }
}

const fn range(what: &'static str, index: usize, value: f64, expected: &'static str) -> Error {
    Error::Range { what, index, value, expected }
}
