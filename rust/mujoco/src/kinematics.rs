//! Motion of points of bodies at a state whose position and velocity stages are done: place, velocity, J̇v.
//!
//! J̇v of a body's rotation and of its points is what they accelerate by at q̈ = 0, their bias acceleration. One pass over
//! the bodies gives it as a spatial vector a = (α, a₀), taken at the centre of mass c of the kinematic tree (Featherstone
//! 2008, *Rigid Body Dynamics Algorithms*, §5.3; the first half of MuJoCo's `mj_rne`, without gravity):
//!
//! ```text
//!     a = a_parent + Σ ṡ q̇   over the body's own joint axes s, MuJoCo's cdof, with the rates ṡ, cdof_dot.
//! ```
//!
//! A spatial acceleration is that of the matter passing c. What accelerates with the body is the point at p = c + r, as in
//! `mj_objectAcceleration`:
//!
//! ```text
//!     p̈ = a₀ + α×r + ω×ṗ,   ṗ = v₀ + ω×r.
//! ```
//!
//! The same as `oarlock.kinematics`, operation for operation.

use std::collections::BTreeSet;
use std::ffi::c_int;
use std::ops::Range;

use crate::library::{Data, Model};
use crate::vectors::{Vector, at, cross, minus, plus};

/// The body that never moves.
const WORLD: usize = 0;

/// An id of MuJoCo's as an index; ids of elements that exist are not negative.
pub(crate) fn index(id: c_int) -> usize {
    usize::try_from(id).expect("ids of elements are not negative")
}

/// Motion of some bodies, and of their points that are, at this moment, at given places.
#[derive(Debug)]
pub struct Kinematics {
    /// Those bodies and all that they hang on, parents first.
    chain: Vec<Link>,
    /// J̇v of every body of `chain` as a spatial vector, by body.
    biases: Vec<[f64; 6]>,
}

#[derive(Debug)]
struct Link {
    body: usize,
    parent: usize,
    /// Its own joints' entries.
    dofs: Range<usize>,
}

impl Kinematics {
    /// Of `bodies`.
    #[must_use]
    pub fn new(model: &Model, bodies: impl Iterator<Item = c_int>) -> Self {
        let parent = |body: usize| index(model.body_parentid()[body]);
        let mut moving = BTreeSet::new();
        for body in bodies {
            let mut body = index(body);
            while body != WORLD && moving.insert(body) {
                body = parent(body);
            }
        }
        let link = |body: usize| {
            let count = index(model.body_dofnum()[body]);
            let first = if count == 0 { 0 } else { index(model.body_dofadr()[body]) };
            Link { body, parent: parent(body), dofs: first..first + count }
        };
        // Parents have the smaller ids.
        let chain = moving.into_iter().map(link).collect();
        Self { chain, biases: vec![[0.0; 6]; model.body_parentid().len()] }
    }

    /// Takes over the bodies' motion; what is said of them is of this state.
    pub fn read(&mut self, data: &Data) {
        let (axes, _) = data.cdof_dot().as_chunks::<6>();
        for Link { body, parent, dofs } in &self.chain {
            let mut bias = self.biases[*parent];
            for (axis, rate) in axes[dofs.clone()].iter().zip(&data.qvel()[dofs.clone()]) {
                for (entry, axis) in bias.iter_mut().zip(axis) {
                    *entry += axis * rate;
                }
            }
            self.biases[*body] = bias;
        }
    }

    /// J̇v of the body's point at a place, m/s².
    #[must_use]
    pub fn bend(&self, data: &Data, body: c_int, place: Vector) -> Vector {
        let bias = &self.biases[index(body)];
        let spatial = plus(at(bias, 1), cross(at(bias, 0), arm(data, body, place)));
        plus(spatial, cross(spin(data, body), velocity(data, body, place)))
    }
}

/// Angular velocity of a body, world axes, rad/s.
#[must_use]
pub fn spin(data: &Data, body: c_int) -> Vector {
    at(data.cvel(), 2 * index(body))
}

