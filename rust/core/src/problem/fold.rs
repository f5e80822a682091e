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

use crate::linalg::kernels::{axpy, dot, largest, norm};

/// Relative tolerance of folding. A row counts as proportional to another if it differs from its multiple by at most this
/// part of its length, and as zero if none of its entries exceeds this part of the largest one. Rows that are the same in exact
/// arithmetic differ by a few rounding errors of the anchors' coordinates; 1e-12 leaves room for long kinematic chains.
pub const FOLD_TOLERANCE: f64 = 1e-12;

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
        let mut fold = Self::default();
        let floor = FOLD_TOLERANCE * largest(rows);
        for (index, row) in rows.chunks_exact(width).enumerate() {
            if largest(row) <= floor {
                fold.members.push(None);
                continue;
            }
            let found = fold.representatives.iter().enumerate().find_map(|(class, &representative)| {
                fit(row, row_of(rows, width, representative)).map(|factor| Member::new(class, factor))
            });
            fold.members.push(Some(found.unwrap_or_else(|| {
                fold.representatives.push(index);
                Member::new(fold.representatives.len() - 1, 1.0)
            })));
        }
        fold.rescale();
        fold
    }

    /// Fits the factors to the rows of another step; returns whether the classes still hold.
    pub fn refit(&mut self, rows: &[f64], width: usize) -> bool {
        self.refit_within(rows, width, |_| (0, width))
    }

    /// The same, of rows that are zero outside of a span each, from its first entry to one past its last.
    pub(crate) fn refit_within(
        &mut self,
        rows: &[f64],
        width: usize,
        span: impl Fn(usize) -> (usize, usize),
    ) -> bool {
        if self.members.len() * width != rows.len() {
            return false;
        }
        if self.is_identity() {
            return true;
        }
        let (mut all, mut vanished, mut standing) = (0.0_f64, 0.0_f64, f64::INFINITY);
        for (index, member) in self.members.iter_mut().enumerate() {
            let (first, end) = span(index);
            let row = row_of(rows, width, index);
            let size = largest(&row[first..end]);
            all = all.max(size);
            let Some(member) = member else {
                vanished = vanished.max(size);
                continue;
            };
            let representative = self.representatives[member.class];
            if representative == index {
                standing = standing.min(size);
                continue;
            }
            let (other, until) = span(representative);
            let both = first.min(other)..end.max(until);
            match fit(&row[both.clone()], &row_of(rows, width, representative)[both]) {
                Some(factor) => member.factor = factor,
                None => return false,
            }
        }
        let floor = FOLD_TOLERANCE * all;
        if vanished > floor || standing <= floor {
            return false;
        }
        self.rescale();
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

fn row_of(rows: &[f64], width: usize, index: usize) -> &[f64] {
    &rows[index * width..(index + 1) * width]
}

/// t with row = t · representative, if there is one.
fn fit(row: &[f64], representative: &[f64]) -> Option<f64> {
    let square = dot(representative, representative);
    if row == representative {
        return (square > 0.0 && square.is_finite()).then_some(1.0);
    }
    let factor = dot(row, representative) / square;
    let length = norm(row);
    // Cheap first: by Cauchy–Schwarz, proportional rows have |t| = ‖row‖ / ‖representative‖.
    if (factor.abs() * square.sqrt() - length).abs() > FOLD_TOLERANCE * length {
        return None;
    }
    let gap = row.iter().zip(representative).map(|(a, b)| (a - factor * b).powi(2)).sum::<f64>().sqrt();
    // Lengths overflow beyond 1e154; rows of that size stay as they are.
    (gap <= FOLD_TOLERANCE * length && length.is_finite()).then_some(factor)
}

/// Adds `scale` times a row to another; used to form the reduced rows.
pub(crate) fn scaled_copy(row: &[f64], scale: f64, out: &mut [f64]) {
    out.fill(0.0);
    axpy(scale, row, out);
}
