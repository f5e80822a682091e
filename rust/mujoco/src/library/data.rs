//! A state of a model.

use std::ffi::{c_int, c_void};
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::Arc;

use super::ffi::{
    DataView, RowsView, oarlock_cone, oarlock_delete_data, oarlock_jacobian_transposed_times,
    oarlock_make_data, oarlock_multiply_mass, oarlock_run, oarlock_solve_mass, oarlock_view_data,
    oarlock_view_rows, oarlock_whiten,
};
use super::model::Model;
use super::placement::Placement;
use super::{array, arrays, size, trapped};
use crate::error::Error;

/// Calls that take nothing but the model and its data; numbers as in shim.h.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(i32)]
pub(super) enum Stage {
    Forward,
    Position,
    Smooth,
    Rates,
    Constraint,
    Integrate,
    Energy,
    Step,
    Sensors,
}

/// A state of a model, with everything that MuJoCo computes from it.
pub struct Data {
    pub(super) model: Arc<Model>,
    raw: NonNull<c_void>,
    pub(super) view: DataView,
    pub(super) rows: RowsView,
    /// Whether the position stage is that of the present positions.
    pub(super) placed: bool,
    /// Whether it is somebody else's.
    borrowed: bool,
    /// Room for a gradient, nv.
    pub(super) left: Vec<f64>,
}

// SAFETY: it is nobody else's, and MuJoCo keeps nothing about it in the thread.
unsafe impl Send for Data {}
// SAFETY: whatever takes it shared only reads, in MuJoCo too: such functions take mjData const, and do not use its stack.
unsafe impl Sync for Data {}

impl Drop for Data {
    fn drop(&mut self) {
        if !self.borrowed {
            // SAFETY: it was made by mj_makeData and is nobody else's.
            unsafe { oarlock_delete_data(self.raw.as_ptr()) }
        }
    }
}

arrays! { Data,
    /// Positions, nq.
    qpos: f64 = |d| d.model.nq();
    /// Velocities, nv.
    qvel: f64 = |d| d.model.nv();
    /// Controls, nu.
    ctrl: f64 = |d| d.model.nu();
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
        Ok(Self::of(model, raw, false))
    }

    /// The data at an address, which stays whose it is.
    ///
    /// # Safety
    /// It is that of an mjData of a model like this one, which outlives what is returned, and nobody else uses it meanwhile.
    ///
    /// # Panics
    /// If the address is null.
    #[must_use]
    pub unsafe fn borrowed(model: &Arc<Model>, address: usize) -> Self {
        Self::of(model, NonNull::new(address as *mut c_void).expect("the address of an mjData"), true)
    }

    fn of(model: &Arc<Model>, raw: NonNull<c_void>, borrowed: bool) -> Self {
        let mut view = std::mem::MaybeUninit::uninit();
        // SAFETY: the shim fills the whole struct from a data.
        let view = unsafe {
            oarlock_view_data(raw.as_ptr(), view.as_mut_ptr());
            view.assume_init()
        };
        Self {
            model: Arc::clone(model),
            raw,
            view,
            rows: rows_of(raw),
            placed: false,
            borrowed,
            left: Vec::new(),
        }
    }

    /// Takes none of its stages for valid, as its state may have been written to; its position stage where it still is what
    /// was taken down of it.
    pub fn moved(&mut self, known: &Placement) {
        self.placed = known.stands(self);
    }

    /// Its model.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Makes a call, after which the rows may lie elsewhere, also when it failed.
    pub(super) fn run(&mut self, stage: Stage) -> Result<(), Error> {
        let (model, data) = (self.model.raw.as_ptr(), self.raw.as_ptr());
        // SAFETY: both are valid and belong together; `&mut self` is exclusive.
        let done = trapped(|message| unsafe { oarlock_run(stage as c_int, model, data, message) });
        self.rows = rows_of(self.raw);
        self.placed = match stage {
            Stage::Forward | Stage::Position | Stage::Smooth => done.is_ok(),
            Stage::Rates | Stage::Constraint | Stage::Energy | Stage::Sensors => self.placed && done.is_ok(),
            Stage::Integrate | Stage::Step => false,
        };
        done
    }

    /// The position stage, unless it was done for these very positions.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn position_stage(&mut self) -> Result<(), Error> {
        if self.placed { Ok(()) } else { self.run(Stage::Position) }
    }

    /// Position, velocity, actuation and acceleration stages: all but the constraint solver. Controls must be written.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn smooth_stages(&mut self) -> Result<(), Error> {
        self.run(if self.placed { Stage::Rates } else { Stage::Smooth })
    }

    /// The second half of `mj_step` by the model's own integrator.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn integrate(&mut self) -> Result<(), Error> {
        self.run(Stage::Integrate)
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

    /// Sensors, at a state whose stages are done and whose forces are written.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn sensors(&mut self) -> Result<(), Error> {
        self.run(Stage::Sensors)
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

    /// `y` = M `x`, both nv; the position stage must be valid.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    ///
    /// # Panics
    /// If the slices are not of this length.
    pub fn multiply_mass(&self, y: &mut [f64], x: &[f64]) -> Result<(), Error> {
        assert_eq!((x.len(), y.len()), (self.model.nv(), self.model.nv()));
        // SAFETY: the lengths are right.
        trapped(|message| unsafe {
            oarlock_multiply_mass(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                y.as_mut_ptr(),
                x.as_ptr(),
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
            oarlock_jacobian_transposed_times(
                self.model.raw.as_ptr(),
                self.raw.as_ptr(),
                x.as_ptr(),
                product.as_mut_ptr(),
                message,
            )
        })
    }

    /// Positions, nq, to be written: no stage is valid after that.
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        self.placed = false;
        let count = self.model.nq();
        if count == 0 {
            return &mut [];
        }
        // SAFETY: as for the other arrays.
        unsafe { slice::from_raw_parts_mut(self.view.qpos, count) }
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

/// The rows of limits, friction loss and contacts: those after the equality rows, `nefc − ne` of them.
#[derive(Debug, Clone, Copy)]
pub struct InequalityRows<'a> {
    /// Kind of each, mjtConstraint.
    pub kind: &'a [c_int],
    /// What each is of: a velocity, tendon, joint or contact by its number.
    pub id: &'a [c_int],
    /// Accelerations that MuJoCo asks of them.
    pub aref: &'a [f64],
    /// Distances: negative of what is violated or penetrates, m or rad.
    pub pos: &'a [f64],
    /// D = 1/R.
    pub stiffness: &'a [f64],
    /// Largest forces of rows of friction loss.
    pub friction_loss: &'a [f64],
}

