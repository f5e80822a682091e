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
