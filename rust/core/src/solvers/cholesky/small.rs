//! [`cholesky`](crate::solvers::cholesky) for a size known at compile time: the same method on the stack, as L D Lᵀ.
//!
//! Whole columns are updated, upper triangle and all: with a fixed length that is one or two vector instructions, cheaper
//! than the bounds of a triangle. Everything is inlined into one function. Vectors wider than every processor has do not pay:
//! columns of six fill them badly, and the whole takes a tenth longer.

#![allow(clippy::inline_always, clippy::needless_range_loop)] // see above; loops of a fixed length over several arrays

use super::found::{Asked, Found};
use crate::problem::Wanted;

/// A pivot in the order of the last step is good enough when it is this part of the first one: searching and swapping cost
/// more than arithmetic here. Rank is decided among the smaller ones, which are searched for.
const GOOD_PIVOT: f64 = 0.02;

type Square<const N: usize> = [[f64; N]; N];

/// A⁺ b (or, for accelerations, a basic solution) of the N×N matrix `a`, column-major, into `x`; the part of b that no x can
/// reach into `outside`. `order` is the order of the pivots, to begin with that of the last step. Where the null space of
/// the factor is to be refined it ends with what was found: [`solve_refined`] goes on.
#[inline(always)]
pub(super) fn solve<const N: usize>(
    asked: Asked,
    order: &mut [usize],
    a: &[f64],
    rhs: &[f64],
    x: &mut [f64],
    outside: &mut [f64],
) -> Found {
    let (a, rhs, x, outside) = (&a[..N * N], &rhs[..N], &mut x[..N], &mut outside[..N]);
    let mut pivots: [usize; N] = std::array::from_fn(|i| order[i].min(N - 1));
    let mut columns: Square<N> =
        std::array::from_fn(|col| std::array::from_fn(|row| a[pivots[col] * N + pivots[row]]));
    let (mut rows, mut inverses) = ([[0.0; N]; N], [0.0; N]);
    let found = factorise(asked, &mut columns, &mut rows, &mut pivots, &mut inverses);
    order.copy_from_slice(&pivots);
    if found.wants_refining(N) {
        return found;
    }
    let rank = found.rank;

    let mut permuted: [f64; N] = std::array::from_fn(|i| rhs[pivots[i]]);
    let null = Null::new(rank, &rows);
    null.project(&mut permuted);
    for (&entry, &pivot) in permuted.iter().zip(&pivots) {
        outside[pivot] = rhs[pivot] - entry;
    }
    solve_basic(rank, &columns, &rows, &inverses, &mut permuted);
    if asked.wanted == Wanted::Multipliers {
        null.project(&mut permuted);
    }
    for (&entry, &pivot) in permuted.iter().zip(&pivots) {
        x[pivot] = entry;
    }
    found
}

/// A⁺ b of such a matrix, with complete pivoting, by a null space that is refined where the factor asks for it, and then a
/// second solve, of what the first one left: the steps of [`Cholesky::run`](super::Cholesky).
pub(super) fn solve_refined<const N: usize>(
    asked: Asked,
    order: &mut [usize],
    a: &[f64],
    rhs: &[f64],
    x: &mut [f64],
    outside: &mut [f64],
) -> Found {
    let (a, rhs, x, outside) = (&a[..N * N], &rhs[..N], &mut x[..N], &mut outside[..N]);
    let (mut columns, mut rows, mut inverses) = ([[0.0; N]; N], [[0.0; N]; N], [0.0; N]);
    let (found, pivots) = factorise_complete(asked, a, &mut columns, &mut rows, &mut inverses);
    order.copy_from_slice(&pivots);
    let (rank, refined) = (found.rank, found.wants_refining(N));
    let mut permuted = [[0.0; N]; N];
    for (column, &pivot) in permuted.iter_mut().zip(&pivots) {
        let from = &a[pivot * N..(pivot + 1) * N];
        for (entry, &pivot) in column.iter_mut().zip(&pivots) {
            *entry = from[pivot];
        }
    }

    let mut null = Null::new(rank, &rows);
    if refined {
        let mut images = [[0.0; N]; N];
        for k in rank..N {
            // Π A P Z
            let mut image = null.kernel[k].map(|entry| -entry);
            image[k] = 1.0;
            image = product(&permuted, &image);
            null.project(&mut image);
            solve_basic(rank, &columns, &rows, &inverses, &mut image);
            images[k] = image;
        }
        for k in rank..N {
            subtract(-1.0, &images[k], &mut null.kernel[k]);
        }
        null.factorise();
    }
    let rhs: [f64; N] = std::array::from_fn(|i| rhs[pivots[i]]);
    let (mut within, mut solution) = (rhs, [0.0; N]);
    null.project(&mut within);
    let mut left = within;
    for second in [false, true] {
        if second {
            if !refined {
                break;
            }
            let image = product(&permuted, &solution);
            left = std::array::from_fn(|i| within[i] - image[i]);
            null.project(&mut left);
        }
        solve_basic(rank, &columns, &rows, &inverses, &mut left);
        if refined || asked.wanted == Wanted::Multipliers {
            null.project(&mut left);
        }
        subtract(-1.0, &left, &mut solution);
    }
    for (i, &pivot) in pivots.iter().enumerate() {
        x[pivot] = solution[i];
        outside[pivot] = rhs[i] - within[i];
    }
    found
}

