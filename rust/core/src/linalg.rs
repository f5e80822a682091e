//! Linear algebra on flat slices: products of small matrices, reflections, narrow symmetric factors, and where sparse rows lie.

pub(crate) mod kernels;
pub(crate) mod reflections;
pub(crate) mod skyline;
pub(crate) mod spans;
