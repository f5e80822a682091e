//! J̇v: the part of the constraints' acceleration that needs no acceleration of the coordinates.
//!
//! The exact time derivative of MuJoCo's own rows of J, times v:
//!
//! - connect and weld: MuJoCo has it, for it asks them for aref = −B Jv − K d r − J̇v (since 3.7). Taking it back costs the
//!   rounding of the other two terms.
//! - joint and tendon: y − p(x) with a quartic p, y and x measured from the model's own pose; J̇v = ÿ − p'(x) ẍ − p''(x) ẋ²,
//!   where ÿ and ẍ are 0 for joints and fixed tendons. MuJoCo leaves it out of their aref.
//!
//! The same as `oarlock.curvature`, operation for operation: that path is readable, and the oracle of this one.

use std::ffi::c_int;

use crate::error::Error;
use crate::kinematics::{Kinematics, index};
use crate::library::{Data, EQ_CONNECT, EQ_DATA, EQ_JOINT, EQ_TENDON, EQ_WELD, Element, Model};
use crate::tendon::Tendon;
use crate::vectors::horner;

/// J̇v of the active rows: connect, weld, joint and tendon equalities.
pub struct Curvature {
    /// By equality.
    rows: Vec<Rows>,
    /// Whether MuJoCo knows it of all.
    theirs: bool,
    kinematics: Kinematics,
}

/// The rows of one equality.
enum Rows {
    /// Of a connect or weld.
    Theirs,
    Joints {
        quartic: Quartic,
        second: Option<Coordinate>,
    },
    Tendons {
        quartic: Quartic,
        first: Tendon,
        second: Option<Second>,
    },
    /// What is said of one of another kind.
    Unknown(String),
}

/// The derivatives of a coupling's p.
struct Quartic {
    first: [f64; 4],
    second: [f64; 3],
}

/// Where a joint's x and ẋ are, and its x at the model's own pose.
struct Coordinate {
    qpos: usize,
    dof: usize,
    zero: f64,
}

/// The second tendon of a coupling.
struct Second {
    tendon: Tendon,
    id: usize,
    zero: f64,
}

impl Curvature {
    /// For states of one model.
    ///
    /// # Errors
    /// [`Error::Refused`]: an equality of another kind is switched on from the beginning.
    pub fn new(model: &Model) -> Result<Self, Error> {
        let rows: Vec<_> = (0..model.eq_type().len()).map(|equality| Rows::new(model, equality)).collect();
        for (rows, &active) in rows.iter().zip(model.eq_active0()) {
            if let (Rows::Unknown(text), true) = (rows, active) {
                return Err(Error::Refused(text.clone()));
            }
        }
        let kinematics = Kinematics::new(model, rows.iter().flat_map(Rows::bodies));
        let theirs = rows.iter().all(|rows| matches!(rows, Rows::Theirs));
        Ok(Self { rows, theirs, kinematics })
    }

    /// Writes J̇v (ne; m/s² or rad/s²) of a state whose position and velocity stages are done.
    ///
    /// Goes by the rows that MuJoCo made: it leaves out an equality whose rows are zero throughout.
    ///
    /// # Errors
    /// [`Error::Refused`]: an equality of another kind was switched on, or a tendon's length has no second derivative.
    ///
    /// # Panics
    /// If `out` is not of this length.
    pub fn write(&mut self, data: &Data, out: &mut [f64]) -> Result<(), Error> {
        assert_eq!(out.len(), data.ne());
        let known = data.law().iter().zip(data.vel()).zip(data.pos()).zip(data.aref());
        for (entry, (((&[stiffness, damping, impedance, _], rate), deviation), aref)) in
            out.iter_mut().zip(known)
        {
            *entry = -damping * rate - stiffness * impedance * deviation - aref;
        }
        if self.theirs {
            return Ok(());
        }
        self.kinematics.read(data);
        for (entry, &owner) in out.iter_mut().zip(data.id()) {
            self.rows[index(owner)].write(data, &self.kinematics, entry)?;
        }
        Ok(())
    }
}

impl Rows {
    fn new(model: &Model, equality: usize) -> Self {
        let kind = model.eq_type()[equality];
        let data = &model.eq_data()[EQ_DATA * equality..EQ_DATA * (equality + 1)];
        let ids = [model.eq_obj1id()[equality], model.eq_obj2id()[equality]];
        let second = usize::try_from(ids[1]).ok();
        match kind {
            EQ_CONNECT | EQ_WELD => Self::Theirs,
            EQ_JOINT => Self::Joints {
                quartic: Quartic::new(data),
                second: second.map(|joint| Coordinate::new(model, joint)),
            },
            EQ_TENDON => Self::Tendons {
                quartic: Quartic::new(data),
                first: Tendon::new(model, index(ids[0])),
                second: second.map(|id| Second {
                    tendon: Tendon::new(model, id),
                    id,
                    zero: model.tendon_length0()[id],
                }),
            },
            _ => Self::Unknown(format!(
                "equality '{}' is a flex, expected connect, weld, joint or tendon: J̇v of other kinds is not known",
                model.name(Element::Equality, equality)
            )),
        }
    }

    /// Those whose motion they need.
    fn bodies(&self) -> Vec<c_int> {
        match self {
            Self::Tendons { first, second, .. } => {
                first.bodies().chain(second.iter().flat_map(|second| second.tendon.bodies())).collect()
            }
            Self::Theirs | Self::Joints { .. } | Self::Unknown(_) => Vec::new(),
        }
    }

    /// Writes J̇v of one row, where MuJoCo does not know it.
    fn write(&self, data: &Data, kinematics: &Kinematics, out: &mut f64) -> Result<(), Error> {
        match self {
            Self::Theirs => {}
            Self::Joints { quartic, second } => {
                *out = second.as_ref().map_or(0.0, |joint| {
                    let x = data.qpos()[joint.qpos] - joint.zero;
                    0.0 - quartic.bend(x, data.qvel()[joint.dof], 0.0)
                });
            }
            Self::Tendons { quartic, first, second } => {
                *out = first.bend(data, kinematics)?;
                if let Some(Second { tendon, id, zero }) = second {
                    let x = data.ten_length()[*id] - zero;
                    *out -= quartic.bend(x, data.ten_velocity()[*id], tendon.bend(data, kinematics)?);
                }
            }
            Self::Unknown(text) => return Err(Error::Refused(text.clone())),
        }
        Ok(())
    }
}

impl Quartic {
    /// From an equality's p₀ … p₄.
    fn new(data: &[f64]) -> Self {
        let first = [data[1], 2.0 * data[2], 3.0 * data[3], 4.0 * data[4]];
        Self { first, second: [first[1], 2.0 * first[2], 3.0 * first[3]] }
    }

    /// p'(x) ẍ + p''(x) ẋ².
    fn bend(&self, x: f64, rate: f64, bend: f64) -> f64 {
        horner(&self.first, x) * bend + horner(&self.second, x) * rate * rate
    }
}

impl Coordinate {
    fn new(model: &Model, joint: usize) -> Self {
        let qpos = index(model.jnt_qposadr()[joint]);
        Self { qpos, dof: index(model.jnt_dofadr()[joint]), zero: model.qpos0()[qpos] }
    }
}
