//! The data that one time step hands to the solvers.

use crate::error::{Error, check_finite, check_len};
pub use crate::linalg::rows::JacobianView;
pub use crate::linalg::tree::TreeView;

/// A borrowed view of one step of a mechanism whose inertia lies along a kinematic tree, as MuJoCo keeps it: nothing in it is n×nv
/// unless the caller has it so.
#[derive(Debug, Clone, Copy)]
pub struct SparseStep<'a> {
    /// J.
    pub jacobian: JacobianView<'a>,
    /// M and its factor.
    pub inertia: TreeView<'a>,
    /// a₀ = M⁻¹ f (`nv`): the acceleration without constraints.
    pub unconstrained: &'a [f64],
    /// aref (`n`): the acceleration that the rows ask for.
    pub aref: &'a [f64],
    /// R (`n`, ≥ 0): softness, as in [`StepView`].
    pub regularisation: Option<&'a [f64]>,
}

impl SparseStep<'_> {
    /// Returns the numbers of constraint rows n and of velocities nv.
    #[must_use]
    pub const fn shape(&self) -> (usize, usize) {
        (self.aref.len(), self.unconstrained.len())
    }

    /// Checks that the shapes fit and that every number is finite.
    ///
    /// # Errors
    /// Those of [`StepView::check`], and [`Error::Pattern`].
    pub fn check(&self) -> Result<(), Error> {
        self.check_beside(false, false)
    }

    /// The same, where the patterns of J or M may be known already.
    pub(crate) fn check_beside(&self, jacobian_known: bool, inertia_known: bool) -> Result<(), Error> {
        let (n, nv) = self.shape();
        check_rows(n, nv, None, self.aref, self.regularisation)?;
        if !jacobian_known {
            self.jacobian.check(n, nv)?;
        }
        if !inertia_known && !self.inertia.fits(nv) {
            return Err(Error::Pattern { what: "mass" });
        }
        self.jacobian.check_finite(n, nv)?;
        for (what, values) in self.inertia.numbers() {
            check_finite(what, values)?;
        }
        check_finite("unconstrained", self.unconstrained)
    }
}

/// A borrowed view of one step whose inertia the caller has factored, M⁻¹ = Hᵀ H. Matrices are dense and row-major.
///
/// A [`Whiten`] that is passed beside it multiplies rows of J by H, so that a sparse factor stays with the caller.
#[derive(Debug, Clone, Copy)]
pub struct FactoredStep<'a> {
    /// J (`n×nv`).
    pub jacobian: &'a [f64],
    /// a₀ = M⁻¹ f (`nv`): the acceleration without constraints.
    pub unconstrained: &'a [f64],
    /// aref (`n`): the acceleration that the rows ask for.
    pub aref: &'a [f64],
    /// R (`n`, ≥ 0): softness, as in [`StepView`].
    pub regularisation: Option<&'a [f64]>,
}

/// Computes H Jᵀ of some rows of J, one after another (`nv` each), from the indices and the entries of the rows.
pub type Whiten<'a> = dyn FnMut(&[usize], &[f64], &mut [f64]) + 'a;

impl FactoredStep<'_> {
    /// Returns the numbers of constraint rows n and of velocities nv.
    #[must_use]
    pub const fn shape(&self) -> (usize, usize) {
        (self.aref.len(), self.unconstrained.len())
    }

    /// Checks that the shapes fit and that every number is finite.
    ///
    /// # Errors
    /// Those of [`StepView::check`].
    pub fn check(&self) -> Result<(), Error> {
        self.check_beside(false)
    }

    /// The same, where J may have been found in order already.
    pub(crate) fn check_beside(&self, jacobian_known: bool) -> Result<(), Error> {
        let (n, nv) = self.shape();
        let jacobian = (!jacobian_known).then_some(self.jacobian);
        check_rows(n, nv, jacobian, self.aref, self.regularisation)?;
        check_finite("unconstrained", self.unconstrained)
    }
}

/// A borrowed view of one step. Matrices are dense and row-major, as NumPy keeps them.
#[derive(Debug, Clone, Copy)]
pub struct StepView<'a> {
    /// M (`nv×nv`), symmetric positive definite; only its upper triangle is read.
    pub mass: &'a [f64],
    /// J (`n×nv`).
    pub jacobian: &'a [f64],
    /// f (`nv`): all smooth forces, passive + applied + actuator − bias.
    pub force: &'a [f64],
    /// aref (`n`): the acceleration that the rows ask for.
    pub aref: &'a [f64],
    /// R (`n`, ≥ 0): softness that is added to the diagonal of A; `None` for exact (hard) constraints.
    pub regularisation: Option<&'a [f64]>,
}

impl StepView<'_> {
    /// Returns the numbers of constraint rows n and of velocities nv.
    #[must_use]
    pub const fn shape(&self) -> (usize, usize) {
        (self.aref.len(), self.force.len())
    }

    /// Checks that the shapes fit and that every number is finite.
    ///
    /// # Errors
    /// [`Error::Empty`], [`Error::Shape`], [`Error::NonFinite`], [`Error::NegativeRegularisation`].
    pub fn check(&self) -> Result<(), Error> {
        self.check_beside(false)
    }

    /// The same, where J may have been found in order already.
    pub(crate) fn check_beside(&self, jacobian_known: bool) -> Result<(), Error> {
        let (n, nv) = self.shape();
        let jacobian = (!jacobian_known).then_some(self.jacobian);
        check_rows(n, nv, jacobian, self.aref, self.regularisation)?;
        check_len("mass", self.mass.len(), &[nv, nv])?;
        check_finite("mass", self.mass)?;
        check_finite("force", self.force)
    }
}

fn check_rows(
    n: usize,
    nv: usize,
    jacobian: Option<&[f64]>,
    aref: &[f64],
    regularisation: Option<&[f64]>,
) -> Result<(), Error> {
    if n == 0 {
        return Err(Error::Empty { what: "aref" });
    }
    if nv == 0 {
        return Err(Error::Empty { what: "force" });
    }
    if let Some(jacobian) = jacobian {
        check_len("jacobian", jacobian.len(), &[n, nv])?;
        check_finite("jacobian", jacobian)?;
    }
    check_finite("aref", aref)?;
    if let Some(regularisation) = regularisation {
        check_len("regularisation", regularisation.len(), &[n])?;
        check_finite("regularisation", regularisation)?;
        if let Some(index) = regularisation.iter().position(|&value| value < 0.0) {
            return Err(Error::NegativeRegularisation { index, value: regularisation[index] });
        }
    }
    Ok(())
}
