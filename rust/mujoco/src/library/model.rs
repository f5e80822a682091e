//! A compiled model.

use std::ffi::{CStr, c_int, c_void};
use std::ptr::{self, NonNull};

use super::ffi::{
    ModelView, oarlock_copy_model, oarlock_delete_model, oarlock_differentiate, oarlock_integrate,
    oarlock_leave_unsolved, oarlock_make_dense, oarlock_name, oarlock_options, oarlock_view_model,
};
use super::{OPENED, array, arrays, size, trapped};
use crate::error::Error;

/// A compiled model: a copy of its own, read only.
pub struct Model {
    pub(super) raw: NonNull<c_void>,
    pub(super) view: ModelView,
    doubted: bool,
}

// SAFETY: nothing writes to a model after it was made, neither here nor in MuJoCo, whose functions take it const.
unsafe impl Send for Model {}
// SAFETY: as above.
unsafe impl Sync for Model {}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: it was made by mj_copyModel and is nobody else's.
        unsafe { oarlock_delete_model(self.raw.as_ptr()) }
    }
}

arrays! { Model,
    /// Parent of each body, nbody.
    body_parentid: c_int = |m| size(m.view.nbody);
    /// Root of each body's tree, nbody.
    body_rootid: c_int = |m| size(m.view.nbody);
    /// First entry of each body's own joints in qvel, or −1, nbody.
    body_dofadr: c_int = |m| size(m.view.nbody);
    /// Number of its own entries, nbody.
    body_dofnum: c_int = |m| size(m.view.nbody);
    /// mjtJoint, njnt.
    jnt_type: c_int = |m| size(m.view.njnt);
    /// First entry in qpos, njnt.
    jnt_qposadr: c_int = |m| size(m.view.njnt);
    /// First entry in qvel, njnt.
    jnt_dofadr: c_int = |m| size(m.view.njnt);
    /// Body of each geom, ngeom.
    geom_bodyid: c_int = |m| size(m.view.ngeom);
    /// Body of each site, nsite.
    site_bodyid: c_int = |m| size(m.view.nsite);
    /// mjtEq, neq: [`EQ_CONNECT`] and its like.
    eq_type: c_int = |m| size(m.view.neq);
    /// mjtObj of the elements of each equality, neq: [`Element`].
    eq_objtype: c_int = |m| size(m.view.neq);
    /// First element of each equality, neq.
    eq_obj1id: c_int = |m| size(m.view.neq);
    /// Second one, or −1, neq.
    eq_obj2id: c_int = |m| size(m.view.neq);
    /// Whether each is switched on at first, neq.
    eq_active0: bool = |m| size(m.view.neq);
    /// First piece of each tendon's path, ntendon.
    tendon_adr: c_int = |m| size(m.view.ntendon);
    /// Number of its pieces, ntendon.
    tendon_num: c_int = |m| size(m.view.ntendon);
    /// mjtWrap, nwrap: [`WRAP_JOINT`] and its like.
    wrap_type: c_int = |m| size(m.view.nwrap);
    /// Element of each piece, nwrap.
    wrap_objid: c_int = |m| size(m.view.nwrap);
    /// The model's own pose, nq.
    qpos0: f64 = |m| size(m.view.nq);
    /// ngeom×3.
    geom_size: f64 = |m| 3 * size(m.view.ngeom);
    /// neq×[`eq_data_width`](Self::eq_data_width).
    eq_data: f64 = |m| m.eq_data_width() * size(m.view.neq);
    /// ntendon.
    tendon_length0: f64 = |m| size(m.view.ntendon);
    /// Divisor of a pulley, coefficient of a joint, side site of a geom, nwrap.
    wrap_prm: f64 = |m| size(m.view.nwrap);
}

/// mjtEq.
pub const EQ_CONNECT: c_int = 0;
/// mjtEq.
pub const EQ_WELD: c_int = 1;
/// mjtEq.
pub const EQ_JOINT: c_int = 2;
/// mjtEq.
pub const EQ_TENDON: c_int = 3;

