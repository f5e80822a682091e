//! An orthonormal basis N (n×d) of null(A), carried from step to step.
//!
//! The basis is extrapolated from its last positions and corrected by the caller (see [`tracked`](crate::solvers::tracked)). A
//! basis is defined only up to a rotation of its columns. The corrections lie in range(A), so that Nᵀ dN = 0: the columns
//! are carried along in parallel, which is as smooth as the null space itself, and earlier bases need no turning before
//! they are extrapolated. What orthonormality is lost is small; the Newton–Schulz iteration `N ← ½ N (3 − NᵀN)` gives the
//! nearest orthonormal basis in one or two steps, without a decomposition and without a turn (Higham, *Functions of
//! Matrices*, §8.3).

use crate::error::Error;
use crate::linalg::kernels::{BLOCKED, axpy, by_size, dot, gemm, gemm_tr};
use crate::solvers::history::{History, LONGEST};
use crate::solvers::solver::State;

/// The basis, with those of earlier steps.
#[derive(Debug, Clone, Default)]
pub(crate) struct NullSpace {
    n: usize,
    d: usize,
    /// The present basis, n×d, column-major.
    basis: Vec<f64>,
    past: History,
    gram: Vec<f64>,
    work: Vec<f64>,
}

impl NullSpace {
    /// For n rows, without a basis yet.
    #[must_use]
    pub(crate) fn new(n: usize) -> Self {
        let full = || Vec::with_capacity(n * n);
        Self { n, d: 0, basis: full(), past: History::new(LONGEST, n * n), gram: full(), work: full() }
    }

    /// Dimension d of the null space.
    #[must_use]
    pub(crate) const fn dim(&self) -> usize {
        self.d
    }

    /// N, n×d, column-major.
    #[must_use]
    pub(crate) fn basis(&self) -> &[f64] {
        &self.basis
    }

    /// The columns of N.
    pub(crate) fn columns(&self) -> std::slice::ChunksExact<'_, f64> {
        self.basis.chunks_exact(self.n.max(1))
    }

    /// N ← N − C, `n×d`.
    pub(crate) fn correct(&mut self, correction: &[f64]) {
        axpy(-1.0, correction, &mut self.basis);
    }

    /// Starts from these orthonormal columns, without a past.
    pub(crate) fn restart<'a>(&mut self, columns: impl Iterator<Item = &'a [f64]>) {
        self.basis.clear();
        columns.for_each(|column| self.basis.extend_from_slice(column));
        self.d = self.basis.len() / self.n.max(1);
        self.past.restart(self.basis.len());
        self.gram.resize(self.d * self.d, 0.0);
        self.work.resize(self.basis.len(), 0.0);
        self.past.push(&self.basis);
    }

    /// Extrapolates the basis to the next step, orthonormal to rounding; gives how far off it is to be expected.
    pub(crate) fn predict(&mut self) -> f64 {
        if self.d == 0 {
            return 0.0;
        }
        self.past.advance();
        self.past.predict(&mut self.basis);
        if self.orthonormalise() { self.past.expected_miss() } else { f64::INFINITY }
    }

    /// Takes the corrected basis as the newest; whether it could be made orthonormal.
    pub(crate) fn accept(&mut self) -> bool {
        if self.d == 0 {
            return true;
        }
        let sound = self.orthonormalise();
        if sound {
            self.past.push(&self.basis);
        }
        sound
    }

    /// The nearest orthonormal basis; whether the columns were near enough to one.
    fn orthonormalise(&mut self) -> bool {
        let (n, d) = (self.n, self.d);
        for _ in 0..4 {
            // In: NᵀN. Out: ½ (3 − NᵀN).
            products(n, d, &self.basis, &mut self.gram);
            let mut off = 0.0_f64;
            for (col, column) in self.gram.chunks_exact_mut(d).enumerate() {
                for (row, entry) in column.iter_mut().enumerate() {
                    let unit = f64::from(u8::from(row == col));
                    off = off.max((*entry - unit).abs());
                    *entry = 1.5 * unit - 0.5 * *entry;
                }
            }
            if off > 0.5 || off.is_nan() {
                return false;
            }
            if off < 4.0 * f64::EPSILON {
                return true;
            }
            multiply(n, d, &self.basis, &self.gram, &mut self.work);
            std::mem::swap(&mut self.basis, &mut self.work);
            // The next error is ¾ of this one's square.
            if off < 1e-8 {
                return true;
            }
        }
        true
    }

    /// Adds itself to a saved state.
    #[must_use]
    pub(crate) fn save(&self, state: State) -> State {
        self.past.save(state.with("null", &self.basis).with("null_dim", &[self.d as f64]), "null_differences")
    }

    /// Takes itself from a saved state of its size, of the solver of that name.
    ///
    /// # Errors
    /// [`Error::State`] if the fields are not whole.
    pub(crate) fn load(&mut self, state: &State, solver: &'static str) -> Result<(), Error> {
        state.check(solver, &[("null_dim", 1)])?;
        let size = State::count(state.field("null_dim")[0], 0..=self.n, solver)? * self.n;
        state.check(solver, &[("null", size)])?;
        self.restart(state.field("null").chunks_exact(self.n.max(1)));
        self.past.load(state, "null_differences", (size, 1), solver)
    }

    /// v ← v − N (Nᵀ v); gives ‖Nᵀ v‖².
    pub(crate) fn project(&self, v: &mut [f64]) -> f64 {
        by_size!(self.n, project_fixed(&self.basis, v), project_dynamic(self.columns(), v))
    }
}

