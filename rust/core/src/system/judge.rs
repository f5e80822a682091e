//! What holds a solver to its word: an independent solve of the same step.
//!
//! A solver that iterates, or carries something from step to step, says `converged` by a test of its own, and where a rank
//! changes or a condition is bad that test can be met by a wrong answer. So its acceleration is held against that of a direct
//! solver that knows this step alone. `auto` judges all but itself and its parts, `pinv` judges those, and `svd`
//! judges `pinv`: nobody is held against himself.

use crate::info::Info;
use crate::solvers::RANK_CUT;
use crate::solvers::auto::{Auto, AutoParams};
use crate::solvers::pinv::{Pinv, PinvParams};
use crate::solvers::solver::{MultiplierSolver, Solver};
use crate::solvers::svd::{Svd, SvdParams};

/// What `converged` promises: the error of an acceleration, relative to the largest of its block, entry by entry.
pub const PROMISED: f64 = 1e-6;

/// The same in the norm of M, relative to what the constraints of its block make of it, where entries are within the promise for
/// certain, also where light bodies hang on heavy ones. Direct solvers leave √cond ε, 1e-11 at the rank cut.
pub(super) const CERTAIN: f64 = 5e-8;

/// Part of the largest block's acceleration below which that of another one is rounding.
pub(super) const ROUNDING: f64 = 1e-13;

/// A direct solver with its answer to the step at hand.
pub(super) struct Judge {
    pub(super) solver: Box<dyn MultiplierSolver>,
    /// Of the reduced rows, and of all.
    pub(super) reduced: Vec<f64>,
    pub(super) multipliers: Vec<f64>,
    pub(super) info: Info,
    /// Whether the answer is that of the present step.
    pub(super) fresh: bool,
}

/// The judges of one system, as far as they were asked.
#[derive(Default)]
pub(super) struct Judges {
    pub(super) all: Vec<Judge>,
    pub(super) gap: Vec<f64>,
    pub(super) work: Vec<f64>,
    /// Size of the acceleration of every block.
    pub(super) scales: Vec<f64>,
}

impl Clone for Judges {
    /// Answers are found anew.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Judges {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.all.iter().map(|judge| judge.solver.name())).finish()
    }
}

impl Judges {
    /// Another step: no answer is that of it.
    pub(super) fn adjourn(&mut self) {
        self.all.iter_mut().for_each(|judge| judge.fresh = false);
    }

    /// The place of the judge of a solver.
    pub(super) fn of(&mut self, solver: &dyn MultiplierSolver) -> usize {
        let (name, rank_cut) = (judge_of(solver.name()), solver.rank_cut().unwrap_or(RANK_CUT));
        let is_his = |judge: &Judge| judge.solver.name() == name && judge.solver.rank_cut() == Some(rank_cut);
        if let Some(at) = self.all.iter().position(is_his) {
            return at;
        }
        let solver: Box<dyn MultiplierSolver> = match name {
            "pinv" => Box::new(Pinv::new(PinvParams { rank_cut })),
            "svd" => Box::new(Svd::new(SvdParams { rank_cut })),
            _ => Box::new(Auto::new(AutoParams { rank_cut })),
        };
        let info = Info::trivial(0.0);
        self.all.push(Judge { solver, reduced: Vec::new(), multipliers: Vec::new(), info, fresh: false });
        self.all.len() - 1
    }
}

/// Name of the judge of a solver.
fn judge_of(solver: &str) -> &'static str {
    match solver {
        "auto" | "cholesky" | "dual" | "primal" => "pinv",
        "pinv" | "pinv-tracked" => "svd",
        _ => "auto",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_solver_is_judged_by_itself_or_by_what_it_is_a_part_of() {
        let parts = ["auto", "cholesky", "dual", "primal", "pinv"];
        for name in parts {
            assert!(judge_of(name) != name && judge_of(name) != "auto", "{name} by {}", judge_of(name));
        }
        assert_eq!([judge_of("sr1-tracked"), judge_of("cg"), judge_of("pinv")], ["auto", "auto", "svd"]);
    }
}
