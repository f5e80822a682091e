//! Folding: zero rows dropped, proportional rows replaced by one representative, exactly.
//!
//! If row i is tᵢ times the representative of its class, J = T Jr with
//!
//! ```text
//!     Jr: the representatives, each scaled by √Σt² over its class;     T: n×nr, tᵢ/√Σt² in the column of row i's class.
//! ```
//!
//! The columns of T are orthonormal, so (J M⁻¹ Jᵀ)⁺ = T (Jr M⁻¹ Jrᵀ)⁺ Tᵀ exactly: minimum norm survives, and the part
//! of b outside range(T), where duplicated rows contradict one another, drops out as it should. What is left for a
//! solver to track is the true redundancy, which moves.
//!
//! The factors t are fitted anew every step; only which rows belong together is planned once.

use crate::linalg::kernels::largest;
use crate::linalg::rows::SparseRows;

/// Relative tolerance of folding. A row counts as proportional to another if it differs from its multiple by at most this
/// part of its length, and as zero if none of its entries exceeds this part of the largest one. Rows that are the same in exact
/// arithmetic differ by a few rounding errors of the anchors' coordinates; 1e-12 leaves room for long kinematic chains.
pub const FOLD_TOLERANCE: f64 = 1e-12;

/// The same for rows that were proportional in a step before: along a chain of a hundred metres the anchors' coordinates round by as
/// much more. Rows that differ by it have an eigenvalue of its square, 1e-20, which no rank cut tells from none.
const HELD_TOLERANCE: f64 = 1e-10;

/// Part of a row's largest entry from which an entry of a proportional one is looked for.
const LARGE: f64 = 0.5;

/// Which class a row belongs to, and its share there.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Member {
    class: usize,
    /// tᵢ, the multiple of the representative.
    factor: f64,
    /// tᵢ/√Σt², its entry of T.
    share: f64,
}

impl Member {
    const fn new(class: usize, factor: f64) -> Self {
        Self { class, factor, share: 1.0 }
    }
}

/// The classes of proportional rows of one mechanism.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fold {
    members: Vec<Option<Member>>,
    representatives: Vec<usize>,
    /// √Σt² of each class.
    scales: Vec<f64>,
}

impl Fold {
    /// Returns a fold that leaves each of `n` rows alone.
    #[must_use]
    pub fn identity(n: usize) -> Self {
        Self {
            members: (0..n).map(|class| Some(Member::new(class, 1.0))).collect(),
            representatives: (0..n).collect(),
            scales: vec![1.0; n],
        }
    }

    /// Finds the classes of n rows of `width` entries, which `rows` holds one after another.
    #[must_use]
    pub fn find(rows: &[f64], width: usize) -> Self {
        Self::find_in(&SparseRows::of(rows, width))
    }

    /// The same of sparse rows. A row is compared with those that are large where it is largest.
    pub(crate) fn find_in(rows: &SparseRows) -> Self {
        let mut fold = Self::default();
        let floor = FOLD_TOLERANCE * rows.most();
        let mut by_column: Vec<Vec<usize>> = vec![Vec::new(); rows.width()];
        for index in 0..rows.len() {
            let row = rows.row(index);
            let size = largest(row.1);
            if size <= floor {
                fold.members.push(None);
                continue;
            }
            let most = row.0.iter().zip(row.1).find(|(_, value)| value.abs() >= size);
            let near = most.map_or(&[][..], |(&column, _)| &by_column[column]);
            let found = near.iter().find_map(|&class| {
                fit(row, rows.row(fold.representatives[class]), FOLD_TOLERANCE)
                    .map(|factor| Member::new(class, factor))
            });
            fold.members.push(Some(found.unwrap_or_else(|| {
                let class = fold.representatives.len();
                for (&column, _) in row.0.iter().zip(row.1).filter(|(_, value)| value.abs() >= LARGE * size) {
                    by_column[column].push(class);
                }
                fold.representatives.push(index);
                Member::new(class, 1.0)
            })));
        }
        fold.rescale();
        fold
    }

    /// Fits the factors to the rows of another step; returns whether the classes still hold.
    pub fn refit(&mut self, rows: &[f64], width: usize) -> bool {
        self.members.len() * width == rows.len() && self.refit_in(&SparseRows::of(rows, width))
    }

    /// The same of sparse rows.
    pub(crate) fn refit_in(&mut self, rows: &SparseRows) -> bool {
        if self.members.len() != rows.len() {
            return false;
        }
        if self.is_identity() {
            return true;
        }
        let all = rows.most();
        let (floor, gone) = (FOLD_TOLERANCE * all, HELD_TOLERANCE * all);
        let mut moved = false;
        for (index, member) in self.members.iter_mut().enumerate() {
            let row = rows.row(index);
            let Some(member) = member else {
                if row.1.iter().any(|entry| entry.abs() > gone) {
                    return false;
                }
                continue;
            };
            let representative = self.representatives[member.class];
            if representative == index {
                if !row.1.iter().any(|entry| entry.abs() > floor) {
                    return false;
                }
                continue;
            }
            let Some(factor) = fit(row, rows.row(representative), HELD_TOLERANCE) else { return false };
            moved |= std::mem::replace(&mut member.factor, factor).to_bits() != factor.to_bits();
        }
        if moved {
            self.rescale();
        }
        true
    }

