//! MuJoCo's C library as safe types. All unsafe code of the crate is here and in the files of this folder.
//!
//! # What it stands on
//!
//! - Struct layouts are rows of a table, one a version ([`layout`]); [`open`] refuses a version that has none. Whoever opens
//!   a library compares its row with what MuJoCo's own bindings show, before any model is copied: the harness does.
//! - [`Model`] and [`Data`] own what they point to: copies that nothing else in the process knows. So `&Model` can be shared
//!   between threads (MuJoCo only reads it), and `&mut Data` is exclusive.
//! - Pointers are read through the sizes that MuJoCo gives for them. Those into the arena are read anew after every call
//!   that can make constraints anew; such calls take `&mut Data`, so that no slice outlives its array.
//! - Every call into MuJoCo that can report an error goes through the shim's trap: the jump crosses MuJoCo's frames only,
//!   never Rust's. The control hook is called by MuJoCo under such a call; it calls nothing of MuJoCo's itself.
#![allow(unsafe_code)]

mod data;
mod ffi;
mod hook;
mod jacobian;
mod layout;
mod model;
mod newton;
mod placement;
#[cfg(all(test, unix))]
pub(crate) mod testing;

use std::ffi::{CStr, CString, c_char, c_int};
use std::sync::OnceLock;
use std::{ptr, slice};

pub use data::{Cone, Data, InequalityRows};
use ffi::oarlock_open;
pub use hook::{Controls, with_controls, without_timers};
pub use jacobian::Jacobian;
pub use layout::{Layout, Place, layout, versions};
pub use model::{
    EQ_CONNECT, EQ_JOINT, EQ_TENDON, EQ_WELD, Element, Model, Options, WRAP_CYLINDER, WRAP_JOINT,
    WRAP_PULLEY, WRAP_SITE,
};

pub use placement::Placement;

use crate::error::Error;

const MESSAGE: usize = 1024;

/// Resolves MuJoCo's functions from the library at `path`, which the process must have loaded. Once a process.
///
/// # Errors
/// [`Error::Library`]: it is not loaded, it lacks a function, or nothing is known of the layout of its version.
pub fn open(path: &str) -> Result<(), Error> {
    OPENED.get_or_init(|| resolve(path)).clone()
}

/// What [`open`] came to.
static OPENED: OnceLock<Result<(), Error>> = OnceLock::new();

fn resolve(path: &str) -> Result<(), Error> {
    let Ok(name) = CString::new(path) else {
        return Err(Error::Library(format!("{path:?} is no path of a library")));
    };
    let (mut version, mut missing) = (0, ptr::null());
    // SAFETY: the arguments are valid for the call, and `open` makes it only once: nothing reads the table meanwhile.
    match unsafe { oarlock_open(name.as_ptr(), &raw mut version, &raw mut missing) } {
        0 => Ok(()),
        1 => Err(Error::Library(format!(
            "'{path}' is not loaded, expected MuJoCo's library after 'import mujoco'"
        ))),
        2 => {
            // SAFETY: with this status it is a string literal of the shim.
            let name = unsafe { CStr::from_ptr(missing) }.to_string_lossy();
            Err(Error::Library(format!("'{path}' has no function {name}")))
        }
        _ => Err(Error::Library(format!(
            "MuJoCo {} is installed, native stepping knows {}",
            spelt(version),
            versions().into_iter().map(spelt).collect::<Vec<_>>().join(", ")
        ))),
    }
}

/// 4000001 as 4.0.1, and 337 as 3.3.7: before 3.5 MuJoCo gave each part a digit.
fn spelt(version: i32) -> String {
    if version < 1_000_000 {
        return format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10);
    }
    format!("{}.{}.{}", version / 1_000_000, version / 1000 % 1000, version % 1000)
}

/// Makes a call of the shim's that can fail, with a buffer for MuJoCo's message.
fn trapped(call: impl FnOnce(*mut c_char) -> c_int) -> Result<(), Error> {
    let mut message = [0_u8; MESSAGE];
    if call(message.as_mut_ptr().cast()) == 0 {
        return Ok(());
    }
    let text = CStr::from_bytes_until_nul(&message)
        .map_or_else(|_| String::new(), |text| text.to_string_lossy().into());
    Err(Error::Mujoco(text))
}

/// A length of MuJoCo's, which is never negative.
fn size(given: i64) -> usize {
    usize::try_from(given).unwrap_or(0)
}

/// An array of a struct, of so many entries.
///
/// # Safety
/// `start` points to as many for as long as `'a`, and nothing writes them meanwhile; or there are none.
unsafe fn array<'a, T>(start: *const T, count: usize) -> &'a [T] {
    if count == 0 || start.is_null() {
        return &[];
    }
    // SAFETY: the caller's.
    unsafe { slice::from_raw_parts(start, count) }
}

macro_rules! arrays {
    ($owner:ty, $($(#[$doc:meta])* $name:ident: $kind:ty = $count:expr;)*) => {
        impl $owner {
            $($(#[$doc])*
            #[must_use]
            pub fn $name(&self) -> &[$kind] {
                let count: fn(&Self) -> usize = $count;
                // SAFETY: MuJoCo's arrays have the sizes it documents; they live as long as `self`, and change only under
                // `&mut self`.
                unsafe { array(self.view.$name, count(self)) }
            })*
        }
    };
}
use arrays;

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_library_that_is_not_there_is_named() {
        for (path, part) in
            [("nowhere.so", "'nowhere.so' is not loaded"), ("no\0where", "is no path of a library")]
        {
            let Err(Error::Library(message)) = resolve(path) else { panic!("{path}") };
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn versions_are_spelt_as_people_do() {
        assert_eq!(spelt(4_000_001), "4.0.1");
        assert_eq!(spelt(12_034_000), "12.34.0");
        assert_eq!(spelt(337), "3.3.7");
    }
}
