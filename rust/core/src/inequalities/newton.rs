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

use super::costs::{Curvature, Piece, along, curvatures, evaluate, total};
use super::factor::Factor;
use super::frame::Frame;
use super::rows::InequalityStep;
use super::search::{is_flat, search};
use crate::info::Status;
use crate::linalg::kernels::{dot_in_lanes, norm, widest};
use crate::linalg::packs::{self, LANES, Pack, packs_of};

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

/// How much more it weighs what rows see of an acceleration than how small its coordinates are; squares of both are summed.
const SEEN: f64 = 1e4;

/// A step that moves the point by less than this part of it is no progress.
const STILL: f64 = 4.0 * f64::EPSILON;

/// A point, its forces, and how the iteration that led there went.
#[derive(Clone, Default)]
pub(super) struct Newton {
    pub(super) z: Vec<f64>,
    /// Of the rows, up to whole packs.
    pub(super) x: Vec<f64>,
    pub(super) f: Vec<f64>,
    pub(super) pieces: Vec<Piece>,
    gradient: Vec<f64>,
    /// What its entries are sums of, in magnitude.
    terms: Vec<f64>,
    curvatures: Vec<Curvature>,
    /// B, as many packs as coordinates each eight rows, and u.
    b: Vec<Pack>,
    u: Vec<f64>,
    factor: Factor,
    /// Whether the factor is that of the rows, and the pieces that it stands on.
    dual: bool,
    before: Vec<Piece>,
    /// z⁺; the step and x along it.
    target: Vec<f64>,
    step: Vec<f64>,
    along: Vec<f64>,
    /// What a force may be off by, over ε.
    sizes: Vec<f64>,
    sums: Vec<Pack>,
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
    fn resize(&mut self, frame: &Frame, rows: usize) {
        let (room, size) = (frame.room(), frame.size);
        for vector in [&mut self.x, &mut self.origin, &mut self.f, &mut self.along, &mut self.sizes] {
            vector.resize(room, 0.0);
            // Rows that are not there push nothing.
            vector[rows..].fill(0.0);
        }
        for vector in [&mut self.z, &mut self.gradient, &mut self.terms, &mut self.target, &mut self.step] {
            vector.resize(size, 0.0);
        }
        self.pieces.resize(rows, Piece::Free);
    }

    /// Goes to the minimum from z = 0, or by way of an acceleration `near` it (nv) if that leads lower; tells whether it did.
    pub(super) fn run(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        near: Option<&[f64]>,
    ) -> (Course, bool) {
        self.resize(frame, step.aref.len());
        self.before.clear();
        let mut course = Course { status: Status::Converged, iterations: 0, evaluations: 0, gradient: 0.0 };
        let warm = near.is_some_and(|near| frame.size > 0 && self.leap(frame, step, near, &mut course));
        if !warm {
            self.z.fill(0.0);
            self.look(frame, step);
        }
        if !self.descend(frame, step, &mut course, DIRECT) {
            self.ease(frame, step, &mut course);
            self.look(frame, step);
            self.descend(frame, step, &mut course, ITERATIONS);
        }
        course.gradient = self.relative_gradient(frame);
        if course.gradient <= CONVERGED {
            course.status = Status::Converged;
        }
        self.polish(frame, step);
        (course, warm)
    }

    /// A whole step from the pieces of an acceleration: where it leads does not depend on where in them it begins, which need not obey
    /// the equality rows. Where it does not end the way, it is one to search along, and begins at what rows see of the acceleration. Tells
    /// whether the step ended or begins lower than z = 0.
    fn leap(&mut self, frame: &Frame, step: &InequalityStep<'_>, near: &[f64], course: &mut Course) -> bool {
        frame.rates(near, &mut self.x);
        self.x.iter_mut().zip(step.aref).for_each(|(x, aref)| *x -= aref);
        self.origin.copy_from_slice(&self.x);
        evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        course.evaluations += 1;
        self.aim(frame, step);
        std::mem::swap(&mut self.z, &mut self.target);
        self.look(frame, step);
        if self.is_rounding() {
            course.iterations += 1;
            return true;
        }
        self.begin_at(frame);
        let cost = self.look(frame, step) + 0.5 * dot_in_lanes(&self.z, &self.z);
        cost < total(step, &frame.offsets)
    }

