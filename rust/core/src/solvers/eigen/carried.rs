//! An eigendecomposition carried from step to step: the last eigenvectors, extrapolated, refined to rounding.
//!
//! With R = 1 − `UᵀU` and S = `UᵀAU` of nearly orthonormal, nearly eigenvectors U (Ogita and Aishima, Iterative refinement for
//! symmetric eigenvalue decomposition, 2018):
//!
//! ```text
//!     λᵢ = Sᵢᵢ / (1 − Rᵢᵢ) + Σ (Sᵢⱼ + λᵢ Rᵢⱼ) Eⱼᵢ;     U ← U (1 + E);
//!     Eᵢⱼ = (Sᵢⱼ + λⱼ Rᵢⱼ) / (λⱼ − λᵢ),  or ½ Rᵢⱼ where nothing is to be turned.
//! ```
//!
//! Four products of matrices, no chain of rotations, and the error is squared. What E was says how good U is now: where that
//! is not rounding after a few rounds, or an eigenvalue has come across the cut, the matrix is decomposed anew. Nothing is
//! taken on trust: S and R are computed from the matrix of the step.
//!
//! The sum over E is of second order, and what makes small eigenvalues right beside large ones.
//!
//! Within the null space nothing is turned, whose eigenvectors nobody asks for: there the values are rounding, or what is left
//! of a redundant row in a loop that stands open, and their vectors turn as they like.

use super::{GRADED, ILL, SEMIDEFINITE_TOLERANCE, SymmetricEigen, margin};
use crate::error::Error;
use crate::linalg::kernels::{axpy, by_size, gram, largest, multiply, multiply_tr, norm, widest};
use crate::problem::Blocks;
use crate::solvers::history::{History, LONGEST};
use crate::solvers::solver::State;

/// E beyond which the eigenvectors are not near enough to be refined.
const FAR: f64 = 0.1;

/// Eigenvalues are told apart where their gap is this many times what couples them …
const APART: f64 = 10.0;

/// … and this many times Σ off² / λₙ, what the turns of all pairs may leave between them, of second order. With the largest
/// coupling of all in place of both, mechanisms of equal legs were decomposed anew at every step, for their eigenvalues come
/// in clusters; with less of it, eigenvalues that are equal are turned by rounding.
const CLEAR: f64 = 100.0;

/// What rounding says of a pair is followed where it turns the vectors by no more than this: squared it vanishes.
const SLIGHT: f64 = 1e-9;

/// Rounds of a refinement: 0.1, 1e-2, 1e-4 and 1e-8 are squared to rounding.
const ROUNDS: usize = 4;

/// Fields of a saved state.
const FIELDS: [&str; 3] = ["rank", "vectors", "vectors_track"];

/// Eigenvalues and eigenvectors of a sequence of matrices.
#[derive(Clone)]
pub(crate) struct CarriedEigen {
    eigen: SymmetricEigen,
    past: History,
    /// A U, then E.
    image: Vec<f64>,
    /// S, then U E.
    form: Vec<f64>,
    /// `UᵀU`.
    gram: Vec<f64>,
    /// The sums over E.
    shifts: Vec<f64>,
}

impl CarriedEigen {
    /// A workspace for `n×n` matrices, without a past.
    #[must_use]
    pub(crate) fn new(n: usize) -> Self {
        let square = || vec![0.0; n * n];
        let (eigen, past) = (SymmetricEigen::new(n), History::new(LONGEST, n * n));
        Self { eigen, past, image: square(), form: square(), gram: square(), shifts: vec![0.0; n] }
    }

    /// The decomposition of the last matrix.
    pub(crate) fn eigen(&mut self) -> &mut SymmetricEigen {
        &mut self.eigen
    }

    /// Forgets all earlier matrices.
    pub(crate) fn forget(&mut self) {
        self.past.restart(self.form.len());
    }

    /// Decomposes the next `matrix` as [`SymmetricEigen::decompose`] does; gives the rounds that refined the last decomposition,
    /// or none if it was not near enough.
    ///
    /// # Errors
    /// Those of [`SymmetricEigen::decompose`].
    pub(crate) fn decompose(
        &mut self,
        matrix: &[f64],
        rank_cut: f64,
        blocks: &mut Blocks,
    ) -> Result<Option<usize>, Error> {
        let rounds = self.refine(matrix, rank_cut, blocks);
        if rounds.is_none() {
            self.forget();
            self.eigen.decompose(matrix, rank_cut, blocks)?;
        }
        // Of several blocks the vectors come in an order of their own.
        if blocks.len() == 1 {
            self.past.push(&self.eigen.vectors);
        }
        Ok(rounds)
    }

