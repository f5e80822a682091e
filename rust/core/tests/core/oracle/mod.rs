//! The right answers, in quad-double arithmetic: four doubles, 62 decimal digits.
//!
//! (Hida, Li, Bailey, "Algorithms for quad-double precision floating point arithmetic", ARITH-15 (2001); sums are
//! distilled as in Ogita, Rump, Oishi, "Accurate sum and dot product", SISC 26 (2005).)

#![allow(dead_code, clippy::needless_range_loop)] // Each test uses its part; indices follow the formulas.

use std::ops::{Add, Div, Mul, Neg, Sub};

use nalgebra::DMatrix;
use oarlock_core::StepView;

/// Pivots of A = J M⁻¹ Jᵀ below this part of the first count as zero: far above the 1e-62 of the arithmetic, and above
/// the (1e-16)² of a row that is zero but for the rounding of π/2.
pub const CUT: f64 = 1e-25;

/// An unevaluated sum of four doubles, each at most half an ulp of the one before.
#[derive(Debug, Clone, Copy, Default)]
pub struct Quad([f64; 4]);

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let back = sum - a;
    (sum, (a - (sum - back)) + (b - back))
}

fn two_product(a: f64, b: f64) -> (f64, f64) {
    let product = a * b;
    (product, a.mul_add(b, -product))
}

/// The sum of terms of falling size.
fn distil<const N: usize>(mut terms: [f64; N]) -> Quad {
    for first in 0..4 {
        for i in (first + 1..N).rev() {
            (terms[i - 1], terms[i]) = two_sum(terms[i - 1], terms[i]);
        }
    }
    let mut quad = [terms[0], terms[1], terms[2], terms[3]];
    for i in 0..3 {
        (quad[i], quad[i + 1]) = two_sum(quad[i], quad[i + 1]);
    }
    Quad(quad)
}

impl Quad {
    /// The nearest double.
    pub const fn value(self) -> f64 {
        self.0[0]
    }

    /// self + a b, for doubles a and b.
    fn plus_product(self, a: f64, b: f64) -> Self {
        let (high, low) = two_product(a, b);
        let [q0, q1, q2, q3] = self.0;
        distil([q0, high, q1, low, q2, q3])
    }

    fn times(self, b: f64) -> Self {
        let [(p0, e0), (p1, e1), (p2, e2)] = [0, 1, 2].map(|i| two_product(self.0[i], b));
        distil([p0, p1, e0, p2, e1, self.0[3].mul_add(b, e2)])
    }
}

impl From<f64> for Quad {
    fn from(value: f64) -> Self {
        Self([value, 0.0, 0.0, 0.0])
    }
}

impl Neg for Quad {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|part| -part))
    }
}

impl Add for Quad {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (self.0, other.0);
        distil([a0, b0, a1, b1, a2, b2, a3, b3])
    }
}

impl Sub for Quad {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Quad {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let ([a0, a1, a2, a3], [b0, b1, b2, b3]) = (self.0, other.0);
        let (p00, e00) = two_product(a0, b0);
        let (p01, e01) = two_product(a0, b1);
        let (p10, e10) = two_product(a1, b0);
        let (p02, e02) = two_product(a0, b2);
        let (p11, e11) = two_product(a1, b1);
        let (p20, e20) = two_product(a2, b0);
        let last = a0 * b3 + a1 * b2 + a2 * b1 + a3 * b0 + e02 + e11 + e20;
        distil([p00, p01, p10, e00, p02, p11, p20, e01, e10, last])
    }
}

impl Div for Quad {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let (mut rest, mut quotient) = (self, Self::default());
        for _ in 0..5 {
            let digit = rest.value() / other.value();
            rest = rest - other.times(digit);
            quotient = quotient + Self::from(digit);
        }
        quotient
    }
}

/// C = L D Lᵀ of a symmetric positive definite matrix; no square roots.
struct Definite {
    lower: Vec<Vec<Quad>>,
}

impl Definite {
    fn new(mut c: Vec<Vec<Quad>>) -> Self {
        let n = c.len();
        for col in 0..n {
            let pivot = c[col][col];
            assert!(pivot.value() > 0.0, "the oracle's matrix is not positive definite");
            let column: Vec<Quad> = (col + 1..n).map(|row| c[row][col]).collect();
            for row in col + 1..n {
                let factor = column[row - col - 1] / pivot;
                for k in col + 1..=row {
                    c[row][k] = c[row][k] - factor * column[k - col - 1];
                }
                c[row][col] = factor;
            }
        }
        Self { lower: c }
    }

