//! Symmetric eigendecomposition with a rank cut, in a workspace that is kept: nalgebra's for small sizes, faer's beyond.

pub(super) mod carried;

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::allocator::Allocator;
use nalgebra::{Const, DefaultAllocator, DimDiff, DimSub, OMatrix, U1};

use crate::error::Error;
use crate::info::Info;
use crate::linalg::kernels::{axpy, by_size, dot, largest, norm, rank_one, vectorised};
use crate::problem::Problem;

/// Eigenvalues of A below this part of the largest count as zero, unless an option `rank_cut` says otherwise.
///
/// A = J M⁻¹ Jᵀ squares the singular values σ of J M^(−1/2), so the cut on σ is its square root, 1e-5. Rounding
/// leaves eigenvalues of about 1e-16; a row pair that closes a loop only to a drift δ (lengths of order one) leaves
/// about δ². A harness that asks the hard question on drifted states must raise the cut above that.
pub const RANK_CUT: f64 = 1e-10;

/// An eigenvalue below minus this part of the largest means that A is not positive semidefinite. Rounding leaves n·ε,
/// whatever the rank cut; a sign that is wrong in a formula leaves order one.
pub(crate) const SEMIDEFINITE_TOLERANCE: f64 = 1e-10;

/// Iterations of QR an eigenvalue may take on average; it takes two. Who needs more is given to faer.
const MAX_SWEEPS: usize = 30;

/// A = U diag(w) Uᵀ and the rank by a relative cut.
pub(crate) struct SymmetricEigen {
    /// U, n×n, column-major.
    vectors: Vec<f64>,
    values: Vec<f64>,
    scratch: MemBuffer,
    rank: usize,
    /// ‖A N‖ of the eigenvectors N that are dropped.
    dropped: f64,
    projected: Vec<f64>,
    image: Vec<f64>,
}

impl Clone for SymmetricEigen {
    /// A workspace with the same decomposition; the scratch memory is its own.
    fn clone(&self) -> Self {
        let mut copy = Self::new(self.len());
        copy.vectors.copy_from_slice(&self.vectors);
        copy.values.copy_from_slice(&self.values);
        (copy.rank, copy.dropped) = (self.rank, self.dropped);
        copy
    }
}

