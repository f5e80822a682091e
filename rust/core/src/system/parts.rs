//! What an assembled system is made of, for those who solve beside it.

use crate::problem::Blocks;

/// W, R and b of the reduced rows, multiplied by powers of two where they are small.
#[derive(Clone, Copy)]
pub(crate) struct Parts<'a> {
    pub(crate) nv: usize,
    /// W, column after column (`nv` each).
    pub(crate) whitened: &'a [f64],
    pub(crate) softness: Option<&'a [f64]>,
    pub(crate) rhs: &'a [f64],
    pub(crate) blocks: &'a Blocks,
    /// What (Wᵀ)⁺ b of these is to be multiplied by.
    pub(crate) unit: f64,
}