/// A x of a matrix by columns.
#[inline(always)]
fn product<const N: usize>(a: &Square<N>, x: &[f64; N]) -> [f64; N] {
    let mut image = [0.0; N];
    for col in 0..N {
        subtract(-x[col], &a[col], &mut image);
    }
    image
}

/// v ← (A₁₁⁻¹ v₁; 0) of a permuted vector.
#[inline(always)]
fn solve_basic<const N: usize>(
    rank: usize,
    columns: &Square<N>,
    rows: &Square<N>,
    inverses: &[f64; N],
    v: &mut [f64; N],
) {
    for col in 0..N {
        // Columns from the rank on hold what is left over.
        if col < rank {
            subtract(v[col], &columns[col], v);
        }
    }
    for (entry, inverse) in v.iter_mut().zip(inverses) {
        *entry *= inverse;
    }
    backward(rank, rows, v);
}

/// to −= factor · from.
#[inline(always)]
fn subtract<const N: usize>(factor: f64, from: &[f64; N], to: &mut [f64; N]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to -= factor * from;
    }
}

/// x · y, in two sums that need not wait for one another.
#[inline(always)]
fn dot<const N: usize>(x: &[f64; N], y: &[f64; N]) -> f64 {
    let mut sums = [0.0; 2];
    for i in 0..N {
        sums[i % 2] += x[i] * y[i];
    }
    sums[0] + sums[1]
}

/// Pᵀ A P = L D Lᵀ: L without its unit diagonal, zero everywhere else, by columns in `a` and by rows in `rows`, and 1/D in
/// `inverses`, which is 0 beyond the rank.
#[inline(always)]
fn factorise<const N: usize>(
    asked: Asked,
    a: &mut Square<N>,
    rows: &mut Square<N>,
    pivots: &mut [usize; N],
    inverses: &mut [f64; N],
) -> Found {
    // Below n·ε a pivot is rounding, and dividing by it makes garbage of the rest.
    let (rank_cut, ceiling) = (asked.rank_cut.max(N as f64 * f64::EPSILON), asked.ceiling);
    let mut found = Found::full(N, 0.0);
    found.first = (0..N).fold(f64::NEG_INFINITY, |first, i| first.max(a[i][i]));
    for col in 0..N {
        let mut pivot = a[col][col];
        if col == ceiling || pivot.is_nan() || pivot < GOOD_PIVOT * found.first || pivot <= f64::MIN_POSITIVE
        {
            let best = (col..N).fold(col, |best, i| if a[i][i] > a[best][best] { i } else { best });
            pivot = a[best][best];
            if col == ceiling || pivot <= rank_cut * found.first || pivot <= f64::MIN_POSITIVE {
                found.rank = col;
                found.dropped = pivot.max(0.0);
                found.lowest = (col..N).map(|i| a[i][i]).fold(f64::INFINITY, f64::min);
                break;
            }
            a.swap(col, best);
            for column in a.iter_mut() {
                column.swap(col, best);
            }
            rows.swap(col, best);
            pivots.swap(col, best);
        }
        let inverse = pivot.recip();
        inverses[col] = inverse;
        let mut scaled = a[col].map(|entry| entry * inverse);
        scaled[..=col].fill(0.0);
        for target in col + 1..N {
            rows[target][col] = scaled[target];
            subtract(a[target][col], &scaled, &mut a[target]);
        }
        a[col] = scaled;
    }
    found.last = inverses.iter().fold(0.0_f64, |most, &inverse| most.max(inverse)).recip();
    found
}

