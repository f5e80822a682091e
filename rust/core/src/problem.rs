//! The problem of one step as a solver sees it: A as an operator, b, and A itself if the solver asks for it.

pub mod blocks;
pub(crate) mod fold;
pub(crate) mod step;
pub(crate) mod whitened;

pub use blocks::Blocks;
pub use fold::{FOLD_TOLERANCE, Fold};
pub use step::{FactoredStep, JacobianView, SparseStep, StepView, TreeView, Whiten};

use self::whitened::{Sparse, Whitened};

use crate::linalg::kernels::{
    BLOCKED, axpy, by_size, combined_norm_fixed, dot, gemm, gemm_tr, gemv, gram, norm, normal_fixed, widest,
};
use crate::linalg::skyline;

/// What a solver works with. This is a hint: a [`Problem`] provides whatever the solver asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Products A x. A is formed only if the solver calls [`Problem::matrix`].
    Operator,
    /// The matrix A.
    Dense,
    /// Rows of J and M as they are, sparse; A or products with it only where it calls for them.
    Sparse,
}

/// What is wanted of a solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wanted {
    /// The minimum-norm multipliers A⁺ b.
    #[default]
    Multipliers,
    /// Any multipliers that give the right acceleration: any least-squares solution of A x = b.
    Acceleration,
}

/// A x = b of one step after folding: A = Wᵀ W + diag(R) with W = L⁻¹ Jrᵀ (nv×n), or A dense as it was given.
#[derive(Debug)]
pub struct Problem<'a> {
    /// What is wanted of the solver.
    pub wanted: Wanted,
    pub(crate) blocks: &'a mut Blocks,
    /// Where the step is sparse; W is made of it where it is asked for.
    pub(crate) sparse: Option<Sparse<'a>>,
    pub(crate) whitened: &'a mut Whitened,
    pub(crate) softness: Option<&'a [f64]>,
    pub(crate) dense: &'a mut [f64],
    pub(crate) formed: &'a mut bool,
    pub(crate) rhs: &'a [f64],
    pub(crate) work: &'a mut [f64],
}

