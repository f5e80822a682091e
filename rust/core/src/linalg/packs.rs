//! Vectors of four rows side by side, entry by entry: what is done to each of many short rows is done to four at once. Eight were
//! tried: beside few rows half of them are nobody's.

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
    for (sum, x) in sum.iter_mut().zip(x) {
        *sum += factor * x;
    }
}

/// sum += x · y of every row.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn add_product(x: &Pack, y: &Pack, sum: &mut Pack) {
    for (sum, (x, y)) in sum.iter_mut().zip(x.iter().zip(y)) {
        *sum += x * y;
    }
}

/// Σ xᵢ yᵢ of every row.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn dots(x: &[Pack], y: &[f64]) -> Pack {
    let mut sums = [NONE; 2];
    let (pairs, factors) = (x.as_chunks::<2>(), y.as_chunks::<2>());
    for (pair, factors) in pairs.0.iter().zip(factors.0) {
        add_scaled(factors[0], &pair[0], &mut sums[0]);
        add_scaled(factors[1], &pair[1], &mut sums[1]);
    }
    if let ([last], [factor]) = (pairs.1, factors.1) {
        add_scaled(*factor, last, &mut sums[0]);
    }
    std::array::from_fn(|lane| sums[0][lane] + sums[1][lane])
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

/// Whether all rows are zero.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn is_zero(x: &Pack) -> bool {
    x.iter().all(|&entry| entry == 0.0)
}

/// x ← (E − v vᵀ) x of every row.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflect(v: &[f64], x: &mut [Pack]) {
    let along = dots(x, v);
    for (x, factor) in x.iter_mut().zip(v) {
        add_scaled(-factor, &along, x);
    }
}

/// The same by v and then by w, which is shorter by the first entry of v: entries are looked at once for both. `between` is the product
/// of w and what v has beside it.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(crate) fn reflect_twice(v: &[f64], w: &[f64], between: f64, x: &mut [Pack]) {
    let ([head, v @ ..], [first, x @ ..]) = (v, x) else { return };
    let (mut along, mut then) = (NONE, NONE);
    add_scaled(*head, first, &mut along);
    for ((x, &v), &w) in x.iter().zip(v).zip(w) {
        add_scaled(v, x, &mut along);
        add_scaled(w, x, &mut then);
    }
    add_scaled(-between, &along, &mut then);
    add_scaled(-head, &along, first);
    for ((x, &v), &w) in x.iter_mut().zip(v).zip(w) {
        add_scaled(-v, &along, x);
        add_scaled(-w, &then, x);
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
                add_scaled(1.0, &dots(rows, y), x);
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
            assert!((dots(own, &y)[row % LANES] - expected).abs() < 1e-13);
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
        reflect(&[0.6, -0.8, 1.0], &mut x);
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
        let (v, w) = ([0.6, -0.8, 1.0, 0.3], [0.9, 0.1, -0.7]);
        reflect(&v, &mut expected);
        reflect(&w, &mut expected[1..]);
        reflect_twice(&v, &w, v[1] * w[0] + v[2] * w[1] + v[3] * w[2], &mut x);
        for (got, expected) in x.as_flattened().iter().zip(expected.as_flattened()) {
            assert!((got - expected).abs() < 1e-13, "{got}, not {expected}");
        }
    }
}
