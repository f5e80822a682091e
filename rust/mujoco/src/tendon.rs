//! J̇v of tendons: the part of a tendon's L̈ that needs no acceleration of the coordinates.
//!
//! A tendon's Jacobian is the gradient of its length, so J̇v is L̈ at q̈ = 0, and a spatial tendon's L̈ follows from the
//! motion of the sites it runs through. A piece that wraps a geom is the shortest path on a sphere or a cylinder, and its
//! length is known in closed form: with ρ₀, ρ₁ the distances of its ends from the centre (the axis) and γ the angle between
//! them,
//!
//! ```text
//!     ℓ = f(ρ₀) + f(ρ₁) + r γ,   f(ρ) = √(ρ² − r²) − r arccos(r/ρ),   and on a cylinder L = √(ℓ² + Δz²).
//! ```
//!
//! The same as `oarlock.tendons`, operation for operation.

use std::f64::consts::PI;
use std::ffi::c_int;

use crate::error::Error;
use crate::kinematics::{Kinematics, index, spin, velocity};
use crate::library::{Data, Element, Model, WRAP_CYLINDER, WRAP_JOINT, WRAP_PULLEY, WRAP_SITE};
use crate::vectors::{Vector, at, cross, dot, minus, plus, scaled};

/// Least length of anything that is divided by: MuJoCo's mjMINVAL.
const LEAST: f64 = 1e-15;

/// What MuJoCo's path says of a point on a site; geoms have their id, pulleys −2.
const ON_SITE: c_int = -1;

/// Place, velocity and acceleration at q̈ = 0 of an end, in a frame said where it is used.
type Motion = (Vector, Vector, Vector);

/// A length and its first and second derivative.
type Length = (f64, f64, f64);

/// One tendon of a model. Its pieces are read from the model once; whether they wrap is read at every state.
pub struct Tendon {
    index: usize,
    name: String,
    pieces: Vec<Piece>,
}

/// From one site to the next, over a geom or not.
struct Piece {
    /// Number of sites that the path runs through before it, its own first one counted.
    order: usize,
    sites: [usize; 2],
    bodies: [c_int; 2],
    divisor: f64,
    geom: Option<Geom>,
}

/// What a piece may wrap.
#[derive(Clone)]
struct Geom {
    index: usize,
    body: c_int,
    name: String,
    radius: f64,
    is_cylinder: bool,
    side: Option<usize>,
}

/// How a piece runs at a state.
enum Run<'a> {
    /// Between two points of one body: its length stays.
    Rigid,
    Straight,
    /// Over a geom, on which it arrives at a point.
    Wrapped(&'a Geom, Vector),
}

impl Tendon {
    /// A tendon by its id.
    #[must_use]
    pub fn new(model: &Model, index: usize) -> Self {
        Self { index, name: model.name(Element::Tendon, index), pieces: pieces(model, index) }
    }

    /// Those whose motion it needs.
    pub fn bodies(&self) -> impl Iterator<Item = c_int> {
        self.pieces
            .iter()
            .flat_map(|piece| piece.bodies.into_iter().chain(piece.geom.as_ref().map(|geom| geom.body)))
    }

    /// J̇v of the tendon, m/s²; 0 for a fixed tendon, whose Jacobian is constant.
    ///
    /// # Errors
    /// [`Error::Refused`]: the length has no second derivative here, or wraps inside a geom.
    pub fn bend(&self, data: &Data, kinematics: &Kinematics) -> Result<f64, Error> {
        let mut total = 0.0;
        for piece in &self.pieces {
            total += match self.run(data, piece) {
                Run::Rigid => continue,
                Run::Straight => self.straight(data, kinematics, piece)?,
                Run::Wrapped(geom, touch) => self.wrapped(data, kinematics, piece, geom, touch)?,
            } / piece.divisor;
        }
        Ok(total)
    }

