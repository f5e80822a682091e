//! Decompositions of one matrix, in a workspace that is kept: nalgebra's for small sizes, faer's beyond.

use faer::diag::DiagMut;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{MatMut, MatRef, Par, Spec};
use nalgebra::allocator::Allocator;
use nalgebra::{Const, DefaultAllocator, DimDiff, DimSub, OMatrix, U1};

use crate::error::Error;
use crate::linalg::kernels::{by_size, dot, vectorised};

/// Iterations of QR an eigenvalue may take on average; it takes two. Who needs more is given to faer.
const MAX_SWEEPS: usize = 30;

/// Sizes up to which nalgebra's decomposition is compiled for each.
const FIXED: usize = 8;

/// Sizes up to which rotations are taken, O(n³) a sweep, and their sweeps at most; ten are next to never needed.
const ROTATED: usize = 64;
const SWEEPS: usize = 40;

/// Workspaces by size: blocks of one system may have several.
#[derive(Default)]
pub(super) struct Raw {
    symmetric: Vec<(usize, MemBuffer)>,
    singular: Vec<((usize, usize), MemBuffer)>,
}

impl Raw {
    /// With room for symmetric matrices of n rows.
    pub(super) fn new(n: usize) -> Self {
        let symmetric = if n > FIXED { vec![(n, Self::symmetric_scratch(n))] } else { Vec::new() };
        Self { symmetric, singular: Vec::new() }
    }

    fn symmetric_scratch(n: usize) -> MemBuffer {
        MemBuffer::new(self_adjoint_evd_scratch::<f64>(
            n,
            ComputeEigenvectors::Yes,
            Par::Seq,
            Spec::default(),
        ))
    }

    /// Eigenvectors (`n×n`, column-major) and eigenvalues in rising order of a symmetric `matrix`.
    ///
    /// # Errors
    /// [`Error::Eigen`].
    pub(super) fn symmetric(
        &mut self,
        n: usize,
        matrix: &[f64],
        vectors: &mut [f64],
        values: &mut [f64],
    ) -> Result<(), Error> {
        if is_nothing(matrix) {
            // faer gives up on subnormal numbers; they count as zero.
            unit(n, vectors, values);
            return Ok(());
        }
        if by_size!(n, symmetric_fixed(matrix, vectors, values), false) {
            return Ok(());
        }
        let scratch = kept(&mut self.symmetric, n, || Self::symmetric_scratch(n));
        vectorised(|| {
            self_adjoint_evd(
                MatRef::from_column_major_slice(matrix, n, n),
                DiagMut::from_slice_mut(values),
                Some(MatMut::from_column_major_slice_mut(vectors, n, n)),
                Par::Seq,
                MemStack::new(scratch),
                Spec::default(),
            )
        })
        .map_err(|_| Error::Eigen { n })
    }

    /// As [`symmetric`](Self::symmetric), small eigenvalues as accurately as large ones, up to a size where that takes too long.
    /// Overwrites `matrix`.
    ///
    /// # Errors
    /// [`Error::Eigen`].
    pub(super) fn accurate(
        &mut self,
        n: usize,
        matrix: &mut [f64],
        vectors: &mut [f64],
        values: &mut [f64],
    ) -> Result<(), Error> {
        if n > ROTATED || is_nothing(matrix) {
            return self.symmetric(n, matrix, vectors, values);
        }
        unit(n, vectors, values);
        let sweep = |matrix: &mut [f64], vectors: &mut [f64]| {
            let mut turned = false;
            for q in 1..n {
                for p in 0..q {
                    let [app, aqq, apq] = [p * n + p, q * n + q, q * n + p].map(|at| matrix[at]);
                    let Some((cos, sin)) = rotation(app, aqq, apq) else { continue };
                    turned = true;
                    rotate(n, matrix, (p, q), (cos, sin));
                    for k in 0..n {
                        let (x, y) = (matrix[k * n + p], matrix[k * n + q]);
                        (matrix[k * n + p], matrix[k * n + q]) = (cos * x - sin * y, sin * x + cos * y);
                    }
                    rotate(n, vectors, (p, q), (cos, sin));
                }
            }
            turned
        };
        (0..SWEEPS).find(|_| !sweep(matrix, vectors));
        values.iter_mut().enumerate().for_each(|(i, value)| *value = matrix[i * (n + 1)]);
        sort(n, vectors, values);
        Ok(())
    }

