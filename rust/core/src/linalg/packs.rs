//! Vectors of four rows side by side, entry by entry: what is done to each of many short rows is done to four at once. Eight were
//! tried: beside few rows half of them are nobody's.

use std::hint::black_box;

use crate::linalg::kernels::widest;

/// Rows side by side.
pub(crate) const LANES: usize = 4;

/// An entry of four rows.
pub(crate) type Pack = [f64; LANES];

/// Of rows that are not there.
pub(crate) const NONE: Pack = [0.0; LANES];

/// Number of packs of so many rows; those that are not there are zero.
pub(crate) const fn packs_of(rows: usize) -> usize {
    rows.div_ceil(LANES)
}

/// sum += factor · x.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn add_scaled(factor: f64, x: &Pack, sum: &mut Pack) {
    // All of them before any is written: so the compiler sees vectors.
    *sum = std::array::from_fn(|lane| sum[lane] + factor * x[lane]);
}

/// sum += x · y of every row.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn add_product(x: &Pack, y: &Pack, sum: &mut Pack) {
    *sum = std::array::from_fn(|lane| sum[lane] + x[lane] * y[lane]);
}

/// Σ xᵢ yᵢ of every row of some packs.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn dots<const N: usize>(x: &[[Pack; N]], y: &[f64]) -> [Pack; N] {
    let mut sums = [[NONE; N]; 2];
    let (pairs, factors) = (x.as_chunks::<2>(), y.as_chunks::<2>());
    for (pair, factors) in pairs.0.iter().zip(factors.0) {
        for ((sums, pair), &factor) in sums.iter_mut().zip(pair).zip(factors) {
            sums.iter_mut().zip(pair).for_each(|(sum, x)| add_scaled(factor, x, sum));
        }
    }
    if let ([last], [factor]) = (pairs.1, factors.1) {
        sums[0].iter_mut().zip(last).for_each(|(sum, x)| add_scaled(*factor, x, sum));
    }
    let [mut sum, others] = sums;
    sum.iter_mut().zip(&others).for_each(|(sum, other)| add_scaled(1.0, other, sum));
    sum
}

/// Σ xᵢ yᵢ over all rows.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn product(x: &[Pack], y: &[Pack]) -> f64 {
    let mut sum = NONE;
    x.iter().zip(y).for_each(|(x, y)| add_product(x, y, &mut sum));
    total(&sum)
}

/// Lengths of the rows.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn norms(x: &[Pack]) -> Pack {
    let mut squares = NONE;
    for entry in x {
        add_product(entry, entry, &mut squares);
    }
    squares.map(f64::sqrt)
}

/// Sum over the rows.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn total(x: &Pack) -> f64 {
    (x[0] + x[2]) + (x[1] + x[3])
}

/// x += factor · v, entry by entry.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn add_multiple(factor: f64, v: &[Pack], x: &mut [Pack]) {
    for (x, v) in x.iter_mut().zip(v) {
        add_scaled(factor, v, x);
        as_packs();
    }
}

/// A loop with this in it is left as it stands. Else compilers take several of its rounds at once, and packs apart for that.
#[allow(clippy::inline_always)]
#[inline(always)]
fn as_packs() {
    black_box(());
}

/// Something that is not zero wherever one of two is not.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn either(x: &Pack, y: &Pack) -> Pack {
    std::array::from_fn(|lane| f64::from_bits(x[lane].to_bits() | y[lane].to_bits()))
}

/// Whether all rows are zero.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn is_zero(x: &Pack) -> bool {
    // But for the signs.
    x.iter().fold(0, |bits, entry| bits | entry.to_bits()) << 1 == 0
}

/// x ← (E − v vᵀ) x of every row of some packs.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflect<const N: usize>(v: &[f64], x: &mut [[Pack; N]]) {
    let mut along = [NONE; N];
    for (x, &v) in x.iter().zip(v) {
        along.iter_mut().zip(x).for_each(|(along, x)| add_scaled(v, x, along));
    }
    for (x, &v) in x.iter_mut().zip(v) {
        x.iter_mut().zip(&along).for_each(|(x, along)| add_scaled(-v, along, x));
        as_packs();
    }
}

/// The same by v and then by w: entries are looked at once for both. `between` is their product.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflect_twice<const N: usize>(v: &[f64], w: &[f64], between: f64, x: &mut [[Pack; N]]) {
    let count = x.len();
    let (v, w) = (&v[..count], &w[..count]);
    let (mut along, mut then) = ([NONE; N], [NONE; N]);
    for k in 0..count {
        for lane in 0..N {
            add_scaled(v[k], &x[k][lane], &mut along[lane]);
            add_scaled(w[k], &x[k][lane], &mut then[lane]);
        }
    }
    for lane in 0..N {
        add_scaled(-between, &along[lane], &mut then[lane]);
    }
    for k in 0..count {
        for lane in 0..N {
            add_scaled(-v[k], &along[lane], &mut x[k][lane]);
            add_scaled(-w[k], &then[lane], &mut x[k][lane]);
        }
        as_packs();
    }
}