/// mjtWrap.
pub const WRAP_JOINT: c_int = 1;
/// mjtWrap.
pub const WRAP_PULLEY: c_int = 2;
/// mjtWrap.
pub const WRAP_SITE: c_int = 3;
/// mjtWrap.
pub const WRAP_CYLINDER: c_int = 5;

/// Elements by kind: mjtObj.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub enum Element {
    /// `mjOBJ_GEOM`.
    Geom = 5,
    /// `mjOBJ_SITE`.
    Site = 6,
    /// `mjOBJ_EQUALITY`.
    Equality = 17,
    /// `mjOBJ_TENDON`.
    Tendon = 18,
}

impl Model {
    /// A copy of the model at an address.
    ///
    /// # Safety
    /// `address` is that of an mjModel of the library that [`open`] resolved, and nothing writes to it during the call.
    ///
    /// # Errors
    /// [`Error::Library`]: [`open`] was not called or failed. [`Error::Mujoco`]: there is no memory for it.
    /// [`Error::Refused`]: the model has plugins, whose state is not copied.
    pub unsafe fn copy_of(address: usize) -> Result<Self, Error> {
        // Without it there is no function to call; everything else starts from a model.
        OPENED
            .get()
            .ok_or_else(|| Error::Library("MuJoCo's library is not opened yet".to_owned()))?
            .clone()?;
        let mut raw = ptr::null_mut();
        // SAFETY: the caller's; `raw` is valid for the call.
        trapped(|message| unsafe { oarlock_copy_model(address as *const c_void, &raw mut raw, message) })?;
        let raw =
            NonNull::new(raw).ok_or_else(|| Error::Mujoco("the model could not be copied".to_owned()))?;
        let mut view = std::mem::MaybeUninit::uninit();
        // SAFETY: the shim fills the whole struct from a model that was just made.
        let view = unsafe {
            oarlock_view_model(raw.as_ptr(), view.as_mut_ptr());
            view.assume_init()
        };
        let model = Self { raw, view, doubted: false };
        if model.view.nplugin > 0 {
            return Err(Error::Refused(format!(
                "the model has {} plugin(s), expected none",
                model.view.nplugin
            )));
        }
        Ok(model)
    }

    /// A copy for walks on which MuJoCo's constraint solver is not asked: without what only that solver needs, islands and a
    /// Jacobian that is dense whatever its size. `timestep` is its own, s.
    ///
    /// # Errors
    /// [`Error::Mujoco`]: there is no memory for it.
    pub fn unsolved(&self, timestep: f64) -> Result<Self, Error> {
        // SAFETY: `self` is a model of this library, and nothing writes to it.
        let mut copy = unsafe { Self::copy_of(self.raw.as_ptr() as usize) }?;
        // SAFETY: nobody else knows the copy yet.
        unsafe {
            oarlock_leave_unsolved(copy.raw.as_ptr(), timestep);
            oarlock_view_model(copy.raw.as_ptr(), &raw mut copy.view);
        }
        Ok(copy)
    }

    /// The same model, of which every answer of MuJoCo's constraint solver is held against the minimum that it is after: see
    /// [`Data::forward`](super::Data::forward).
    #[must_use]
    pub fn doubted(mut self) -> Self {
        self.doubted = true;
        self
    }

    /// Whether it is such a model.
    #[must_use]
    pub fn is_doubted(&self) -> bool {
        self.doubted
    }

    /// A copy with a Jacobian that is dense whatever its size.
    ///
    /// # Errors
    /// [`Error::Mujoco`]: there is no memory for it.
    pub(super) fn dense(&self) -> Result<Self, Error> {
        // SAFETY: as for `unsolved`.
        let mut copy = unsafe { Self::copy_of(self.raw.as_ptr() as usize) }?;
        // SAFETY: as for `unsolved`.
        unsafe {
            oarlock_make_dense(copy.raw.as_ptr());
            oarlock_view_model(copy.raw.as_ptr(), &raw mut copy.view);
        }
        Ok(copy)
    }

