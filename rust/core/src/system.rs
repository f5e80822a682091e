//! The system A λ = b of one step: from a [`StepView`] to what a solver sees, and from multipliers back to accelerations.

mod answer;
mod check;
mod given;
mod inspect;
mod judge;
mod parts;
mod planning;
mod renew;
mod scale;
mod sparse;

use std::mem;

use self::judge::Judges;
pub use self::judge::PROMISED;
pub(crate) use self::parts::Parts;
use self::planning::Planning;
use self::scale::{exponent_of_factor, exponent_of_small, power_of_two};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::error::{Error, LARGEST, check_size};
use crate::linalg::rows::SparseRows;
use crate::linalg::tree::Tree;
use crate::problem::fold::Fold;
use crate::problem::step::{FactoredStep, JacobianView, StepView, Whiten};
use crate::problem::whitened::{Sparse, Whitened};
use crate::problem::{Blocks, Problem, Wanted};

/// Largest asymmetry of a dense A that a caller hands over, relative to its largest entry. `A = J M⁻¹ Jᵀ` computed in any
/// sensible way is symmetric to a few rounding errors; 1e-10 leaves room for large sums and still catches a wrong matrix.
pub const SYMMETRY_TOLERANCE: f64 = 1e-10;

/// The linear system of one step. It is made once and filled anew every step, and allocates only when the shape or the fold
/// changes.
///
/// With `M = L Lᵀ`, the fold `J = T Jr` and `W = L⁻¹ Jrᵀ` (nv×nr), a solver sees `A = Wᵀ W (+ R)`, and
/// `a = a₀ + M⁻¹ Jᵀ λ`, where `a₀ = M⁻¹ f` is the acceleration without constraints. Soft rows (R given) are not folded:
/// the identity that makes folding exact does not hold for A + R.
#[derive(Debug, Clone, Default)]
pub struct ConstrainedSystem {
    fold: Fold,
    /// Whether the fold was found, on hard rows of this shape.
    planned: bool,
    /// Times that a fold had to be found anew since the first one.
    refolds: usize,
    refolded: bool,
    /// ‖b − T Tᵀ b‖.
    outside: f64,
    blocks: Blocks,
    /// Exponents of the powers of two that W and b were multiplied by, lest squares of their entries underflow; 0 next to always.
    exponent: i32,
    rhs_exponent: i32,
    /// Constraint of every row; see [`set_constraints`](Self::set_constraints).
    constraints: Vec<usize>,
    /// Gaps of the next step; see [`hold_rank`](Self::hold_rank).
    gaps: Vec<f64>,
    /// L; empty where the inertia is somebody else's.
    mass_factor: DMatrix<f64>,
    /// M, where it lies along a tree.
    tree: Tree,
    planning: Planning,
    /// J.
    rows: SparseRows,
    /// Rows of J that stand for their class, for somebody else's factor.
    representatives: Vec<f64>,
    whitened: Whitened,
    softness: Option<Vec<f64>>,
    dense: DMatrix<f64>,
    formed: bool,
    given: DMatrix<f64>,
    /// For [`check_semidefinite`](Self::check_semidefinite).
    shifted: DMatrix<f64>,
    rhs: DVector<f64>,
    reduced_rhs: DVector<f64>,
    unconstrained: DVector<f64>,
    /// What it was before other forces were added: largest magnitude of each entry since the step was assembled.
    at_work: Vec<f64>,
    work: DVector<f64>,
    solution: Vec<f64>,
    judges: Judges,
}

