//! MuJoCo's C library as safe types. All unsafe code of the crate is here.
//!
//! # What it stands on
//!
//! - Struct layouts come from the shim, compiled against the headers of one version; [`open`] refuses any other.
//! - [`Model`] and [`Data`] own what they point to: copies that nothing else in the process knows. So `&Model` can be shared
//!   between threads (MuJoCo only reads it), and `&mut Data` is exclusive.
//! - Pointers are read through the sizes that MuJoCo gives for them. Those into the arena are read anew after every call
//!   that can make constraints anew; such calls take `&mut Data`, so that no slice outlives its array.
//! - Every call into MuJoCo that can report an error goes through the shim's trap: the jump crosses MuJoCo's frames only,
//!   never Rust's. The control hook is called by MuJoCo under such a call; it calls nothing of MuJoCo's itself.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, OnceLock};
use std::{ptr, slice};

use crate::error::Error;

const MESSAGE: usize = 1024;

/// Sizes and arrays of a model, as in shim.h.
#[repr(C)]
struct ModelView {
    nq: i64,
    nv: i64,
    nu: i64,
    na: i64,
    nbody: i64,
    njnt: i64,
    ngeom: i64,
    nsite: i64,
    neq: i64,
    ntendon: i64,
    nwrap: i64,
    nplugin: i64,
    sparse: i64,
    integrator: i64,
    timestep: f64,
    body_parentid: *const c_int,
    body_rootid: *const c_int,
    body_dofadr: *const c_int,
    body_dofnum: *const c_int,
    jnt_type: *const c_int,
    jnt_qposadr: *const c_int,
    jnt_dofadr: *const c_int,
    geom_bodyid: *const c_int,
    site_bodyid: *const c_int,
    eq_type: *const c_int,
    eq_obj1id: *const c_int,
    eq_obj2id: *const c_int,
    eq_objtype: *const c_int,
    tendon_adr: *const c_int,
    tendon_num: *const c_int,
    wrap_type: *const c_int,
    wrap_objid: *const c_int,
    eq_active0: *const bool,
    qpos0: *const f64,
    geom_size: *const f64,
    site_quat: *const f64,
    eq_data: *const f64,
    tendon_length0: *const f64,
    wrap_prm: *const f64,
    extent: f64,
    center: [f64; 3],
}

/// Arrays of a data that stay where they are, as in shim.h.
#[repr(C)]
struct DataView {
    time: *mut f64,
    energy: *mut f64,
    qpos: *mut f64,
    qvel: *mut f64,
    act: *mut f64,
    ctrl: *mut f64,
    qacc: *mut f64,
    qfrc_constraint: *mut f64,
    qfrc_smooth: *const f64,
    qacc_smooth: *const f64,
    inverse_diagonal: *const f64,
    xpos: *const f64,
    xquat: *const f64,
    xmat: *const f64,
    cvel: *const f64,
    cdof_dot: *const f64,
    subtree_com: *const f64,
    geom_xpos: *const f64,
    geom_xmat: *const f64,
    site_xpos: *const f64,
    ten_length: *const f64,
    ten_velocity: *const f64,
    wrap_xpos: *const f64,
    ten_wrapadr: *const c_int,
    ten_wrapnum: *const c_int,
    wrap_obj: *const c_int,
    solver_niter: *const c_int,
}

/// Arrays of a data in its arena, as in shim.h.
#[repr(C)]
struct RowsView {
    ne: i64,
    nefc: i64,
    njacobian: i64,
    nisland: i64,
    id: *const c_int,
    rownnz: *const c_int,
    rowadr: *const c_int,
    colind: *const c_int,
    jacobian: *const f64,
    pos: *const f64,
    vel: *const f64,
    aref: *const f64,
    softness: *const f64,
    force: *mut f64,
}

type Control = extern "C" fn(*mut c_void, f64, *mut f64);

