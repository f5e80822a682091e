//! Rank-revealing Cholesky: the fast direct solver.
//!
//! With complete pivoting, Pᵀ A P = L Lᵀ, L = (L₁; L₂) with L₁ r×r lower triangular, stopped when the largest remaining pivot
//! falls below `rank_cut` times the first (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., §10.3). The
//! factor gives a basis of null(A) for nothing more than d = n − r triangular solves, and with it projections:
//!
//! ```text
//!     Z = (−K; E),  K = L₁⁻ᵀ L₂ᵀ  (r×d)              A P Z = 0
//!     Π v = v − Z (E + KᵀK)⁻¹ Zᵀ v                    the projection onto range(A), permuted
//!     b ← Π Pᵀ b                                      what is cut off is the part of b that no x can reach
//!     A⁺ b = P Π (L₁⁻ᵀ L₁⁻¹ b₁; 0)                    a basic solution, then minimum norm
//! ```
//!
//! This is the complete orthogonal route without an orthogonal factorisation. The usual one, A⁺ = L (LᵀL)⁻² Lᵀ (Courrieu,
//! "Fast computation of Moore–Penrose inverse matrices", 2005), costs n r² + r³/3 more multiplications instead of
//! r² d + d² n, and its error grows with the condition of A rather than with that of L₁, its square root. At full rank the
//! two triangular solves are all there is; where only accelerations are wanted the last projection is left out.
//!
//! Where what is left over, S, is more than rounding, as loops that stand open leave it, Z is off by ‖S‖/λᵣ from what the
//! dropped eigenvectors span. A P Z = (0; S) shows it: K ← K + A₁₁⁻¹ (Π A P Z)₁ squares the error, and a second solve, of the
//! residual, does the same for x.
//!
//! Where A has a narrow envelope, as with chains of loops, and is clearly of full rank, its factor is that of `skyline`,
//! without pivots. Of the rest, sizes up to 8 run on code compiled for their size (as L D Lᵀ, without square roots), those
//! from 24 on on faer's blocked kernels. faer's own rank cut is at rounding; with complete pivoting the pivots fall, so that
//! ours is a shorter prefix of the same factor.

mod columns;
pub(super) mod found;
mod small;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::{llt, llt_pivoting};
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_solve::solve_upper_triangular_in_place;
use faer::{Accum, MatMut, MatRef, Par, Spec};

use self::columns::{backward, factorise, factorise_definite, forward, permute};
use self::found::{Asked, Found};
use crate::error::{Error, check_len};
use crate::info::Info;
use crate::linalg::kernels::{BLOCKED, axpy, by_size, dot, gemv, norm, vectorised};
use crate::linalg::skyline;
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem, Wanted};
use crate::solvers::eigen::RANK_CUT;
use crate::solvers::solver::{Solver, State};

/// A negative pivot counts as A not being positive semidefinite when it is larger than this part of the first one.
/// Rounding leaves n·ε; an indefinite matrix has pivots of order one.
const INDEFINITE: f64 = 1e-8;

/// Name of the field that holds the order of the pivots.
const ORDER: &str = "order";

/// Parameters of [`Cholesky`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CholeskyParams {
    /// Pivots below this part of the first count as zero; in [0, 1). See [`RANK_CUT`].
    pub rank_cut: f64,
}

impl Params for CholeskyParams {
    const SOLVER: &'static str = "cholesky";

    fn read(reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self { rank_cut: reader.fraction("rank_cut", RANK_CUT)? })
    }
}

