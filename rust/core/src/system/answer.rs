//! From the assembled step to multipliers, and from multipliers back to accelerations.

use std::mem;

use super::ConstrainedSystem;
use super::scale::power_of_two;
use crate::error::{Error, check_finite, check_len};
use crate::info::Info;
use crate::linalg::kernels::norm;
use crate::problem::{Needs, Wanted};
use crate::solvers::solver::MultiplierSolver;

impl ConstrainedSystem {
    /// Solves A λ = b with `solver`, writes λ to `multipliers` (`n`), and holds it to its word: see [`check`](Self::check). The
    /// status [`Converged`](crate::Status::Converged) then means that the acceleration is right, whatever solver it was.
    ///
    /// # Errors
    /// Those of [`solve_unchecked`](Self::solve_unchecked).
    pub fn solve(
        &mut self,
        solver: &mut dyn MultiplierSolver,
        wanted: Wanted,
        multipliers: &mut [f64],
    ) -> Result<Info, Error> {
        let mut info = self.solve_unchecked(solver, wanted, multipliers)?;
        self.check(solver, multipliers, &mut info)?;
        Ok(info)
    }

    /// Solves as [`solve`](Self::solve) does and takes the status from the solver: what the solver itself costs.
    ///
    /// If λ or its residual overflows, that is an error, and the solver starts anew, as after
    /// [`reset`](MultiplierSolver::reset). Products A b below 1e-150 may underflow and count as zero.
    ///
    /// # Errors
    /// Those of the solver, [`Error::Shape`], and [`Error::NonFinite`] where λ or its residual overflow.
    pub fn solve_unchecked(
        &mut self,
        solver: &mut dyn MultiplierSolver,
        wanted: Wanted,
        multipliers: &mut [f64],
    ) -> Result<Info, Error> {
        check_len("multipliers", multipliers.len(), &[self.len()])?;
        if self.is_empty() {
            return Err(Error::Empty { what: "system" });
        }
        if self.reduced_rhs.is_empty() {
            // Every row is zero: A = 0, A⁺ = 0.
            multipliers.fill(0.0);
            check_finite("residual", &[self.outside])?;
            return Ok(Info { folded: self.len(), refolded: self.refolded, ..Info::trivial(self.outside) });
        }
        let mut solution = mem::take(&mut self.solution);
        let mut problem = self.problem(wanted);
        if solver.needs() == Needs::Dense {
            problem.matrix();
        }
        let solved = solver.solve(&mut problem, &mut solution);
        self.solution = solution;
        let mut info = solved?;
        self.fold.expand(&self.solution, multipliers);
        let (scale, rhs_scale) = (power_of_two(self.exponent), power_of_two(self.rhs_exponent));
        if (self.exponent, self.rhs_exponent) != (0, 0) {
            for entry in multipliers.iter_mut() {
                *entry = *entry * scale / rhs_scale * scale;
            }
        }
        let (norm, inside) = (norm(self.rhs.as_slice()), norm(self.reduced_rhs.as_slice()) / rhs_scale);
        if norm > 0.0 {
            info.residual_rel *= inside / norm;
        }
        info.inconsistency = info.inconsistency.map(|part| (part / rhs_scale).hypot(self.outside));
        check_finite("multipliers", multipliers)
            .and_then(|()| check_finite("residual", &[info.residual_rel, info.inconsistency.unwrap_or(0.0)]))
            .inspect_err(|_| solver.reset())?;
        info.folded = self.len() - self.fold.reduced();
        info.refolded = self.refolded;
        info.risen = self.blocks.has_risen();
        Ok(info)
    }

    /// Computes `qfrc = Jᵀ λ` and `qacc = a₀ + M⁻¹ Jᵀ λ` (both `nv`).
    ///
    /// # Errors
    /// [`Error::Shape`], also for a system given as dense (A, b), which has no accelerations; [`Error::Factored`];
    /// [`Error::NonFinite`] if they overflow.
    pub fn acceleration(
        &mut self,
        multipliers: &[f64],
        qfrc: &mut [f64],
        qacc: &mut [f64],
    ) -> Result<(), Error> {
        check_len("multipliers", multipliers.len(), &[self.len()])?;
        check_len("qfrc", qfrc.len(), &[self.nv()])?;
        check_len("qacc", qacc.len(), &[self.nv()])?;
        if self.mass_factor.is_empty() && !self.planning.on_tree && self.nv() > 0 {
            return Err(Error::Factored);
        }
        self.force(multipliers, qfrc)?;
        if self.planning.on_tree {
            self.tree.solve(self.work.as_mut_slice());
        } else {
            self.mass_factor.solve_lower_triangular_mut(&mut self.work);
            self.mass_factor.tr_solve_lower_triangular_mut(&mut self.work);
        }
        self.work += &self.unconstrained;
        qacc.copy_from_slice(self.work.as_slice());
        check_finite("qacc", qacc)
    }

    /// Computes `qfrc = Jᵀ λ` (`nv`).
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NonFinite`] if it overflows.
    pub fn force(&mut self, multipliers: &[f64], qfrc: &mut [f64]) -> Result<(), Error> {
        check_len("multipliers", multipliers.len(), &[self.len()])?;
        check_len("qfrc", qfrc.len(), &[self.nv()])?;
        self.rows.combine(multipliers, self.work.as_mut_slice());
        qfrc.copy_from_slice(self.work.as_slice());
        check_finite("qfrc", qfrc)
    }
}