    /// Returns one row of each class.
    #[must_use]
    pub fn representatives(&self) -> &[usize] {
        &self.representatives
    }

    fn rescale(&mut self) {
        self.scales.clear();
        self.scales.resize(self.representatives.len(), 0.0);
        for member in self.members.iter().flatten() {
            self.scales[member.class] += member.factor * member.factor;
        }
        self.scales.iter_mut().for_each(|scale| *scale = scale.sqrt());
        for member in self.members.iter_mut().flatten() {
            member.share = member.factor / self.scales[member.class];
        }
    }

    /// Returns the number of rows n.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.members.len()
    }

    /// Returns the number of rows nr that are left.
    #[must_use]
    pub fn reduced(&self) -> usize {
        self.representatives.len()
    }

    /// Tells whether every row is left alone.
    #[must_use]
    pub fn is_identity(&self) -> bool {
        self.rows() == self.reduced()
    }

    /// Returns the representative row and the scale of every class.
    pub fn classes(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.representatives.iter().copied().zip(self.scales.iter().copied())
    }

    /// Class and entry of T of every row; `None` for a zero row.
    pub(crate) fn shares(&self) -> impl Iterator<Item = Option<(usize, f64)>> + Clone + '_ {
        self.members.iter().map(|member| member.map(|m| (m.class, m.share)))
    }

    /// Computes `reduced` = Tᵀ `full`; returns ‖full − T Tᵀ full‖, the part outside range(T).
    pub fn reduce(&self, full: &[f64], reduced: &mut [f64]) -> f64 {
        reduced.fill(0.0);
        for (member, &value) in self.members.iter().zip(full) {
            if let Some(member) = member {
                reduced[member.class] += member.share * value;
            }
        }
        if self.is_identity() {
            return 0.0;
        }
        // Entry by entry: the difference of two squared norms would lose half the digits.
        let outside = |(member, value): (&Option<Member>, &f64)| match member {
            Some(m) => (value - m.share * reduced[m.class]).powi(2),
            None => value * value,
        };
        self.members.iter().zip(full).map(outside).sum::<f64>().sqrt()
    }

    /// Computes `full` = T `reduced`.
    pub fn expand(&self, reduced: &[f64], full: &mut [f64]) {
        for (member, value) in self.members.iter().zip(full) {
            *value = member.map_or(0.0, |m| m.share * reduced[m.class]);
        }
    }
}

/// Columns and entries of a row.
type Row<'a> = (&'a [usize], &'a [f64]);

/// t with row = t · representative, if there is one.
fn fit(row: Row<'_>, representative: Row<'_>, tolerance: f64) -> Option<f64> {
    if row == representative {
        let square: f64 = row.1.iter().map(|entry| entry * entry).sum();
        return (square > 0.0 && square.is_finite()).then_some(1.0);
    }
    let (mut square, mut product, mut own) = (0.0, 0.0, 0.0);
    together(row, representative, |a, b| {
        square += b * b;
        product += a * b;
        own += a * a;
    });
    let (factor, length) = (product / square, f64::sqrt(own));
    // Cheap first: by Cauchy–Schwarz, proportional rows have |t| = ‖row‖ / ‖representative‖.
    if (factor.abs() * f64::sqrt(square) - length).abs() > tolerance * length {
        return None;
    }
    let mut gap = 0.0;
    together(row, representative, |a, b| gap += (a - factor * b).powi(2));
    // Lengths overflow beyond 1e154; rows of that size stay as they are.
    (gap.sqrt() <= tolerance * length && length.is_finite()).then_some(factor)
}

/// Hands over the entries of two rows, column by column.
#[inline]
fn together(row: Row<'_>, other: Row<'_>, mut take: impl FnMut(f64, f64)) {
    if row.0 == other.0 {
        row.1.iter().zip(other.1).for_each(|(&a, &b)| take(a, b));
        return;
    }
    let (mut i, mut j) = (0, 0);
    while i < row.0.len() || j < other.0.len() {
        let (a, b) =
            (row.0.get(i).copied().unwrap_or(usize::MAX), other.0.get(j).copied().unwrap_or(usize::MAX));
        take(if a <= b { row.1[i] } else { 0.0 }, if b <= a { other.1[j] } else { 0.0 });
        i += usize::from(a <= b);
        j += usize::from(b <= a);
    }
}
