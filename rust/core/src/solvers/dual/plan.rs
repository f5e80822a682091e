//! Where the entries of W = H Jᵀ and of A = Wᵀ W lie, and what they are computed from.

use crate::linalg::ldl::{SparseLdl, short};
use crate::problem::whitened::Sparse;

/// The patterns of one mechanism; numbers are filled in every step.
#[derive(Debug, Clone, Default)]
pub(super) struct Plan {
    /// Of the patterns that it was made for.
    number: Option<u64>,
    pub(super) ldl: SparseLdl,
    /// Entries of the columns of W, one after another; each has those of its row of J and of what they hang on.
    values: Vec<f64>,
    /// Velocity of each, and where every entry of J goes.
    velocities: Vec<u32>,
    starts: Vec<usize>,
    loads: Vec<u32>,
    /// Steps of L⁻ᵀ: an entry, the one that it loses a multiple of, and the place of the factor in L.
    descents: Vec<(u32, u32, u32)>,
    /// Products of two entries of W, and where they go in A.
    products: Vec<(u32, u32, u32)>,
    /// Places of the rows, in the order of elimination.
    pub(super) places: Vec<u32>,
}

impl Plan {
    /// Takes the patterns of a step if they are others.
    pub(super) fn plan(&mut self, given: Sparse<'_>) {
        if given.plan.is_none() || self.number != given.plan {
            *self = Self::of(given);
        }
    }

    fn of(given: Sparse<'_>) -> Self {
        let Sparse { rows, fold, tree, plan } = given;
        let mut found = Self { number: plan, starts: vec![0], ..Self::default() };
        let mut columns = Vec::new();
        // By velocity, rows that touch it and where.
        let mut touched: Vec<Vec<(usize, usize)>> = vec![Vec::new(); tree.len()];
        for (class, &row) in fold.representatives().iter().enumerate() {
            let first = found.velocities.len();
            columns.clear();
            columns.extend(rows.row(row).0.iter().flat_map(|&velocity| tree.row(velocity).0.iter().copied()));
            columns.sort_unstable();
            columns.dedup();
            let at = |velocity| first + columns.binary_search(&velocity).unwrap_or(0);
            found.loads.extend(rows.row(row).0.iter().map(|&velocity| short(at(velocity))));
            for &velocity in columns.iter().rev() {
                let (above, factors) = tree.above(velocity);
                let steps = above.iter().zip(factors);
                found.descents.extend(
                    steps.map(|(&other, factor)| (short(at(other)), short(at(velocity)), short(factor))),
                );
            }
            for (offset, &velocity) in columns.iter().enumerate() {
                touched[velocity].push((class, first + offset));
            }
            found.velocities.extend(columns.iter().map(|&velocity| short(velocity)));
            found.starts.push(found.velocities.len());
        }
        let mut pairs = Vec::new();
        for all in &touched {
            for (index, &(row, _)) in all.iter().enumerate() {
                pairs.extend(all[..index].iter().map(|&(other, _)| (row, other)));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let ldl = SparseLdl::new(fold.reduced(), &pairs);
        for all in &touched {
            for (index, &(row, at)) in all.iter().enumerate() {
                let products = all[..=index].iter();
                found
                    .products
                    .extend(products.map(|&(other, there)| (short(at), short(there), ldl.home(row, other))));
            }
        }
        found.places = (0..ldl.len()).map(|row| short(ldl.place(row))).collect();
        found.values = vec![0.0; found.velocities.len()];
        Self { ldl, ..found }
    }

    /// Multiplications that A takes at least, before anything is planned.
    pub(super) fn least_work(given: Sparse<'_>) -> usize {
        let Sparse { rows, fold, tree, .. } = given;
        let mut touching = vec![0_usize; tree.len()];
        for &row in fold.representatives() {
            // What a velocity hangs on is touched at least by the row that touches most of it.
            let longest = rows.row(row).0.iter().max_by_key(|&&velocity| tree.row(velocity).0.len());
            for &velocity in longest.map_or(&[][..], |&velocity| tree.row(velocity).0) {
                touching[velocity] += 1;
            }
        }
        touching.iter().map(|count| count * (count + 1) / 2).sum()
    }

    /// Multiplications of both factorisations and of a solve with its residual.
    pub(super) fn work(&self) -> usize {
        self.descents.len()
            + self.products.len()
            + 2 * self.ldl.work()
            + 4 * (self.ldl.size() + self.ldl.len())
    }

    /// Fills A in.
    pub(super) fn fill(&mut self, given: Sparse<'_>, softness: Option<&[f64]>) {
        let Sparse { rows, fold, tree, .. } = given;
        self.values.fill(0.0);
        let mut loads = self.loads.iter();
        for &row in fold.representatives() {
            for (&value, &at) in rows.row(row).1.iter().zip(loads.by_ref()) {
                self.values[at as usize] = value;
            }
        }
        let factors = tree.factors();
        for &(to, from, factor) in &self.descents {
            self.values[to as usize] -= factors[factor as usize] * self.values[from as usize];
        }
        let roots = tree.roots();
        for ((_, scale), range) in fold.classes().zip(self.starts.windows(2)) {
            let range = range[0]..range[1];
            for (value, &velocity) in self.values[range.clone()].iter_mut().zip(&self.velocities[range]) {
                *value *= scale * roots[velocity as usize];
            }
        }
        let entries = self.ldl.entries_mut();
        entries.fill(0.0);
        for &(a, b, home) in &self.products {
            entries[home as usize] += self.values[a as usize] * self.values[b as usize];
        }
        for (&softness, &place) in softness.unwrap_or_default().iter().zip(&self.places) {
            entries[place as usize] += softness;
        }
    }
}