    /// The z, nearly the least, whose deviations are nearest to those in `origin`.
    fn begin_at(&mut self, frame: &Frame) {
        let most = frame.reaches.iter().fold(f64::MIN_POSITIVE, |most: f64, reach| most.max(*reach));
        let weight = SEEN / most;
        self.b.clear();
        self.b.extend(frame.rows.iter().map(|row| row.map(|entry| weight * entry)));
        self.u.clear();
        self.u.extend(self.origin.iter().zip(&frame.offsets).map(|(x, offset)| weight * (x - offset)));
        self.factor.of_columns(frame.size, &self.b);
        self.before.clear();
        self.z.fill(0.0);
        packs::multiply_tr(&self.b, &self.u, &mut self.sums, &mut self.z);
        self.factor.solve(&mut self.z);
    }

    /// Goes down from where [`look`](Self::look) was until the gradient is rounding; gives whether it is.
    fn descend(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        course: &mut Course,
        limit: usize,
    ) -> bool {
        course.status = Status::Converged;
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
        let stiffest = (0..step.stiffness.len()).map(inertia).fold(0.0, f64::max);
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
            let softer = InequalityStep { stiffness: &eased, ..*step };
            self.look(frame, &softer);
            self.descend(frame, &softer, course, DIRECT);
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
        let mut pulls = packs::NONE;
        for (reaches, forces) in frame.reaches.as_chunks().0.iter().zip(self.f.as_chunks().0) {
            packs::add_product(reaches, &forces.map(f64::abs), &mut pulls);
        }
        let (gradient, scale) = (norm(&self.gradient), norm(&self.z) + packs::total(&pulls));
        if scale > 0.0 { gradient / scale } else { 0.0 }
    }