    /// As a saved state of the solver of that name; empty without an earlier matrix.
    #[must_use]
    pub(crate) fn save(&self, solver: &str) -> State {
        if self.past.is_empty() {
            return State::new(solver, 0);
        }
        let state = State::new(solver, self.eigen.len()).with("rank", &[self.eigen.rank as f64]);
        self.past.save(state, "vectors")
    }

    /// From a saved state.
    ///
    /// # Errors
    /// [`Error::State`] if it is another solver's, or not whole.
    pub(crate) fn load(state: &State, solver: &'static str) -> Result<Self, Error> {
        state.check(solver, &[])?;
        state.check_names(solver, &FIELDS)?;
        if state.fields.is_empty() {
            return Ok(Self::new(0));
        }
        let (n, entries) = (state.size, state.field("vectors").len());
        if n == 0 || n.saturating_mul(n) > entries {
            let reason = format!("field 'vectors' has {entries} entries, expected at least {n}×{n} of them");
            return Err(Error::State { solver, reason });
        }
        state.check(solver, &[("rank", 1)])?;
        let mut carried = Self::new(n);
        carried.eigen.rank = State::count(state.field("rank")[0], 0..=n, solver)?;
        carried.past.load(state, "vectors", (n * n, 1), solver)?;
        Ok(carried)
    }

    fn refine(&mut self, matrix: &[f64], rank_cut: f64, blocks: &mut Blocks) -> Option<usize> {
        let n = self.eigen.len();
        let graded =
            |sizes: &mut Vec<f64>| blocks.sizes(blocks.of(0), |row| matrix[row * (n + 1)], sizes) > GRADED;
        if self.past.is_empty() || blocks.len() > 1 || graded(&mut self.eigen.scales) {
            return None;
        }
        self.past.advance();
        self.past.predict(&mut self.eigen.vectors);
        for round in 1..=ROUNDS {
            let (turned, coupled) = self.turn(matrix);
            if turned.is_nan() || turned > FAR {
                return None;
            }
            if turned * turned <= f64::EPSILON && !coupled {
                return self.are_divided(rank_cut, blocks).then_some(round);
            }
        }
        None
    }

    /// Whether the rank is still that of the kept values, all of which lie above the others, and those not below zero.
    fn are_divided(&mut self, rank_cut: f64, blocks: &mut Blocks) -> bool {
        let eigen = &mut self.eigen;
        let null = eigen.len() - eigen.rank;
        let (dropped, kept) = eigen.values.split_at(null);
        let scale = largest(&eigen.values);
        let least = kept.iter().fold(f64::INFINITY, |least, &value| least.min(value));
        let told = dropped.iter().all(|&value| value < least && value >= -SEMIDEFINITE_TOLERANCE * scale);
        eigen.margin = margin(&eigen.values, null, rank_cut);
        eigen.least = if least.is_finite() { least } else { 0.0 };
        // Of small ones the refinement has fewer digits than Jacobi's rotations.
        told && least > ILL * scale && blocks.decide(0, &eigen.values, rank_cut, 0.0) == eigen.rank
    }

    /// Values and vectors of one round; gives ‖E‖, and whether vectors are coupled that cannot be told apart yet.
    fn turn(&mut self, matrix: &[f64]) -> (f64, bool) {
        let n = self.eigen.len();
        by_size!(n, Self::turn_fixed(self, matrix), self.turn_sized(n, matrix))
    }

    /// For the processor's widest vectors.
    fn turn_fixed<const N: usize>(&mut self, matrix: &[f64]) -> (f64, bool) {
        widest(
            #[inline(always)]
            || self.turn_sized(N, matrix),
        )
    }

