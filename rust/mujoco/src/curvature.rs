//! J̇v: the part of the constraints' acceleration that needs no acceleration of the coordinates.
//!
//! The rows of a kind of equality are MuJoCo's own, and J̇v is the exact time derivative of their Jacobian, times v:
//!
//! - connect: p₁ − p₂ of the anchors.
//! - weld: the same of its anchors, then τ Im(q̄₂ q₁) with the orientations q₁ (with the relative pose) and q₂ as
//!   quaternions and τ the torque scale; its rate is ½τ Im(q̄₂ (ω₁ − ω₂) q₁), and with q̇ = ½ωq the rate of that is
//!   ½τ Im(q̄₂ (α₁ − α₂ + ω₁×ω₂ − ½|ω₁ − ω₂|²) q₁), where α = J̇v of a body's rotation.
//! - joint and tendon: y − p(x) with a quartic p, y and x measured from the model's own pose; J̇v = ÿ − p'(x) ẍ − p''(x) ẋ²,
//!   where ÿ and ẍ are 0 for joints and fixed tendons.
//!
//! The same as `oarlock.curvature`, operation for operation: that path is readable, and the oracle of this one.

use std::ffi::c_int;

use crate::error::Error;
use crate::kinematics::{Fixed, Kinematics, Point, index, spin};
use crate::library::{Data, EQ_CONNECT, EQ_DATA, EQ_JOINT, EQ_TENDON, EQ_WELD, Element, Model};
use crate::tendon::Tendon;
use crate::vectors::{Quaternion, at, conjugate, cross, dot, horner, minus, plus, product};

/// J̇v of the active rows: connect, weld, joint and tendon equalities.
pub struct Curvature {
    /// By equality.
    rows: Vec<Rows>,
    kinematics: Kinematics,
}

/// The rows of one equality.
enum Rows {
    Connect([Point; 2]),
    Weld(Box<Weld>),
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

struct Weld {
    ends: [Point; 2],
    turns: [Quaternion; 2],
    half_scale: f64,
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
        Ok(Self { rows, kinematics })
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
        self.kinematics.read(data);
        let (mut owners, mut rest) = (data.id(), out);
        while let Some(&owner) = owners.first() {
            let rows = &self.rows[index(owner)];
            let count = rows.count();
            let (own, others) = rest.split_at_mut(count);
            rows.write(data, &self.kinematics, own)?;
            (owners, rest) = (&owners[count..], others);
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
        let on_sites = model.eq_objtype()[equality] == Element::Site as c_int;
        match kind {
            EQ_CONNECT => Self::Connect(anchors(model, ids, on_sites, [at(data, 0), at(data, 1)])),
            EQ_WELD => {
                let quaternion = |values: &[f64]| [values[0], values[1], values[2], values[3]];
                let turns = if on_sites {
                    ids.map(|site| quaternion(&model.site_quat()[4 * index(site)..]))
                } else {
                    [quaternion(&data[6..]), [1.0, 0.0, 0.0, 0.0]]
                };
                // A connect keeps the first body's anchor first, a weld the second body's.
                let ends = anchors(model, ids, on_sites, [at(data, 1), at(data, 0)]);
                Self::Weld(Box::new(Weld { ends, turns, half_scale: 0.5 * data[10] }))
            }
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

    /// Number of rows; of an unknown kind at least one.
    fn count(&self) -> usize {
        match self {
            Self::Connect(_) => 3,
            Self::Weld(_) => 6,
            Self::Joints { .. } | Self::Tendons { .. } | Self::Unknown(_) => 1,
        }
    }

    /// Those whose motion they need.
    fn bodies(&self) -> Vec<c_int> {
        match self {
            Self::Connect(ends) => ends.map(|end| end.body).to_vec(),
            Self::Weld(weld) => weld.ends.map(|end| end.body).to_vec(),
            Self::Tendons { first, second, .. } => {
                first.bodies().chain(second.iter().flat_map(|second| second.tendon.bodies())).collect()
            }
            Self::Joints { .. } | Self::Unknown(_) => Vec::new(),
        }
    }

    fn write(&self, data: &Data, kinematics: &Kinematics, out: &mut [f64]) -> Result<(), Error> {
        match self {
            Self::Connect(ends) => out.copy_from_slice(&kinematics.points_apart(data, ends)),
            Self::Weld(weld) => weld.write(data, kinematics, out),
            Self::Joints { quartic, second } => {
                out[0] = second.as_ref().map_or(0.0, |joint| {
                    let x = data.qpos()[joint.qpos] - joint.zero;
                    0.0 - quartic.bend(x, data.qvel()[joint.dof], 0.0)
                });
            }
            Self::Tendons { quartic, first, second } => {
                out[0] = first.bend(data, kinematics)?;
                if let Some(Second { tendon, id, zero }) = second {
                    let x = data.ten_length()[*id] - zero;
                    out[0] -= quartic.bend(x, data.ten_velocity()[*id], tendon.bend(data, kinematics)?);
                }
            }
            Self::Unknown(text) => return Err(Error::Refused(text.clone())),
        }
        Ok(())
    }
}

/// The anchors of a connect or weld, given those on bodies, m.
fn anchors(model: &Model, ids: [c_int; 2], on_sites: bool, offsets: [[f64; 3]; 2]) -> [Point; 2] {
    [0, 1].map(|end| {
        if on_sites {
            let site = index(ids[end]);
            Point { body: model.site_bodyid()[site], fixed: Fixed::Site(site) }
        } else {
            Point { body: ids[end], fixed: Fixed::Offset(offsets[end]) }
        }
    })
}

impl Weld {
    fn write(&self, data: &Data, kinematics: &Kinematics, out: &mut [f64]) {
        let [spin1, spin2] = self.ends.map(|end| spin(data, end.body));
        let [bend1, bend2] = self.ends.map(|end| kinematics.spin_bend(end.body));
        let apart = minus(spin1, spin2);
        let [x, y, z] = plus(minus(bend1, bend2), cross(spin1, spin2));
        let [quat1, quat2] = [0, 1].map(|end| {
            let quats = &data.xquat()[4 * index(self.ends[end].body)..];
            product([quats[0], quats[1], quats[2], quats[3]], self.turns[end])
        });
        let turned = product(conjugate(quat2), product([-0.5 * dot(apart, apart), x, y, z], quat1));
        out[..3].copy_from_slice(&kinematics.points_apart(data, &self.ends));
        for (entry, turned) in out[3..].iter_mut().zip(&turned[1..]) {
            *entry = self.half_scale * turned;
        }
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
