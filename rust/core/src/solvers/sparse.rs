//! The frame of the sparse direct solvers, [`dual`](crate::solvers::dual) and [`primal`](crate::solvers::primal): a factor of what a step has
//! of sparse, and rank-revealing Cholesky where a step is given dense or the factor does not prove the rank.

use std::marker::PhantomData;

use crate::error::{Error, check_len};
use crate::info::Info;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::cholesky::{Cholesky, CholeskyParams};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::solver::{Solver, State};

/// A sparse factor with its patterns and workspace.
pub trait SparseFactor: Clone + Send + Sync + 'static {
    /// Name in the registry.
    const NAME: &'static str;
    /// One line on what it is.
    const SUMMARY: &'static str;

    /// Makes one before its first step. `rank_cut`: eigenvalues below this part of the largest count as zero.
    fn new(rank_cut: f64) -> Self;

    /// Solves a sparse step into x (`n`), with minimum norm; `None` where the rank is not proved, or refinement does not
    /// converge, and x is worthless then.
    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Option<Info>;

    /// Forgets the numbers of earlier steps.
    fn forget(&mut self) {}
}

/// Parameters of [`Sparse`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseParams<F> {
    /// Eigenvalues below this part of the largest count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
    /// The factor.
    pub factor: PhantomData<F>,
}

impl<F: SparseFactor> Params for SparseParams<F> {
    const SOLVER: &'static str = F::NAME;

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)?, factor: PhantomData })
    }
}

/// A sparse factor with Cholesky behind it.
#[derive(Clone)]
pub struct Sparse<F> {
    rank_cut: f64,
    factor: F,
    dense: Cholesky,
}

impl<F: SparseFactor> Solver for Sparse<F> {
    type Params = SparseParams<F>;
    const SUMMARY: &'static str = F::SUMMARY;
    const NEEDS: Needs = Needs::Sparse;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.rank_cut)
    }

    fn new(params: SparseParams<F>) -> Self {
        let rank_cut = params.rank_cut;
        Self { rank_cut, factor: F::new(rank_cut), dense: Cholesky::new(CholeskyParams { rank_cut }) }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        check_len("x", x.len(), &[problem.len()])?;
        if let Some(info) = self.factor.solve(problem, x) {
            return Ok(info);
        }
        // A step that is given dense is no event.
        let fallbacks = usize::from(problem.sparse.is_some());
        self.dense.solve(problem, x).map(|info| Info { fallbacks, ..info })
    }

    fn reset(&mut self) {
        self.factor.forget();
        Solver::reset(&mut self.dense);
    }

    fn state(&self) -> State {
        self.dense.save(F::NAME)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.dense.load(state, F::NAME)
    }
}