/// An elliptic contact: number of its rows, μ of its regularised cone, and its friction coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Number of rows.
    pub dim: usize,
    /// μ.
    pub mu: f64,
    /// Tangential, torsional and rolling.
    pub friction: [f64; 5],
}

impl Data {
    /// Rows of limits, friction loss and contacts, as they stand after the velocity stage.
    #[must_use]
    pub fn inequalities(&self) -> InequalityRows<'_> {
        let (ne, all) = (self.ne(), self.nefc());
        let rows = &self.rows;
        // SAFETY: as for the other rows, all nefc of them.
        unsafe {
            InequalityRows {
                kind: &array(rows.kind, all)[ne..],
                id: &array(rows.id, all)[ne..],
                aref: &array(rows.aref, all)[ne..],
                pos: &array(rows.pos, all)[ne..],
                stiffness: &array(rows.stiffness, all)[ne..],
                friction_loss: &array(rows.friction_loss, all)[ne..],
            }
        }
    }

    /// An elliptic contact, by the number that its rows have as `id`.
    #[must_use]
    pub fn cone(&self, contact: c_int) -> Cone {
        let (mut mu, mut friction) = (0.0, [0.0; 5]);
        // SAFETY: `id` of a contact's row is the number of a contact; room for five coefficients.
        let dim = unsafe { oarlock_cone(self.raw.as_ptr(), contact, &raw mut mu, friction.as_mut_ptr()) };
        Cone { dim: usize::try_from(dim).unwrap_or(0), mu, friction }
    }

    /// Stiffness K, damping B, impedance d, and its derivative, of each row, ne.
    #[must_use]
    pub fn law(&self) -> &[[f64; 4]] {
        // SAFETY: as for the other rows, four numbers each.
        unsafe { array(self.rows.law.cast(), self.ne()) }
    }

    /// Accelerations that MuJoCo asks of all rows, and their D = 1/R, nefc.
    #[must_use]
    pub fn laws(&self) -> (&[f64], &[f64]) {
        // SAFETY: as for the other rows.
        unsafe { (array(self.rows.aref, self.nefc()), array(self.rows.stiffness, self.nefc())) }
    }

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
    /// Whether each equality is active, neq.
    #[must_use]
    pub fn eq_active(&self) -> &[bool] {
        // SAFETY: MuJoCo's array has neq entries of mjtBool, a byte that it keeps at 0 or 1.
        unsafe { array(self.view.eq_active, size(self.model.view.neq)) }
    }

    /// The same, to be written: no stage is valid after that.
    pub fn eq_active_mut(&mut self) -> &mut [bool] {
        self.placed = false;
        let count = size(self.model.view.neq);
        if count == 0 {
            return &mut [];
        }
        // SAFETY: MuJoCo's array has neq entries of mjtBool, a byte that it keeps at 0 or 1; `&mut self` is exclusive.
        unsafe { slice::from_raw_parts_mut(self.view.eq_active, count) }
    }

    /// Writes the forces of all rows: multipliers (ne) of the equalities, then those of the others (nefc − ne).
    ///
    /// # Panics
    /// If they are not as many.
    pub fn write_force(&mut self, multipliers: &[f64], others: &[f64]) {
        let (own, rest) = self.force_mut().split_at_mut(multipliers.len());
        own.copy_from_slice(multipliers);
        rest.copy_from_slice(others);
    }

    /// Multipliers of the equality rows, ne.
    #[must_use]
    pub fn multipliers(&self) -> &[f64] {
        // SAFETY: as for the other rows.
        unsafe { array(self.rows.force, self.ne()) }
    }

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
