//! Newton's method with the exact Hessian for min ½‖z‖² + s(c + G z), and a line search that ends.
//!
//! All pieces of s but slip are homogeneous of degree two, so that a step from z leads to the point where z⁺ = Gᵀf⁺ with
//! f⁺ = φ − Cᵀ C (c + G z⁺), where Cᵀ C = ∂²s at z and φ are the forces of rows that slip, whatever z was. With B = C G and u = −C c that is
//!
//! ```text
//!     f⁺ = φ + Cᵀ (E + B Bᵀ)⁻¹ (u − B Gᵀ φ)                 as many unknowns as curved rows
//!     (E + BᵀB) z⁺ = Gᵀ φ + Bᵀ u                             as many unknowns as coordinates
//! ```
//!
//! of which the smaller is taken. So nothing cancels that was far off at the start, and where no row changes its piece, one step ends.

use super::costs::{Curvature, Piece, along, curvatures, evaluate};
use super::factor::Factor;
use super::frame::Frame;
use super::rows::InequalityStep;
use super::search::{is_flat, search};
use crate::info::Status;
use crate::linalg::kernels::{axpy, dot_in_lanes, norm};

/// Newton steps at most of the last part of the way.
pub const ITERATIONS: usize = 100;

/// Newton steps before softer rows are tried. A change of all pieces of 300 contact rows takes ten to twenty.
const DIRECT: usize = 25;

/// Stiffness that softer rows begin with, beside their inertia: there are no narrow valleys yet.
const SOFTEST: f64 = 1e2;

/// By how much they get harder: one or two steps lead from one to the next.
const HARDER: f64 = 30.0;

/// A gradient is rounding where each of its entries is below this many rounding errors of what it is the sum of.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The same where no step makes it smaller, of the whole gradient.
const LEAST: f64 = 64.0 * f64::EPSILON;

/// Gradient beside the forces that it is the difference of which still counts as converged where rounding lets the iteration come no
/// nearer.
pub const CONVERGED: f64 = 1e-9;

/// A step that moves the point by less than this part of it is no progress.
const STILL: f64 = 4.0 * f64::EPSILON;

/// A point, its forces, and how the iteration that led there went.
#[derive(Clone, Default)]
pub(super) struct Newton {
    pub(super) z: Vec<f64>,
    pub(super) x: Vec<f64>,
    pub(super) f: Vec<f64>,
    pub(super) pieces: Vec<Piece>,
    gradient: Vec<f64>,
    /// What its entries are sums of, in magnitude.
    terms: Vec<f64>,
    curvatures: Vec<Curvature>,
    /// B and u.
    b: Vec<f64>,
    u: Vec<f64>,
    factor: Factor,
    /// Whether the factor is that of the rows, and the pieces that it stands on.
    dual: bool,
    before: Vec<Piece>,
    /// z⁺; the step and x along it.
    target: Vec<f64>,
    step: Vec<f64>,
    along: Vec<f64>,
    /// Stiffness of softer rows.
    eased: Vec<f64>,
    /// x and z where the step began are here and in `target`.
    origin: Vec<f64>,
}

/// How an iteration went.
#[derive(Debug, Clone, Copy)]
pub(super) struct Course {
    pub(super) status: Status,
    pub(super) iterations: usize,
    pub(super) evaluations: usize,
    /// ‖z − Gᵀf‖ relative to ‖z‖ + Σ‖g‖|f|.
    pub(super) gradient: f64,
}

impl Newton {
    /// Fits the workspace to the frame.
    fn resize(&mut self, frame: &Frame) {
        let (m, size) = (frame.offsets.len(), frame.size);
        for vector in [&mut self.x, &mut self.origin, &mut self.f, &mut self.along] {
            vector.resize(m, 0.0);
        }
        for vector in [&mut self.z, &mut self.gradient, &mut self.terms, &mut self.target, &mut self.step] {
            vector.resize(size, 0.0);
        }
        self.pieces.resize(m, Piece::Free);
    }

    /// Goes to the minimum from z = 0, or from `warm` if that is lower; tells whether it was.
    pub(super) fn run(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        warm: Option<&[f64]>,
    ) -> (Course, bool) {
        self.resize(frame);
        self.before.clear();
        let warmed = self.start(frame, step, warm);
        let mut course = Course { status: Status::Converged, iterations: 0, evaluations: 0, gradient: 0.0 };
        if !self.descend(frame, step, &mut course, DIRECT) {
            self.ease(frame, step, &mut course);
            self.descend(frame, step, &mut course, ITERATIONS);
        }
        course.gradient = self.relative_gradient(frame);
        if course.gradient <= CONVERGED {
            course.status = Status::Converged;
        }
        self.polish(frame, step);
        (course, warmed)
    }

