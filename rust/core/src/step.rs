//! What one time step hands to the solvers.

use crate::error::{Error, check_finite, check_len};

/// A borrowed view of one step. Matrices are dense and row-major, as NumPy keeps them.
#[derive(Debug, Clone, Copy)]
pub struct StepView<'a> {
    /// M, `nv×nv`, symmetric positive definite; of the two triangles the upper is read.
    pub mass: &'a [f64],
    /// J, `n×nv`.
    pub jacobian: &'a [f64],
    /// f, `nv`: all smooth forces (passive, applied, actuator, minus bias).
    pub force: &'a [f64],
    /// `n`: the acceleration that the rows ask for.
    pub aref: &'a [f64],
    /// R, `n`, ≥ 0: softness added to the diagonal of A. `None` asks for the exact (hard) constraint.
    pub regularisation: Option<&'a [f64]>,
}

impl StepView<'_> {
    /// Number of constraint rows n and of velocities nv.
    #[must_use]
    pub const fn shape(&self) -> (usize, usize) {
        (self.aref.len(), self.force.len())
    }

    /// Checks shapes and that every number is finite.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Shape`], [`Error::NonFinite`], [`Error::NegativeRegularisation`].
    pub fn check(&self) -> Result<(), Error> {
        let (n, nv) = self.shape();
        if n == 0 {
            return Err(Error::Empty { what: "aref" });
        }
        if nv == 0 {
            return Err(Error::Empty { what: "force" });
        }
        check_len("mass", self.mass.len(), &[nv, nv])?;
        check_len("jacobian", self.jacobian.len(), &[n, nv])?;
        check_finite("mass", self.mass)?;
        check_finite("jacobian", self.jacobian)?;
        check_finite("force", self.force)?;
        check_finite("aref", self.aref)?;
        if let Some(regularisation) = self.regularisation {
            check_len("regularisation", regularisation.len(), &[n])?;
            check_finite("regularisation", regularisation)?;
            if let Some(index) = regularisation.iter().position(|&value| value < 0.0) {
                return Err(Error::NegativeRegularisation { index, value: regularisation[index] });
            }
        }
        Ok(())
    }
}
