//! Where the entries of `P = JᵀJ − τM` lie, and what is computed with J and M in the order of its elimination.

use crate::linalg::forest::{join, root};
use crate::linalg::kernels::dot;
use crate::linalg::ldl::{SparseLdl, short};
use crate::problem::whitened::Sparse;

/// The patterns of one mechanism; numbers are filled in every step. Vectors of velocities are in the order of elimination.
#[derive(Debug, Clone, Default)]
pub(super) struct Plan {
    /// Of the patterns that it was made for.
    number: Option<u64>,
    pub(super) ldl: SparseLdl,
    /// The rows that folding left, by what they touch.
    groups: Vec<Group>,
    /// Velocities that each group touches.
    places: Vec<u32>,
    /// Entries, those of one velocity and all rows of a group one after another.
    values: Vec<f64>,
    /// Where products of entries of a row go, group after group: the lower triangle of each.
    products: Vec<u32>,
    /// Entries of M by rows, the diagonal last: where they go, where rows begin, their velocities, and the entries.
    mass_homes: Vec<u32>,
    mass_starts: Vec<usize>,
    mass_places: Vec<u32>,
    mass: Vec<f64>,
    /// Part of the mechanism that neither J nor M couples with others, of each velocity and of each row.
    pub(super) islands: Vec<usize>,
    pub(super) island_of_row: Vec<usize>,
    pub(super) count: usize,
    /// Velocities in their own order, for the factor of M.
    natural: Vec<f64>,
}

/// Rows that follow one another and touch the same velocities, as those of a connect do: what is found for one holds for all.
#[derive(Debug, Clone, Copy)]
struct Group {
    /// The first row, and how many.
    row: usize,
    count: usize,
    /// Where its velocities begin and end, and where its entries begin.
    places: (usize, usize),
    values: usize,
}

/// Rows of a group at most.
const MOST: usize = 3;

impl Group {
    /// Its velocities, and the entries of its `N` rows with each.
    #[allow(clippy::inline_always)]
    #[inline(always)]
    fn of<'a, const N: usize>(&self, places: &'a [u32], values: &'a [f64]) -> (&'a [u32], &'a [[f64; N]]) {
        let places = &places[self.places.0..self.places.1];
        (places, values[self.values..self.values + N * places.len()].as_chunks::<N>().0)
    }
}

