//! The frame of the Krylov solvers without preconditioner, [`cg`](crate::solvers::cg) and [`minres`](crate::solvers::minres): products with
//! A, and nothing carried but the last x.
//!
//! Both seek x in x₀ + K, K = span{r₀, A r₀, A² r₀, …}, with r = Π (b − A x) (the other sign than the quasi-Newton solvers), until
//! ‖r‖ ≤ rtol ‖b‖. Recurrences drift: when a method claims to be done, r is computed, and unless it agrees the method starts
//! anew from there, [`PASSES`] times in all. A pass that makes ‖r‖ larger is undone.
//!
//! **The null space.** A method that sees A by products alone cannot tell an eigenvalue that drift has made from one that
//! counts: on loops that stand open it converges to multipliers that are wrong by a factor of 1e5, with a residual of
//! 1e-10. And where b leaves range(A), nothing converges. Π = 1 − N Nᵀ is therefore that of everybody else, from a decomposition
//! of A in every step, and b, r and x are held in range(A): x has minimum norm, also from a warm start. The price is that
//! of `pinv`; what these methods show is how many products they need beside it.

use std::marker::PhantomData;

use crate::error::{Error, check_len};
use crate::info::{Info, Status};
use crate::linalg::kernels::norm;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem};
use crate::solvers::eigen::{RANK_CUT, SymmetricEigen};
use crate::solvers::solver::{Solver, State};

/// Times that a method is run from a computed residual in one solve.
pub(crate) const PASSES: usize = 3;

/// Rounding of b − A x, relative to ‖b‖ + ‖A‖ ‖x‖: a few units in the last place for each of a few terms.
pub(crate) const NOISE: f64 = 16.0 * f64::EPSILON;

/// Work vectors, `n` each; what they hold means nothing between passes.
pub type Space = [Vec<f64>; 5];

/// When a solve is done, and what it knows so far.
#[derive(Debug, Clone, Copy)]
pub struct Goal {
    /// ‖r‖ wanted.
    pub tolerance: f64,
    /// ‖A‖, from below.
    pub norm: f64,
    /// Iterations left; each takes one product.
    pub left: usize,
}

/// How a pass ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The recurrences say that it is done.
    Claimed,
    /// No iterations left.
    Limit,
    /// No curvature, no progress or an overflow.
    Stuck,
}

/// A Krylov method.
pub trait Method: Clone + Send + Sync + 'static {
    /// Name in the registry.
    const NAME: &'static str;
    /// One line on what it is.
    const SUMMARY: &'static str;

    /// Iterates from x and r = b − A x (`n` each) until it is done, by its recurrences, or cannot go on; x is then the best
    /// it has, and r worthless.
    fn run(
        space: &mut Space,
        problem: &mut Problem<'_>,
        x: &mut [f64],
        r: &mut [f64],
        goal: &mut Goal,
    ) -> End;
}

/// Default of the stopping test.
const RTOL: f64 = 1e-10;

/// Parameters of [`Krylov`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KrylovParams<M> {
    /// Of the stopping test ‖Π (A x − b)‖ ≤ rtol ‖b‖; > 0.
    pub rtol: f64,
    /// Iterations, of all passes, after which a solve gives up; one product each.
    pub max_iterations: usize,
    /// Whether a solve starts from the x of the last one.
    pub warm: bool,
    /// Rank cut of the null space; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
    /// The method.
    pub method: PhantomData<M>,
}

impl<M: Method> Params for KrylovParams<M> {
    const SOLVER: &'static str = M::NAME;

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            rtol: reader.positive("rtol", RTOL)?,
            max_iterations: reader.count("max_iterations", 500)?,
            warm: reader.switch("warm", true)?,
            rank_cut: reader.fraction("rank_cut", RANK_CUT)?,
            method: PhantomData,
        })
    }
}

/// A Krylov method with the x of the last solve.
#[derive(Clone)]
pub struct Krylov<M> {
    params: KrylovParams<M>,
    x: Vec<f64>,
    /// Whether x is that of a solve.
    kept: bool,
    eigen: SymmetricEigen,
    /// Π b.
    b: Vec<f64>,
    r: Vec<f64>,
    /// x before a pass.
    before: Vec<f64>,
    space: Space,
}

impl<M: Method> Krylov<M> {
    fn resize(&mut self, n: usize) {
        if self.x.len() != n {
            self.kept = false;
            self.eigen = SymmetricEigen::new(n);
            self.x = vec![0.0; n];
            self.b = vec![0.0; n];
            self.r = vec![0.0; n];
            self.before = vec![0.0; n];
            self.space = std::array::from_fn(|_| vec![0.0; n]);
        }
    }

    /// r = Π (b − A x), computed; gives ‖r‖.
    fn residual(&mut self, problem: &mut Problem<'_>) -> f64 {
        problem.apply(&self.x, &mut self.r);
        for (r, b) in self.r.iter_mut().zip(&self.b) {
            *r = b - *r;
        }
        self.eigen.project(&mut self.r);
        norm(&self.r)
    }
}