    fn solve(&self, z: &mut [Quad]) {
        let n = z.len();
        for row in 0..n {
            for k in 0..row {
                z[row] = z[row] - self.lower[row][k] * z[k];
            }
        }
        for row in (0..n).rev() {
            z[row] = z[row] / self.lower[row][row];
            for k in row + 1..n {
                z[row] = z[row] - self.lower[k][row] * z[k];
            }
        }
    }
}

/// x = (J Jᵀ)⁺ b = J (JᵀJ)⁻² Jᵀ b, `n`, for J (`n×r`) of full column rank; rounded at the very end.
pub fn minimum_norm(factor: &DMatrix<f64>, rhs: &[f64]) -> Vec<f64> {
    let dot =
        |a: &[f64], b: &[f64]| a.iter().zip(b).fold(Quad::default(), |sum, (&a, &b)| sum.plus_product(a, b));
    let columns: Vec<&[f64]> = factor.as_slice().chunks_exact(factor.nrows()).collect();
    let rank = columns.len();
    let gram = (0..rank).map(|i| (0..=i).map(|j| dot(columns[i], columns[j])).collect()).collect();
    let gram = Definite::new(gram);
    let mut z: Vec<Quad> = columns.iter().map(|column| dot(column, rhs)).collect();
    gram.solve(&mut z);
    gram.solve(&mut z);
    let row = |row: usize| (0..rank).fold(Quad::default(), |sum, col| sum + z[col].times(columns[col][row]));
    (0..rhs.len()).map(|i| row(i).value()).collect()
}

/// a of M a = f + Jᵀλ, J a = aref, `nv`, and the rank of J: by elimination of A = J M⁻¹ Jᵀ with complete pivoting.
///
/// The rows must agree: the multipliers outside the pivots are zero, and their equations are not looked at.
pub fn acceleration(step: &StepView<'_>) -> (Vec<f64>, usize) {
    let (n, nv) = (step.aref.len(), step.force.len());
    let mass = Definite::new(
        (0..nv).map(|i| (0..=i).map(|j| Quad::from(step.mass[i * nv + j])).collect()).collect(),
    );
    let dot = |row: usize, z: &[Quad]| {
        let entries = &step.jacobian[row * nv..(row + 1) * nv];
        z.iter()
            .zip(entries)
            .fold(Quad::default(), |sum, (z, &j)| if j == 0.0 { sum } else { sum + z.times(j) })
    };
    let mut a0: Vec<Quad> = step.force.iter().map(|&f| Quad::from(f)).collect();
    mass.solve(&mut a0);
    let moved: Vec<Vec<Quad>> = (0..n)
        .map(|row| {
            let mut z: Vec<Quad> = (0..nv).map(|j| Quad::from(step.jacobian[row * nv + j])).collect();
            mass.solve(&mut z);
            z
        })
        .collect();
    let mut a: Vec<Vec<Quad>> = (0..n).map(|i| moved.iter().map(|z| dot(i, z)).collect()).collect();
    let mut b: Vec<Quad> = (0..n).map(|row| Quad::from(step.aref[row]) - dot(row, &a0)).collect();

    // A is semidefinite: the largest of what is left is on the diagonal.
    let (mut pivots, mut left): (Vec<usize>, Vec<usize>) = (Vec::new(), (0..n).collect());
    let mut first = 0.0;
    while let Some(at) =
        (0..left.len()).max_by(|&p, &q| a[left[p]][left[p]].value().total_cmp(&a[left[q]][left[q]].value()))
    {
        let pivot = left[at];
        let size = a[pivot][pivot].value();
        if pivots.is_empty() {
            first = size;
        }
        if size <= CUT * first {
            break;
        }
        left.swap_remove(at);
        for &row in &left {
            if a[row][pivot].value() == 0.0 {
                continue;
            }
            let factor = a[row][pivot] / a[pivot][pivot];
            for &col in &left {
                a[row][col] = a[row][col] - factor * a[pivot][col];
            }
            b[row] = b[row] - factor * b[pivot];
        }
        pivots.push(pivot);
    }
    let rank = pivots.len();
    let mut multipliers = vec![Quad::default(); n];
    for (order, &pivot) in pivots.iter().enumerate().rev() {
        let known = pivots[order + 1..].iter();
        let sum = known.fold(b[pivot], |sum, &other| sum - a[pivot][other] * multipliers[other]);
        multipliers[pivot] = sum / a[pivot][pivot];
    }
    for (z, &multiplier) in moved.iter().zip(&multipliers) {
        for (entry, &part) in a0.iter_mut().zip(z) {
            *entry = *entry + part * multiplier;
        }
    }
    (a0.iter().map(|entry| entry.value()).collect(), rank)
}
