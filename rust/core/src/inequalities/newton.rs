//! Newton's method with the exact Hessian for min ½‖z‖² + s(c + G z), and a line search that ends.
//!
//! All pieces of s but slip are homogeneous of degree two, so that a step from z leads to the point where z⁺ = Gᵀf⁺ with
//! f⁺ = f_slip − CᵀC(c + G z⁺), CᵀC = ∂²s at z, whatever z was. With B = C G and u = −C c that is
//!
//! ```text
//!     f⁺ = f_slip + Cᵀ (E + B Bᵀ)⁻¹ (u − B Gᵀ f_slip)       as many unknowns as curved rows
//!     (E + BᵀB) z⁺ = Gᵀ f_slip + Bᵀ u                        as many unknowns as coordinates
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

/// Newton steps at most. A change of all pieces of 300 contact rows takes ten to twenty.
pub const ITERATIONS: usize = 200;

/// A gradient is rounding where each of its entries is below this many rounding errors of what it is the sum of.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

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
    /// f_slip, then f⁺; z⁺; the step and x along it.
    pushed: Vec<f64>,
    target: Vec<f64>,
    step: Vec<f64>,
    along: Vec<f64>,
    before: Vec<Piece>,
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
        for vector in [&mut self.x, &mut self.origin, &mut self.f, &mut self.pushed, &mut self.along] {
            vector.resize(m, 0.0);
        }
        for vector in [&mut self.z, &mut self.gradient, &mut self.terms, &mut self.target, &mut self.step] {
            vector.resize(size, 0.0);
        }
        self.pieces.resize(m, Piece::Free);
        self.before.resize(m, Piece::Free);
    }

    /// Goes to the minimum from z = 0, or from `warm` if that is lower; tells whether it was.
    pub(super) fn run(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        warm: Option<&[f64]>,
    ) -> (Course, bool) {
        self.resize(frame);
        let warmed = self.start(frame, step, warm);
        let mut course = Course { status: Status::Converged, iterations: 0, evaluations: 0, gradient: 0.0 };
        self.differentiate(frame, step);
        while !self.is_rounding() {
            if course.iterations == ITERATIONS {
                course.status = Status::IterationLimit;
                break;
            }
            course.iterations += 1;
            if !self.advance(frame, step, &mut course.evaluations) {
                course.status = Status::Breakdown;
                break;
            }
        }
        let scale = norm(&self.z) + frame.reaches.iter().zip(&self.f).map(|(g, f)| g * f.abs()).sum::<f64>();
        let gradient = norm(&self.gradient);
        course.gradient = if scale > 0.0 { gradient / scale } else { 0.0 };
        if course.gradient <= CONVERGED {
            course.status = Status::Converged;
        }
        (course, warmed)
    }

    /// Puts z where the objective is lower.
    fn start(&mut self, frame: &Frame, step: &InequalityStep<'_>, warm: Option<&[f64]>) -> bool {
        self.z.fill(0.0);
        self.x.copy_from_slice(&frame.offsets);
        let at_rest = evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        let Some(warm) = warm else { return false };
        frame.deviations(warm, &mut self.along);
        let cost = evaluate(step, &self.along, &mut self.pushed, &mut self.before);
        let lower = cost + 0.5 * dot_in_lanes(warm, warm) < at_rest;
        if lower {
            self.z.copy_from_slice(warm);
            self.x.copy_from_slice(&self.along);
            self.f.copy_from_slice(&self.pushed);
            self.pieces.copy_from_slice(&self.before);
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
        let is_dual = self.aim(frame, step);
        for ((step, target), z) in self.step.iter_mut().zip(&self.target).zip(&self.z) {
            *step = target - z;
        }
        let first = dot_in_lanes(&self.gradient, &self.step);
        let least = dot_in_lanes(&self.step, &self.step);
        if !(first < 0.0 && least > 0.0) {
            return false;
        }
        std::mem::swap(&mut self.pieces, &mut self.before);
        std::mem::swap(&mut self.z, &mut self.target);
        std::mem::swap(&mut self.x, &mut self.origin);
        // The whole step, which is the last one where no row changes its piece.
        self.look(frame, step);
        *evaluations += 1;
        let slope = dot_in_lanes(&self.gradient, &self.step);
        if self.is_rounding() {
            if is_dual && self.pieces == self.before && self.pieces.iter().all(|piece| piece.is_quadratic()) {
                self.take_dual(frame);
            }
            return true;
        }
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

    /// Forces as the step found them: those of x have its rounding, times the stiffness.
    fn take_dual(&mut self, frame: &Frame) {
        for (index, (force, &pushed)) in self.f.iter_mut().zip(&self.pushed).enumerate() {
            if !frame.immobile[index] {
                *force = if self.pieces[index] == Piece::On { pushed.max(0.0) } else { pushed };
            }
        }
    }

    /// Where a whole step leads; gives whether its forces are known too.
    fn aim(&mut self, frame: &Frame, step: &InequalityStep<'_>) -> bool {
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
        self.target.fill(0.0);
        for (index, (pushed, (&force, &piece))) in
            self.pushed.iter_mut().zip(self.f.iter().zip(&self.pieces)).enumerate()
        {
            let slips = matches!(piece, Piece::SlipForward | Piece::SlipBackward);
            *pushed = if slips { force } else { 0.0 };
            if slips {
                axpy(force, frame.row(index), &mut self.target);
            }
        }
        if count > size {
            for (&entry, row) in self.u.iter().zip(self.b.chunks_exact(size)) {
                axpy(entry, row, &mut self.target);
            }
            self.factor.of_columns(size, &self.b);
            self.factor.solve(&mut self.target);
            return false;
        }
        for (entry, row) in self.u.iter_mut().zip(self.b.chunks_exact(size)) {
            *entry -= dot_in_lanes(row, &self.target);
        }
        self.factor.of_rows(count, &self.b);
        self.factor.solve(&mut self.u);
        for ((curvature, row), &entry) in self.curvatures.iter().zip(self.b.chunks_exact(size)).zip(&self.u) {
            axpy(entry, row, &mut self.target);
            for (force, part) in
                self.pushed[curvature.first..].iter_mut().zip(&curvature.entries[..curvature.dim])
            {
                *force += part * entry;
            }
        }
        true
    }
}