unsafe extern "C" {
    safe fn oarlock_header_version() -> c_int;
    fn oarlock_open(path: *const c_char, version: *mut c_int, missing: *mut *const c_char) -> c_int;
    fn oarlock_copy_model(model: *const c_void, copy: *mut *mut c_void, message: *mut c_char) -> c_int;
    fn oarlock_delete_model(model: *mut c_void);
    fn oarlock_make_data(model: *const c_void, data: *mut *mut c_void, message: *mut c_char) -> c_int;
    fn oarlock_delete_data(data: *mut c_void);
    fn oarlock_view_model(model: *const c_void, view: *mut ModelView);
    fn oarlock_name(model: *const c_void, kind: c_int, index: c_int) -> *const c_char;
    fn oarlock_view_data(data: *mut c_void, view: *mut DataView);
    fn oarlock_view_rows(data: *mut c_void, view: *mut RowsView);
    fn oarlock_run(stage: c_int, model: *const c_void, data: *mut c_void, message: *mut c_char) -> c_int;
    fn oarlock_whiten(
        model: *const c_void,
        data: *mut c_void,
        count: c_int,
        x: *mut f64,
        y: *const f64,
        roots: *const f64,
        message: *mut c_char,
    ) -> c_int;
    fn oarlock_solve_mass(
        model: *const c_void,
        data: *mut c_void,
        x: *mut f64,
        y: *const f64,
        message: *mut c_char,
    ) -> c_int;
    fn oarlock_jacobian_times(
        model: *const c_void,
        data: *const c_void,
        transposed: c_int,
        x: *const f64,
        y: *mut f64,
        message: *mut c_char,
    ) -> c_int;
    fn oarlock_integrate(model: *const c_void, qpos: *mut f64, qvel: *const f64, dt: f64);
    fn oarlock_differentiate(model: *const c_void, qvel: *mut f64, qpos1: *const f64, qpos2: *const f64);
    safe fn oarlock_hook();
    safe fn oarlock_unhook();
    fn oarlock_answer(model: *const c_void, control: Option<Control>, this: *mut c_void);
}

/// The MuJoCo version that the crate was built against, as `mj_version` gives it: 4000000 is 4.0.0.
#[must_use]
pub fn built_against() -> i32 {
    oarlock_header_version()
}

/// Resolves MuJoCo's functions from the library at `path`, which the process must have loaded. Once a process.
///
/// # Errors
/// [`Error::Library`]: it is not loaded, it lacks a function, or it is not of the version that this was built against.
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
            "MuJoCo {} is installed, the native stepping was built against {}",
            spelt(version),
            spelt(oarlock_header_version())
        ))),
    }
}