    /// Goes down until the gradient is rounding; gives whether it is.
    fn descend(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        course: &mut Course,
        limit: usize,
    ) -> bool {
        course.status = Status::Converged;
        self.look(frame, step);
        for _ in 0..limit {
            if self.is_rounding() {
                return true;
            }
            course.iterations += 1;
            if !self.advance(frame, step, &mut course.evaluations) {
                let least = self.is_least();
                course.status = if least { Status::Converged } else { Status::Breakdown };
                return least;
            }
        }
        if !self.is_rounding() {
            course.status = Status::IterationLimit;
        }
        self.is_rounding()
    }

    /// Goes to the minimum by way of softer rows, from z = 0: the valley of a stiff cone is narrow and bent, but each of these ends
    /// near the next.
    fn ease(&mut self, frame: &Frame, step: &InequalityStep<'_>, course: &mut Course) {
        let mut eased = std::mem::take(&mut self.eased);
        let inertia = |row: usize| step.stiffness[row] * frame.reaches[row] * frame.reaches[row];
        let stiffest = (0..frame.offsets.len()).map(inertia).fold(0.0, f64::max);
        self.z.fill(0.0);
        let mut most = SOFTEST;
        while most < stiffest {
            eased.clear();
            for group in step.groups {
                let rows = eased.len()..eased.len() + group.rows();
                let own = rows.clone().map(inertia).fold(0.0, f64::max);
                let share = if own > most { most / own } else { 1.0 };
                eased.extend(step.stiffness[rows].iter().map(|stiffness| stiffness * share));
            }
            self.descend(frame, &InequalityStep { stiffness: &eased, ..*step }, course, DIRECT);
            most *= HARDER;
        }
        self.eased = eased;
        self.before.clear();
    }

    /// Whether the gradient is as small as rounding lets it be where no step makes it smaller.
    fn is_least(&self) -> bool {
        norm(&self.gradient) <= LEAST * norm(&self.terms)
    }

    /// ‖z − Gᵀf‖ relative to ‖z‖ + Σ‖g‖|f|.
    fn relative_gradient(&self, frame: &Frame) -> f64 {
        let pulls = frame.reaches.iter().zip(&self.f).map(|(reach, force)| reach * force.abs());
        let (gradient, scale) = (norm(&self.gradient), norm(&self.z) + pulls.sum::<f64>());
        if scale > 0.0 { gradient / scale } else { 0.0 }
    }

    /// Puts z where the objective is lower.
    fn start(&mut self, frame: &Frame, step: &InequalityStep<'_>, warm: Option<&[f64]>) -> bool {
        self.z.fill(0.0);
        self.x.copy_from_slice(&frame.offsets);
        let at_rest = evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        let Some(warm) = warm else { return false };
        frame.deviations(warm, &mut self.along);
        self.x.copy_from_slice(&self.along);
        let cost = evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        let lower = cost + 0.5 * dot_in_lanes(warm, warm) < at_rest;
        if lower {
            self.z.copy_from_slice(warm);
        }
        lower
    }

    /// z − Gᵀf, and what it is the sum of.
    fn differentiate(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        let length = norm(&self.z);
        self.gradient.copy_from_slice(&self.z);
        self.terms.iter_mut().zip(&self.z).for_each(|(terms, z)| *terms = z.abs());
        if frame.size == 0 {
            return;
        }
        for (index, row) in frame.rows.chunks_exact(frame.size).enumerate() {
            let (force, reach) = (self.f[index], frame.reaches[index]);
            let curved = if self.pieces[index].is_curved() { step.stiffness[index] } else { 0.0 };
            // An error of x, ε times its terms, becomes one of f by the stiffness.
            let size = force.abs() + curved * (frame.offsets[index].abs() + reach * length);
            if size > 0.0 {
                axpy(-force, row, &mut self.gradient);
                for (terms, entry) in self.terms.iter_mut().zip(row) {
                    *terms += size * entry.abs();
                }
            }
        }
    }

    fn is_rounding(&self) -> bool {
        self.gradient.iter().zip(&self.terms).all(|(entry, terms)| entry.abs() <= ROUNDING * terms)
    }

