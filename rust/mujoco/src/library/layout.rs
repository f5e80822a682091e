//! Where each version of MuJoCo keeps what is read: the rows of layouts/table.h.

use std::ffi::{CStr, c_char, c_int};
use std::ptr;

use super::ffi::{oarlock_describe, oarlock_versions};
use super::{array, size};

/// A field of MuJoCo's structs and where one version keeps it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// The struct: `mjModel`, `mjData` or `mjContact`.
    pub whole: &'static str,
    /// The field, `opt.timestep` for one in a struct within it.
    pub field: &'static str,
    /// Its type in C: `int64_t`, `double*`, `int[20]`.
    pub kind: &'static str,
    /// Bytes from the start of the struct.
    pub offset: u32,
}

/// What one version of MuJoCo's structs looks like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layout {
    /// Every field that is read or written.
    pub places: Vec<Place>,
    /// Bytes of an mjContact.
    pub contact_size: usize,
    /// mjNEQDATA.
    pub eq_data_width: usize,
}

/// The versions whose layouts are known, as `mj_version()` has them, oldest first.
#[must_use]
pub fn versions() -> Vec<i32> {
    // SAFETY: with no room nothing is written.
    let mut found = vec![0; size(i64::from(unsafe { oarlock_versions(ptr::null_mut(), 0) }))];
    let room = c_int::try_from(found.len()).unwrap_or(c_int::MAX);
    // SAFETY: there is as much room.
    unsafe { oarlock_versions(found.as_mut_ptr(), room) };
    found
}

/// The layout of a version, as `mj_version()` has it; none where it is not known.
#[must_use]
pub fn layout(version: i32) -> Option<Layout> {
    let (mut fields, mut offsets) = (ptr::null(), ptr::null());
    let (mut contact_size, mut eq_data_width) = (0, 0);
    // SAFETY: all are valid for the call.
    let count = unsafe {
        oarlock_describe(
            version,
            &raw mut fields,
            &raw mut offsets,
            &raw mut contact_size,
            &raw mut eq_data_width,
        )
    };
    let count = size(count.into());
    // SAFETY: arrays of constants of the shim, as long as it says; without a layout it says 0.
    let (fields, offsets) = unsafe { (array(fields, count), array(offsets, count)) };
    let places = fields.iter().zip(offsets).map(|(field, &offset)| Place {
        whole: text(field.whole),
        field: text(field.name),
        kind: text(field.kind),
        offset,
    });
    (count > 0).then(|| Layout {
        places: places.collect(),
        contact_size: size(contact_size.into()),
        eq_data_width: size(eq_data_width.into()),
    })
}

fn text(literal: *const c_char) -> &'static str {
    // SAFETY: a string literal of the shim.
    unsafe { CStr::from_ptr(literal) }.to_str().expect("names are ASCII")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_whole_and_no_two_fields_share_a_place() {
        let versions = versions();
        assert!(versions.len() >= 9 && versions.is_sorted(), "{versions:?}");
        for version in versions {
            let layout = layout(version).expect("a row");
            for (at, one) in layout.places.iter().enumerate() {
                // A row that is too short is filled up with zeros.
                assert!(one.offset > 0 || one.field == "nq", "{version}: {one:?}");
                let shared = |other: &&Place| other.whole == one.whole && other.offset == one.offset;
                assert_eq!(layout.places[at + 1..].iter().find(shared), None, "{version}: {one:?}");
            }
        }
    }

    #[test]
    fn a_version_that_nobody_knows_has_no_layout() {
        assert_eq!(layout(4_099_000), None);
    }
}