/// Velocity of the body's point at a place, m/s.
#[must_use]
pub fn velocity(data: &Data, body: c_int, place: Vector) -> Vector {
    plus(at(data.cvel(), 2 * index(body) + 1), cross(spin(data, body), arm(data, body, place)))
}

/// A place as seen from where the spatial vectors of a body are taken: its tree's centre of mass.
fn arm(data: &Data, body: c_int, place: Vector) -> Vector {
    let root = index(data.model().body_rootid()[index(body)]);
    minus(place, at(data.subtree_com(), root))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::library::testing::{data, model, moved, somewhere};
    use crate::vectors::{dot, scaled};

    /// Step of a second difference, s: its error is of second order, 1e-8, and rounding over its square as much.
    const STEP: f64 = 1e-4;

    /// Both, times derivatives of order ten.
    const DIFFERENCE: f64 = 1e-6;

    const TREE: &str = r#"<mujoco>
      <option><flag contact="disable"/></option>
      <worldbody>
        <body pos=".1 .2 .3">
          <freejoint/><geom type="box" size=".1 .2 .3"/><site pos=".3 .1 -.2"/>
          <body pos=".4 0 .1">
            <joint type="ball" pos=".05 0 0"/><geom type="capsule" size=".05 .2" pos=".1 .1 0"/>
            <body pos="0 .3 0">
              <joint type="hinge" axis="1 2 3" pos="0 .1 0"/><joint type="slide" axis="0 1 1"/>
              <geom size=".1" pos="0 .2 .1"/><site pos=".2 .3 .4"/>
              <body pos=".1 0 0"><geom size=".1"/><site pos="0 -.1 .2"/></body>
            </body>
          </body>
        </body>
        <body pos="2 0 0"><joint type="hinge" axis="0 1 0"/><geom size=".1" pos=".5 0 0"/><site pos=".4 .1 0"/></body>
        <site pos="1 1 1"/>
      </worldbody>
    </mujoco>"#;

    #[test]
    fn velocity_and_bend_are_the_derivatives_of_a_place_without_accelerations() {
        let model = model(TREE);
        let (qpos, qvel) = somewhere(&model);
        let place = |time: f64, site: usize| {
            at(data(&model, &moved(&model, &qpos, &qvel, time), &qvel).site_xpos(), site)
        };
        let state = data(&model, &qpos, &qvel);
        let bodies = model.site_bodyid();
        let mut kinematics = Kinematics::new(&model, bodies.iter().copied());
        kinematics.read(&state);
        for (site, &body) in bodies.iter().enumerate() {
            let [before, now, after] = [-STEP, 0.0, STEP].map(|time| place(time, site));
            let rate = scaled(0.5 / STEP, minus(after, before));
            let bend = scaled(1.0 / (STEP * STEP), minus(plus(after, before), scaled(2.0, now)));
            let gap = |a: Vector, b: Vector| dot(minus(a, b), minus(a, b)).sqrt();
            let rate_gap = gap(velocity(&state, body, now), rate);
            assert!(rate_gap < DIFFERENCE, "velocity of site {site} is off by {rate_gap:e} of {rate:?}");
            let bend_gap = gap(kinematics.bend(&state, body, now), bend);
            assert!(bend_gap < DIFFERENCE, "bend of site {site} is off by {bend_gap:e} of {bend:?}");
        }
    }

    #[test]
    fn only_what_bodies_hang_on_is_looked_at() {
        let model = model(TREE);
        let chain = |body: c_int| {
            Kinematics::new(&model, [body].into_iter()).chain.iter().map(|link| link.body).collect()
        };
        let (deep, other, world): (Vec<_>, Vec<_>, Vec<_>) = (chain(4), chain(5), chain(0));
        assert_eq!((deep, other, world), (vec![1, 2, 3, 4], vec![5], vec![]));
    }
}
