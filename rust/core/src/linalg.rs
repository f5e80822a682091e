//! Linear algebra on flat slices: products of small matrices, reflections, sparse rows and symmetric factors.

pub(crate) mod forest;
pub(crate) mod kernels;
pub(crate) mod ldl;
pub(crate) mod packs;
pub(crate) mod reflections;
pub(crate) mod rows;
pub(crate) mod skyline;
pub(crate) mod spans;
pub(crate) mod tree;