    fn run<'a>(&self, data: &Data, piece: &'a Piece) -> Run<'a> {
        let touch = piece.geom.as_ref().and_then(|geom| Some((geom, self.touch(data, piece.order)?)));
        match touch {
            Some((geom, touch)) => Run::Wrapped(geom, touch),
            None if piece.bodies[0] == piece.bodies[1] => Run::Rigid,
            None => Run::Straight,
        }
    }

    /// The point where the piece after so many sites arrives on its geom, if it wraps it here.
    fn touch(&self, data: &Data, order: usize) -> Option<Vector> {
        let (first, count) = (index(data.ten_wrapadr()[self.index]), index(data.ten_wrapnum()[self.index]));
        let mut sites = 0;
        for point in first..first + count {
            match data.wrap_obj()[point] {
                ON_SITE => sites += 1,
                geom if geom >= 0 && sites == order => return Some(at(data.wrap_xpos(), point)),
                _ => {}
            }
        }
        None
    }

    fn straight(&self, data: &Data, kinematics: &Kinematics, piece: &Piece) -> Result<f64, Error> {
        let [end0, end1] = [0, 1].map(|end| motion(data, kinematics, piece, end));
        let apart = (minus(end1.0, end0.0), minus(end1.1, end0.1), minus(end1.2, end0.2));
        if dot(apart.0, apart.0).sqrt() < LEAST {
            return Err(Error::Refused(format!(
                "tendon '{}' has a piece of length 0, expected a length with a derivative",
                self.name
            )));
        }
        Ok(norm(apart).2)
    }

    fn wrapped(
        &self,
        data: &Data,
        kinematics: &Kinematics,
        piece: &Piece,
        geom: &Geom,
        touch: Vector,
    ) -> Result<f64, Error> {
        let (body, radius, centre) = (geom.body, geom.radius, at(data.geom_xpos(), geom.index));
        let matrix = &data.geom_xmat()[9 * geom.index..];
        let axis = geom.is_cylinder.then(|| [matrix[2], matrix[5], matrix[8]]);
        if let Some(side) = geom.side {
            let side = across(minus(at(data.site_xpos(), side), centre), axis);
            if dot(side, side).sqrt() < radius {
                return Err(Error::Refused(format!(
                    "tendon '{}' wraps inside geom '{}', expected its side site outside: J̇v of a tendon inside a geom \
                     is not known",
                    self.name, geom.name
                )));
            }
        }
        let spin = spin(data, body);
        // In the geom's frame, written in world axes.
        let ends = [0, 1].map(|end| {
            let (place, own_velocity, own_bend) = motion(data, kinematics, piece, end);
            let relative = minus(own_velocity, velocity(data, body, place));
            let bend = minus(own_bend, kinematics.bend(data, body, place));
            (minus(place, centre), relative, minus(bend, scaled(2.0, cross(spin, relative))))
        });
        let arrival = minus(touch, centre);
        let Some(axis) = axis else {
            return Ok(self.around(ends, radius, arrival, None)?.2);
        };
        let flat =
            ends.map(|(x, v, a)| (across(x, Some(axis)), across(v, Some(axis)), across(a, Some(axis))));
        let (length, rate, bend) = self.around(flat, radius, arrival, Some(axis))?;
        let [end0, end1] = ends;
        let rise = dot(minus(end1.0, end0.0), axis);
        let climb = dot(minus(end1.1, end0.1), axis);
        let heave = dot(minus(end1.2, end0.2), axis);
        let total = (length * length + rise * rise).sqrt();
        let total_rate = (length * rate + rise * climb) / total;
        Ok((rate * rate + length * bend + climb * climb + rise * heave - total_rate * total_rate) / total)
    }

    /// A path around a circle (axis given: all vectors but `touch` across it) or a sphere.
    fn around(
        &self,
        ends: [Motion; 2],
        radius: f64,
        touch: Vector,
        axis: Option<Vector>,
    ) -> Result<Length, Error> {
        let [(x0, v0, a0), (x1, v1, a1)] = ends;
        let normal = cross(x0, x1);
        let normal_rate = plus(cross(v0, x1), cross(x0, v1));
        let normal_bend = plus(plus(cross(a0, x1), scaled(2.0, cross(v0, v1))), cross(x0, a1));
        let (sine, sine_rate, sine_bend) = if let Some(axis) = axis {
            (dot(normal, axis), dot(normal_rate, axis), dot(normal_bend, axis))
        } else {
            if dot(normal, normal).sqrt() < LEAST {
                return Err(Error::Refused(format!(
                    "tendon '{}' runs straight over the centre of its sphere, where its path is undetermined",
                    self.name
                )));
            }
            norm((normal, normal_rate, normal_bend))
        };
        let pole = axis.unwrap_or(normal);
        let (cosine, cosine_rate) = (dot(x0, x1), dot(v0, x1) + dot(x0, v1));
        let cosine_bend = dot(a0, x1) + 2.0 * dot(v0, v1) + dot(x0, a1);
        let square = sine * sine + cosine * cosine;
        let turn = (sine_rate * cosine - sine * cosine_rate) / square;
        let square_rate = 2.0 * (sine * sine_rate + cosine * cosine_rate);
        let turn_bend = (sine_bend * cosine - sine * cosine_bend - turn * square_rate) / square;
        // The path starts towards where it arrives on the geom: that is the way round it goes.
        let way = if dot(cross(x0, touch), pole) >= 0.0 { 1.0 } else { -1.0 };
        let mut angle = way * sine.atan2(cosine);
        if angle < 0.0 {
            angle += 2.0 * PI;
        }

        let (mut length, mut rate, mut bend) =
            (radius * angle, radius * way * turn, radius * way * turn_bend);
        for end in ends {
            let (rho, rho_rate, rho_bend) = norm(end);
            let free = at_least(LEAST, rho * rho - radius * radius).sqrt();
            length += free - radius * at_most(1.0, radius / rho).acos();
            rate += free / rho * rho_rate;
            bend += free / rho * rho_bend + radius * radius / (rho * rho * free) * rho_rate * rho_rate;
        }
        Ok((length, rate, bend))
    }
}