    #[allow(clippy::inline_always)] // so that the size is known, and the vectors are as wide as the caller's
    #[inline(always)]
    fn turn_sized(&mut self, n: usize, matrix: &[f64]) -> (f64, bool) {
        let (vectors, values) = (&mut self.eigen.vectors, &mut self.eigen.values);
        multiply(n, matrix, vectors, &mut self.image);
        multiply_tr(n, vectors, &self.image, &mut self.form);
        gram(n, vectors, &mut self.gram);
        for (i, value) in values.iter_mut().enumerate() {
            *value = self.form[i * (n + 1)] / self.gram[i * (n + 1)];
        }
        let null = n - self.eigen.rank;
        let (form, gram) = (&self.form[..n * n], &self.gram[..n * n]);
        let (mut coupling, mut square) = (0.0, 0.0);
        for col in 0..n {
            for row in 0..col {
                let (entry, rest) = (form[col * n + row], -gram[col * n + row]);
                if col < null {
                    square += 2.0 * entry * entry;
                } else {
                    let (off, other) = (entry + values[col] * rest, entry + values[row] * rest);
                    coupling += off * off + other * other;
                }
            }
        }
        let dropped = values[..null].iter().map(|value| value * value).sum::<f64>();
        self.eigen.dropped = (dropped + square).sqrt();
        let scale = largest(values);
        let rounding = n as f64 * f64::EPSILON * scale;
        let apart = CLEAR * coupling / scale;
        let (turns, shifts) = (&mut self.image[..n * n], &mut self.shifts[..n]);
        shifts.fill(0.0);
        let mut coupled = false;
        for col in 0..n {
            turns[col * (n + 1)] = 0.5 * (1.0 - gram[col * (n + 1)]);
            for row in 0..col {
                let (at, mirrored) = (col * n + row, row * n + col);
                let (entry, rest) = (form[at], -gram[at]);
                let (off, other) = (entry + values[col] * rest, entry + values[row] * rest);
                let gap = values[col] - values[row];
                let turn = off / gap;
                // −other / gap, but for a rounding that would cost orthogonality where the gap is small.
                let back = rest - turn;
                let size = off.abs().max(other.abs());
                let sound = size > rounding;
                let told = if sound {
                    gap.abs() > apart.max(APART * size)
                } else {
                    turn.abs().max(back.abs()) <= SLIGHT
                };
                (turns[at], turns[mirrored]) = if told && col >= null {
                    shifts[col] += off * turn;
                    shifts[row] += other * back;
                    (turn, back)
                } else {
                    coupled |= sound && col >= null;
                    (0.5 * rest, 0.5 * rest)
                };
            }
        }
        axpy(1.0, shifts, values);
        let turned = norm(&self.image);
        multiply(n, vectors, &self.image, &mut self.form);
        axpy(1.0, &self.form, vectors);
        (turned, coupled)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use crate::solvers::eigen::RANK_CUT;

    /// Q diag(values) Qᵀ, Q a rotation by `angle` in every plane of two neighbours.
    fn turned(values: &[f64], angle: f64) -> DMatrix<f64> {
        let n = values.len();
        let mut q = DMatrix::<f64>::identity(n, n);
        for i in 1..n {
            let mut plane = DMatrix::<f64>::identity(n, n);
            let (sin, cos) = angle.sin_cos();
            (plane[(i - 1, i - 1)], plane[(i, i)]) = (cos, cos);
            (plane[(i - 1, i)], plane[(i, i - 1)]) = (-sin, sin);
            q *= plane;
        }
        &q * DMatrix::from_diagonal(&DVector::from_row_slice(values)) * q.transpose()
    }

    #[test]
    fn an_eigenvalue_below_zero_is_refused_also_by_one_who_was_near_it() {
        let mut carried = CarriedEigen::new(3);
        let at = |value: f64| turned(&[1.0, 2.0, value], 0.3);
        carried.decompose(at(1e-12).as_slice(), RANK_CUT, &mut Blocks::whole(3)).expect("semidefinite");
        assert_eq!(carried.decompose(at(1e-13).as_slice(), RANK_CUT, &mut Blocks::whole(3)), Ok(Some(1)));
        let refused = carried.decompose(at(-1e-6).as_slice(), RANK_CUT, &mut Blocks::whole(3));
        assert!(matches!(refused, Err(Error::NotPositiveSemidefinite { .. })), "{refused:?}");
        assert_eq!(
            carried.decompose(at(0.0).as_slice(), RANK_CUT, &mut Blocks::whole(3)),
            Ok(None),
            "nothing is carried from what was refused"
        );
    }

    #[test]
    fn what_is_carried_is_a_decomposition_to_rounding() {
        let mut carried = CarriedEigen::new(4);
        for k in 0..50 {
            let matrix = turned(&[3.0, 1.0, 1.0, 0.0], 0.3 + 1e-3 * f64::from(k));
            carried.decompose(matrix.as_slice(), RANK_CUT, &mut Blocks::whole(4)).expect("semidefinite");
            let eigen: &SymmetricEigen = carried.eigen();
            let vectors = DMatrix::from_fn(4, 4, |row, col| eigen.vector(col)[row]);
            let values = DMatrix::from_fn(4, 4, |row, col| if row == col { eigen.value(row) } else { 0.0 });
            let unit = vectors.tr_mul(&vectors) - DMatrix::<f64>::identity(4, 4);
            assert!(unit.norm() <= 100.0 * f64::EPSILON, "UᵀU = 1: {:e}", unit.norm());
            let gap = &matrix * &vectors - &vectors * values;
            assert!(gap.norm() <= 100.0 * f64::EPSILON * matrix.norm(), "A U = U diag(w): {:e}", gap.norm());
        }
    }
}