/// The factor and its workspace. Carried from step to step is the order of the pivots, where a size has code of its own
/// that begins with it: it decides the last bits of x.
pub struct Cholesky {
    params: CholeskyParams,
    /// Pᵀ A P, then L in its lower trapezium; column-major, n×n.
    factor: Vec<f64>,
    /// Reciprocals of the diagonals of L and of the factor of `E + KᵀK`: a division costs as much as a small column.
    factor_inverse: Vec<f64>,
    gram_inverse: Vec<f64>,
    pivots: Vec<usize>,
    /// K, r×d with stride r.
    kernel: Vec<f64>,
    /// `E + KᵀK`, then its factor; column-major, d×d.
    gram: Vec<f64>,
    /// Pᵀ b, then Pᵀ x.
    permuted: Vec<f64>,
    /// Zᵀ v.
    part: Vec<f64>,
    /// The part of b outside range(A).
    outside: Vec<f64>,
    image: Vec<f64>,
    found: Found,
    /// For faer: inverse of the pivots, scratch.
    unpivots: Vec<usize>,
    scratch: MemBuffer,
}

impl Clone for Cholesky {
    /// With the same order of pivots; the workspace is its own.
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.params);
        copy.resize(self.pivots.len());
        copy.pivots.copy_from_slice(&self.pivots);
        copy
    }
}