/// The same with complete pivoting, and the order of the pivots. Nothing is swapped: L is gathered at the end.
#[inline(always)]
fn factorise_complete<const N: usize>(
    asked: Asked,
    given: &[f64],
    columns: &mut Square<N>,
    rows: &mut Square<N>,
    inverses: &mut [f64; N],
) -> (Found, [usize; N]) {
    let rank_cut = asked.rank_cut.max(N as f64 * f64::EPSILON);
    let mut found = Found::full(N, 0.0);
    let mut a = [[0.0; N]; N];
    a.as_flattened_mut().copy_from_slice(given);
    // What is left of the diagonal.
    let mut left: [f64; N] = std::array::from_fn(|i| a[i][i]);
    let mut pivots: [usize; N] = std::array::from_fn(|i| i);
    let mut unordered = [[0.0; N]; N];
    found.first = left.iter().fold(f64::NEG_INFINITY, |first, &entry| first.max(entry));
    for step in 0..N {
        let best =
            (step + 1..N).fold(step, |best, i| if left[pivots[i]] > left[pivots[best]] { i } else { best });
        let row = pivots[best];
        let pivot = left[row];
        if step == asked.ceiling || pivot <= rank_cut * found.first || pivot <= f64::MIN_POSITIVE {
            found.rank = step;
            found.dropped = pivot.max(0.0);
            found.lowest = pivots[step..].iter().fold(f64::INFINITY, |lowest, &i| lowest.min(left[i]));
            break;
        }
        pivots.swap(step, best);
        let inverse = pivot.recip();
        inverses[step] = inverse;
        let factors = a[row];
        let mut scaled = factors.map(|entry| entry * inverse);
        pivots[..=step].iter().for_each(|&taken| scaled[taken] = 0.0);
        for target in 0..N {
            subtract(factors[target], &scaled, &mut a[target]);
            left[target] = a[target][target];
        }
        unordered[step] = scaled;
    }
    for step in 0..found.rank {
        for i in step + 1..N {
            let entry = unordered[step][pivots[i]];
            (columns[step][i], rows[i][step]) = (entry, entry);
        }
    }
    found.last = inverses.iter().fold(0.0_f64, |most, &inverse| most.max(inverse)).recip();
    (found, pivots)
}

/// L₁ᵀ z = z for the unit triangle of the first `rank` rows, of which the last comes first: nothing waits for a sum.
#[inline(always)]
fn backward<const N: usize>(rank: usize, rows: &Square<N>, z: &mut [f64; N]) {
    for row in (0..N).rev() {
        if row < rank {
            subtract(z[row], &rows[row], z);
        }
    }
}

/// Z = (−K; E) and the factor of `E + KᵀK`. Columns are counted from the rank on, as the rows of E.
struct Null<const N: usize> {
    rank: usize,
    /// Columns of K, zero in the rows of E.
    kernel: Square<N>,
    /// Unit factor of `E + KᵀK` below the diagonal, the inverse of D on it.
    gram: Square<N>,
}

impl<const N: usize> Null<N> {
    #[inline(always)]
    fn new(rank: usize, rows: &Square<N>) -> Self {
        let mut null = Self { rank, kernel: [[0.0; N]; N], gram: [[0.0; N]; N] };
        for k in 0..N {
            if k >= rank {
                null.kernel[k] = rows[k];
                backward(rank, rows, &mut null.kernel[k]);
            }
        }
        null.factorise();
        null
    }

