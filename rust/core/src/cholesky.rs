//! Rank-revealing Cholesky: the fast direct solver.
//!
//! With complete pivoting, Pᵀ A P = L Lᵀ, L n×r lower trapezoidal, stopped when the largest remaining pivot falls below
//! `rank_cut` times the first (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., §10.3). Then, with
//! B = Lᵀ L (r×r, positive definite, the nonzero eigenvalues of A),
//!
//! ```text
//!     A⁺ b = P L B⁻² Lᵀ Pᵀ b        minimum norm, least squares
//!     y = B⁻¹ Lᵀ Pᵀ b               b − P L y is the part of b outside range(A)
//! ```
//!
//! (Courrieu, "Fast computation of Moore–Penrose inverse matrices", 2005). At full rank the two triangular solves with L
//! itself do, and are more accurate. Where only accelerations are wanted, Lᵀ Pᵀ x = y with x zero outside the pivots is
//! a least-squares solution for one solve less.
//!
//! Sizes up to 8 run on code compiled for their size.

use crate::eigen::RANK_CUT;
use crate::error::{Error, check_len};
use crate::info::Info;
use crate::kernels::{axpy, by_size, dot, norm};
use crate::params::{Params, Reader};
use crate::problem::{Needs, Problem, Wanted};
use crate::solver::{MultiplierSolver, SolverKind};

/// Registry entry.
pub const KIND: SolverKind = SolverKind {
    name: CholeskyParams::SOLVER,
    summary: "rank-revealing Cholesky, minimum norm: the fast direct solver",
    build: |options| Ok(Box::new(Cholesky::new(CholeskyParams::from_options(options)?))),
    options: CholeskyParams::defaults,
};

/// A negative pivot counts as A not being positive semidefinite when it is larger than this part of the first one.
/// Rounding leaves n·ε; an indefinite matrix has pivots of order one.
const INDEFINITE: f64 = 1e-8;

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

/// The factor and its workspace; nothing is carried from step to step.
#[derive(Clone)]
pub struct Cholesky {
    params: CholeskyParams,
    /// Pᵀ A P, then L in its lower trapezium; column-major, n×n.
    factor: Vec<f64>,
    /// B = Lᵀ L, then its factor; column-major with stride n.
    gram: Vec<f64>,
    /// Reciprocals of the diagonals of L and of the factor of B: a division costs as much as a small column.
    factor_inverse: Vec<f64>,
    gram_inverse: Vec<f64>,
    pivots: Vec<usize>,
    /// Pᵀ b.
    permuted: Vec<f64>,
    /// y, then B⁻¹ y.
    inner: Vec<f64>,
    /// b − P L y, the part of b outside range(A).
    outside: Vec<f64>,
    image: Vec<f64>,
}

/// What the factorisation found.
struct Found {
    rank: usize,
    first: f64,
    /// Largest diagonal entry that was dropped, and the smallest one, which a positive semidefinite A keeps ≥ 0.
    dropped: f64,
    lowest: f64,
}

impl Cholesky {
    /// A solver with these parameters.
    #[must_use]
    pub fn new(params: CholeskyParams) -> Self {
        Self {
            params,
            factor: Vec::new(),
            gram: Vec::new(),
            factor_inverse: Vec::new(),
            gram_inverse: Vec::new(),
            pivots: Vec::new(),
            permuted: Vec::new(),
            inner: Vec::new(),
            outside: Vec::new(),
            image: Vec::new(),
        }
    }

    fn resize(&mut self, n: usize) {
        if self.pivots.len() != n {
            self.factor = vec![0.0; n * n];
            self.gram = vec![0.0; n * n];
            self.factor_inverse = vec![0.0; n];
            self.gram_inverse = vec![0.0; n];
            self.pivots = vec![0; n];
            self.permuted = vec![0.0; n];
            self.inner = vec![0.0; n];
            self.outside = vec![0.0; n];
            self.image = vec![0.0; n];
        }
    }

