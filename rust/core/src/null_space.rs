//! An orthonormal basis N (n×d) of null(A), carried from step to step.
//!
//! The basis is extrapolated from its last positions and corrected by the caller (see [`tracked`](crate::tracked)). A
//! basis is defined only up to a rotation of its columns; earlier ones are therefore turned to meet the newest before
//! they are extrapolated (orthogonal Procrustes). All rotations here are near the identity, where the Newton–Schulz
//! iteration `X ← ½ X (3 − XᵀX)` gives the nearest orthonormal matrix in one or two steps (Higham, *Functions of
//! Matrices*, §8.3), without a decomposition.

use crate::error::Error;
use crate::kernels::{axpy, dot, norm};
use crate::params::Params;
use crate::solver::State;
use crate::tracked::TrackedParams;

/// Bases kept: the present one and those it is extrapolated from.
const HISTORY: usize = 3;

/// Coefficients of the extrapolation of order 0, 1, 2 at equal steps, newest first.
const EXTRAPOLATION: [&[f64]; HISTORY] = [&[1.0], &[2.0, -1.0], &[3.0, -3.0, 1.0]];

/// The basis, with those of earlier steps.
#[derive(Debug, Clone, Default)]
pub struct NullSpace {
    n: usize,
    d: usize,
    /// The present basis, n×d, column-major.
    basis: Vec<f64>,
    /// Accepted bases, newest first; all turned to meet the newest.
    past: [Vec<f64>; HISTORY],
    kept: usize,
    gram: Vec<f64>,
    work: Vec<f64>,
    /// How far each order of extrapolation was off lately.
    misses: [f64; HISTORY],
}

impl NullSpace {
    /// For n rows, without a basis yet.
    #[must_use]
    pub fn new(n: usize) -> Self {
        let full = || Vec::with_capacity(n * n);
        Self {
            n,
            d: 0,
            basis: full(),
            past: std::array::from_fn(|_| full()),
            kept: 0,
            gram: full(),
            work: full(),
            misses: [0.0; HISTORY],
        }
    }

    /// Dimension d of the null space.
    #[must_use]
    pub const fn dim(&self) -> usize {
        self.d
    }

    /// N, n×d, column-major.
    #[must_use]
    pub fn basis(&self) -> &[f64] {
        &self.basis
    }

