//! Statuses that are promises: an answer is held against that of a judge.

use super::judge::{CERTAIN, Judges, PROMISED, ROUNDING};
use super::{ConstrainedSystem, power_of_two};
use crate::error::Error;
use crate::info::{Info, Status};
use crate::problem::Wanted;
use crate::solvers::solver::MultiplierSolver;

/// How far an acceleration may be off, in units of the residual that the stopping test allows.
const ALLOWED: f64 = 10.0;

impl ConstrainedSystem {
    /// Returns the minimum-norm multipliers of the step (`n`) and what is known of it, by a direct solver that is not `solver`
    /// and carries nothing from other steps. Each is asked once a step.
    ///
    /// # Errors
    /// Those of [`solve`](Self::solve).
    pub fn reference(&mut self, solver: &dyn MultiplierSolver) -> Result<(&[f64], &Info), Error> {
        let at = self.judge(solver)?;
        let judge = &self.judges.all[at];
        Ok((&judge.multipliers, &judge.info))
    }

    /// Holds a solver to its word: an answer with the status [`Converged`](Status::Converged) whose acceleration is off by more than
    /// [`PROMISED`], or by more than a tolerance that is looser allows, becomes [`Inaccurate`](Status::Inaccurate). A direct
    /// solver is taken at its word.
    ///
    /// Without M, which a factored step keeps to itself, accelerations are measured in its norm, and so strictly that entries
    /// are right for certain; [`confirm`](Self::confirm) then looks at them one by one.
    ///
    /// # Errors
    /// Those of [`solve`](Self::solve), of the judge.
    pub fn check(
        &mut self,
        solver: &dyn MultiplierSolver,
        multipliers: &[f64],
        info: &mut Info,
    ) -> Result<(), Error> {
        if solver.is_direct() || info.status != Status::Converged || self.reduced_rhs.is_empty() {
            return Ok(());
        }
        let at = self.judge(solver)?;
        let mut judges = std::mem::take(&mut self.judges);
        let reference = &judges.all[at].reduced;
        judges.gap.resize(reference.len(), 0.0);
        self.fold.reduce(multipliers, &mut judges.gap);
        // Where squares would underflow, the reference is in the units of what is solved.
        let scale =
            power_of_two(self.rhs_exponent) / power_of_two(self.exponent) / power_of_two(self.exponent);
        for (gap, reference) in judges.gap.iter_mut().zip(reference) {
            *gap = scale * *gap - reference;
        }
        let allowed = CERTAIN.max(ALLOWED * info.tolerance);
        let mut problem = self.problem(Wanted::Multipliers);
        problem.whiten();
        let blocks = || (0..problem.blocks.len()).map(|block| problem.blocks.of(block));
        let Judges { all, work, scales, gap } = &mut judges;
        let reference = &all[at].reduced;
        scales.clear();
        scales.extend(blocks().map(|rows| {
            let part = rows.iter().map(|&row| problem.rhs[row] * problem.rhs[row]).sum::<f64>().sqrt();
            let trace = rows.iter().map(|&row| problem.diagonal(row)).sum::<f64>();
            let floor = if trace > 0.0 { part / trace.sqrt() } else { 0.0 };
            problem.acceleration_norm(rows, reference, work).max(floor)
        }));
        // Block by block: a fast mechanism says nothing of a slow one beside it.
        let most = scales.iter().fold(0.0_f64, |most, &scale| most.max(scale));
        let wrong = blocks().zip(&*scales).any(|(rows, scale)| {
            let bound = allowed * scale + ROUNDING * most;
            let off = problem.acceleration_norm(rows, gap, work);
            // A NaN is no promise either.
            off > bound || off.is_nan() || bound.is_nan()
        });
        self.judges = judges;
        if wrong {
            info.status = Status::Inaccurate;
            self.confirm_by_mass(at, multipliers, info)?;
        }
        Ok(())
    }

    /// Takes [`Inaccurate`](Status::Inaccurate) back where every entry of an acceleration (`nv`) is within the promise of the
    /// [`reference`](Self::reference)'s, block by block.
    pub fn confirm(&self, qacc: &[f64], reference: &[f64], info: &mut Info) {
        if info.status != Status::Inaccurate || self.blocks.is_empty() {
            return;
        }
        let size = |entries: &[f64], block: usize| {
            let own = entries
                .iter()
                .enumerate()
                .filter(|&(velocity, _)| self.blocks.owner(velocity) == Some(block));
            own.fold(0.0_f64, |most, (_, entry)| most.max(entry.abs()))
        };
        // At rest on a floor only what pushes and what it holds up have a size.
        let starts = [self.unconstrained.as_slice(), self.at_work.as_slice()];
        let scale = |block: usize| {
            starts.iter().fold(size(reference, block), |most, start| most.max(size(start, block)))
        };
        let most = (0..self.blocks.len()).map(scale).fold(0.0, f64::max);
        let allowed = PROMISED.max(ALLOWED * info.tolerance);
        let right = (0..self.blocks.len()).all(|block| {
            let bound = allowed * scale(block) + ROUNDING * most;
            qacc.iter()
                .zip(reference)
                .enumerate()
                .filter(|&(velocity, _)| self.blocks.owner(velocity) == Some(block))
                .all(|(_, (entry, reference))| (entry - reference).abs() <= bound)
        });
        if right {
            info.status = Status::Converged;
        }
    }

    /// The same of a system that has M itself.
    fn confirm_by_mass(&mut self, judge: usize, multipliers: &[f64], info: &mut Info) -> Result<(), Error> {
        if self.mass_factor.is_empty() {
            return Ok(());
        }
        let nv = self.nv();
        let (mut qfrc, mut qacc, mut reference) = (vec![0.0; nv], vec![0.0; nv], vec![0.0; nv]);
        let least = self.judges.all[judge].multipliers.clone();
        self.acceleration(multipliers, &mut qfrc, &mut qacc)?;
        self.acceleration(&least, &mut qfrc, &mut reference)?;
        self.confirm(&qacc, &reference, info);
        Ok(())
    }

    /// Asks the judge of a solver, unless it has answered this step already; gives its place.
    fn judge(&mut self, solver: &dyn MultiplierSolver) -> Result<usize, Error> {
        let at = self.judges.of(solver);
        if self.judges.all[at].fresh {
            return Ok(at);
        }
        let mut judges = std::mem::take(&mut self.judges);
        let judge = &mut judges.all[at];
        judge.multipliers.resize(self.len(), 0.0);
        // Of earlier steps not even the order of pivots.
        judge.solver.reset();
        let solved = self.solve_unchecked(&mut *judge.solver, Wanted::Multipliers, &mut judge.multipliers);
        if let Ok(info) = &solved {
            judge.info = *info;
            judge.fresh = true;
            judge.reduced.resize(self.reduced_rhs.len(), 0.0);
            judge.reduced.copy_from_slice(&self.solution);
        }
        self.judges = judges;
        solved.map(|_| at)
    }
}