    #[inline]
    fn run(&mut self, n: usize, rhs: &[f64], wanted: Wanted, x: &mut [f64]) -> Found {
        let found = factorise(
            n,
            self.params.rank_cut,
            &mut self.factor[..n * n],
            &mut self.factor_inverse[..n],
            &mut self.pivots[..n],
        );
        let rank = found.rank;
        let (factor, gram) = (&self.factor[..n * n], &mut self.gram[..n * n]);
        let (factor_inverse, gram_inverse) = (&self.factor_inverse[..n], &mut self.gram_inverse[..n]);
        let (permuted, inner) = (&mut self.permuted[..n], &mut self.inner[..n]);
        for (entry, &pivot) in permuted.iter_mut().zip(&self.pivots) {
            *entry = rhs[pivot];
        }
        if rank == n {
            inner.copy_from_slice(permuted);
            forward(n, n, factor, factor_inverse, inner);
            backward(n, n, factor, factor_inverse, inner);
            for (&entry, &pivot) in inner.iter().zip(&self.pivots) {
                x[pivot] = entry;
            }
            self.outside.fill(0.0);
            return found;
        }
        // y = B⁻¹ Lᵀ Pᵀ b
        for col in 0..rank {
            let column = &factor[col * n + col..(col + 1) * n];
            inner[col] = dot(column, &permuted[col..]);
            for row in col..rank {
                gram[col * n + row] =
                    dot(&factor[row * n + row..(row + 1) * n], &factor[col * n + row..(col + 1) * n]);
            }
        }
        factorise_definite(n, rank, gram, gram_inverse);
        forward(n, rank, gram, gram_inverse, &mut inner[..rank]);
        backward(n, rank, gram, gram_inverse, &mut inner[..rank]);
        // What of b no x can reach: b − L y.
        for col in 0..rank {
            axpy(-inner[col], &factor[col * n + col..(col + 1) * n], &mut permuted[col..]);
        }
        for (&entry, &pivot) in permuted.iter().zip(&self.pivots) {
            self.outside[pivot] = entry;
        }
        match wanted {
            Wanted::Multipliers => {
                forward(n, rank, gram, gram_inverse, &mut inner[..rank]);
                backward(n, rank, gram, gram_inverse, &mut inner[..rank]);
                permuted.fill(0.0);
                for col in 0..rank {
                    axpy(inner[col], &factor[col * n + col..(col + 1) * n], &mut permuted[col..]);
                }
            }
            Wanted::Acceleration => {
                backward(n, rank, factor, factor_inverse, &mut inner[..rank]);
                permuted[..rank].copy_from_slice(&inner[..rank]);
                permuted[rank..].fill(0.0);
            }
        }
        for (&entry, &pivot) in permuted.iter().zip(&self.pivots) {
            x[pivot] = entry;
        }
        found
    }

    fn run_fixed<const N: usize>(&mut self, rhs: &[f64], wanted: Wanted, x: &mut [f64]) -> Found {
        self.run(N, &rhs[..N], wanted, &mut x[..N])
    }
}

