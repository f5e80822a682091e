//! The parts of an assembled system, and the same system from another start.

use nalgebra::DMatrixViewMut;

use super::ConstrainedSystem;
use super::parts::Parts;
use super::scale::power_of_two;
use crate::error::{Error, check_finite, check_len, check_size};
use crate::linalg::tree::Tree;

impl ConstrainedSystem {
    pub(crate) fn parts(&self) -> Parts<'_> {
        Parts {
            nv: self.nv(),
            whitened: self.whitened.columns.as_slice(),
            softness: self.softness.as_deref(),
            rhs: self.reduced_rhs.as_slice(),
            blocks: &self.blocks,
            unit: power_of_two(self.exponent) / power_of_two(self.rhs_exponent),
        }
    }

    /// M and its factor, where they lie along a tree.
    pub(crate) fn tree(&self) -> Option<&Tree> {
        self.planning.on_tree.then_some(&self.tree)
    }

    /// Multiplies rows (`nv` each) by L⁻¹, M = L Lᵀ of a system that does not lie on a [`tree`](Self::tree).
    ///
    /// # Errors
    /// [`Error::Factored`] where the inertia is somebody else's.
    pub(crate) fn whiten(&self, rows: &mut [f64]) -> Result<(), Error> {
        if self.mass_factor.is_empty() {
            return Err(Error::Factored);
        }
        let count = rows.len() / self.nv();
        let mut columns = DMatrixViewMut::from_slice(rows, self.nv(), count);
        self.mass_factor.solve_lower_triangular_mut(&mut columns);
        Ok(())
    }

    /// Asks the same rows again from another acceleration without constraints a₀ (`nv`), as other smooth forces give it:
    /// b = `aref` − J a₀. A, its fold, its blocks and the ranks that they hold stay as they are.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Shape`], [`Error::NonFinite`], which leave the system in place; [`Error::NonFinite`] or
    /// [`Error::TooLarge`] if b overflows, which leave it empty.
    pub fn renew(&mut self, unconstrained: &[f64], aref: &[f64]) -> Result<(), Error> {
        if self.nv() == 0 {
            return Err(Error::Empty { what: "system" });
        }
        check_len("unconstrained", unconstrained.len(), &[self.nv()])?;
        check_len("aref", aref.len(), &[self.len()])?;
        check_finite("unconstrained", unconstrained)?;
        check_finite("aref", aref)?;
        for (most, entry) in self.at_work.iter_mut().zip(&self.unconstrained) {
            *most = most.max(entry.abs());
        }
        self.unconstrained.copy_from_slice(unconstrained);
        self.ask(aref);
        self.judges.adjourn();
        // Whether somebody formed A for the question before must not change how this one is answered.
        self.formed = false;
        check_size("b", self.rhs.as_slice()).inspect_err(|_| *self = Self::default())
    }
}