    /// z − Gᵀf, and what it is the sum of.
    fn differentiate(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        let length = norm(&self.z);
        let given = frame.offsets.iter().zip(&frame.reaches).zip(self.f.iter().zip(&self.pieces));
        for ((size, stiffness), ((offset, reach), (force, piece))) in
            self.sizes.iter_mut().zip(step.stiffness).zip(given)
        {
            // An error of x, ε times its terms, becomes one of f by the stiffness.
            let curved = if piece.is_curved() { *stiffness } else { 0.0 };
            *size = force.abs() + curved * (offset.abs() + reach * length);
        }
        let Self { z, f, sizes, gradient, terms, sums, .. } = self;
        sums.clear();
        sums.resize(2 * frame.size, packs::NONE);
        let (pulls, most) = sums.split_at_mut(frame.size);
        if frame.size > 0 {
            widest(
                #[inline(always)]
                || {
                    let rows = frame.rows.chunks_exact(frame.size);
                    for (rows, (f, sizes)) in rows.zip(f.as_chunks().0.iter().zip(sizes.as_chunks().0)) {
                        for (row, (pull, most)) in rows.iter().zip(pulls.iter_mut().zip(most.iter_mut())) {
                            packs::add_product(row, f, pull);
                            packs::add_product(&row.map(f64::abs), sizes, most);
                        }
                    }
                },
            );
        }
        for (index, &z) in z.iter().enumerate() {
            gradient[index] = z - packs::total(&pulls[index]);
            terms[index] = z.abs() + packs::total(&most[index]);
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
        self.along.fill(0.0);
        packs::multiply(&frame.rows, &self.step, &mut self.along);
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

    /// Forces, pieces and gradient at z; gives the cost of the rows.
    fn look(&mut self, frame: &Frame, step: &InequalityStep<'_>) -> f64 {
        frame.deviations(&self.z, &mut self.x);
        let cost = evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        self.differentiate(frame, step);
        cost
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
        self.u.fill(0.0);
        if self.dual {
            packs::multiply(&self.b, &self.target, &mut self.u);
            self.factor.solve(&mut self.u[..self.curvatures.len()]);
        } else {
            self.factor.solve(&mut self.target);
            packs::multiply(&self.b, &self.target, &mut self.u);
        }
        for (curvature, &entry) in self.curvatures.iter().zip(&self.u) {
            for (index, part) in curvature.entries() {
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
        if frame.has_immobile {
            self.curvatures.retain(|curvature| curvature.entries().any(|(row, _)| !frame.immobile[row]));
        }
        let count = self.curvatures.len();
        // Every entry is written below.
        self.b.resize(packs_of(count) * size, packs::NONE);
        self.u.resize(packs_of(count) * LANES, 0.0);
        let Self { curvatures, b, u, .. } = self;
        for (index, (some, u)) in curvatures.chunks(LANES).zip(u.as_chunks_mut().0).enumerate() {
            let own = &mut b[index * size..][..size];
            if let Some((pack, entries)) = in_order(some) {
                let offsets = &frame.offsets[pack * LANES..][..LANES];
                *u = std::array::from_fn(|lane| -entries[lane] * offsets[lane]);
                for (own, row) in own.iter_mut().zip(&frame.rows[pack * size..][..size]) {
                    *own = std::array::from_fn(|lane| entries[lane] * row[lane]);
                }
                continue;
            }
            own.fill(packs::NONE);
            *u = packs::NONE;
            for (lane, curvature) in some.iter().enumerate() {
                for (row, entry) in curvature.entries() {
                    u[lane] -= entry * frame.offsets[row];
                    let rows = &frame.rows[row / LANES * size..][..size];
                    own.iter_mut().zip(rows).for_each(|(own, rows)| own[lane] += entry * rows[row % LANES]);
                }
            }
        }
        self.dual = count <= size;
        self.before.clear();
        self.before.extend_from_slice(&self.pieces);
    }

    /// The smaller of the two factors.
    fn factorise(&mut self, size: usize) {
        if self.dual {
            self.factor.of_rows(self.curvatures.len(), size, &self.b);
        } else {
            self.factor.of_columns(size, &self.b);
        }
    }

    /// Where a whole step leads.
    fn aim(&mut self, frame: &Frame, step: &InequalityStep<'_>) {
        self.linearise(frame, step);
        self.factorise(frame.size);
        self.target.fill(0.0);
        let slips = |piece: &Piece| matches!(piece, Piece::SlipForward | Piece::SlipBackward);
        if self.pieces.iter().any(slips) {
            for (slipping, (force, piece)) in self.along.iter_mut().zip(self.f.iter().zip(&self.pieces)) {
                *slipping = if slips(piece) { *force } else { 0.0 };
            }
            packs::multiply_tr(&frame.rows, &self.along, &mut self.sums, &mut self.target);
        }
        if self.dual {
            let Self { target, step, .. } = self;
            step.iter_mut().zip(target.iter()).for_each(|(step, target)| *step = -target);
            packs::multiply(&self.b, &self.step, &mut self.u);
            self.factor.solve(&mut self.u[..self.curvatures.len()]);
        }
        packs::multiply_tr(&self.b, &self.u, &mut self.sums, &mut self.target);
        if !self.dual {
            self.factor.solve(&mut self.target);
        }
    }
}

/// The pack of rows that some single ones are the first of, and their entries.
fn in_order(some: &[Curvature]) -> Option<(usize, Pack)> {
    let first = some.first()?.first;
    let follow = some.iter().zip(first..).all(|(own, row)| own.dim == 1 && own.first == row);
    (first.is_multiple_of(LANES) && follow).then(|| {
        let mut entries = packs::NONE;
        entries.iter_mut().zip(some).for_each(|(entry, own)| *entry = own.entries[0]);
        (first / LANES, entries)
    })
}