    /// Right singular vectors (`n×n`, column-major) and squares of the singular values, in rising order, of some n `columns`,
    /// which are overwritten. Small ones are as accurate as large ones, up to a size where that takes too long: columns are
    /// turned until they stand on one another (Hestenes 1958).
    ///
    /// # Errors
    /// [`Error::Eigen`].
    pub(super) fn singular(
        &mut self,
        n: usize,
        columns: &mut [f64],
        vectors: &mut [f64],
        values: &mut [f64],
    ) -> Result<(), Error> {
        if is_nothing(columns) {
            unit(n, vectors, values);
            return Ok(());
        }
        let height = columns.len() / n;
        if n <= ROTATED {
            unit(n, vectors, values);
            let sweep = |columns: &mut [f64], vectors: &mut [f64]| {
                let mut turned = false;
                for q in 1..n {
                    for p in 0..q {
                        let column = |index: usize| &columns[index * height..(index + 1) * height];
                        let (x, y) = (column(p), column(q));
                        let Some(turn) = rotation(dot(x, x), dot(y, y), dot(x, y)) else { continue };
                        turned = true;
                        rotate(height, columns, (p, q), turn);
                        rotate(n, vectors, (p, q), turn);
                    }
                }
                turned
            };
            (0..SWEEPS).find(|_| !sweep(columns, vectors));
            for (value, column) in values.iter_mut().zip(columns.chunks_exact(height)) {
                *value = dot(column, column);
            }
            sort(n, vectors, values);
            return Ok(());
        }
        let (no, full) = (ComputeSvdVectors::No, ComputeSvdVectors::Full);
        let scratch = kept(&mut self.singular, (height, n), || {
            MemBuffer::new(svd_scratch::<f64>(height, n, no, full, Par::Seq, Spec::default()))
        });
        let few = height.min(n);
        values.fill(0.0);
        vectorised(|| {
            svd(
                MatRef::from_column_major_slice(columns, height, n),
                DiagMut::from_slice_mut(&mut values[..few]),
                None,
                Some(MatMut::from_column_major_slice_mut(vectors, n, n)),
                Par::Seq,
                MemStack::new(scratch),
                Spec::default(),
            )
        })
        .map_err(|_| Error::Eigen { n })?;
        for value in values.iter_mut() {
            *value *= *value;
        }
        // They come in falling order.
        values.reverse();
        for col in 0..n / 2 {
            let (before, after) = vectors.split_at_mut((n - 1 - col) * n);
            before[col * n..(col + 1) * n].swap_with_slice(&mut after[..n]);
        }
        Ok(())
    }
}

/// Cosine and sine of the rotation that takes a pair of diagonal entries apart; none where what couples them is rounding.
fn rotation(app: f64, aqq: f64, apq: f64) -> Option<(f64, f64)> {
    if apq.abs() <= f64::EPSILON * (app.abs().sqrt() * aqq.abs().sqrt()) || apq.abs() < f64::MIN_POSITIVE {
        return None;
    }
    let cotangent = (aqq - app) / (2.0 * apq);
    let tangent = cotangent.signum() / (cotangent.abs() + cotangent.hypot(1.0));
    let cos = tangent.hypot(1.0).recip();
    Some((cos, cos * tangent))
}

/// Turns two columns of `height` entries: x ← c x − s y, y ← s x + c y.
fn rotate(height: usize, columns: &mut [f64], (p, q): (usize, usize), (cos, sin): (f64, f64)) {
    let (before, after) = columns.split_at_mut(q * height);
    for (x, y) in before[p * height..(p + 1) * height].iter_mut().zip(&mut after[..height]) {
        (*x, *y) = (cos * *x - sin * *y, sin * *x + cos * *y);
    }
}

/// Values in rising order, each with its vector.
fn sort(n: usize, vectors: &mut [f64], values: &mut [f64]) {
    for to in 0..n {
        let from = (to..n).fold(to, |least, i| if values[i] < values[least] { i } else { least });
        if from != to {
            values.swap(to, from);
            let (before, after) = vectors.split_at_mut(from * n);
            before[to * n..(to + 1) * n].swap_with_slice(&mut after[..n]);
        }
    }
}

fn kept<K: PartialEq>(
    all: &mut Vec<(K, MemBuffer)>,
    key: K,
    make: impl FnOnce() -> MemBuffer,
) -> &mut MemBuffer {
    let at = all.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
        all.push((key, make()));
        all.len() - 1
    });
    &mut all[at].1
}

fn is_nothing(matrix: &[f64]) -> bool {
    matrix.iter().all(|entry| entry.abs() < f64::MIN_POSITIVE)
}

fn unit(n: usize, vectors: &mut [f64], values: &mut [f64]) {
    vectors.fill(0.0);
    vectors.iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
    values.fill(0.0);
}

/// nalgebra's for a size known at compile time, in half the time; gives whether it converged.
fn symmetric_fixed<const N: usize>(matrix: &[f64], vectors: &mut [f64], values: &mut [f64]) -> bool
where
    Const<N>: DimSub<U1>,
    DefaultAllocator: Allocator<Const<N>, Const<N>> + Allocator<Const<N>> + Allocator<DimDiff<Const<N>, U1>>,
{
    let matrix = OMatrix::<f64, Const<N>, Const<N>>::from_column_slice(matrix);
    let found = nalgebra::SymmetricEigen::<f64, Const<N>>::try_new(matrix, f64::EPSILON, MAX_SWEEPS * N);
    let Some(found) = found.filter(|found| found.eigenvalues.iter().all(|value| value.is_finite())) else {
        return false;
    };
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_unstable_by(|&i, &j| found.eigenvalues[i].total_cmp(&found.eigenvalues[j]));
    for (col, from) in order.into_iter().enumerate() {
        values[col] = found.eigenvalues[from];
        let vector = &mut vectors[col * N..(col + 1) * N];
        vector.iter_mut().zip(&found.eigenvectors.column(from)).for_each(|(entry, value)| *entry = *value);
    }
    true
}