fn project_fixed<const N: usize>(basis: &[f64], v: &mut [f64]) -> f64 {
    let (columns, _) = basis.as_chunks::<N>();
    let Some(v) = v.first_chunk_mut::<N>() else { return 0.0 };
    let mut squared = 0.0;
    for column in columns {
        let part = dot(column, v);
        squared += part * part;
        axpy(-part, column, v);
    }
    squared
}

fn project_dynamic<'a>(columns: impl Iterator<Item = &'a [f64]>, v: &mut [f64]) -> f64 {
    let mut squared = 0.0;
    for column in columns {
        let part = dot(column, v);
        squared += part * part;
        axpy(-part, column, v);
    }
    squared
}

/// `gram` = `NᵀN` of columns of n entries.
fn products(n: usize, d: usize, basis: &[f64], gram: &mut [f64]) {
    if n >= BLOCKED && d > 2 {
        gemm_tr(d, n, basis, basis, gram);
        return;
    }
    by_size!(
        n,
        products_fixed(d, basis, gram),
        for col in 0..d {
            for row in 0..=col {
                let product = dot(&basis[row * n..(row + 1) * n], &basis[col * n..(col + 1) * n]);
                gram[col * d + row] = product;
                gram[row * d + col] = product;
            }
        }
    );
}

fn products_fixed<const N: usize>(d: usize, basis: &[f64], gram: &mut [f64]) {
    let (columns, _) = basis.as_chunks::<N>();
    for (col, column) in columns.iter().enumerate() {
        for (row, other) in columns[..=col].iter().enumerate() {
            let product = dot(other, column);
            gram[col * d + row] = product;
            gram[row * d + col] = product;
        }
    }
}

/// out = X G, X n×d and G d×d, column-major.
fn multiply(n: usize, d: usize, x: &[f64], g: &[f64], out: &mut [f64]) {
    if n >= BLOCKED && d > 2 {
        gemm(n, d, x, g, out);
        return;
    }
    out.fill(0.0);
    for (column, coefficients) in out.chunks_exact_mut(n).zip(g.chunks_exact(d)) {
        for (from, &coefficient) in x.chunks_exact(n).zip(coefficients) {
            axpy(coefficient, from, column);
        }
    }
}
