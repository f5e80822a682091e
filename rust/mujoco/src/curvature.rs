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
use crate::library::{Data, EQ_CONNECT, EQ_JOINT, EQ_TENDON, EQ_WELD, Element, Model};
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
        let width = model.eq_data_width();
        let data = &model.eq_data()[width * equality..width * (equality + 1)];
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::library::Jacobian;
    use crate::library::testing::{data, model, moved, somewhere};
    use crate::vectors::{largest, times};

    /// Step of a central difference, s: its error is 1e-10, and rounding over it 1e-11.
    const STEP: f64 = 1e-5;

    /// Both, times rates and stiffnesses of MuJoCo's aref (K up to 1e4), from which J̇v is taken back.
    const DIFFERENCE: f64 = 1e-7;

    fn with(equalities: &str) -> String {
        format!(
            r#"<mujoco>
              <option><flag contact="disable"/></option>
              <worldbody>
                <site name="hook" pos="0 0 1"/>
                <body name="p" pos=".5 0 .2">
                  <joint name="turn" type="hinge" axis="0 1 0"/><joint name="slide" type="slide" axis="1 0 0"/>
                  <geom size=".05"/><site name="ps" pos=".1 0 .1"/>
                  <body name="c" pos=".2 0 .1">
                    <joint type="ball"/><geom type="capsule" size=".03 .1"/><site name="cs" pos=".1 .05 .2"/>
                  </body>
                </body>
                <body name="f" pos="-.5 .1 .3"><freejoint/><geom type="box" size=".1 .05 .02"/><site name="fs" pos=".05 .1 0"/></body>
              </worldbody>
              <tendon>
                <spatial name="path"><site site="hook"/><site site="ps"/><site site="fs"/></spatial>
                <spatial name="block"><site site="hook"/><site site="cs"/><pulley divisor="2"/><site site="cs"/><site site="fs"/></spatial>
                <fixed name="sum"><joint joint="turn" coef="2"/><joint joint="slide" coef="-1"/></fixed>
              </tendon>
              <equality>{equalities}</equality>
            </mujoco>"#
        )
    }

    /// J̇v as it is written, and as the difference of J along the motion at q̈ = 0.
    fn both(equalities: &str) -> (Vec<f64>, Vec<f64>) {
        let model = model(&with(equalities));
        let (qpos, qvel) = somewhere(&model);
        let rates = |time: f64| {
            let state = data(&model, &moved(&model, &qpos, &qvel, time), &qvel);
            let (mut jacobian, mut rates) = (Jacobian::default(), vec![0.0; state.ne()]);
            jacobian.read(&state);
            times(jacobian.entries(), &qvel, &mut rates);
            rates
        };
        let difference = rates(STEP)
            .iter()
            .zip(rates(-STEP))
            .map(|(after, before)| (after - before) / (2.0 * STEP))
            .collect();
        let state = data(&model, &qpos, &qvel);
        let mut written = vec![0.0; state.ne()];
        Curvature::new(&model).expect("known kinds").write(&state, &mut written).expect("smooth here");
        (written, difference)
    }

    #[test]
    fn it_is_the_rate_of_the_rows_for_every_kind_of_equality() {
        for (equalities, rows) in [
            (r#"<connect body1="c" body2="f" anchor=".1 0 0"/>"#, 3),
            (r#"<weld body1="c" body2="f"/>"#, 6),
            (r#"<joint joint1="turn" polycoef=".1 0 0 0 0"/>"#, 1),
            (r#"<joint joint1="turn" joint2="slide" polycoef="0 .5 .3 .2 .1"/>"#, 1),
            (r#"<tendon tendon1="path"/>"#, 1),
            (r#"<tendon tendon1="sum"/>"#, 1),
            (r#"<tendon tendon1="path" tendon2="block" polycoef="0 1 .2 .1 -.3"/>"#, 1),
            (r#"<tendon tendon1="sum" tendon2="path" polycoef="0 .7 .2 .1 .3"/>"#, 1),
            (
                r#"<joint joint1="slide"/><connect body1="p" body2="f" anchor="0 .1 0"/><tendon tendon1="block"/>"#,
                5,
            ),
        ] {
            let (written, difference) = both(equalities);
            assert_eq!((written.len(), difference.len()), (rows, rows), "{equalities}");
            let gaps: Vec<f64> = written.iter().zip(&difference).map(|(a, b)| a - b).collect();
            assert!(largest(&gaps) < DIFFERENCE, "{equalities}: {written:?}, not {difference:?}");
        }
    }

    #[test]
    fn rows_that_are_constant_have_none() {
        let (written, _) = both(r#"<joint joint1="turn"/><tendon tendon1="sum"/>"#);
        assert_eq!(written, [0.0, 0.0]);
    }
}
