//! M of a kinematic tree and its factor, M = Lᵀ D L, as MuJoCo keeps them: sparse rows along the tree, without fill (Featherstone 2005).

use std::ops::Range;

use crate::linalg::packs::{Pack, add_scaled, is_zero};
use crate::linalg::rows::size;

/// Borrowed arrays of M and its factor. Row i of both has an entry for velocity i, its last, and for velocities that it hangs on.
#[derive(Debug, Clone, Copy)]
pub struct TreeView<'a> {
    /// Number of entries of each row (`nv`).
    pub lengths: &'a [i32],
    /// Where each row begins (`nv`).
    pub starts: &'a [i32],
    /// Column of each entry, rising along a row.
    pub columns: &'a [i32],
    /// Entries of the lower triangle of M.
    pub mass: &'a [f64],
    /// Entries of L; those of its diagonal are not read.
    pub factor: &'a [f64],
    /// 1/D (`nv`).
    pub inverse_diagonal: &'a [f64],
}

/// The same, as it was last taken.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tree {
    starts: Vec<usize>,
    columns: Vec<usize>,
    /// The columns as they were given.
    given: Vec<i32>,
    mass: Vec<f64>,
    factor: Vec<f64>,
    inverse_diagonal: Vec<f64>,
    roots: Vec<f64>,
}

impl TreeView<'_> {
    /// Tells whether lengths fit together for `nv` velocities and rows end at their diagonals.
    #[must_use]
    pub fn fits(&self, nv: usize) -> bool {
        let (lengths, starts, columns) = (self.lengths, self.starts, self.columns);
        if [lengths.len(), starts.len(), self.inverse_diagonal.len()] != [nv; 3] {
            return false;
        }
        let mut end = 0;
        for (row, (&length, &start)) in lengths.iter().zip(starts).enumerate() {
            let (first, length) = (size(start), size(length));
            if first != end || length == 0 || length > columns.len() - end {
                return false;
            }
            end += length;
            let own = &columns[first..end];
            if !own.is_sorted() || own[0] < 0 || size(own[length - 1]) != row {
                return false;
            }
        }
        self.mass.len() >= end && self.factor.len() >= end
    }

    /// Number of entries of M.
    fn end(&self) -> usize {
        self.lengths.last().zip(self.starts.last()).map_or(0, |(count, start)| size(count + start))
    }

    /// The arrays of numbers, of which no entry may be other than finite, with their names.
    pub(crate) fn numbers(&self) -> [(&'static str, &[f64]); 3] {
        let end = self.end();
        [
            ("mass", &self.mass[..end]),
            ("factor of M", &self.factor[..end]),
            ("inverse diagonal", self.inverse_diagonal),
        ]
    }
}

impl Tree {
    /// Whether what is given has the pattern of what was last taken.
    pub(crate) fn knows(&self, given: &TreeView<'_>) -> bool {
        let end = self.given.len();
        self.inverse_diagonal.len() == given.inverse_diagonal.len()
            && [given.lengths.len(), given.starts.len()] == [self.len(); 2]
            && given.end() == end
            && [given.columns.len(), given.mass.len(), given.factor.len()].iter().all(|&length| length >= end)
            && self.given[..] == given.columns[..end]
    }

    /// Takes what is given, which has to fit. `known`: its pattern is that of before.
    pub(crate) fn take(&mut self, given: &TreeView<'_>, known: bool) {
        let end = given.end();
        if !known {
            self.given.clear();
            self.given.extend_from_slice(&given.columns[..end]);
            self.columns.clear();
            self.columns.extend(self.given.iter().map(|&column| size(column)));
            self.starts.clear();
            self.starts.extend(given.starts.iter().map(|&start| size(start)));
            self.starts.push(end);
            self.mass.resize(end, 0.0);
            self.factor.resize(end, 0.0);
            self.inverse_diagonal.resize(given.inverse_diagonal.len(), 0.0);
            self.roots.resize(given.inverse_diagonal.len(), 0.0);
        }
        self.mass.copy_from_slice(&given.mass[..end]);
        self.factor.copy_from_slice(&given.factor[..end]);
        self.inverse_diagonal.copy_from_slice(given.inverse_diagonal);
        for (root, inverse) in self.roots.iter_mut().zip(&self.inverse_diagonal) {
            *root = inverse.sqrt();
        }
    }

    /// Number of velocities.
    pub(crate) fn len(&self) -> usize {
        self.inverse_diagonal.len()
    }

    /// 1/D.
    pub(crate) fn inverse_diagonal(&self) -> &[f64] {
        &self.inverse_diagonal
    }

    /// The velocities that one hangs on, and its entries of M with them; with itself last.
    pub(crate) fn row(&self, row: usize) -> (&[usize], &[f64]) {
        let range = self.starts[row]..self.starts[row + 1];
        (&self.columns[range.clone()], &self.mass[range])
    }

    /// The velocities that one hangs on, without itself, and where its entries of L lie in [`factors`](Self::factors).
    pub(crate) fn above(&self, row: usize) -> (&[usize], Range<usize>) {
        let range = self.starts[row]..self.starts[row + 1] - 1;
        (&self.columns[range.clone()], range)
    }

    /// Entries of L, row after row.
    pub(crate) fn factors(&self) -> &[f64] {
        &self.factor
    }

    /// 1/√D.
    pub(crate) fn roots(&self) -> &[f64] {
        &self.roots
    }

