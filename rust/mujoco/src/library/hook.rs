//! What MuJoCo calls back, once for the process: its control hook and its clock, shared out among threads.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::sync::{Mutex, PoisonError};
use std::{ptr, slice};

use super::ffi::{oarlock_answer, oarlock_hook, oarlock_start_timers, oarlock_stop_timers, oarlock_unhook};
use super::model::Model;

/// Writes controls (nu) at a time, s. MuJoCo's own integrators ask it at every stage.
pub trait Controls {
    /// Writes them.
    fn write(&mut self, time: f64, ctrl: &mut [f64]);
}

/// How many threads have MuJoCo's control hook installed, and its timers stopped.
static HOOKED: Mutex<usize> = Mutex::new(0);
static UNTIMED: Mutex<usize> = Mutex::new(0);

/// One more; the first one does `first`.
fn enter(count: &Mutex<usize>, first: impl FnOnce()) {
    let mut count = count.lock().unwrap_or_else(PoisonError::into_inner);
    if *count == 0 {
        first();
    }
    *count += 1;
}

/// One less; the last one does `last`.
fn leave(count: &Mutex<usize>, last: impl FnOnce()) {
    let mut count = count.lock().unwrap_or_else(PoisonError::into_inner);
    *count -= 1;
    if *count == 0 {
        last();
    }
}

/// Does `work` while MuJoCo's timers, in `mjData.timer` of whoever runs meanwhile, stand still. Its Python bindings set a
/// clock, which costs a fifth of a step of a small model.
pub fn without_timers<T>(work: impl FnOnce() -> T) -> T {
    struct Restart;
    impl Drop for Restart {
        fn drop(&mut self) {
            leave(&UNTIMED, || oarlock_start_timers());
        }
    }
    enter(&UNTIMED, || oarlock_stop_timers());
    let _restart = Restart;
    work()
}

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
            leave(&HOOKED, || oarlock_unhook());
        }
    }
    let mut hook = Hook { nu: model.nu(), controls };
    enter(&HOOKED, || oarlock_hook());
    let _unhook = Unhook(PhantomData);
    // SAFETY: `_unhook` takes the answer back before `hook`, which was made earlier, goes out of scope.
    unsafe { oarlock_answer(model.raw.as_ptr(), Some(answer::<C>), (&raw mut hook).cast()) };
    work()
}