impl Cholesky {
    fn resize(&mut self, n: usize) {
        if self.pivots.len() != n {
            let (vector, square) = (|| vec![0.0; n], || vec![0.0; n * n]);
            let pivoted =
                llt_pivoting::factor::cholesky_in_place_scratch::<usize, f64>(n, Par::Seq, Spec::default());
            let plain = llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default());
            *self = Self {
                params: self.params,
                factor: square(),
                factor_inverse: vector(),
                gram_inverse: vector(),
                pivots: (0..n).collect(),
                kernel: square(),
                gram: square(),
                permuted: vector(),
                part: vector(),
                outside: vector(),
                image: vector(),
                found: Found::full(0, 0.0),
                unpivots: vec![0; n],
                scratch: MemBuffer::new(pivoted.or(plain)),
            };
        }
    }

    fn forget(&mut self) {
        self.pivots.iter_mut().enumerate().for_each(|(i, pivot)| *pivot = i);
    }

    /// The order of the pivots, unless it is that of the rows, under the name of a solver.
    pub(crate) fn save(&self, solver: &str) -> State {
        let state = State::new(solver, self.pivots.len());
        if self.pivots.iter().enumerate().all(|(i, &pivot)| i == pivot) {
            return state;
        }
        let order = self.pivots.iter().map(|&pivot| pivot as f64).collect::<Vec<_>>();
        state.with(ORDER, &order)
    }

    /// Goes on from a state of this solver.
    ///
    /// # Errors
    /// [`Error::State`].
    pub(crate) fn load(&mut self, state: &State, solver: &'static str) -> Result<(), Error> {
        state.check_names(solver, &[ORDER])?;
        if state.fields.is_empty() {
            state.check(solver, &[])?;
            self.forget();
            return Ok(());
        }
        let order = state.order(ORDER, solver)?;
        self.resize(order.len());
        self.pivots.copy_from_slice(&order);
        Ok(())
    }

    /// Without pivots where A has a narrow envelope and is clearly of full rank.
    fn run_narrow(&mut self, first: &[usize], matrix: &[f64], rhs: &[f64], x: &mut [f64]) -> Option<Found> {
        let cut = self.params.rank_cut.max(rhs.len() as f64 * f64::EPSILON);
        x.copy_from_slice(rhs);
        let largest =
            skyline::solve_regular(first, cut, matrix, &mut self.factor, &mut self.factor_inverse, x)?;
        self.outside.fill(0.0);
        self.forget();
        Some(Found::full(rhs.len(), largest))
    }

    /// Factor, projections and solves for sizes that have no code of their own.
    fn run(&mut self, matrix: &[f64], rhs: &[f64], asked: Asked, x: &mut [f64]) -> Found {
        let n = rhs.len();
        self.factor.copy_from_slice(matrix);
        let found = if n >= BLOCKED {
            self.factorise_blocked(n, asked.ceiling)
        } else {
            factorise(n, asked, &mut self.factor, &mut self.pivots)
        };
        let rank = found.rank;
        for (col, inverse) in self.factor_inverse.iter_mut().enumerate().take(rank) {
            *inverse = self.factor[col * n + col].recip();
        }
        let refined = found.wants_refining(n);
        if rank < n {
            self.find_null_space(n, rank);
            if refined {
                self.refine_null_space(matrix, rank, x);
            }
        }
        permute(&self.pivots, rhs, &mut self.permuted);
        self.outside.fill(0.0);
        if rank < n {
            self.project(rank);
            for (&entry, &pivot) in self.permuted.iter().zip(&self.pivots) {
                self.outside[pivot] = rhs[pivot] - entry;
            }
        }
        self.solve_basic(rank);
        if rank < n && (refined || asked.wanted == Wanted::Multipliers) {
            self.project(rank);
        }
        for (&entry, &pivot) in self.permuted.iter().zip(&self.pivots) {
            x[pivot] = entry;
        }
        if refined {
            self.refine_solution(matrix, rhs, rank, x);
        }
        found
    }

    /// One more solve, of what the first one left of Π b: the factor is not quite that of A on its range.
    fn refine_solution(&mut self, matrix: &[f64], rhs: &[f64], rank: usize, x: &mut [f64]) {
        gemv(matrix, x, &mut self.image);
        for (entry, &pivot) in self.permuted.iter_mut().zip(&self.pivots) {
            *entry = rhs[pivot] - self.outside[pivot] - self.image[pivot];
        }
        self.project(rank);
        self.solve_basic(rank);
        self.project(rank);
        for (&entry, &pivot) in self.permuted.iter().zip(&self.pivots) {
            x[pivot] += entry;
        }
    }

    /// v ← (A₁₁⁻¹ v₁; 0) of the permuted vector.
    fn solve_basic(&mut self, rank: usize) {
        let (kept, rest) = self.permuted.split_at_mut(rank);
        let n = kept.len() + rest.len();
        forward(n, &self.factor, &self.factor_inverse, kept);
        backward(n, &self.factor, &self.factor_inverse, kept);
        rest.fill(0.0);
    }

    /// One step nearer to the invariant subspace, K ← K + A₁₁⁻¹ (Π A P Z)₁; `column` is workspace.
    fn refine_null_space(&mut self, matrix: &[f64], rank: usize, column: &mut [f64]) {
        let d = column.len() - rank;
        for k in 0..d {
            column.fill(0.0);
            column[self.pivots[rank + k]] = 1.0;
            for (&pivot, entry) in self.pivots.iter().zip(&self.kernel[k * rank..(k + 1) * rank]) {
                column[pivot] = -entry;
            }
            gemv(matrix, column, &mut self.image);
            permute(&self.pivots, &self.image, &mut self.permuted);
            self.project(rank);
            self.solve_basic(rank);
            // Projections go by the old K until all of the new one is there, in the other half.
            let (old, new) = self.kernel.split_at_mut(rank * d);
            let columns = new[k * rank..(k + 1) * rank].iter_mut().zip(&old[k * rank..]);
            for ((new, old), correction) in columns.zip(&self.permuted) {
                *new = old + correction;
            }
        }
        self.kernel.copy_within(rank * d..2 * rank * d, 0);
        self.factorise_gram(column.len(), rank);
    }

    /// Pᵀ A P = L Lᵀ in place, blocked.
    fn factorise_blocked(&mut self, n: usize, ceiling: usize) -> Found {
        let Self { factor, pivots, unpivots, scratch, image, .. } = self;
        let diagonal = image;
        for (i, entry) in diagonal.iter_mut().enumerate() {
            *entry = factor[i * n + i];
        }
        let first = diagonal.iter().fold(0.0_f64, |first, &entry| first.max(entry));
        let lowest = diagonal.iter().fold(f64::INFINITY, |lowest, &entry| lowest.min(entry));
        let matrix = MatMut::from_column_major_slice_mut(factor, n, n);
        let stack = MemStack::new(scratch);
        let factored = vectorised(|| {
            llt_pivoting::factor::cholesky_in_place(
                matrix,
                pivots,
                unpivots,
                Par::Seq,
                stack,
                Spec::default(),
            )
        });
        let Ok((found, _)) = factored else {
            // It refuses a negative diagonal entry, which shows in `lowest`.
            pivots.iter_mut().enumerate().for_each(|(i, pivot)| *pivot = i);
            return Found { rank: 0, first, dropped: first, lowest, last: f64::INFINITY };
        };
        let cut = (self.params.rank_cut * first).max(f64::MIN_POSITIVE);
        let most = found.rank.min(ceiling);
        let above = |col: &usize| *col < most && factor[col * n + col] * factor[col * n + col] > cut;
        let rank = (0..n).take_while(above).count();
        // The diagonal of what is left over.
        let (mut dropped, mut lowest) = (0.0_f64, if rank == n { 0.0 } else { f64::INFINITY });
        for row in rank..n {
            let squares = (0..rank).map(|col| factor[col * n + row] * factor[col * n + row]);
            let left = diagonal[pivots[row]] - squares.sum::<f64>();
            (dropped, lowest) = (dropped.max(left), lowest.min(left));
        }
        let pivots = (0..rank).map(|col| factor[col * n + col] * factor[col * n + col]);
        Found { rank, first, last: pivots.fold(f64::INFINITY, f64::min), dropped, lowest }
    }

    /// K and the factor of `E + KᵀK`.
    fn find_null_space(&mut self, n: usize, rank: usize) {
        let d = n - rank;
        let kernel = &mut self.kernel[..rank * d];
        for k in 0..d {
            for col in 0..rank {
                kernel[k * rank + col] = self.factor[col * n + rank + k];
            }
        }
        if rank > 0 && n >= BLOCKED {
            let triangle = MatRef::from_column_major_slice(&self.factor, n, n).submatrix(0, 0, rank, rank);
            let columns = MatMut::from_column_major_slice_mut(kernel, rank, d);
            vectorised(|| solve_upper_triangular_in_place(triangle.transpose(), columns, Par::Seq));
        } else if rank > 0 {
            for column in kernel.chunks_exact_mut(rank) {
                backward(n, &self.factor, &self.factor_inverse, column);
            }
        }
        self.factorise_gram(n, rank);
    }

    /// The factor of `E + KᵀK`.
    fn factorise_gram(&mut self, n: usize, rank: usize) {
        let d = n - rank;
        let (kernel, gram) = (&self.kernel[..rank * d], &mut self.gram[..d * d]);
        if rank == 0 {
            gram.fill(0.0);
            (0..d).for_each(|k| gram[k * d + k] = 1.0);
            self.gram_inverse[..d].fill(1.0);
            return;
        }
        if n < BLOCKED {
            for col in 0..d {
                for row in col..d {
                    let product =
                        dot(&kernel[row * rank..(row + 1) * rank], &kernel[col * rank..(col + 1) * rank]);
                    gram[col * d + row] = product + f64::from(u8::from(row == col));
                }
            }
            factorise_definite(d, gram);
        } else {
            let columns = MatRef::from_column_major_slice(kernel, rank, d);
            let mut matrix = MatMut::from_column_major_slice_mut(gram, d, d);
            vectorised(|| {
                matmul(
                    matrix.as_mut(),
                    BlockStructure::TriangularLower,
                    Accum::Replace,
                    columns.transpose(),
                    BlockStructure::Rectangular,
                    columns,
                    BlockStructure::Rectangular,
                    1.0,
                    Par::Seq,
                );
            });
            (0..d).for_each(|k| matrix[(k, k)] += 1.0);
            // All its eigenvalues are at least 1: it has a factor.
            let stack = MemStack::new(&mut self.scratch);
            let plain = llt::factor::LltRegularization::default();
            let _ = vectorised(|| {
                llt::factor::cholesky_in_place(matrix, plain, Par::Seq, stack, Spec::default())
            });
        }
        for (k, inverse) in self.gram_inverse.iter_mut().enumerate().take(d) {
            *inverse = self.gram[k * d + k].recip();
        }
    }

    /// v ← Π v of the permuted vector.
    fn project(&mut self, rank: usize) {
        let (first, second) = self.permuted.split_at_mut(rank);
        let d = second.len();
        let columns = self.kernel.chunks_exact(rank.max(1));
        let part = &mut self.part[..d];
        part.copy_from_slice(second);
        if rank > 0 {
            for (part, column) in part.iter_mut().zip(columns.clone()) {
                *part -= dot(column, first);
            }
        }
        forward(d, &self.gram, &self.gram_inverse, part);
        backward(d, &self.gram, &self.gram_inverse, part);
        for (entry, part) in second.iter_mut().zip(part.iter()) {
            *entry -= part;
        }
        if rank > 0 {
            for (&part, column) in part.iter().zip(columns) {
                axpy(part, column, first);
            }
        }
    }

    /// What the last factorisation found.
    pub(crate) const fn found(&self) -> &Found {
        &self.found
    }

    fn run_fixed<const N: usize>(
        &mut self,
        matrix: &[f64],
        rhs: &[f64],
        asked: Asked,
        x: &mut [f64],
    ) -> Found {
        let Self { pivots, outside, .. } = self;
        let found = small::solve::<N>(asked, pivots, matrix, rhs, x, outside);
        // Code for it in there would cost all others a tenth by its mere presence.
        if found.wants_refining(N) {
            small::solve_refined::<N>(asked, pivots, matrix, rhs, x, outside)
        } else {
            found
        }
    }
}