impl ConstrainedSystem {
    /// Returns an empty system, which [`assemble`](Self::assemble) or [`set_dense`](Self::set_dense) fills.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the number of rows n.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rhs.len()
    }

    /// Tells whether nothing has been assembled yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rhs.is_empty()
    }

    /// Returns the number of velocities nv; 0 for a system that was given as dense (A, b).
    #[must_use]
    pub fn nv(&self) -> usize {
        self.unconstrained.len()
    }

    /// Returns b (`n`) before folding.
    #[must_use]
    pub fn rhs(&self) -> &[f64] {
        self.rhs.as_slice()
    }

    /// Returns a₀ = M⁻¹ f (`nv`), the acceleration without constraints.
    #[must_use]
    pub fn unconstrained(&self) -> &[f64] {
        self.unconstrained.as_slice()
    }

    /// Returns the fold of the rows.
    #[must_use]
    pub const fn fold(&self) -> &Fold {
        &self.fold
    }

    /// Returns the blocks of rows that A does not couple, of those that folding left.
    #[must_use]
    pub const fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Says how far each row (`n`) of the next step stands open, as a part of the length that it turns on (a metre of a connect
    /// over the longest lever of a joint that moves it; 0 of a row that does not turn), and asks to hold the rank along the
    /// path that the step belongs to.
    ///
    /// The first such step of a system decides the rank and should be closed to rounding. A later step without this
    /// call is cut on its own. See [`blocks`](crate::problem::blocks).
    pub fn hold_rank(&mut self, gaps: &[f64]) {
        self.gaps.clear();
        self.gaps.extend(gaps.iter().map(|gap| gap.abs()));
    }

    /// Tells which constraint each row (`n`) of the steps to come belongs to: the three rows of a connect belong to one. Rows of a
    /// constraint have one unit; without this call all rows have.
    pub fn set_constraints(&mut self, constraints: impl Iterator<Item = usize> + Clone) {
        if !self.constraints.iter().copied().eq(constraints.clone()) {
            self.constraints.clear();
            self.constraints.extend(constraints);
            self.blocks.invalidate();
        }
    }

    /// Returns how often the classes of the fold no longer held and were found anew.
    #[must_use]
    pub const fn refolds(&self) -> usize {
        self.refolds
    }

    /// Makes a solver that needs A form it once more, as on a new step. This is for timing.
    #[cfg(feature = "bench")]
    pub(crate) fn forget_matrix(&mut self) {
        self.formed = self.nv() == 0;
    }

    /// Forms A now instead of in the solve. This is for timing.
    pub fn form_matrix(&mut self) {
        if !self.reduced_rhs.is_empty() {
            self.problem(Wanted::Multipliers).matrix();
        }
    }

    fn problem(&mut self, wanted: Wanted) -> Problem<'_> {
        Problem {
            wanted,
            blocks: &mut self.blocks,
            sparse: self.planning.on_tree.then_some(Sparse {
                rows: &self.rows,
                fold: &self.fold,
                tree: &self.tree,
                plan: self.planning.plan,
            }),
            whitened: &mut self.whitened,
            softness: self.softness.as_deref(),
            dense: self.dense.as_mut_slice(),
            formed: &mut self.formed,
            rhs: self.reduced_rhs.as_slice(),
            work: self.work.as_mut_slice(),
        }
    }

    fn resize(&mut self, n: usize, nv: usize) {
        if (self.len(), self.nv()) == (n, nv) {
            return;
        }
        *self = Self {
            gaps: mem::take(&mut self.gaps),
            constraints: mem::take(&mut self.constraints),
            judges: mem::take(&mut self.judges),
            tree: mem::take(&mut self.tree),
            rhs: DVector::zeros(n),
            unconstrained: DVector::zeros(nv),
            at_work: vec![0.0; nv],
            work: DVector::zeros(nv),
            ..Self::default()
        };
    }

    fn refit(&mut self) -> bool {
        match self.nv() {
            0 => self.fold.refit(self.given.as_slice(), self.given.nrows()),
            _ => self.fold.refit_in(&self.rows),
        }
    }

    /// Fits the fold to the rows of this step, or finds it anew.
    fn refold(&mut self, foldable: bool) {
        let n = self.len();
        self.refolded = false;
        if !foldable {
            self.planned = false;
            if !(self.fold.is_identity() && self.fold.rows() == n) {
                self.blocks.invalidate();
                self.planning.stale = true;
                self.fold = Fold::identity(n);
            }
        } else if !(self.planned && self.refit()) {
            self.refolded = self.planned;
            self.refolds += usize::from(self.refolded);
            self.fold = match self.nv() {
                0 => Fold::find(self.given.as_slice(), n),
                _ => Fold::find_in(&self.rows),
            };
            self.planned = true;
            self.planning.stale = true;
            self.blocks.invalidate();
        }
        let reduced = self.fold.reduced();
        let shapes = (self.reduced_rhs.len(), self.dense.nrows(), self.whitened.columns.shape());
        if shapes != (reduced, reduced, (self.nv(), reduced)) {
            self.whitened = Whitened { columns: DMatrix::zeros(self.nv(), reduced), ..Whitened::default() };
            self.dense = DMatrix::zeros(reduced, reduced);
            self.reduced_rhs = DVector::zeros(reduced);
            self.solution = vec![0.0; reduced];
        }
        self.formed = false;
        self.whitened.made = false;
        self.exponent = 0;
        self.judges.adjourn();
    }

    /// Assembles the system of one step.
    ///
    /// # Errors
    /// Those of [`StepView::check`], which leave the last step in place; [`Error::MassNotPositiveDefinite`], and
    /// [`Error::NonFinite`] or [`Error::TooLarge`] if A or b overflow, which leave the system empty.
    pub fn assemble(&mut self, step: &StepView<'_>) -> Result<(), Error> {
        step.check()?;
        let (n, nv) = step.shape();
        self.resize(n, nv);

        // A symmetric row-major M is its own column-major form.
        let mut factor = mem::take(&mut self.mass_factor);
        if factor.nrows() != nv {
            factor = DMatrix::zeros(nv, nv);
        }
        factor.copy_from_slice(step.mass);
        // A pivot that has cancelled to rounding is none: M is singular.
        let sound = |factor: &Cholesky<f64, Dyn>| {
            let (pivots, floor) = (factor.l_dirty(), nv as f64 * f64::EPSILON);
            (0..nv).all(|i| pivots[(i, i)].powi(2) > floor * step.mass[i * nv + i])
        };
        let Some(factor) = Cholesky::new(factor).filter(sound) else {
            // The old factor went with the attempt: without it there is no way back to accelerations.
            *self = Self::default();
            let diagonal = (0..nv).map(|i| step.mass[i * nv + i]);
            return Err(Error::MassNotPositiveDefinite {
                smallest: diagonal.clone().fold(f64::INFINITY, f64::min),
                largest: diagonal.fold(f64::NEG_INFINITY, f64::max),
            });
        };
        self.mass_factor = factor.unpack_dirty();

        let jacobian = JacobianView::Dense(step.jacobian);
        self.take_rows(&jacobian, self.rows.knows(&jacobian, n, nv), step.regularisation);
        let columns = self.whitened.columns.as_mut_slice().chunks_exact_mut(nv);
        for (column, (representative, scale)) in columns.zip(self.fold.classes()) {
            self.rows.scatter(representative, scale, column);
        }
        self.mass_factor.solve_lower_triangular_mut(&mut self.whitened.columns);
        self.locate();

        self.unconstrained.copy_from_slice(step.force);
        self.mass_factor.solve_lower_triangular_mut(&mut self.unconstrained);
        self.mass_factor.tr_solve_lower_triangular_mut(&mut self.unconstrained);
        self.at_work.fill(0.0);
        self.ask(step.aref);
        self.check_overflow()
    }

    /// Assembles the system of a step whose inertia the caller has factored; `whiten` multiplies rows of J by the factor H. The
    /// way back from multipliers then ends at [`force`](Self::force), because M⁻¹ stays with the caller.
    ///
    /// # Errors
    /// Those of [`FactoredStep::check`], which leave the last step in place; [`Error::NonFinite`] or [`Error::TooLarge`] if A
    /// or b overflow, which leave the system empty.
    pub fn assemble_factored(
        &mut self,
        step: &FactoredStep<'_>,
        whiten: &mut Whiten<'_>,
    ) -> Result<(), Error> {
        step.check()?;
        let (n, nv) = step.shape();
        self.resize(n, nv);
        self.mass_factor = DMatrix::default();
        let jacobian = JacobianView::Dense(step.jacobian);
        self.take_rows(&jacobian, self.rows.knows(&jacobian, n, nv), step.regularisation);
        let columns = self.whitened.columns.as_mut_slice();
        if self.fold.is_identity() {
            whiten(self.fold.representatives(), step.jacobian, columns);
        } else {
            self.representatives.clear();
            for &row in self.fold.representatives() {
                self.representatives.extend_from_slice(&step.jacobian[row * nv..(row + 1) * nv]);
            }
            whiten(self.fold.representatives(), &self.representatives, columns);
        }
        self.locate();
        let columns = self.whitened.columns.as_mut_slice().chunks_exact_mut(nv).zip(self.fold.classes());
        for (class, (column, (_, scale))) in columns.enumerate() {
            for entry in self.whitened.spans.cut_mut(class, column) {
                *entry *= scale;
            }
        }
        self.unconstrained.copy_from_slice(step.unconstrained);
        self.at_work.fill(0.0);
        self.ask(step.aref);
        self.check_overflow()
    }

    /// J, its fold, and R, of a step that has no tree unless the caller says so.
    /// `known`: J is laid out as the last one.
    fn take_rows(&mut self, jacobian: &JacobianView<'_>, known: bool, regularisation: Option<&[f64]>) {
        self.rows.take(jacobian, known, self.len(), self.nv());
        self.planning.leave_tree();
        self.refold(regularisation.is_none());
        match (regularisation, &mut self.softness) {
            (None, softness) => *softness = None,
            (Some(given), Some(softness)) if softness.len() == given.len() => softness.copy_from_slice(given),
            (Some(given), softness) => *softness = Some(given.to_vec()),
        }
    }

    /// Where the entries of W, and so those of A, lie; and the blocks that follow.
    fn locate(&mut self) {
        if self.whitened.locate() {
            // Only the envelope is written to from now on.
            self.dense.fill(0.0);
        }
        let columns = self.whitened.columns.as_slice();
        if !self.blocks.hold(columns, self.nv(), !self.gaps.is_empty()) {
            let classes = self.fold.shares().map(|share| share.map(|(class, _)| class));
            self.blocks.find(columns, self.nv(), classes);
            self.name_constraints();
        }
        self.begin();
    }

    /// Tells the blocks which constraint each of their rows belongs to.
    fn name_constraints(&mut self) {
        let known = self.constraints.len() == self.fold.rows();
        let representatives = self.fold.representatives().iter().filter(|_| known);
        self.blocks.set_constraints(representatives.map(|&row| self.constraints[row]));
    }

    /// Begins a step whose blocks are found.
    fn begin(&mut self) {
        self.blocks.step(if self.softness.is_none() { &self.gaps } else { &[] });
        self.gaps.clear();
    }

    /// b = aref − J a₀.
    fn ask(&mut self, aref: &[f64]) {
        let (start, rhs) = (self.unconstrained.as_slice(), self.rhs.as_mut_slice());
        self.rows.products(start, |row, product| rhs[row] = aref[row] - product);
        self.reduce_rhs();
    }

    /// b of the reduced rows, scaled where it is small.
    fn reduce_rhs(&mut self) {
        self.outside = self.fold.reduce(self.rhs.as_slice(), self.reduced_rhs.as_mut_slice());
        self.rhs_exponent = exponent_of_small(self.reduced_rhs.amax());
        if self.rhs_exponent != 0 {
            self.reduced_rhs *= power_of_two(self.rhs_exponent);
        }
    }

    /// Finite input can still overflow: the diagonal of A bounds its other entries.
    fn check_overflow(&mut self) -> Result<(), Error> {
        let (n, softness) = (self.reduced_rhs.len(), self.softness.as_deref());
        let (mut most, mut overflow) = (0.0_f64, None);
        let Whitened { columns, spans, .. } = &self.whitened;
        spans.products(columns.as_slice(), None, |i, square| {
            let entry = square + softness.map_or(0.0, |softness| softness[i]);
            most = most.max(entry);
            if overflow.is_none() && (!entry.is_finite() || entry > LARGEST) {
                overflow = Some((i * n + i, entry));
            }
        });
        let checked = match overflow {
            Some((index, value)) if value.is_finite() => Err(Error::TooLarge { what: "A", index, value }),
            Some((index, value)) => Err(Error::NonFinite { what: "A", index, value }),
            None => check_size("b", self.rhs.as_slice()),
        };
        checked.inspect_err(|_| *self = Self::default())?;
        self.exponent = exponent_of_factor(self.whitened.columns.as_slice(), most);
        if self.exponent != 0 {
            self.whitened.columns *= power_of_two(self.exponent);
            self.softness.iter_mut().flatten().for_each(|entry| *entry *= power_of_two(2 * self.exponent));
        }
        Ok(())
    }
}