/// Of one end of a piece.
fn motion(data: &Data, kinematics: &Kinematics, piece: &Piece, end: usize) -> Motion {
    let (place, body) = (at(data.site_xpos(), piece.sites[end]), piece.bodies[end]);
    (place, velocity(data, body, place), kinematics.bend(data, body, place))
}

/// |x|; x is not 0.
fn norm((x, v, a): Motion) -> Length {
    let length = dot(x, x).sqrt();
    let rate = dot(x, v) / length;
    (length, rate, (dot(v, v) + dot(x, a) - rate * rate) / length)
}

/// The part of a vector at right angles to an axis; all of it where there is none.
fn across(vector: Vector, axis: Option<Vector>) -> Vector {
    axis.map_or(vector, |axis| minus(vector, scaled(dot(vector, axis), axis)))
}

/// Unlike `f64::max`, leaves a NaN.
fn at_least(least: f64, value: f64) -> f64 {
    if least > value { least } else { value }
}

/// Unlike `f64::min`, leaves a NaN.
fn at_most(most: f64, value: f64) -> f64 {
    if most < value { most } else { value }
}

fn pieces(model: &Model, tendon: usize) -> Vec<Piece> {
    let first = index(model.tendon_adr()[tendon]);
    let count = index(model.tendon_num()[tendon]);
    let mut pieces = Vec::new();
    let (mut divisor, mut sites) = (1.0, 0);
    let (mut last, mut geom) = (None, None);
    for place in first..first + count {
        let (kind, item) = (model.wrap_type()[place], model.wrap_objid()[place]);
        match kind {
            WRAP_JOINT => return Vec::new(),
            WRAP_PULLEY => {
                divisor = model.wrap_prm()[place];
                last = None;
            }
            WRAP_SITE => {
                let site = index(item);
                let over = geom.take();
                if let Some(before) = last {
                    let ends = [before, site];
                    let bodies = ends.map(|site| model.site_bodyid()[site]);
                    pieces.push(Piece { order: sites, sites: ends, bodies, divisor, geom: over });
                }
                sites += 1;
                last = Some(site);
            }
            _ => geom = Some(wrapped_geom(model, place)),
        }
    }
    pieces
}

