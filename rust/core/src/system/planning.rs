//! Which patterns a sparse step has, and whether they are those of the step before.

/// What is planned of a system, once and for as long as its patterns stand.
#[derive(Debug, Clone, Default)]
pub(super) struct Planning {
    /// Whether the step at hand has its inertia along a tree.
    pub(super) on_tree: bool,
    /// Number of the patterns of J, M and fold, where the step is sparse and its numbers are of ordinary size.
    pub(super) plan: Option<u64>,
    /// The same of the last sparse step, and the pattern of J that it was for.
    pub(super) number: u64,
    pub(super) rows: u64,
    /// Whether the pattern of M or the fold has changed since.
    pub(super) stale: bool,
}

impl Planning {
    /// A step that is dense.
    pub(super) const fn leave_tree(&mut self) {
        (self.on_tree, self.plan) = (false, None);
    }
}
