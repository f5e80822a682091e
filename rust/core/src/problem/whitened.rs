//! W = H Jrᵀ of the rows that folding left, dense: made for those solvers that work with it.

use nalgebra::DMatrix;

use super::fold::Fold;
use crate::linalg::kernels::widest;
use crate::linalg::packs::{self, LANES, Pack, packs_of};
use crate::linalg::rows::SparseRows;
use crate::linalg::spans::{Envelope, Spans};
use crate::linalg::tree::Tree;

/// The columns of W and where their entries lie, and those of A.
#[derive(Debug, Clone, Default)]
pub(crate) struct Whitened {
    /// `nv×nr`.
    pub(crate) columns: DMatrix<f64>,
    pub(crate) spans: Spans,
    /// Of A.
    pub(crate) envelope: Envelope,
    /// Whether it is that of the step at hand.
    pub(crate) made: bool,
    pub(crate) packs: Vec<Pack>,
}

/// What a step is made of, as far as it is sparse.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sparse<'a> {
    /// J of all rows.
    pub(crate) rows: &'a SparseRows,
    pub(crate) fold: &'a Fold,
    pub(crate) tree: &'a Tree,
    /// A number that no other patterns of J, M and fold have; none where numbers are too large or too small to be squared.
    pub(crate) plan: Option<u64>,
}

impl Whitened {
    /// Makes it from the rows and the factor of M; tells whether entries of A lie elsewhere than before.
    pub(crate) fn make(&mut self, given: Sparse<'_>) -> bool {
        let (nv, Sparse { rows, fold, tree, .. }) = (self.columns.nrows(), given);
        let (packs, mut classes) = (&mut self.packs, fold.classes());
        // Two packs of rows at once.
        for some in self.columns.as_mut_slice().chunks_mut(2 * LANES * nv.max(1)) {
            let count = some.len() / nv.max(1);
            packs.clear();
            packs.resize(packs_of(count) * nv, packs::NONE);
            let mut scales = [1.0; 2 * LANES];
            for (place, scale) in scales[..count].iter_mut().enumerate() {
                if let Some((representative, own)) = classes.next() {
                    let (columns, values) = rows.row(representative);
                    let (pack, lane) = (&mut packs[place / LANES * nv..][..nv], place % LANES);
                    columns.iter().zip(values).for_each(|(&column, &value)| pack[column][lane] = value);
                    *scale = own;
                }
            }
            widest(
                #[inline(always)]
                || tree.whiten_packs(packs),
            );
            for (place, (column, scale)) in some.chunks_exact_mut(nv.max(1)).zip(scales).enumerate() {
                let (pack, lane) = (&packs[place / LANES * nv..][..nv], place % LANES);
                column.iter_mut().zip(pack).for_each(|(entry, pack)| *entry = pack[lane] * scale);
            }
        }
        self.locate()
    }

    /// Finds where its entries lie; tells whether those of A lie elsewhere than before.
    pub(crate) fn locate(&mut self) -> bool {
        let (nv, reduced) = self.columns.shape();
        let columns = self.columns.as_slice();
        let known = self.spans.hold(columns, reduced);
        self.made = true;
        let moved = self.spans.update(columns, nv, known);
        if moved {
            self.envelope.find(&self.spans, reduced);
        }
        moved
    }
}