    /// x ← L⁻ᵀ x.
    fn descend(&self, x: &mut [f64]) {
        for row in (0..self.len()).rev() {
            let entry = x[row];
            if entry != 0.0 {
                let (columns, range) = self.above(row);
                for (&column, factor) in columns.iter().zip(&self.factor[range]) {
                    x[column] -= factor * entry;
                }
            }
        }
    }

    /// x ← M⁻¹ x.
    pub(crate) fn solve(&self, x: &mut [f64]) {
        self.descend(x);
        for (entry, inverse) in x.iter_mut().zip(&self.inverse_diagonal) {
            *entry *= inverse;
        }
        for row in 0..self.len() {
            let (columns, range) = self.above(row);
            let sum: f64 =
                columns.iter().zip(&self.factor[range]).map(|(&column, factor)| factor * x[column]).sum();
            x[row] -= sum;
        }
    }

    /// x ← H x with H = D^(−1/2) L⁻ᵀ, M⁻¹ = Hᵀ H.
    pub(crate) fn whiten(&self, x: &mut [f64]) {
        self.descend(x);
        for (entry, root) in x.iter_mut().zip(&self.roots) {
            *entry *= root;
        }
    }

    /// The same of several vectors, `len` packs each four: two packs at once as far as there are two, which share the way along
    /// the tree.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    pub(crate) fn whiten_packs(&self, x: &mut [Pack]) {
        let nv = self.len();
        let mut pairs = x.chunks_exact_mut(2 * nv);
        for pair in &mut pairs {
            let (one, other) = pair.split_at_mut(nv);
            for row in (0..nv).rev() {
                let (a, b) = (one[row], other[row]);
                if !(is_zero(&a) && is_zero(&b)) {
                    let (columns, range) = self.above(row);
                    for (&column, &factor) in columns.iter().zip(&self.factor[range]) {
                        add_scaled(-factor, &a, &mut one[column]);
                        add_scaled(-factor, &b, &mut other[column]);
                    }
                }
            }
            for ((a, b), root) in one.iter_mut().zip(other).zip(&self.roots) {
                (*a, *b) = (a.map(|entry| entry * root), b.map(|entry| entry * root));
            }
        }
        self.whiten_pack(pairs.into_remainder());
    }

    /// The same of four vectors, or of none.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn whiten_pack(&self, x: &mut [Pack]) {
        for row in (0..x.len()).rev() {
            let entry = x[row];
            if !is_zero(&entry) {
                let (columns, range) = self.above(row);
                for (&column, &factor) in columns.iter().zip(&self.factor[range]) {
                    add_scaled(-factor, &entry, &mut x[column]);
                }
            }
        }
        for (pack, root) in x.iter_mut().zip(&self.roots) {
            *pack = pack.map(|entry| entry * root);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two branches on one root: velocities 1 and 2 hang on 0, and 3 on 2.
    const VIEW: TreeView<'static> = TreeView {
        lengths: &[1, 2, 2, 3],
        starts: &[0, 1, 3, 5],
        columns: &[0, 0, 1, 0, 2, 0, 2, 3],
        mass: &[0.0; 8],
        factor: &[1.0, 0.5, 1.0, -0.25, 1.0, 2.0, 0.75, 1.0],
        inverse_diagonal: &[0.5, 4.0, 0.25, 1.0],
    };

    #[test]
    fn m_its_solves_and_its_whitening_belong_together() {
        let mut tree = Tree::default();
        let mut factor = nalgebra::DMatrix::<f64>::identity(4, 4);
        for (row, column, entry) in [(1, 0, 0.5), (2, 0, -0.25), (3, 0, 2.0), (3, 2, 0.75)] {
            factor[(row, column)] = entry;
        }
        let diagonal =
            nalgebra::DVector::from_iterator(4, VIEW.inverse_diagonal.iter().map(|entry| entry.recip()));
        let dense = factor.transpose() * nalgebra::DMatrix::from_diagonal(&diagonal) * &factor;
        let mass: Vec<f64> = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 2), (3, 0), (3, 2), (3, 3)]
            .map(|place| dense[place])
            .to_vec();
        let view = TreeView { mass: &mass, ..VIEW };
        assert!(view.fits(4) && !tree.knows(&view));
        tree.take(&view, false);
        assert!(tree.knows(&view));
        let x = nalgebra::DVector::from_row_slice(&[1.0, -2.0, 0.5, 3.0]);
        let mut product = &dense * &x;
        assert_eq!((tree.row(3), tree.inverse_diagonal()[1]), ((&[0, 2, 3][..], &mass[5..]), 4.0));
        let scale = |lane: usize| 0.5 * lane as f64 - 1.0;
        let mut whitened: Vec<Pack> =
            product.iter().map(|&entry| std::array::from_fn(|lane| entry * scale(lane))).collect();
        tree.whiten_packs(&mut whitened);
        for lane in 0..whitened[0].len() {
            let found: f64 = whitened.iter().map(|pack| pack[lane] * pack[lane]).sum();
            assert!((found - x.dot(&product) * scale(lane).powi(2)).abs() < 1e-11, "{found}");
        }
        tree.solve(product.as_mut_slice());
        assert!((x - product).amax() < 1e-14);
    }

    #[test]
    fn what_does_not_belong_together_does_not_fit() {
        assert!(VIEW.fits(4));
        assert!(!VIEW.fits(5));
        assert!(!TreeView { columns: &[0, 1, 0, 0, 2, 0, 2, 3], ..VIEW }.fits(4), "a row ends elsewhere");
        assert!(!TreeView { lengths: &[1, 2, 2, 4], ..VIEW }.fits(4), "more entries than there are");
    }
}