/// 4000001 as 4.0.1.
fn spelt(version: i32) -> String {
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

/// A compiled model: a copy of its own, read only.
pub struct Model {
    raw: NonNull<c_void>,
    view: ModelView,
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
    /// First element of each equality, neq.
    eq_obj1id: c_int = |m| size(m.view.neq);
    /// Second one, or −1, neq.
    eq_obj2id: c_int = |m| size(m.view.neq);
    /// mjtObj of both, neq.
    eq_objtype: c_int = |m| size(m.view.neq);
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
    /// nsite×4.
    site_quat: f64 = |m| 4 * size(m.view.nsite);
    /// neq×[`EQ_DATA`].
    eq_data: f64 = |m| EQ_DATA * size(m.view.neq);
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

/// Numbers that an equality has in `eq_data`: mjNEQDATA.
pub const EQ_DATA: usize = 12;

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
        let model = Self { raw, view };
        if model.view.nplugin > 0 {
            return Err(Error::Refused(format!(
                "the model has {} plugin(s), expected none",
                model.view.nplugin
            )));
        }
        Ok(model)
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

    /// Timestep, s.
    #[must_use]
    pub fn timestep(&self) -> f64 {
        self.view.timestep
    }

    /// The integrator that the model asks for.
    #[must_use]
    pub fn integrator(&self) -> Integrator {
        match self.view.integrator {
            0 => Integrator::Euler,
            1 => Integrator::RungeKutta,
            _ => Integrator::Implicit,
        }
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

/// MuJoCo's integrators, as far as they differ in how they are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrator {
    /// Semi-implicit Euler.
    Euler,
    /// Runge–Kutta of order four.
    RungeKutta,
    /// Implicit in velocity, both kinds.
    Implicit,
}

/// Calls that take nothing but the model and its data; numbers as in shim.h.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
enum Stage {
    Forward,
    Position,
    Smooth,
    Constraint,
    RungeKutta,
    Euler,
    Implicit,
    Energy,
    Step,
}

/// A state of a model, with everything that MuJoCo computes from it.
pub struct Data {
    model: Arc<Model>,
    raw: NonNull<c_void>,
    view: DataView,
    rows: RowsView,
}

// SAFETY: it is nobody else's, and MuJoCo keeps nothing about it in the thread.
unsafe impl Send for Data {}
// SAFETY: whatever takes it shared only reads, in MuJoCo too: such functions take mjData const, and do not use its stack.
unsafe impl Sync for Data {}

impl Drop for Data {
    fn drop(&mut self) {
        // SAFETY: it was made by mj_makeData and is nobody else's.
        unsafe { oarlock_delete_data(self.raw.as_ptr()) }
    }
}

arrays! { Data,
    /// Positions, nq.
    qpos: f64 = |d| d.model.nq();
    /// Velocities, nv.
    qvel: f64 = |d| d.model.nv();
    /// Actuator activations, na.
    act: f64 = |d| d.model.na();
    /// Accelerations, nv.
    qacc: f64 = |d| d.model.nv();
    /// Jᵀ λ, nv.
    qfrc_constraint: f64 = |d| d.model.nv();
    /// All forces but those of constraints, nv.
    qfrc_smooth: f64 = |d| d.model.nv();
    /// 1/D of M's factor, nv.
    inverse_diagonal: f64 = |d| d.model.nv();
    /// Accelerations without constraints, nv.
    qacc_smooth: f64 = |d| d.model.nv();
    /// Places of bodies, nbody×3, m.
    xpos: f64 = |d| 3 * size(d.model.view.nbody);
    /// Their orientations, nbody×4.
    xquat: f64 = |d| 4 * size(d.model.view.nbody);
    /// The same as matrices, nbody×9, row-major.
    xmat: f64 = |d| 9 * size(d.model.view.nbody);
    /// Angular velocities of bodies and linear ones at their tree's centre of mass, nbody×6.
    cvel: f64 = |d| 6 * size(d.model.view.nbody);
    /// Rates of the joint axes as spatial vectors at their tree's centre of mass, nv×6.
    cdof_dot: f64 = |d| 6 * d.model.nv();
    /// Centres of mass of subtrees, nbody×3, m.
    subtree_com: f64 = |d| 3 * size(d.model.view.nbody);
    /// Places of geoms, ngeom×3, m.
    geom_xpos: f64 = |d| 3 * size(d.model.view.ngeom);
    /// Their orientations, ngeom×9, row-major.
    geom_xmat: f64 = |d| 9 * size(d.model.view.ngeom);
    /// Places of sites, nsite×3, m.
    site_xpos: f64 = |d| 3 * size(d.model.view.nsite);
    /// Lengths of tendons, ntendon, m.
    ten_length: f64 = |d| size(d.model.view.ntendon);
    /// Their rates, ntendon, m/s.
    ten_velocity: f64 = |d| size(d.model.view.ntendon);
    /// Points of all paths, nwrap×6, m.
    wrap_xpos: f64 = |d| 6 * size(d.model.view.nwrap);
    /// First point of each tendon's path, ntendon.
    ten_wrapadr: c_int = |d| size(d.model.view.ntendon);
    /// Number of its points, ntendon.
    ten_wrapnum: c_int = |d| size(d.model.view.ntendon);
    /// Geom of each point, −1 on a site, −2 at a pulley, nwrap×2.
    wrap_obj: c_int = |d| 2 * size(d.model.view.nwrap);
}

impl Data {
    /// A data at the model's own pose.
    ///
    /// # Errors
    /// [`Error::Mujoco`]: there is no memory for it.
    pub fn new(model: &Arc<Model>) -> Result<Self, Error> {
        let mut raw = ptr::null_mut();
        // SAFETY: the model is valid; `raw` is valid for the call.
        trapped(|message| unsafe { oarlock_make_data(model.raw.as_ptr(), &raw mut raw, message) })?;
        let raw = NonNull::new(raw).ok_or_else(|| Error::Mujoco("no memory for mjData".to_owned()))?;
        let mut view = std::mem::MaybeUninit::uninit();
        // SAFETY: the shim fills the whole struct from a data that was just made.
        let view = unsafe {
            oarlock_view_data(raw.as_ptr(), view.as_mut_ptr());
            view.assume_init()
        };
        Ok(Self { model: Arc::clone(model), raw, view, rows: rows_of(raw) })
    }

    /// Its model.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Makes a call, after which the rows may lie elsewhere, also when it failed.
    fn run(&mut self, stage: Stage) -> Result<(), Error> {
        let (model, data) = (self.model.raw.as_ptr(), self.raw.as_ptr());
        // SAFETY: both are valid and belong together; `&mut self` is exclusive.
        let done = trapped(|message| unsafe { oarlock_run(stage as c_int, model, data, message) });
        self.rows = rows_of(self.raw);
        done
    }

    /// `mj_forward`.
    ///
    /// # Errors
    /// [`Error::Mujoco`], here and in the other stages.
    pub fn forward(&mut self) -> Result<(), Error> {
        self.run(Stage::Forward)
    }

    /// The position stage.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn position_stage(&mut self) -> Result<(), Error> {
        self.run(Stage::Position)
    }

    /// Position, velocity, actuation and acceleration stages: all but the constraint solver. Controls must be written.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn smooth_stages(&mut self) -> Result<(), Error> {
        self.run(Stage::Smooth)
    }

    /// MuJoCo's constraint solver, after the smooth stages.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn constraint_stage(&mut self) -> Result<(), Error> {
        self.run(Stage::Constraint)
    }

    /// The second half of `mj_step` by the model's own integrator.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn integrate(&mut self) -> Result<(), Error> {
        self.run(match self.model.integrator() {
            Integrator::Euler => Stage::Euler,
            Integrator::RungeKutta => Stage::RungeKutta,
            Integrator::Implicit => Stage::Implicit,
        })
    }

    /// `mj_step`.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn step(&mut self) -> Result<(), Error> {
        self.run(Stage::Step)
    }

    /// Potential and kinetic energy, J, at a state whose position and velocity stages are done.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn energy(&mut self) -> Result<[f64; 2], Error> {
        self.run(Stage::Energy)?;
        // SAFETY: two numbers of the struct itself.
        Ok(unsafe { [*self.view.energy, *self.view.energy.add(1)] })
    }

    /// `whitened` = H `vectors`, several of nv one after another, where M⁻¹ = Hᵀ H; `roots` (nv) are the square roots of
    /// [`inverse_diagonal`](Self::inverse_diagonal). The position stage must be valid.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    ///
    /// # Panics
    /// If the slices are not of these lengths.
    pub fn whiten(&mut self, whitened: &mut [f64], vectors: &[f64], roots: &[f64]) -> Result<(), Error> {
        let nv = self.model.nv();
        let count = vectors.len() / nv;
        assert_eq!((whitened.len(), vectors.len(), roots.len()), (count * nv, count * nv, nv));
        let count = c_int::try_from(count).expect("no model has as many rows");
        // SAFETY: the lengths are right; MuJoCo uses the data's stack, which `&mut self` makes exclusive.
        trapped(|message| unsafe {
            oarlock_whiten(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                count,
                whitened.as_mut_ptr(),
                vectors.as_ptr(),
                roots.as_ptr(),
                message,
            )
        })
    }

    /// `x` = M⁻¹ `y`, both nv.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    ///
    /// # Panics
    /// If the slices are not of this length.
    pub fn solve_mass(&mut self, x: &mut [f64], y: &[f64]) -> Result<(), Error> {
        assert_eq!((x.len(), y.len()), (self.model.nv(), self.model.nv()));
        // SAFETY: the lengths are right; MuJoCo uses the data's stack, which `&mut self` makes exclusive.
        trapped(|message| unsafe {
            oarlock_solve_mass(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                x.as_mut_ptr(),
                y.as_ptr(),
                message,
            )
        })
    }

    /// `product` (nefc) = J `x` (nv).
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    ///
    /// # Panics
    /// If the slices are not of these lengths.
    pub fn jacobian_times(&mut self, x: &[f64], product: &mut [f64]) -> Result<(), Error> {
        assert_eq!((x.len(), product.len()), (self.model.nv(), self.nefc()));
        // SAFETY: lengths are right.
        trapped(|message| unsafe {
            oarlock_jacobian_times(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                0,
                x.as_ptr(),
                product.as_mut_ptr(),
                message,
            )
        })
    }

    /// `product` (nv) = Jᵀ `x` (nefc).
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    ///
    /// # Panics
    /// If the slices are not of these lengths.
    pub fn jacobian_transposed_times(&mut self, x: &[f64], product: &mut [f64]) -> Result<(), Error> {
        assert_eq!((product.len(), x.len()), (self.model.nv(), self.nefc()));
        // MuJoCo leaves the product as it was where there are no rows.
        product.fill(0.0);
        // SAFETY: lengths are right.
        trapped(|message| unsafe {
            oarlock_jacobian_times(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                1,
                x.as_ptr(),
                product.as_mut_ptr(),
                message,
            )
        })
    }

    /// Time, s.
    #[must_use]
    pub fn time(&self) -> f64 {
        // SAFETY: a number of the struct itself.
        unsafe { *self.view.time }
    }

    /// Sets the time, s.
    pub fn set_time(&mut self, time: f64) {
        // SAFETY: a number of the struct itself; `&mut self` is exclusive.
        unsafe { *self.view.time = time }
    }

    /// Solver iterations of the last constraint stage, over all islands.
    #[must_use]
    pub fn solver_iterations(&self) -> i64 {
        let islands = size(self.rows.nisland).clamp(1, 20);
        // SAFETY: an array of mjNISLAND = 20 in the struct itself.
        unsafe { array(self.view.solver_niter, islands) }.iter().map(|&count| i64::from(count)).sum()
    }

    /// Number of equality rows.
    #[must_use]
    pub fn ne(&self) -> usize {
        size(self.rows.ne)
    }

    /// Number of all constraint rows.
    #[must_use]
    pub fn nefc(&self) -> usize {
        size(self.rows.nefc)
    }

    /// Copies J of the equality rows into `jacobian`, ne×nv, row-major.
    ///
    /// # Panics
    /// If `jacobian` is not of this length.
    pub fn copy_jacobian(&self, jacobian: &mut [f64]) {
        let (ne, nv) = (self.ne(), self.model.nv());
        assert_eq!(jacobian.len(), ne * nv);
        let entries = size(self.rows.njacobian);
        // SAFETY: nJ is the number of entries of the array, dense or not, after constraints were made.
        let given =
            unsafe { array(self.rows.jacobian, if self.model.is_sparse() { entries } else { ne * nv }) };
        if !self.model.is_sparse() {
            jacobian.copy_from_slice(given);
            return;
        }
        // SAFETY: rows of nefc, columns of nJ.
        let (counts, starts, columns) = unsafe {
            (array(self.rows.rownnz, ne), array(self.rows.rowadr, ne), array(self.rows.colind, entries))
        };
        jacobian.fill(0.0);
        for (row, (&count, &start)) in jacobian.chunks_exact_mut(nv).zip(counts.iter().zip(starts)) {
            let range = size(start.into())..size(start.into()) + size(count.into());
            for (&column, &value) in columns[range.clone()].iter().zip(&given[range]) {
                row[size(column.into())] = value;
            }
        }
    }
}