    /// A Newton step; gives whether it led anywhere.
    fn advance(&mut self, frame: &Frame, step: &InequalityStep<'_>, evaluations: &mut usize) -> bool {
        self.aim(frame, step);
        for ((step, target), z) in self.step.iter_mut().zip(&self.target).zip(&self.z) {
            *step = target - z;
        }
        let first = dot_in_lanes(&self.gradient, &self.step);
        let least = dot_in_lanes(&self.step, &self.step);
        if !(first < 0.0 && least > 0.0) {
            return false;
        }
        std::mem::swap(&mut self.z, &mut self.target);
        std::mem::swap(&mut self.x, &mut self.origin);
        // The whole step, which is the last one where no row changes its piece.
        self.look(frame, step);
        *evaluations += 1;
        if self.is_rounding() {
            return true;
        }
        let slope = dot_in_lanes(&self.gradient, &self.step);
        if is_flat(slope, first) {
            return least.sqrt() > STILL * norm(&self.z);
        }
        for (along, row) in self.along.iter_mut().zip(frame.rows.chunks_exact(frame.size)) {
            *along = dot_in_lanes(row, &self.step);
        }
        let (across, origin, q) = (&mut self.x, &self.origin, &self.along);
        let from = dot_in_lanes(&self.target, &self.step);
        let bend = least + along(step, across, q).1;
        let (alpha, count) = search(first, (slope, bend), least, |alpha| {
            for ((x, origin), q) in across.iter_mut().zip(origin).zip(q) {
                *x = origin + alpha * q;
            }
            let (slope, bend) = along(step, across, q);
            (from + alpha * least + slope, least + bend)
        });
        *evaluations += count;
        for ((z, start), step) in self.z.iter_mut().zip(&self.target).zip(&self.step) {
            *z = start + alpha * step;
        }
        self.look(frame, step);
        self.is_rounding() || alpha * least.sqrt() > STILL * norm(&self.z)
    }

    /// Forces, pieces and gradient at z.
    fn look(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        frame.deviations(&self.z, &mut self.x);
        evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        self.differentiate(frame, step);
    }

    /// Takes the rest of the gradient out of f and z together. Forces of x have its rounding times the stiffness; a step that changes
    /// them by what its own equations say does not.
    fn polish(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        if self.gradient.iter().all(|&entry| entry == 0.0) {
            return;
        }
        let size = frame.size;
        // The factor of the last step will do where it stands on the same pieces: what is left is small.
        if self.pieces != self.before {
            self.linearise(frame, step);
            self.factorise(size);
        }
        self.target.copy_from_slice(&self.gradient);
        if self.dual {
            self.u.clear();
            self.u.extend(self.b.chunks_exact(size).map(|row| dot_in_lanes(row, &self.target)));
            self.factor.solve(&mut self.u);
        } else {
            self.factor.solve(&mut self.target);
            self.u.clear();
            self.u.extend(self.b.chunks_exact(size).map(|row| dot_in_lanes(row, &self.target)));
        }
        for (curvature, &entry) in self.curvatures.iter().zip(&self.u) {
            let rows = curvature.first..curvature.first + curvature.dim;
            for (index, part) in rows.zip(&curvature.entries[..curvature.dim]) {
                let force = &mut self.f[index];
                *force += part * entry;
                if self.pieces[index] == Piece::On {
                    *force = force.max(0.0);
                }
            }
        }
    }

    /// B and u at x, and whether their rows are fewer than the coordinates.
    fn linearise(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        let size = frame.size;
        curvatures(step, &self.x, &self.pieces, &mut self.curvatures);
        self.curvatures.retain(|curvature| {
            (curvature.first..curvature.first + curvature.dim).any(|row| !frame.immobile[row])
        });
        let count = self.curvatures.len();
        self.b.clear();
        self.b.resize(count * size, 0.0);
        self.u.clear();
        for (curvature, row) in self.curvatures.iter().zip(self.b.chunks_exact_mut(size)) {
            let mut offset = 0.0;
            for (index, &entry) in (curvature.first..).zip(&curvature.entries[..curvature.dim]) {
                if entry != 0.0 {
                    axpy(entry, frame.row(index), row);
                    offset -= entry * frame.offsets[index];
                }
            }
            self.u.push(offset);
        }
        self.dual = count <= size;
        self.before.clear();
        self.before.extend_from_slice(&self.pieces);
    }

    /// The smaller of the two factors.
    fn factorise(&mut self, size: usize) {
        if self.dual {
            self.factor.of_rows(self.curvatures.len(), &self.b);
        } else {
            self.factor.of_columns(size, &self.b);
        }
    }

    /// Where a whole step leads.
    fn aim(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        let size = frame.size;
        self.linearise(frame, step);
        self.factorise(size);
        self.target.fill(0.0);
        for (index, (&force, piece)) in self.f.iter().zip(&self.pieces).enumerate() {
            if matches!(piece, Piece::SlipForward | Piece::SlipBackward) {
                axpy(force, frame.row(index), &mut self.target);
            }
        }
        if self.dual {
            for (entry, row) in self.u.iter_mut().zip(self.b.chunks_exact(size)) {
                *entry -= dot_in_lanes(row, &self.target);
            }
            self.factor.solve(&mut self.u);
        }
        for (&entry, row) in self.u.iter().zip(self.b.chunks_exact(size)) {
            axpy(entry, row, &mut self.target);
        }
        if !self.dual {
            self.factor.solve(&mut self.target);
        }
    }
}