/// Puts rows of `width` entries, row after row, side by side.
pub(crate) fn gather(width: usize, rows: &[f64], packs: &mut Vec<Pack>) {
    packs.clear();
    let (whole, rest) = rows.split_at(rows.len() - rows.len() % (LANES * width));
    for four in whole.chunks_exact(LANES * width) {
        packs.extend((0..width).map(|k| std::array::from_fn(|lane| four[lane * width + k])));
    }
    if !rest.is_empty() {
        packs.extend(
            (0..width)
                .map(|k| std::array::from_fn(|lane| rest.get(lane * width + k).copied().unwrap_or(0.0))),
        );
    }
}

/// x += rows · y, rows of `y.len()` packs each four.
pub(crate) fn multiply(rows: &[Pack], y: &[f64], x: &mut [f64]) {
    if y.is_empty() {
        return;
    }
    widest(
        #[inline(always)]
        || {
            for (x, rows) in x.as_chunks_mut().0.iter_mut().zip(rows.chunks_exact(y.len())) {
                let [sum] = dots(rows.as_chunks().0, y);
                add_scaled(1.0, &sum, x);
            }
        },
    );
}

/// y += rowsᵀ · x; `sums` is workspace.
pub(crate) fn multiply_tr(rows: &[Pack], x: &[f64], sums: &mut Vec<Pack>, y: &mut [f64]) {
    if y.is_empty() {
        return;
    }
    sums.clear();
    sums.resize(y.len(), NONE);
    widest(
        #[inline(always)]
        || {
            for (x, rows) in x.as_chunks().0.iter().zip(rows.chunks_exact(y.len())) {
                for (sum, row) in sums.iter_mut().zip(rows) {
                    add_product(row, x, sum);
                }
            }
            y.iter_mut().zip(sums.iter()).for_each(|(y, sum)| *y += total(sum));
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[allow(clippy::float_cmp)]
    fn rows_side_by_side_are_the_rows() {
        let (width, count) = (3, LANES + 2);
        let rows: Vec<f64> = (0..width * count).map(|k| k as f64 - 7.5).collect();
        let mut packs = Vec::new();
        gather(width, &rows, &mut packs);
        assert_eq!(packs.len(), packs_of(count) * width);
        let y = [0.5, -2.0, 3.0];
        let (mut product, mut image, mut x) = ([1.0; 2 * LANES], [0.0; 3], [0.0; 2 * LANES]);
        multiply(&packs, &y, &mut product);
        (x[1], x[LANES]) = (2.0, -1.0);
        multiply_tr(&packs, &x, &mut Vec::new(), &mut image);
        assert_eq!(image, std::array::from_fn(|k| 2.0 * rows[width + k] - rows[LANES * width + k]));
        for (row, entries) in rows.chunks_exact(width).enumerate() {
            let own = &packs[row / LANES * width..][..width];
            let expected: f64 = entries.iter().zip(y).map(|(a, b)| a * b).sum();
            assert!((dots::<1>(own.as_chunks().0, &y)[0][row % LANES] - expected).abs() < 1e-13);
            assert!((product[row] - 1.0 - expected).abs() < 1e-13);
            assert!(entries.iter().zip(own).all(|(entry, pack)| pack[row % LANES] == *entry));
        }
        let last = &packs[width..];
        assert!(last.iter().all(|pack| pack[2..] == NONE[2..]) && !is_zero(&last[0]) && is_zero(&NONE));
    }

    #[test]
    fn a_reflection_keeps_lengths() {
        let mut x: Vec<Pack> =
            (0..3).map(|k| std::array::from_fn(|lane| (3 * lane + k) as f64 - 4.5)).collect();
        let before = norms(&x);
        // ‖v‖² = 2.
        reflect::<1>(&[0.6, -0.8, 1.0], x.as_chunks_mut().0);
        for (before, after) in before.iter().zip(norms(&x)) {
            assert!((before - after).abs() < 1e-13, "{before}, {after}");
        }
        assert!((total(&x[0]) - x[0].iter().sum::<f64>()).abs() < 1e-13);
    }

    #[test]
    fn two_reflections_at_once_are_one_after_the_other() {
        let mut x: Vec<Pack> =
            (0..4).map(|k| std::array::from_fn(|lane| (3 * lane + k) as f64 - 4.5)).collect();
        let mut expected = x.clone();
        let (v, w) = ([0.6, -0.8, 1.0, 0.3], [0.0, 0.9, 0.1, -0.7]);
        reflect::<1>(&v, expected.as_chunks_mut().0);
        reflect::<1>(&w[1..], expected[1..].as_chunks_mut().0);
        let between = v[1] * w[1] + v[2] * w[2] + v[3] * w[3];
        reflect_twice::<1>(&v, &w, between, x.as_chunks_mut().0);
        for (got, expected) in x.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((got - expected).abs() < 1e-13, "{got}, not {expected}");
        }
    }
}