/// Calls a function generic in the number of rows of a group.
macro_rules! by_count {
    ($group:expr, $function:ident($($arg:expr),*)) => {
        match $group.count {
            1 => $function::<1>($group, $($arg),*),
            2 => $function::<2>($group, $($arg),*),
            _ => $function::<MOST>($group, $($arg),*),
        }
    };
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
        let mut classes = given.fold.classes();
        for group in &self.groups {
            for row in 0..group.count {
                let Some((representative, scale)) = classes.next() else { return };
                let own = self.values[group.values + row..].iter_mut().step_by(group.count);
                own.zip(given.rows.row(representative).1).for_each(|(own, value)| *own = scale * value);
            }
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
        let mut found =
            Self { number: plan, mass_starts: vec![0], natural: vec![0.0; nv], ..Self::default() };
        let mut parents: Vec<usize> = (0..nv).collect();
        for &(a, b) in &pairs {
            join(&mut parents, ldl.place(a), ldl.place(b));
        }
        found.number_islands(&mut parents);
        let mut before: Option<&[usize]> = None;
        for (index, &row) in fold.representatives().iter().enumerate() {
            let columns = rows.row(row).0;
            found.island_of_row.push(columns.first().map_or(0, |&column| found.islands[ldl.place(column)]));
            if let Some(group) =
                found.groups.last_mut().filter(|group| group.count < MOST && before == Some(columns))
            {
                group.count += 1;
                continue;
            }
            before = Some(columns);
            let first = found.places.len();
            for (index, &column) in columns.iter().enumerate() {
                found.places.push(short(ldl.place(column)));
                found.products.extend(columns[..=index].iter().map(|&other| ldl.home(column, other)));
            }
            found.groups.push(Group { row: index, count: 1, places: (first, found.places.len()), values: 0 });
        }
        let mut size = 0;
        for group in &mut found.groups {
            group.values = size;
            size += group.count * (group.places.1 - group.places.0);
        }
        found.values = vec![0.0; size];
        for row in 0..nv {
            for &column in tree.row(row).0 {
                found.mass_homes.push(ldl.home(row, column));
                found.mass_places.push(short(ldl.place(column)));
            }
            found.mass_starts.push(found.mass_places.len());
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
        for group in &self.groups {
            by_count!(group, square(&self.places, &self.values, &mut homes, entries));
        }
        for ((range, homes), entries_of) in self.mass_starts.windows(2).map(|range| {
            let range = range[0]..range[1];
            ((range.clone(), &self.mass_homes[range.clone()]), &self.mass[range])
        }) {
            let shift = shifts[self.mass_places[range.end - 1] as usize];
            for (&home, entry) in homes.iter().zip(entries_of) {
                entries[home as usize] -= shift * entry;
            }
        }
        self.ldl.factorise()
    }

    /// y = J x.
    pub(super) fn times(&self, x: &[f64], y: &mut [f64]) {
        for group in &self.groups {
            by_count!(group, product(&self.places, &self.values, x, y));
        }
    }

    /// x = Jᵀ y.
    pub(super) fn transposed_times(&self, y: &[f64], x: &mut [f64]) {
        x.fill(0.0);
        for group in &self.groups {
            by_count!(group, combine(&self.places, &self.values, y, x));
        }
    }

    /// y += J x, then z = Jᵀ y of the sum, in one pass.
    pub(super) fn add_and_transpose(&self, x: &[f64], y: &mut [f64], z: &mut [f64]) {
        z.fill(0.0);
        for group in &self.groups {
            by_count!(group, add(&self.places, &self.values, x, y));
            by_count!(group, combine(&self.places, &self.values, y, z));
        }
    }

    /// y = M x.
    pub(super) fn mass_times(&self, x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for range in self.mass_starts.windows(2) {
            let (places, entries) = (&self.mass_places[range[0]..range[1]], &self.mass[range[0]..range[1]]);
            let (Some((&row, places)), Some((diagonal, entries))) =
                (places.split_last(), entries.split_last())
            else {
                continue;
            };
            let own = x[row as usize];
            let mut sum = diagonal * own;
            for (&column, entry) in places.iter().zip(entries) {
                sum += entry * x[column as usize];
                y[column as usize] += entry * own;
            }
            y[row as usize] += sum;
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

/// Adds products of the entries of a group's rows to the entries of P.
fn square<const N: usize>(
    group: &Group,
    places: &[u32],
    values: &[f64],
    homes: &mut std::slice::Iter<'_, u32>,
    entries: &mut [f64],
) {
    let (_, values) = group.of::<N>(places, values);
    for (index, own) in values.iter().enumerate() {
        for (other, &home) in values[..=index].iter().zip(homes.by_ref()) {
            entries[home as usize] += dot(own, other);
        }
    }
}

/// The products of a group's rows with x.
#[inline]
fn products<const N: usize>(group: &Group, places: &[u32], values: &[f64], x: &[f64]) -> [f64; N] {
    let (places, values) = group.of::<N>(places, values);
    let mut sums = [0.0; N];
    for (&place, values) in places.iter().zip(values) {
        let entry = x[place as usize];
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value * entry;
        }
    }
    sums
}

/// y = J x of a group.
fn product<const N: usize>(group: &Group, places: &[u32], values: &[f64], x: &[f64], y: &mut [f64]) {
    y[group.row..group.row + N].copy_from_slice(&products::<N>(group, places, values, x));
}

/// y += J x of a group.
fn add<const N: usize>(group: &Group, places: &[u32], values: &[f64], x: &[f64], y: &mut [f64]) {
    let sums = products::<N>(group, places, values, x);
    y[group.row..group.row + N].iter_mut().zip(sums).for_each(|(entry, sum)| *entry += sum);
}

/// x += Jᵀ y of a group.
fn combine<const N: usize>(group: &Group, places: &[u32], values: &[f64], y: &[f64], x: &mut [f64]) {
    let factors = &y[group.row..group.row + N];
    let (places, values) = group.of::<N>(places, values);
    for (&place, values) in places.iter().zip(values) {
        x[place as usize] += dot(values, factors);
    }
}