    /// Name of an element, or its number in `#` form where it has none.
    #[must_use]
    pub fn name(&self, kind: Element, index: usize) -> String {
        let number = c_int::try_from(index).unwrap_or(-1);
        // SAFETY: the function looks the number up in the model and reports no errors; a name is a string of the model's.
        unsafe {
            let name = oarlock_name(self.raw.as_ptr(), kind as c_int, number);
            if name.is_null() {
                format!("#{index}")
            } else {
                CStr::from_ptr(name).to_string_lossy().into_owned()
            }
        }
    }

    /// Number of positions.
    #[must_use]
    pub fn nq(&self) -> usize {
        size(self.view.nq)
    }

    /// Number of velocities.
    #[must_use]
    pub fn nv(&self) -> usize {
        size(self.view.nv)
    }

    /// Number of actuator activations.
    #[must_use]
    pub fn na(&self) -> usize {
        size(self.view.na)
    }

    /// Number of controls.
    #[must_use]
    pub fn nu(&self) -> usize {
        size(self.view.nu)
    }

    /// Numbers that an equality has in `eq_data`: mjNEQDATA.
    #[must_use]
    pub fn eq_data_width(&self) -> usize {
        size(self.view.eq_data_width)
    }

    /// Timestep, s.
    #[must_use]
    pub fn timestep(&self) -> f64 {
        self.view.timestep
    }

    /// Whether the model's integrator asks for forces at stages within a step: Runge–Kutta of order four.
    #[must_use]
    pub fn is_staged(&self) -> bool {
        self.view.staged != 0
    }

    /// Whether MuJoCo keeps the Jacobian in compressed rows.
    #[must_use]
    pub fn is_sparse(&self) -> bool {
        self.view.sparse != 0
    }

    /// Size of the model, m.
    #[must_use]
    pub fn extent(&self) -> f64 {
        self.view.extent
    }

    /// Middle of the model, m.
    #[must_use]
    pub fn center(&self) -> [f64; 3] {
        self.view.center
    }

    /// Moves `qpos` (nq) by `dt` times a velocity (nv), quaternions as rotations.
    ///
    /// # Panics
    /// If the slices are not of these lengths.
    pub fn integrate(&self, qpos: &mut [f64], velocity: &[f64], dt: f64) {
        assert_eq!((qpos.len(), velocity.len()), (self.nq(), self.nv()));
        // SAFETY: the lengths are those of the model; the function reports no errors.
        unsafe { oarlock_integrate(self.raw.as_ptr(), qpos.as_mut_ptr(), velocity.as_ptr(), dt) }
    }

    /// `apart` (nv): the velocity that takes `from` to `to` (nq each) in one second.
    ///
    /// # Panics
    /// If the slices are not of these lengths.
    pub fn differentiate(&self, apart: &mut [f64], from: &[f64], to: &[f64]) {
        assert_eq!((apart.len(), from.len(), to.len()), (self.nv(), self.nq(), self.nq()));
        // SAFETY: as for `integrate`.
        unsafe { oarlock_differentiate(self.raw.as_ptr(), apart.as_mut_ptr(), from.as_ptr(), to.as_ptr()) }
    }
}

/// The options of a model as they are now: numbers (timestep, gravity, viscosity, …), kinds, limits and switches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    bytes: [u8; OPTIONS],
}

/// Room for all of an mjOption.
const OPTIONS: usize = 512;

impl Options {
    /// Those of the model at an address.
    ///
    /// # Safety
    /// It is that of an mjModel, and nobody writes to it meanwhile.
    ///
    /// # Panics
    /// If there is no room for them.
    #[must_use]
    pub unsafe fn at(address: usize) -> Self {
        let mut bytes = [0; OPTIONS];
        // SAFETY: the caller's; room for as many bytes as are said to be there.
        let length = unsafe { oarlock_options(address as *const c_void, bytes.as_mut_ptr().cast(), OPTIONS) };
        assert!(length <= OPTIONS, "options of {length} bytes");
        Self { bytes }
    }
}