fn wrapped_geom(model: &Model, place: usize) -> Geom {
    let geom = index(model.wrap_objid()[place]);
    let side = model.wrap_prm()[place];
    Geom {
        index: geom,
        body: model.geom_bodyid()[geom],
        name: model.name(Element::Geom, geom),
        radius: model.geom_size()[3 * geom],
        is_cylinder: model.wrap_type()[place] == WRAP_CYLINDER,
        side: (0..model.site_bodyid().len()).find(|&site| (site as f64 - side).abs() < 0.5),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::library::testing::{data, model, moved, somewhere};

    /// Step of a second difference over five points, s: its error is of fourth order, 1e-12, and rounding over its square 1e-9.
    const STEP: f64 = 1e-3;

    /// Both, times derivatives that grow as a rope comes near the centre of a sphere.
    const DIFFERENCE: f64 = 1e-7;

    /// Two free bodies at given places, a third one between them that the tendon may wrap, and the tendon.
    fn with(places: [&str; 2], geom: &str, side: &str, path: &str) -> Arc<Model> {
        let [left, right] = places;
        model(&format!(
            r#"<mujoco>
              <option><flag contact="disable"/></option>
              <worldbody>
                <body pos="{left}"><freejoint/><geom size=".1"/><site name="left"/></body>
                <body pos="{right}"><freejoint/><geom size=".1"/><site name="right"/></body>
                <body><freejoint/><geom name="drum" {geom}/><site name="side" pos="{side}"/><site name="rim" pos="0 0 .1"/></body>
              </worldbody>
              <tendon><spatial name="rope">{path}</spatial></tendon>
            </mujoco>"#
        ))
    }

    const SPHERE: &str = r#"type="sphere" size=".3""#;
    const CYLINDER: &str = r#"type="cylinder" size=".3 .5" euler="10 20 0""#;
    const STRAIGHT: &str = r#"<site site="left"/><site site="right"/>"#;
    const OVER: &str = r#"<site site="left"/><geom geom="drum"/><site site="right"/>"#;
    const BESIDE: &str = r#"<site site="left"/><geom geom="drum" sidesite="side"/><site site="right"/>"#;
    const APART: [&str; 2] = ["-1 .2 0", "1 .15 .1"];

    fn bend(data: &Data) -> Result<f64, Error> {
        let tendon = Tendon::new(data.model(), 0);
        let mut kinematics = Kinematics::new(data.model(), tendon.bodies());
        kinematics.read(data);
        tendon.bend(data, &kinematics)
    }

    #[test]
    fn bend_is_the_second_derivative_of_the_length_without_accelerations() {
        let hoist = r#"<site site="left"/><site site="rim"/><pulley divisor="2"/><site site="rim"/><site site="right"/>"#;
        for (name, geom, side, path, wraps) in [
            ("straight", SPHERE, "0 .5 0", STRAIGHT, false),
            ("pulley", SPHERE, "0 .5 0", hoist, false),
            ("sphere", SPHERE, "0 .5 0", OVER, true),
            ("sphere with a side", SPHERE, "0 0 .5", BESIDE, true),
            ("cylinder", CYLINDER, "0 .5 0", OVER, true),
            ("cylinder with a side", CYLINDER, "0 .5 0", BESIDE, true),
        ] {
            let model = with(APART, geom, side, path);
            let (_, qvel) = somewhere(&model);
            let qpos = moved(&model, model.qpos0(), &qvel, 0.05);
            let length = |time: f64| data(&model, &moved(&model, &qpos, &qvel, time), &qvel).ten_length()[0];
            let [first, before, now, after, last] =
                [-2.0, -1.0, 0.0, 1.0, 2.0].map(|steps| length(steps * STEP));
            let difference = (16.0 * (before + after) - 30.0 * now - first - last) / (12.0 * STEP * STEP);
            let state = data(&model, &qpos, &qvel);
            let ends = minus(at(state.site_xpos(), 0), at(state.site_xpos(), 1));
            let direct = dot(ends, ends).sqrt();
            assert!(
                !wraps || now > 1.001 * direct,
                "{name} does not wrap: {now} m, {direct} m from end to end"
            );
            let bend = bend(&state).expect(name);
            assert!((bend - difference).abs() < DIFFERENCE, "{name}: {bend} m/s², not {difference}");
        }
    }

    #[test]
    fn what_has_no_second_derivative_is_refused_by_name() {
        let refused = |model: &Arc<Model>| {
            let (_, qvel) = somewhere(model);
            let error =
                bend(&data(model, model.qpos0(), &qvel)).expect_err("no second derivative").to_string();
            assert!(error.contains("tendon 'rope'"), "{error}");
            error
        };
        let together = refused(&with(["0 0 1", "0 0 1"], SPHERE, "0 .5 0", STRAIGHT));
        assert!(together.contains("length 0"), "{together}");
        let inside = refused(&with(["-1 .5 0", "1 .5 0"], CYLINDER, "0 .1 0", BESIDE));
        assert!(inside.contains("wraps inside geom 'drum'"), "{inside}");
    }

    #[test]
    fn a_path_between_points_of_one_body_does_not_bend() {
        let model = with(APART, SPHERE, "0 .5 0", r#"<site site="side"/><site site="rim"/>"#);
        let (qpos, qvel) = somewhere(&model);
        assert_eq!(bend(&data(&model, &qpos, &qvel)), Ok(0.0));
    }
}