impl SymmetricEigen {
    /// A workspace for `n×n` matrices.
    #[must_use]
    pub(crate) fn new(n: usize) -> Self {
        // faer's own count underflows for n = 0, the size that a solver has before its first system.
        let scratch = if n == 0 {
            StackReq::EMPTY
        } else {
            self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Spec::default())
        };
        Self {
            vectors: vec![0.0; n * n],
            values: vec![0.0; n],
            scratch: MemBuffer::new(scratch),
            rank: 0,
            dropped: 0.0,
            projected: vec![0.0; n],
            image: vec![0.0; n],
        }
    }

    /// The size it was made for.
    #[must_use]
    pub(crate) fn len(&self) -> usize {
        self.projected.len()
    }

    /// Decomposes `matrix` (`n×n`, column-major, lower triangle read) and counts its rank: eigenvalues above `rank_cut` times the
    /// largest.
    ///
    /// # Errors
    /// [`Error::NotPositiveSemidefinite`] by [`SEMIDEFINITE_TOLERANCE`], [`Error::Eigen`].
    pub(crate) fn decompose(&mut self, matrix: &[f64], rank_cut: f64) -> Result<(), Error> {
        let n = self.len();
        if matrix.iter().all(|entry| entry.abs() < f64::MIN_POSITIVE) {
            // faer gives up on subnormal numbers; they count as zero.
            self.vectors.fill(0.0);
            self.vectors.iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
            self.values.fill(0.0);
            (self.rank, self.dropped) = (0, 0.0);
            return Ok(());
        }
        if !by_size!(n, Self::decompose_fixed(self, matrix), false) {
            self.decompose_dynamic(matrix)?;
        }
        let (least, most) = (self.values[0], self.values[n - 1]);
        // Subnormal eigenvalues count as zero, and their sign says nothing.
        let scale = most.abs().max(least.abs());
        let cut = (rank_cut * scale).max(f64::MIN_POSITIVE);
        if least < -(SEMIDEFINITE_TOLERANCE * scale).max(f64::MIN_POSITIVE) {
            return Err(Error::NotPositiveSemidefinite { smallest: least, largest: most });
        }
        self.rank = self.values.iter().filter(|&&value| value > cut).count();
        self.dropped = largest(&self.values[..n - self.rank]);
        Ok(())
    }

    /// faer's decomposition.
    fn decompose_dynamic(&mut self, matrix: &[f64]) -> Result<(), Error> {
        let n = self.len();
        let view = MatRef::from_column_major_slice(matrix, n, n);
        vectorised(|| {
            self_adjoint_evd(
                view,
                DiagMut::from_slice_mut(&mut self.values),
                Some(MatMut::from_column_major_slice_mut(&mut self.vectors, n, n)),
                Par::Seq,
                MemStack::new(&mut self.scratch),
                Spec::default(),
            )
        })
        .map_err(|_| Error::Eigen { n })
    }

    /// nalgebra's for a size known at compile time, in half the time; gives whether it converged.
    fn decompose_fixed<const N: usize>(&mut self, matrix: &[f64]) -> bool
    where
        Const<N>: DimSub<U1>,
        DefaultAllocator:
            Allocator<Const<N>, Const<N>> + Allocator<Const<N>> + Allocator<DimDiff<Const<N>, U1>>,
    {
        let matrix = OMatrix::<f64, Const<N>, Const<N>>::from_column_slice(matrix);
        let found = nalgebra::SymmetricEigen::<f64, Const<N>>::try_new(matrix, f64::EPSILON, MAX_SWEEPS * N);
        let Some(found) = found.filter(|found| found.eigenvalues.iter().all(|value| value.is_finite()))
        else {
            return false;
        };
        let mut order: [usize; N] = std::array::from_fn(|i| i);
        order.sort_unstable_by(|&i, &j| found.eigenvalues[i].total_cmp(&found.eigenvalues[j]));
        for (col, from) in order.into_iter().enumerate() {
            self.values[col] = found.eigenvalues[from];
            let vector = &mut self.vectors[col * N..(col + 1) * N];
            vector
                .iter_mut()
                .zip(&found.eigenvectors.column(from))
                .for_each(|(entry, value)| *entry = *value);
        }
        true
    }

    /// Number of eigenvalues above the cut.
    #[must_use]
    pub(crate) const fn rank(&self) -> usize {
        self.rank
    }

    /// The i-th eigenvalue, in rising order.
    #[must_use]
    pub(crate) fn value(&self, i: usize) -> f64 {
        self.values[i]
    }

    /// x = A⁺ b; gives ‖Nᵀ b‖, the part of b outside range(A).
    ///
    /// # Panics
    /// If b or x are not of the size decomposed.
    pub(crate) fn solve(&mut self, rhs: &[f64], x: &mut [f64]) -> f64 {
        let n = self.len();
        assert_eq!((rhs.len(), x.len()), (n, n));
        for i in 0..n {
            self.projected[i] = dot(self.vector(i), rhs);
        }
        let null = n - self.rank;
        x.fill(0.0);
        for i in null..n {
            axpy(self.projected[i] / self.values[i], self.vector(i), x);
        }
        norm(&self.projected[..null])
    }

    /// x = A⁺ b of the problem that was decomposed, with its figures.
    ///
    /// # Panics
    /// As [`solve`](Self::solve).
    pub(crate) fn answer(&mut self, problem: &mut Problem<'_>, x: &mut [f64]) -> Info {
        let inconsistency = self.solve(problem.rhs(), x);
        Info {
            residual_rel: self.residual_rel(problem, x),
            inconsistency: Some(inconsistency),
            rank: Some(self.rank),
            null_residual: Some(self.null_residual()),
            ..Info::trivial(0.0)
        }
    }

    /// ‖A x − P b‖ / ‖b‖ for an x in range(A), P the projector onto range(A); 0 when b = 0. Call it after
    /// [`solve`](Self::solve) with the same system, whose Uᵀ b it uses.
    ///
    /// # Panics
    /// If the system or x are not of the size decomposed.
    pub(crate) fn residual_rel(&mut self, problem: &mut Problem<'_>, x: &[f64]) -> f64 {
        let (n, null) = (self.len(), self.len() - self.rank);
        assert_eq!((problem.len(), x.len()), (n, n));
        let norm = norm(problem.rhs());
        if norm == 0.0 {
            return 0.0;
        }
        // Uᵀ(A x) on the range, with A itself rather than its decomposition, so that a wrong one shows.
        problem.apply(x, &mut self.image);
        let miss = |i: usize| (dot(self.vector(i), &self.image) - self.projected[i]).powi(2);
        (null..n).map(miss).sum::<f64>().sqrt() / norm
    }

    /// ‖A N‖ / ‖A‖ of the null-space basis, the eigenvectors that are dropped; 0 without any.
    #[must_use]
    pub(crate) fn null_residual(&self) -> f64 {
        let most = largest(&self.values);
        if most == 0.0 { 0.0 } else { self.dropped / most }
    }

    /// The i-th eigenvector, `n`.
    #[must_use]
    pub(crate) fn vector(&self, i: usize) -> &[f64] {
        &self.vectors[i * self.len()..(i + 1) * self.len()]
    }

    /// Writes A⁺ into `inverse` (`n×n`, column-major).
    pub(crate) fn pseudo_inverse(&self, inverse: &mut [f64]) {
        inverse.fill(0.0);
        for i in self.len() - self.rank..self.len() {
            rank_one(self.values[i].recip(), self.vector(i), inverse);
        }
    }
}
