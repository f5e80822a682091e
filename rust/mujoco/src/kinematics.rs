//! Motion of points of bodies at a state whose position and velocity stages are done: place, velocity, J̇v.
//!
//! Accelerations are those that need no acceleration of the coordinates, J̇v with the Jacobian J of the point or of the
//! body's rotation: `mj_jacDot` gives J̇ exactly. It is asked for all points of a state in one call: [`Points`] gathers
//! them, [`Bends`] reads the answers in the same order.

use std::ffi::c_int;

use crate::error::Error;
use crate::library::Data;
use crate::vectors::{Vector, at, cross, minus, plus, sum};

/// An id of MuJoCo's as an index; ids of elements that exist are not negative.
pub(crate) fn index(id: c_int) -> usize {
    usize::try_from(id).expect("ids of elements are not negative")
}

/// A point fixed on a body.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// The body.
    pub body: c_int,
    /// Where on it.
    pub fixed: Fixed,
}

/// What a point is fixed by.
#[derive(Debug, Clone, Copy)]
pub enum Fixed {
    /// A site.
    Site(usize),
    /// An offset in the body's own frame, m.
    Offset(Vector),
}

impl Point {
    /// In world coordinates, m.
    #[must_use]
    pub fn place(&self, data: &Data) -> Vector {
        match self.fixed {
            Fixed::Site(site) => at(data.site_xpos(), site),
            Fixed::Offset(offset) => {
                let body = index(self.body);
                let row = |i| at(data.xmat(), 3 * body + i);
                let turned = [0, 1, 2].map(|i| sum(row(i).iter().zip(&offset).map(|(a, b)| a * b)));
                plus(at(data.xpos(), body), turned)
            }
        }
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
    // cvel is the velocity at the centre of mass of the kinematic tree.
    let root = index(data.model().body_rootid()[index(body)]);
    let arm = minus(place, at(data.subtree_com(), root));
    plus(at(data.cvel(), 2 * index(body) + 1), cross(spin(data, body), arm))
}

/// Points of bodies, and J̇ of each.
#[derive(Debug, Default)]
pub struct Points {
    bodies: Vec<c_int>,
    places: Vec<f64>,
    linear: Vec<f64>,
    angular: Vec<f64>,
}

impl Points {
    /// With room for `count` points of a model of `nv` velocities, so that gathering them allocates nothing.
    #[must_use]
    pub fn with_capacity(count: usize, nv: usize) -> Self {
        Self {
            bodies: Vec::with_capacity(count),
            places: Vec::with_capacity(3 * count),
            linear: vec![0.0; 3 * count * nv],
            angular: vec![0.0; 3 * count * nv],
        }
    }

    /// Forgets the points.
    pub fn clear(&mut self) {
        self.bodies.clear();
        self.places.clear();
    }

    /// Adds the body's point at a place.
    pub fn push(&mut self, body: c_int, place: Vector) {
        self.bodies.push(body);
        self.places.extend_from_slice(&place);
    }

    /// Adds a point.
    pub fn push_point(&mut self, point: &Point, data: &Data) {
        self.push(point.body, point.place(data));
    }

    /// Computes J̇ of every point and of its body's rotation.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn differentiate(&mut self, data: &mut Data) -> Result<(), Error> {
        let entries = self.places.len() * data.model().nv();
        if self.linear.len() < entries {
            self.linear.resize(entries, 0.0);
            self.angular.resize(entries, 0.0);
        }
        let (linear, angular) = (&mut self.linear[..entries], &mut self.angular[..entries]);
        data.jacobians_dot(&self.bodies, &self.places, linear, angular)
    }

    /// J̇v of every point, in the order in which they were added.
    #[must_use]
    pub fn bends<'a>(&'a self, qvel: &'a [f64]) -> Bends<'a> {
        let rows = |entries: &'a [f64]| entries.chunks_exact(3 * qvel.len());
        Bends { qvel, linear: rows(&self.linear), angular: rows(&self.angular) }
    }
}

/// J̇v of points, one after another.
#[derive(Debug)]
pub struct Bends<'a> {
    qvel: &'a [f64],
    linear: std::slice::ChunksExact<'a, f64>,
    angular: std::slice::ChunksExact<'a, f64>,
}

impl<'a> Bends<'a> {
    /// J̇ of the next point and of its body's rotation, 3×nv each.
    fn next(&mut self) -> (&'a [f64], &'a [f64]) {
        self.linear.next().zip(self.angular.next()).expect("no more points are read than were added")
    }

    /// Of the next point, m/s².
    pub fn point(&mut self) -> Vector {
        let (linear, _) = self.next();
        let row = |i| &linear[i * self.qvel.len()..];
        [0, 1, 2].map(|i| sum(row(i).iter().zip(self.qvel).map(|(rate, v)| rate * v)))
    }

    /// Of p₁ − p₂, the next two points, m/s².
    pub fn points_apart(&mut self) -> Vector {
        let ((linear1, _), (linear2, _)) = (self.next(), self.next());
        self.apart(linear1, linear2)
    }

    /// Of p₁ − p₂, the next two points, m/s², and of ω₁ − ω₂, rad/s².
    pub fn bodies_apart(&mut self) -> (Vector, Vector) {
        let ((linear1, angular1), (linear2, angular2)) = (self.next(), self.next());
        (self.apart(linear1, linear2), self.apart(angular1, angular2))
    }

    /// (J̇₁ − J̇₂) v: the difference first, so that a point and one that moves with it leave exactly nothing.
    fn apart(&self, first: &[f64], second: &[f64]) -> Vector {
        let nv = self.qvel.len();
        let rows = |i: usize| first[i * nv..].iter().zip(&second[i * nv..]).zip(self.qvel);
        [0, 1, 2].map(|i| sum(rows(i).map(|((a, b), v)| (a - b) * v)))
    }
}
