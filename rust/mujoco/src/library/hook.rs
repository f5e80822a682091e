//! MuJoCo's control hook, which is one for the process, shared out among threads.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::sync::Mutex;
use std::{ptr, slice};

use super::ffi::{oarlock_answer, oarlock_hook, oarlock_unhook};
use super::model::Model;

/// Writes controls (nu) at a time, s. MuJoCo's own integrators ask it at every stage.
pub trait Controls {
    /// Writes them.
    fn write(&mut self, time: f64, ctrl: &mut [f64]);
}

/// How many threads have MuJoCo's control hook installed.
static HOOKED: Mutex<usize> = Mutex::new(0);

/// Who answers MuJoCo in this thread.
struct Hook<'a, C> {
    nu: usize,
    controls: &'a mut C,
}

extern "C" fn answer<C: Controls>(this: *mut c_void, time: f64, ctrl: *mut f64) {
    // SAFETY: `this` is the hook that `with_controls` has on its stack, and nobody else uses it during the call; `ctrl` is the
    // array of a data of its model.
    unsafe {
        let hook = &mut *this.cast::<Hook<'_, C>>();
        hook.controls
            .write(time, if hook.nu == 0 { &mut [] } else { slice::from_raw_parts_mut(ctrl, hook.nu) });
    }
}

/// Does `work` while MuJoCo asks `controls` at every stage that this thread takes `model` through; for other models and
/// threads, whatever was installed before answers.
pub fn with_controls<C: Controls, T>(model: &Model, controls: &mut C, work: impl FnOnce() -> T) -> T {
    struct Unhook(PhantomData<*const ()>);
    impl Drop for Unhook {
        fn drop(&mut self) {
            // SAFETY: nobody answers.
            unsafe { oarlock_answer(ptr::null(), None, ptr::null_mut()) };
            let mut count = HOOKED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *count -= 1;
            if *count == 0 {
                oarlock_unhook();
            }
        }
    }
    let mut hook = Hook { nu: model.nu(), controls };
    {
        let mut count = HOOKED.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if *count == 0 {
            oarlock_hook();
        }
        *count += 1;
    }
    let _unhook = Unhook(PhantomData);
    // SAFETY: `_unhook` takes the answer back before `hook`, which was made earlier, goes out of scope.
    unsafe { oarlock_answer(model.raw.as_ptr(), Some(answer::<C>), (&raw mut hook).cast()) };
    work()
}
