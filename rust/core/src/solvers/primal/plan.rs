//! Where the entries of `P = JᵀJ − τM` lie, and what is computed with J and M in the order of its elimination.

use crate::linalg::forest::{join, root};
use crate::linalg::ldl::{SparseLdl, short};
use crate::problem::whitened::Sparse;

/// The patterns of one mechanism; numbers are filled in every step. Vectors of velocities are in the order of elimination.
#[derive(Debug, Clone, Default)]
pub(super) struct Plan {
    /// Of the patterns that it was made for.
    number: Option<u64>,
    pub(super) ldl: SparseLdl,
    /// The rows that folding left: where each begins, the places of its entries and the entries.
    starts: Vec<usize>,
    places: Vec<u32>,
    values: Vec<f64>,
    /// Where products of entries of a row go, row after row: the lower triangle of each.
    products: Vec<u32>,
    /// Entries of M: where they go, their places, and the entries.
    mass_homes: Vec<u32>,
    mass_places: Vec<(u32, u32)>,
    mass: Vec<f64>,
    /// Part of the mechanism that neither J nor M couples with others, of each velocity and of each row.
    pub(super) islands: Vec<usize>,
    pub(super) island_of_row: Vec<usize>,
    pub(super) count: usize,
    /// Velocities in their own order, for the factor of M.
    natural: Vec<f64>,
}

impl Plan {
    /// Takes the patterns of a step if they are others.
    pub(super) fn plan(&mut self, given: Sparse<'_>) {
        if given.plan.is_none() || self.number != given.plan {
            *self = Self::of(given);
        }
    }

    /// Takes the numbers of a step, and its patterns if they are others.
    pub(super) fn take(&mut self, given: Sparse<'_>) {
        self.plan(given);
        self.values.clear();
        for (representative, scale) in given.fold.classes() {
            self.values.extend(given.rows.row(representative).1.iter().map(|value| scale * value));
        }
        self.mass.clear();
        for row in 0..given.tree.len() {
            self.mass.extend_from_slice(given.tree.row(row).1);
        }
    }

    fn of(given: Sparse<'_>) -> Self {
        let Sparse { rows, fold, tree, plan } = given;
        let nv = tree.len();
        let mut pairs = Vec::new();
        for &row in fold.representatives() {
            let columns = rows.row(row).0;
            for (index, &column) in columns.iter().enumerate() {
                pairs.extend(columns[..index].iter().map(|&other| (column, other)));
            }
        }
        for row in 0..nv {
            pairs.extend(tree.row(row).0.iter().map(|&column| (row, column)));
        }
        let ldl = SparseLdl::new(nv, &pairs);
        let mut found = Self { number: plan, starts: vec![0], natural: vec![0.0; nv], ..Self::default() };
        let mut parents: Vec<usize> = (0..nv).collect();
        for &(a, b) in &pairs {
            join(&mut parents, ldl.place(a), ldl.place(b));
        }
        found.number_islands(&mut parents);
        for &row in fold.representatives() {
            let columns = rows.row(row).0;
            for (index, &column) in columns.iter().enumerate() {
                found.places.push(short(ldl.place(column)));
                found.products.extend(columns[..=index].iter().map(|&other| ldl.home(column, other)));
            }
            found.starts.push(found.places.len());
            found.island_of_row.push(columns.first().map_or(0, |&column| found.islands[ldl.place(column)]));
        }
        for row in 0..nv {
            for &column in tree.row(row).0 {
                found.mass_homes.push(ldl.home(row, column));
                found.mass_places.push((short(ldl.place(row)), short(ldl.place(column))));
            }
        }
        Self { ldl, ..found }
    }

    fn number_islands(&mut self, parents: &mut [usize]) {
        let nv = parents.len();
        let mut numbers = vec![usize::MAX; nv];
        for place in 0..nv {
            let root = root(parents, place);
            if numbers[root] == usize::MAX {
                numbers[root] = self.count;
                self.count += 1;
            }
            self.islands.push(numbers[root]);
        }
    }

    /// Number of rows.
    pub(super) fn rows(&self) -> usize {
        self.island_of_row.len()
    }

    /// Multiplications of a factorisation and of a refinement that takes a usual number of steps.
    pub(super) fn work(&self) -> usize {
        self.products.len() + self.ldl.work() + 8 * (self.ldl.size() + self.ldl.len()) + 8 * self.places.len()
    }

    /// Fills P in, τ by place, and factorises it; false where a pivot is zero.
    pub(super) fn factorise(&mut self, shifts: &[f64]) -> bool {
        let entries = self.ldl.entries_mut();
        entries.fill(0.0);
        let mut homes = self.products.iter();
        for row in self.starts.windows(2) {
            let values = &self.values[row[0]..row[1]];
            for (index, value) in values.iter().enumerate() {
                for (other, &home) in values[..=index].iter().zip(homes.by_ref()) {
                    entries[home as usize] += value * other;
                }
            }
        }
        for ((&home, &(place, _)), entry) in self.mass_homes.iter().zip(&self.mass_places).zip(&self.mass) {
            entries[home as usize] -= shifts[place as usize] * entry;
        }
        self.ldl.factorise()
    }

    /// y = J x.
    pub(super) fn times(&self, x: &[f64], y: &mut [f64]) {
        for (entry, row) in y.iter_mut().zip(self.starts.windows(2)) {
            let range = row[0]..row[1];
            let (places, values) = (&self.places[range.clone()], &self.values[range]);
            *entry = places.iter().zip(values).map(|(&at, value)| value * x[at as usize]).sum();
        }
    }

    /// x = Jᵀ y.
    pub(super) fn transposed_times(&self, y: &[f64], x: &mut [f64]) {
        x.fill(0.0);
        for (entry, row) in y.iter().zip(self.starts.windows(2)) {
            let range = row[0]..row[1];
            for (&at, value) in self.places[range.clone()].iter().zip(&self.values[range]) {
                x[at as usize] += value * entry;
            }
        }
    }

    /// y += J x, then z = Jᵀ y of the sum, in one pass.
    pub(super) fn add_and_transpose(&self, x: &[f64], y: &mut [f64], z: &mut [f64]) {
        z.fill(0.0);
        for (entry, row) in y.iter_mut().zip(self.starts.windows(2)) {
            let range = row[0]..row[1];
            let (places, values) = (&self.places[range.clone()], &self.values[range]);
            *entry += places.iter().zip(values).map(|(&at, value)| value * x[at as usize]).sum::<f64>();
            for (&at, value) in places.iter().zip(values) {
                z[at as usize] += value * *entry;
            }
        }
    }

    /// y = M x.
    pub(super) fn mass_times(&self, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (&(row, column), entry) in self.mass_places.iter().zip(&self.mass) {
            let (row, column) = (row as usize, column as usize);
            y[row] += entry * x[column];
            if row != column {
                y[column] += entry * x[row];
            }
        }
    }

    /// x ← M⁻¹ x.
    pub(super) fn solve_mass(&mut self, given: Sparse<'_>, x: &mut [f64]) {
        for (velocity, entry) in self.natural.iter_mut().enumerate() {
            *entry = x[self.ldl.place(velocity)];
        }
        given.tree.solve(&mut self.natural);
        for (velocity, entry) in self.natural.iter().enumerate() {
            x[self.ldl.place(velocity)] = *entry;
        }
    }
}
