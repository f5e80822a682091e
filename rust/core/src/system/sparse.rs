//! Systems of sparse steps: J and M as a mechanism has them, and dense matrices only for those who ask for them.

use nalgebra::DMatrix;

use super::ConstrainedSystem;
use crate::error::{Error, check_size};
use crate::linalg::rows::fresh_generation;
use crate::problem::Wanted;
use crate::problem::step::SparseStep;

/// Where the largest entry of J and all of 1/D lie within this and its reciprocal, squares neither overflow nor underflow. Beyond it W
/// is scaled by powers of two, and the step is treated as dense.
const ORDINARY: f64 = 1e40;

impl ConstrainedSystem {
    /// Assembles the system of one step of a mechanism whose inertia lies along a kinematic tree. Its patterns are planned at the first
    /// step, and anew where entries appear that were zero before or the fold no longer holds.
    ///
    /// # Errors
    /// Those of [`SparseStep::check`], which leave the last step in place; [`Error::NonFinite`] or [`Error::TooLarge`] if A
    /// or b overflow, which leave the system empty.
    pub fn assemble_sparse(&mut self, step: &SparseStep<'_>) -> Result<(), Error> {
        let (n, nv) = step.shape();
        let (known, same_tree) = (self.rows.knows(&step.jacobian, n, nv), self.tree.knows(&step.inertia));
        step.check_beside(known, same_tree)?;
        self.resize(n, nv);
        self.mass_factor = DMatrix::default();
        self.take_rows(&step.jacobian, known, step.regularisation);
        self.tree.take(&step.inertia, same_tree);
        self.planning.stale |= !same_tree | (self.planning.rows != self.rows.generation());
        self.planning.on_tree = true;
        if self.planning.stale || !self.blocks.are_found(nv) {
            self.find_blocks_by_pattern();
        }
        if self.planning.stale {
            self.planning.stale = false;
            self.planning.number = fresh_generation();
            self.planning.rows = self.rows.generation();
        }
        self.begin();
        self.unconstrained.copy_from_slice(step.unconstrained);
        self.at_work.fill(0.0);
        self.ask(step.aref);
        let ordinary = |value: f64| (1.0 / ORDINARY..=ORDINARY).contains(&value);
        if ordinary(self.rows.most()) && self.tree.inverse_diagonal().iter().all(|&entry| ordinary(entry)) {
            self.planning.plan = Some(self.planning.number);
            return check_size("b", self.rhs.as_slice()).inspect_err(|_| *self = Self::default());
        }
        self.form_whitened();
        self.check_overflow()
    }

    /// Blocks as the patterns of J and M couple rows: two of them meet in velocities that both touch or hang on.
    fn find_blocks_by_pattern(&mut self) {
        let (rows, tree) = (&self.rows, &self.tree);
        let touched = |&row: &usize| {
            let columns = rows.row(row).0.iter();
            columns.flat_map(|&velocity| tree.row(velocity).0.iter().copied())
        };
        let classes = self.fold.shares().map(|share| share.map(|(class, _)| class));
        self.blocks.find_touched(self.fold.representatives().iter().map(touched), self.nv(), classes);
        self.name_constraints();
    }

    /// Makes W now, for those who solve beside the equality rows.
    pub(crate) fn form_whitened(&mut self) {
        if self.planning.on_tree {
            self.problem(Wanted::Multipliers).whiten();
        }
    }
}