impl<M: Method> Solver for Krylov<M> {
    type Params = KrylovParams<M>;
    const SUMMARY: &'static str = M::SUMMARY;
    const NEEDS: Needs = Needs::Dense;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: KrylovParams<M>) -> Self {
        Self {
            params,
            x: Vec::new(),
            kept: false,
            eigen: SymmetricEigen::new(0),
            b: Vec::new(),
            r: Vec::new(),
            before: Vec::new(),
            space: Space::default(),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        let KrylovParams { rtol, max_iterations, warm, rank_cut, .. } = self.params;
        let (matrix, blocks) = problem.matrix_and_blocks();
        self.eigen.decompose(matrix, rank_cut, blocks)?;
        self.b.copy_from_slice(problem.rhs());
        let inconsistency = self.eigen.project(&mut self.b);
        let (b_norm, asked) = (norm(problem.rhs()), norm(&self.b));
        let (mut r_norm, mut checks) = (asked, 0);
        if warm && self.kept {
            self.eigen.project(&mut self.x);
            r_norm = self.residual(problem);
            checks += 1;
        }
        if !(warm && self.kept && r_norm < asked) {
            self.x.fill(0.0);
            self.r.copy_from_slice(&self.b);
            r_norm = asked;
        }
        let tolerance = rtol * b_norm;
        let mut goal = Goal { tolerance, norm: 0.0, left: max_iterations };
        let mut status = Status::Breakdown;
        for pass in 0..=PASSES {
            if r_norm <= tolerance && r_norm.is_finite() {
                status = Status::Converged;
            }
            if status == Status::Converged || pass == PASSES {
                break;
            }
            self.before.copy_from_slice(&self.x);
            let end = M::run(&mut self.space, problem, &mut self.x, &mut self.r, &mut goal);
            self.eigen.project(&mut self.x);
            let reached = self.residual(problem);
            checks += 1;
            let noise = NOISE * (b_norm + goal.norm * norm(&self.x));
            if reached > r_norm + noise || reached.is_nan() {
                self.x.copy_from_slice(&self.before);
                break;
            }
            r_norm = reached;
            if r_norm > tolerance && end == End::Limit {
                status = Status::IterationLimit;
                break;
            }
            if r_norm > tolerance && end == End::Stuck {
                break;
            }
        }
        self.kept = status != Status::Breakdown;
        x.copy_from_slice(&self.x);
        let iterations = max_iterations - goal.left;
        Ok(Info {
            status,
            iterations,
            products: iterations + checks,
            residual_rel: if b_norm == 0.0 { 0.0 } else { r_norm / b_norm },
            inconsistency: Some(inconsistency),
            rank: Some(self.eigen.rank()),
            null_residual: Some(self.eigen.null_residual()),
            margin: Some(self.eigen.margin()),
            tolerance: if rtol > RTOL { rtol } else { 0.0 },
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        self.kept = false;
    }

    fn state(&self) -> State {
        let state = State::new(M::NAME, self.x.len());
        if self.kept { state.with("x", &self.x) } else { state }
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        let last = state.last_x(M::NAME)?;
        if let Some(x) = last {
            self.resize(x.len());
            self.x.copy_from_slice(x);
        }
        self.kept = last.is_some();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_problems::{RANK, ROWS, boat};
    use crate::{ConstrainedSystem, MultiplierSolver, Options, Wanted, make_solver};

    #[test]
    fn the_boat_is_solved_in_no_more_iterations_than_its_rank_and_cold_with_minimum_norm() {
        for name in ["cg", "minres"] {
            for warm in [false, true] {
                let options = Options::new().with("warm", warm);
                let (mut solver, mut pinv) =
                    (make_solver(name, &options).unwrap(), make_solver("pinv", &Options::new()).unwrap());
                let (mut system, mut x, mut least) = (ConstrainedSystem::new(), [0.0; ROWS], [0.0; ROWS]);
                for k in 0..500 {
                    system.assemble(&boat(0.01 * f64::from(k)).view()).unwrap();
                    let info = system.solve(&mut *solver, Wanted::Multipliers, &mut x).unwrap();
                    assert_eq!(info.status, Status::Converged, "{name} at {k}: {info:?}");
                    assert!(info.residual_rel <= 1e-10 && info.iterations <= RANK, "{name} at {k}: {info:?}");
                    system.solve(&mut *pinv, Wanted::Multipliers, &mut least).unwrap();
                    let gap = x.iter().zip(least).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(warm || gap <= 1e-9 * norm(&least), "{name} at {k}: {gap:e}");
                }
            }
        }
    }

    #[test]
    fn the_limit_is_kept_and_a_good_start_costs_no_iteration() {
        for name in ["cg", "minres"] {
            let mut system = ConstrainedSystem::new();
            system.set_dense(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0], &[1.0; 3]).unwrap();
            let mut solve = |solver: &mut dyn MultiplierSolver| {
                system.solve(solver, Wanted::Multipliers, &mut [0.0; 3]).unwrap()
            };
            let mut solver = make_solver(name, &Options::new().with("max_iterations", 2)).unwrap();
            let info = solve(&mut *solver);
            assert_eq!((info.status, info.iterations), (Status::IterationLimit, 2), "{name}");
            // The next solves go on from there.
            assert!((0..20).any(|_| solve(&mut *solver).status == Status::Converged), "{}", name);
            assert_eq!(solve(&mut *solver).iterations, 0, "{name}");
            solver.reset();
            assert_eq!(solve(&mut *solver).iterations, 2, "{name}");
        }
    }
}