impl Problem<'_> {
    /// Returns the number of rows n.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rhs.len()
    }

    /// Tells whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rhs.is_empty()
    }

    /// Returns b (`n`).
    #[must_use]
    pub fn rhs(&self) -> &[f64] {
        self.rhs
    }

    /// Makes W, unless it is made or the system was given as dense (A, b).
    pub(crate) fn whiten(&mut self) {
        if let (false, Some(sparse)) = (self.whitened.made, self.sparse)
            && self.whitened.make(sparse)
        {
            // Only the envelope is written to from now on.
            self.dense.fill(0.0);
        }
    }

    /// First columns of the rows of A, if its envelope is narrow.
    pub(crate) fn envelope(&self) -> Option<&[usize]> {
        self.whitened.envelope.narrow()
    }

    /// Computes y = A x (`n`), with A itself if it has been formed.
    pub fn apply(&mut self, x: &[f64], y: &mut [f64]) {
        self.whiten();
        if *self.formed {
            match self.whitened.envelope.narrow() {
                Some(first) => skyline::product(first, self.dense, x, y),
                None => gemv(self.dense, x, y),
            }
            return;
        }
        let columns = self.whitened.columns.as_slice();
        by_size!(self.work.len(), normal_fixed(columns, x, y), self.apply_spans(x, y));
        if let Some(softness) = self.softness {
            for ((entry, softness), x) in y.iter_mut().zip(softness).zip(x) {
                *entry += softness * x;
            }
        }
    }

    /// y = Wᵀ W x, each column of W by its span.
    fn apply_spans(&mut self, x: &[f64], y: &mut [f64]) {
        let Whitened { columns, spans, .. } = &*self.whitened;
        spans.combine(columns.as_slice(), x, self.work);
        spans.products(columns.as_slice(), Some(self.work), |index, product| y[index] = product);
    }

    /// Returns ‖W x‖ of some `rows` of x, the acceleration M⁻¹ Jᵀ x in the norm of M; of a system given as dense (A, b) √(xᵀ A x).
    /// `work` is workspace.
    pub(crate) fn acceleration_norm(&self, rows: &[usize], x: &[f64], work: &mut Vec<f64>) -> f64 {
        let (n, nv) = (self.len(), self.work.len());
        if nv == 0 {
            let row_sum = |&row: &usize| {
                x[row] * rows.iter().map(|&col| self.dense[row * n + col] * x[col]).sum::<f64>()
            };
            return rows.iter().map(row_sum).sum::<f64>().max(0.0).sqrt();
        }
        // W x before its square: rounding of a part of x in null(A) would stand beside it otherwise.
        let columns = self.whitened.columns.as_slice();
        by_size!(nv, combined_norm_fixed(columns, rows, x), self.acceleration_norm_spans(rows, x, work))
    }

    fn acceleration_norm_spans(&self, rows: &[usize], x: &[f64], work: &mut Vec<f64>) -> f64 {
        let nv = self.work.len();
        work.clear();
        work.resize(nv, 0.0);
        let Whitened { columns, spans, .. } = &*self.whitened;
        for &row in rows {
            let column = &columns.as_slice()[row * nv..(row + 1) * nv];
            axpy(x[row], spans.cut(row, column), spans.cut_mut(row, work));
        }
        norm(work)
    }

    /// Returns an entry of the diagonal of A.
    pub(crate) fn diagonal(&self, row: usize) -> f64 {
        let nv = self.work.len();
        if *self.formed {
            return self.dense[row * (self.len() + 1)];
        }
        let column = &self.whitened.columns.as_slice()[row * nv..(row + 1) * nv];
        dot(column, column) + self.softness.map_or(0.0, |softness| softness[row])
    }

    /// Computes Y = A X for a few columns at once (`n×d` each). `scratch` is workspace that grows as needed.
    pub fn apply_columns(&mut self, x: &[f64], y: &mut [f64], scratch: &mut Vec<f64>) {
        let (n, nv) = (self.len(), self.work.len());
        let columns = x.len() / n;
        if n < BLOCKED || columns < 3 {
            for (x, y) in x.chunks_exact(n).zip(y.chunks_exact_mut(n)) {
                self.apply(x, y);
            }
            return;
        }
        if *self.formed {
            gemm(n, n, self.dense, x, y);
            return;
        }
        self.whiten();
        let whitened = self.whitened.columns.as_slice();
        scratch.resize(nv * columns, 0.0);
        gemm(nv, n, whitened, x, scratch);
        gemm_tr(n, nv, whitened, scratch, y);
        if let Some(softness) = self.softness {
            for (x, y) in x.chunks_exact(n).zip(y.chunks_exact_mut(n)) {
                for ((entry, softness), x) in y.iter_mut().zip(softness).zip(x) {
                    *entry += softness * x;
                }
            }
        }
    }

    /// Returns the blocks of rows and the ranks that they hold.
    #[must_use]
    pub const fn blocks(&self) -> &Blocks {
        self.blocks
    }

    /// Returns A as [`matrix`](Self::matrix) does, beside the blocks, whose ranks its eigenvalues decide.
    pub(crate) fn matrix_and_blocks(&mut self) -> (&[f64], &mut Blocks) {
        self.matrix();
        (self.dense, self.blocks)
    }

    /// Returns A (`n×n`, symmetric, so both column-major and row-major), which is formed at the first call of a step.
    pub fn matrix(&mut self) -> &[f64] {
        if !*self.formed {
            self.whiten();
            if let Some(first) = self.whitened.envelope.narrow() {
                fill(self.whitened, first, self.work.len(), self.dense);
            } else {
                let (inner, columns) = (self.work.len(), self.whitened.columns.as_slice());
                let dense = &mut *self.dense;
                widest(
                    #[inline(always)]
                    || gram(inner, columns, dense),
                );
            }
            if let Some(softness) = self.softness {
                let n = self.rhs.len();
                for (i, value) in softness.iter().enumerate() {
                    self.dense[i * n + i] += value;
                }
            }
            *self.formed = true;
        }
        self.dense
    }

    /// Returns the smallest diagonal entry of A.
    #[must_use]
    pub fn least_diagonal(&self) -> f64 {
        (0..self.len()).map(|row| self.diagonal(row)).fold(f64::INFINITY, f64::min)
    }

    /// Returns trace(A), which is at least ‖A‖ and at most n ‖A‖.
    #[must_use]
    pub fn trace(&mut self) -> f64 {
        if *self.formed {
            return self.dense.iter().step_by(self.len() + 1).fold(0.0, |sum, entry| sum + entry);
        }
        self.whiten();
        let mut sum = self.softness.map_or(0.0, |softness| softness.iter().sum());
        self.whitened.spans.products(self.whitened.columns.as_slice(), None, |_, square| sum += square);
        sum
    }
}

/// `WᵀW` within its envelope; the rest of A is zero.
fn fill(whitened: &Whitened, first: &[usize], nv: usize, a: &mut [f64]) {
    let (n, w, spans) = (first.len(), whitened.columns.as_slice(), &whitened.spans);
    for (row, &start) in first.iter().enumerate() {
        let (begin, end) = spans.of(row);
        for col in start..=row {
            let (other, until) = spans.of(col);
            let to = end.min(until);
            let from = begin.max(other).min(to);
            let entry = dot(&w[row * nv + from..row * nv + to], &w[col * nv + from..col * nv + to]);
            a[row * n + col] = entry;
            a[col * n + row] = entry;
        }
    }
}