    /// The factor, from the kernel.
    #[inline(always)]
    fn factorise(&mut self) {
        let Self { rank, kernel, gram } = self;
        for col in 0..N {
            for row in col..N {
                if col >= *rank {
                    gram[col][row] = f64::from(u8::from(row == col)) + dot(&kernel[row], &kernel[col]);
                }
            }
        }
        for col in 0..N {
            if col < *rank {
                continue;
            }
            let inverse = gram[col][col].recip();
            gram[col][col] = inverse;
            for target in col + 1..N {
                let entry = gram[col][target] * inverse;
                for row in target..N {
                    gram[target][row] -= entry * gram[col][row];
                }
            }
            gram[col][col + 1..].iter_mut().for_each(|entry| *entry *= inverse);
        }
    }

    /// v ← Π v.
    #[inline(always)]
    fn project(&self, v: &mut [f64; N]) {
        let Self { rank, kernel, gram } = self;
        let mut part = [0.0; N];
        for k in 0..N {
            if k >= *rank {
                part[k] = v[k] - dot(&kernel[k], v);
            }
        }
        for col in 0..N {
            if col >= *rank {
                for row in col + 1..N {
                    part[row] -= part[col] * gram[col][row];
                }
            }
        }
        for col in (0..N).rev() {
            if col >= *rank {
                part[col] *= gram[col][col];
                for row in col + 1..N {
                    part[col] -= part[row] * gram[col][row];
                }
                v[col] -= part[col];
            }
        }
        for k in 0..N {
            if k >= *rank {
                subtract(-part[k], &kernel[k], v);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a loop that stands open leaves of a redundant row.
    const OPEN: f64 = 1e-9;

    /// Rounding of a system with a condition of 10, some ten times.
    const TOLERANCE: f64 = 1e-13;

    /// An orthonormal basis: the cosines of a discrete transform.
    fn basis<const N: usize>() -> Square<N> {
        let size = N as f64;
        std::array::from_fn(|k| {
            let scale = if k == 0 { size.recip().sqrt() } else { (2.0 / size).sqrt() };
            std::array::from_fn(|i| scale * (std::f64::consts::PI * k as f64 * (i as f64 + 0.5) / size).cos())
        })
    }

    /// Eigenvalues from 1 to 10 on `rank` directions, and [`OPEN`] on the others.
    fn check<const N: usize>(rank: usize) {
        let basis = basis::<N>();
        let value = |k: usize| if k < rank { 1.0 + 9.0 * k as f64 / N as f64 } else { OPEN };
        let mut matrix = vec![0.0; N * N];
        for (at, entry) in matrix.iter_mut().enumerate() {
            *entry = (0..N).map(|k| value(k) * basis[k][at / N] * basis[k][at % N]).sum();
        }
        let rhs: [f64; N] = std::array::from_fn(|i| 1.0 + i as f64);
        let (mut expected, mut cut_off) = ([0.0; N], rhs);
        for k in 0..rank {
            let part: f64 = basis[k].iter().zip(&rhs).map(|(entry, b)| entry * b).sum();
            subtract(-part / value(k), &basis[k], &mut expected);
            subtract(part, &basis[k], &mut cut_off);
        }
        let asked = Asked { rank_cut: 1e3 * OPEN, ceiling: N, wanted: Wanted::Multipliers };
        let (mut order, mut x, mut outside): ([usize; N], _, _) =
            (std::array::from_fn(|i| i), [0.0; N], [0.0; N]);
        let first = solve::<N>(asked, &mut order, &matrix, &rhs, &mut x, &mut outside);
        assert!(first.rank == rank && first.wants_refining(N), "{N}, {rank}: {first:?}");
        let found = solve_refined::<N>(asked, &mut order, &matrix, &rhs, &mut x, &mut outside);
        assert_eq!(found.rank, rank);
        for (got, expected) in x.iter().zip(expected).chain(outside.iter().zip(cut_off)) {
            let size = rhs[N - 1] * N as f64;
            assert!((got - expected).abs() < TOLERANCE * size, "{N}, {rank}: {got:e}, not {expected:e}");
        }
    }

    #[test]
    fn a_null_space_of_open_loops_is_refined_to_rounding() {
        check::<2>(1);
        check::<3>(2);
        check::<4>(2);
        check::<5>(4);
        check::<6>(4);
        check::<7>(3);
        check::<8>(5);
    }
}
