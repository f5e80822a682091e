//! What shim.h declares, and the functions of shim.c.

use std::ffi::{c_char, c_int, c_void};

/// Sizes and arrays of a model, as in shim.h.
#[repr(C)]
pub(super) struct ModelView {
    pub(super) nq: i64,
    pub(super) nv: i64,
    pub(super) nu: i64,
    pub(super) na: i64,
    pub(super) nbody: i64,
    pub(super) njnt: i64,
    pub(super) ngeom: i64,
    pub(super) nsite: i64,
    pub(super) neq: i64,
    pub(super) ntendon: i64,
    pub(super) nwrap: i64,
    pub(super) nplugin: i64,
    pub(super) sparse: i64,
    pub(super) staged: i64,
    pub(super) eq_data_width: i64,
    pub(super) timestep: f64,
    pub(super) mass_lengths: *const c_int,
    pub(super) mass_starts: *const c_int,
    pub(super) mass_columns: *const c_int,
    pub(super) body_parentid: *const c_int,
    pub(super) body_rootid: *const c_int,
    pub(super) body_dofadr: *const c_int,
    pub(super) body_dofnum: *const c_int,
    pub(super) jnt_type: *const c_int,
    pub(super) jnt_qposadr: *const c_int,
    pub(super) jnt_dofadr: *const c_int,
    pub(super) geom_bodyid: *const c_int,
    pub(super) site_bodyid: *const c_int,
    pub(super) eq_type: *const c_int,
    pub(super) eq_objtype: *const c_int,
    pub(super) eq_obj1id: *const c_int,
    pub(super) eq_obj2id: *const c_int,
    pub(super) tendon_adr: *const c_int,
    pub(super) tendon_num: *const c_int,
    pub(super) wrap_type: *const c_int,
    pub(super) wrap_objid: *const c_int,
    pub(super) eq_active0: *const bool,
    pub(super) qpos0: *const f64,
    pub(super) geom_size: *const f64,
    pub(super) eq_data: *const f64,
    pub(super) tendon_length0: *const f64,
    pub(super) wrap_prm: *const f64,
    pub(super) extent: f64,
    pub(super) center: [f64; 3],
}

/// Arrays of a data that stay where they are, as in shim.h.
#[repr(C)]
pub(super) struct DataView {
    pub(super) time: *mut f64,
    pub(super) energy: *mut f64,
    pub(super) qpos: *mut f64,
    pub(super) qvel: *mut f64,
    pub(super) act: *mut f64,
    pub(super) ctrl: *mut f64,
    pub(super) qacc: *mut f64,
    pub(super) qfrc_constraint: *mut f64,
    pub(super) eq_active: *mut bool,
    pub(super) qfrc_smooth: *const f64,
    pub(super) qacc_smooth: *const f64,
    pub(super) mass: *const f64,
    pub(super) mass_factor: *const f64,
    pub(super) inverse_diagonal: *const f64,
    pub(super) cvel: *const f64,
    pub(super) cdof_dot: *const f64,
    pub(super) subtree_com: *const f64,
    pub(super) geom_xpos: *const f64,
    pub(super) geom_xmat: *const f64,
    pub(super) site_xpos: *const f64,
    pub(super) ten_length: *const f64,
    pub(super) ten_velocity: *const f64,
    pub(super) wrap_xpos: *const f64,
    pub(super) ten_wrapadr: *const c_int,
    pub(super) ten_wrapnum: *const c_int,
    pub(super) wrap_obj: *const c_int,
    pub(super) solver_niter: *const c_int,
}

/// Arrays of a data in its arena, as in shim.h.
#[repr(C)]
pub(super) struct RowsView {
    pub(super) ne: i64,
    pub(super) nefc: i64,
    pub(super) njacobian: i64,
    pub(super) nisland: i64,
    pub(super) id: *const c_int,
    pub(super) rownnz: *const c_int,
    pub(super) rowadr: *const c_int,
    pub(super) colind: *const c_int,
    pub(super) jacobian: *const f64,
    pub(super) pos: *const f64,
    pub(super) vel: *const f64,
    pub(super) aref: *const f64,
    pub(super) softness: *const f64,
    pub(super) law: *const f64,
    pub(super) force: *mut f64,
    pub(super) kind: *const c_int,
    pub(super) stiffness: *const f64,
    pub(super) friction_loss: *const f64,
}

/// A field of MuJoCo's structs, as in shim.h.
#[repr(C)]
pub(super) struct Field {
    pub(super) whole: *const c_char,
    pub(super) name: *const c_char,
    pub(super) kind: *const c_char,
}

pub(super) type Control = extern "C" fn(*mut c_void, f64, *mut f64);

unsafe extern "C" {
    pub(super) fn oarlock_versions(versions: *mut c_int, room: c_int) -> c_int;
    pub(super) fn oarlock_describe(
        version: c_int,
        fields: *mut *const Field,
        offsets: *mut *const u32,
        contact_size: *mut c_int,
        eq_data_width: *mut c_int,
    ) -> c_int;
    pub(super) fn oarlock_open(
        path: *const c_char,
        version: *mut c_int,
        missing: *mut *const c_char,
    ) -> c_int;
    pub(super) fn oarlock_copy_model(
        model: *const c_void,
        copy: *mut *mut c_void,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_leave_unsolved(model: *mut c_void, timestep: f64);
    pub(super) fn oarlock_options(model: *const c_void, room: *mut c_void, size: usize) -> usize;
    pub(super) fn oarlock_make_dense(model: *mut c_void);
    pub(super) fn oarlock_delete_model(model: *mut c_void);
    pub(super) fn oarlock_make_data(
        model: *const c_void,
        data: *mut *mut c_void,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_delete_data(data: *mut c_void);
    pub(super) fn oarlock_view_model(model: *const c_void, view: *mut ModelView);
    pub(super) fn oarlock_name(model: *const c_void, kind: c_int, index: c_int) -> *const c_char;
    pub(super) fn oarlock_view_data(data: *mut c_void, view: *mut DataView);
    pub(super) fn oarlock_view_rows(data: *mut c_void, view: *mut RowsView);
    pub(super) fn oarlock_run(
        stage: c_int,
        model: *const c_void,
        data: *mut c_void,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_whiten(
        model: *const c_void,
        data: *mut c_void,
        count: c_int,
        x: *mut f64,
        y: *const f64,
        roots: *const f64,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_solve_mass(
        model: *const c_void,
        data: *mut c_void,
        x: *mut f64,
        y: *const f64,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_cone(
        data: *const c_void,
        contact: c_int,
        mu: *mut f64,
        friction: *mut f64,
    ) -> c_int;
    pub(super) fn oarlock_multiply_mass(
        model: *const c_void,
        data: *const c_void,
        y: *mut f64,
        x: *const f64,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_jacobian_transposed_times(
        model: *const c_void,
        data: *const c_void,
        x: *const f64,
        y: *mut f64,
        message: *mut c_char,
    ) -> c_int;
    pub(super) fn oarlock_integrate(model: *const c_void, qpos: *mut f64, qvel: *const f64, dt: f64);
    pub(super) fn oarlock_differentiate(
        model: *const c_void,
        qvel: *mut f64,
        qpos1: *const f64,
        qpos2: *const f64,
    );
    pub(super) safe fn oarlock_stop_timers();
    pub(super) safe fn oarlock_start_timers();
    pub(super) safe fn oarlock_hook();
    pub(super) safe fn oarlock_unhook();
    pub(super) fn oarlock_answer(model: *const c_void, control: Option<Control>, this: *mut c_void);
}