    /// The columns of N.
    pub fn columns(&self) -> std::slice::ChunksExact<'_, f64> {
        self.basis.chunks_exact(self.n.max(1))
    }

    /// The j-th column of N, to be corrected.
    pub fn column_mut(&mut self, j: usize) -> &mut [f64] {
        &mut self.basis[j * self.n..(j + 1) * self.n]
    }

    /// Starts from these orthonormal columns, without a past.
    pub fn restart<'a>(&mut self, columns: impl Iterator<Item = &'a [f64]>) {
        self.basis.clear();
        columns.for_each(|column| self.basis.extend_from_slice(column));
        self.d = self.basis.len() / self.n.max(1);
        let size = self.basis.len();
        for past in &mut self.past {
            past.clear();
            past.resize(size, 0.0);
        }
        self.gram.resize(self.d * self.d, 0.0);
        self.work.resize(size, 0.0);
        self.misses = [0.0; HISTORY];
        self.kept = 0;
        self.keep();
    }

    /// Extrapolates the basis to the next step by the order that was best lately; orthonormal to rounding.
    pub fn predict(&mut self) {
        if self.d == 0 {
            return;
        }
        // Ties go to the higher order: at a refresh all have missed by nothing.
        let order = (0..self.kept).rev().fold(self.kept - 1, |best, order| {
            if self.misses[order] < self.misses[best] { order } else { best }
        });
        extrapolate(EXTRAPOLATION[order], &self.past, &mut self.basis);
        self.orthonormalise();
    }

    /// Takes the corrected basis as the newest; whether it could be made orthonormal.
    pub fn accept(&mut self) -> bool {
        if self.d == 0 {
            return true;
        }
        if !self.orthonormalise() {
            return false;
        }
        self.score();
        self.keep();
        true
    }

    /// Turns the past to meet the present basis, and sees how far each order would have missed it.
    fn score(&mut self) {
        let (n, d) = (self.n, self.d);
        for (col, gram) in self.gram.chunks_exact_mut(d).enumerate() {
            let new = &self.basis[col * n..(col + 1) * n];
            for (row, entry) in gram.iter_mut().enumerate() {
                *entry = dot(&self.past[0][row * n..(row + 1) * n], new);
            }
        }
        polar(d, &mut self.gram, &mut self.work);
        for past in &mut self.past[..self.kept] {
            multiply(n, d, past, &self.gram, &mut self.work);
            past.copy_from_slice(&self.work);
        }
        for (order, coefficients) in EXTRAPOLATION.iter().enumerate().take(self.kept) {
            extrapolate(coefficients, &self.past, &mut self.work);
            axpy(-1.0, &self.basis, &mut self.work);
            self.misses[order] = norm(&self.work).max(0.5 * self.misses[order]);
        }
    }

    fn keep(&mut self) {
        self.past.rotate_right(1);
        self.past[0].copy_from_slice(&self.basis);
        self.kept = (self.kept + 1).min(HISTORY);
    }

    /// The nearest orthonormal basis; whether the columns were near enough to one.
    fn orthonormalise(&mut self) -> bool {
        let (n, d) = (self.n, self.d);
        for _ in 0..4 {
            let mut off = 0.0_f64;
            for col in 0..d {
                for row in 0..=col {
                    let product =
                        dot(&self.basis[row * n..(row + 1) * n], &self.basis[col * n..(col + 1) * n]);
                    let unit = f64::from(u8::from(row == col));
                    off = off.max((product - unit).abs());
                    let entry = 1.5 * unit - 0.5 * product;
                    self.gram[col * d + row] = entry;
                    self.gram[row * d + col] = entry;
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
            if off < 1e-8 {
                return true;
            }
        }
        true
    }

    /// Adds itself to a saved state.
    #[must_use]
    pub fn save(&self, state: State) -> State {
        let mut track = vec![self.d as f64, self.kept as f64];
        track.extend_from_slice(&self.misses);
        state.with("null", &self.basis).with("null_past", &self.past.concat()).with("null_track", &track)
    }

    /// Takes itself from a saved state of its size.
    ///
    /// # Errors
    /// [`Error::State`] if the fields are not whole.
    pub fn load(&mut self, state: &State) -> Result<(), Error> {
        let solver = TrackedParams::SOLVER;
        state.check(solver, &[("null_track", 2 + HISTORY)])?;
        let track = state.field("null_track");
        let size = State::count(track[0], 0..=self.n, solver)? * self.n;
        let kept = State::count(track[1], 1..=HISTORY, solver)?;
        state.check(solver, &[("null", size), ("null_past", HISTORY * size)])?;
        self.restart(state.field("null").chunks_exact(self.n.max(1)));
        self.kept = kept;
        self.misses.copy_from_slice(&track[2..]);
        if size > 0 {
            for (past, saved) in self.past.iter_mut().zip(state.field("null_past").chunks_exact(size)) {
                past.copy_from_slice(saved);
            }
        }
        Ok(())
    }

    /// v ← v − N (Nᵀ v); gives ‖Nᵀ v‖².
    pub fn project(&self, v: &mut [f64]) -> f64 {
        let mut squared = 0.0;
        for column in self.columns() {
            let part = dot(column, v);
            squared += part * part;
            axpy(-part, column, v);
        }
        squared
    }
}

/// Σ coefficientᵢ pastᵢ into `out`.
fn extrapolate(coefficients: &[f64], past: &[Vec<f64>], out: &mut [f64]) {
    out.fill(0.0);
    for (&coefficient, past) in coefficients.iter().zip(past) {
        axpy(coefficient, past, out);
    }
}

/// out = X G, X n×d and G d×d, column-major.
fn multiply(n: usize, d: usize, x: &[f64], g: &[f64], out: &mut [f64]) {
    out.fill(0.0);
    for (column, coefficients) in out.chunks_exact_mut(n).zip(g.chunks_exact(d)) {
        for (from, &coefficient) in x.chunks_exact(n).zip(coefficients) {
            axpy(coefficient, from, column);
        }
    }
}

/// The orthogonal matrix nearest to G (d×d, near one), in place.
fn polar(d: usize, g: &mut [f64], work: &mut [f64]) {
    if d == 1 {
        g[0] = g[0].signum();
        return;
    }
    let work = &mut work[..d * d];
    for _ in 0..6 {
        let mut off = 0.0_f64;
        work.copy_from_slice(g);
        for col in 0..d {
            for row in 0..d {
                // ½ G (3 − GᵀG), entry by entry: d is small.
                let mut sum = 0.0;
                for k in 0..d {
                    let product = dot(&work[k * d..(k + 1) * d], &work[col * d..(col + 1) * d]);
                    let unit = f64::from(u8::from(k == col));
                    off = off.max((product - unit).abs());
                    sum += work[k * d + row] * (1.5 * unit - 0.5 * product);
                }
                g[col * d + row] = sum;
            }
        }
        if off < 1e-8 {
            return;
        }
    }
}