/// Pᵀ A P = L Lᵀ in place, column by column.
#[inline]
fn factorise(n: usize, rank_cut: f64, a: &mut [f64], inverses: &mut [f64], pivots: &mut [usize]) -> Found {
    for (index, pivot) in pivots.iter_mut().enumerate() {
        *pivot = index;
    }
    // Below n·ε a pivot is rounding, and dividing by it makes garbage of the rest.
    let rank_cut = rank_cut.max(n as f64 * f64::EPSILON);
    let mut found = Found { rank: n, first: 0.0, dropped: 0.0, lowest: 0.0 };
    for col in 0..n {
        let mut best = col;
        for candidate in col + 1..n {
            if a[candidate * n + candidate] > a[best * n + best] {
                best = candidate;
            }
        }
        let pivot = a[best * n + best];
        if col == 0 {
            found.first = pivot;
        }
        if pivot <= rank_cut * found.first || pivot <= f64::MIN_POSITIVE {
            found.rank = col;
            found.dropped = pivot.max(0.0);
            found.lowest = (col..n).map(|i| a[i * n + i]).fold(f64::INFINITY, f64::min);
            break;
        }
        if best != col {
            swap(n, col, best, a);
            pivots.swap(col, best);
        }
        let root = pivot.sqrt();
        let (left, right) = a.split_at_mut((col + 1) * n);
        let column = &mut left[col * n..];
        column[col] = root;
        let inverse = root.recip();
        inverses[col] = inverse;
        for entry in &mut column[col + 1..] {
            *entry *= inverse;
        }
        for (offset, target) in right.chunks_exact_mut(n).enumerate() {
            let row = col + 1 + offset;
            let factor = column[row];
            for (t, c) in target[row..].iter_mut().zip(&column[row..]) {
                *t -= factor * c;
            }
        }
    }
    found
}

/// Swaps rows and columns p < q of the matrix whose lower triangle is stored, with the rows of the part that is factored.
#[inline]
fn swap(n: usize, p: usize, q: usize, a: &mut [f64]) {
    for col in 0..p {
        a.swap(col * n + p, col * n + q);
    }
    a.swap(p * n + p, q * n + q);
    for i in p + 1..q {
        a.swap(p * n + i, i * n + q);
    }
    for row in q + 1..n {
        a.swap(p * n + row, q * n + row);
    }
}

/// B = C Cᵀ in place, lower triangle, of the leading `rank` columns with stride n.
#[inline]
fn factorise_definite(n: usize, rank: usize, b: &mut [f64], inverses: &mut [f64]) {
    for col in 0..rank {
        let (left, right) = b.split_at_mut((col + 1) * n);
        let column = &mut left[col * n..col * n + rank];
        let root = column[col].max(f64::MIN_POSITIVE).sqrt();
        column[col] = root;
        let inverse = root.recip();
        inverses[col] = inverse;
        for entry in &mut column[col + 1..] {
            *entry *= inverse;
        }
        for (offset, target) in right.chunks_exact_mut(n).take(rank - col - 1).enumerate() {
            let row = col + 1 + offset;
            let factor = column[row];
            for (t, c) in target[row..rank].iter_mut().zip(&column[row..]) {
                *t -= factor * c;
            }
        }
    }
}

/// L z = z, the leading `rank` rows of L with stride n.
#[inline]
fn forward(n: usize, rank: usize, l: &[f64], inverses: &[f64], z: &mut [f64]) {
    for col in 0..rank {
        let entry = z[col] * inverses[col];
        z[col] = entry;
        axpy(-entry, &l[col * n + col + 1..col * n + rank], &mut z[col + 1..rank]);
    }
}

/// Lᵀ z = z, the leading `rank` rows of L with stride n.
#[inline]
fn backward(n: usize, rank: usize, l: &[f64], inverses: &[f64], z: &mut [f64]) {
    for col in (0..rank).rev() {
        let below = dot(&l[col * n + col + 1..col * n + rank], &z[col + 1..rank]);
        z[col] = (z[col] - below) * inverses[col];
    }
}

impl MultiplierSolver for Cholesky {
    fn name(&self) -> &'static str {
        CholeskyParams::SOLVER
    }

    fn needs(&self) -> Needs {
        Needs::Dense
    }

    fn solve(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Result<Info, Error> {
        let n = problem.len();
        check_len("x", x.len(), &[n])?;
        self.resize(n);
        self.factor.copy_from_slice(problem.matrix().as_slice());
        let (rhs, wanted) = (problem.rhs(), problem.wanted);
        let found = by_size!(n, Self::run_fixed(self, rhs, wanted, x), self.run(n, rhs, wanted, x));
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

    fn reset(&mut self) {}

    fn clone_box(&self) -> Box<dyn MultiplierSolver> {
        Box::new(self.clone())
    }
}