macro_rules! rows {
    ($($(#[$doc:meta])* $name:ident: $kind:ty;)*) => {
        impl Data {
            $($(#[$doc])*
            #[must_use]
            pub fn $name(&self) -> &[$kind] {
                // SAFETY: as for the other arrays, with `rows` taken after the last call that can move them.
                unsafe { array(self.rows.$name, self.ne()) }
            })*
        }
    };
}

rows! {
    /// Equality of each row, ne.
    id: c_int;
    /// Deviations r, ne, m or rad.
    pos: f64;
    /// Rates J v, ne.
    vel: f64;
    /// Accelerations that MuJoCo asks of the rows, ne.
    aref: f64;
    /// R, ne.
    softness: f64;
}

impl Data {
    /// MuJoCo's multipliers, nefc.
    #[must_use]
    pub fn force(&self) -> &[f64] {
        // SAFETY: as for the other rows.
        unsafe { array(self.rows.force, self.nefc()) }
    }
}

macro_rules! writable {
    ($($(#[$doc:meta])* $name:ident: $field:ident, $count:expr;)*) => {
        impl Data {
            $($(#[$doc])*
            pub fn $name(&mut self) -> &mut [f64] {
                let count: fn(&Self) -> usize = $count;
                let count = count(self);
                if count == 0 {
                    return &mut [];
                }
                // SAFETY: MuJoCo's arrays have the sizes it documents; `&mut self` is exclusive.
                unsafe { slice::from_raw_parts_mut(self.view.$field, count) }
            })*
        }
    };
}

writable! {
    /// Positions, nq.
    qpos_mut: qpos, |d| d.model.nq();
    /// Velocities, nv.
    qvel_mut: qvel, |d| d.model.nv();
    /// Actuator activations, na.
    act_mut: act, |d| d.model.na();
    /// Controls, nu.
    ctrl_mut: ctrl, |d| d.model.nu();
    /// Accelerations, nv.
    qacc_mut: qacc, |d| d.model.nv();
    /// Jᵀ λ, nv.
    qfrc_constraint_mut: qfrc_constraint, |d| d.model.nv();
}

impl Data {
    /// Multipliers of all rows, nefc.
    pub fn force_mut(&mut self) -> &mut [f64] {
        let count = self.nefc();
        if count == 0 || self.rows.force.is_null() {
            return &mut [];
        }
        // SAFETY: as for the other rows; `&mut self` is exclusive.
        unsafe { slice::from_raw_parts_mut(self.rows.force, count) }
    }
}

fn rows_of(data: NonNull<c_void>) -> RowsView {
    let mut view = std::mem::MaybeUninit::uninit();
    // SAFETY: the data is valid, and the shim fills the whole struct.
    unsafe {
        oarlock_view_rows(data.as_ptr(), view.as_mut_ptr());
        view.assume_init()
    }
}

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