impl Solver for Cholesky {
    type Params = CholeskyParams;
    const SUMMARY: &'static str = "rank-revealing Cholesky, minimum norm: the fast direct solver";
    const NEEDS: Needs = Needs::Dense;

    fn rank_cut(&self) -> Option<f64> {
        Some(self.params.rank_cut)
    }

    fn new(params: CholeskyParams) -> Self {
        Self {
            params,
            factor: Vec::new(),
            factor_inverse: Vec::new(),
            gram_inverse: Vec::new(),
            pivots: Vec::new(),
            kernel: Vec::new(),
            gram: Vec::new(),
            permuted: Vec::new(),
            part: Vec::new(),
            outside: Vec::new(),
            image: Vec::new(),
            found: Found::full(0, 0.0),
            unpivots: Vec::new(),
            scratch: MemBuffer::new(StackReq::EMPTY),
        }
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        problem.matrix();
        let blocks = problem.blocks();
        let (rank_cut, ceiling) = (blocks.cut(self.params.rank_cut), blocks.ceiling());
        let asked = Asked { rank_cut, ceiling, wanted: problem.wanted };
        let (matrix, rhs) = (&*problem.dense, problem.rhs());
        let narrow = problem
            .envelope()
            .filter(|_| ceiling == n)
            .and_then(|first| self.run_narrow(first, matrix, rhs, x));
        let found = match narrow {
            Some(found) => found,
            None => {
                by_size!(n, Self::run_fixed(self, matrix, rhs, asked, x), self.run(matrix, rhs, asked, x))
            }
        };
        self.found = found;
        if found.lowest < -INDEFINITE * found.first.abs() || found.first < 0.0 {
            return Err(Error::NotPositiveSemidefinite { smallest: found.lowest, largest: found.first });
        }
        let b_norm = norm(rhs);
        problem.apply(x, &mut self.image);
        for ((image, b), outside) in self.image.iter_mut().zip(problem.rhs()).zip(&self.outside) {
            *image -= b - outside;
        }
        Ok(Info {
            residual_rel: if b_norm == 0.0 { 0.0 } else { norm(&self.image) / b_norm },
            inconsistency: Some(norm(&self.outside)),
            rank: Some(found.rank),
            null_residual: Some(if found.first > 0.0 { found.dropped / found.first } else { 0.0 }),
            ..Info::trivial(0.0)
        })
    }

    fn reset(&mut self) {
        self.forget();
    }

    fn state(&self) -> State {
        self.save(CholeskyParams::SOLVER)
    }

    fn restore(&mut self, state: &State) -> Result<(), Error> {
        self.load(state, CholeskyParams::SOLVER)
    }
}
