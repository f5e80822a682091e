//! What proves an answer, from the accelerations that came out in the end.
//!
//! With forces f of the inequality rows, equality multipliers and acceleration a of the same step, everything holds but f = −∂s(J a − aref).
//! How far that is off is measured in three ways: as the gradient that is left, as the complementarity of each row, and as the
//! gap of the dual problem, which for convex costs is the sum of
//!
//! ```text
//!     s(x) + s*(−f) + f x ≥ 0,    s*(−f) = ½ f²/D within |f| ≤ η, f ≥ 0, or the friction cone; else infinite,
//! ```
//!
//! zero where f = −∂s(x) and nowhere else (Fenchel). They bound the distance from the one answer: the objective is strongly convex
//! in the norm of M.

use super::costs::{Piece, evaluate};
use super::frame::Frame;
use super::rows::{Group, InequalityStep};
use crate::error::{Error, check_finite};
use crate::linalg::kernels::dot_in_lanes;

/// Largest gradient of a certified answer, relative to the forces: what the promise of an acceleration, 1e-6 of its largest entry, leaves room
/// for where the stiffness of a row is what its inertia asks for.
pub const GRADIENT: f64 = 1e-6;

/// Largest complementarity and gap, relative to the energies that they are differences of. They are of second order in the
/// error of x where a row pushes, of first order where it only just does.
pub const GAP: f64 = 1e-6;

/// Rounding errors of x relative to the sizes that it is the difference of; times the stiffness they are what no gradient can be
/// below. An acceleration comes out of two solves with M, whose condition of 1e4 and more leaves its part.
pub const ROUNDING: f64 = 1e4 * f64::EPSILON;

/// The figures of an answer; all are relative and 0 where it is exact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Certificate {
    /// √Σ‖w‖²(f + ∂s(x))² over the forces' size, w the whitened rows: the gradient in the norm of M⁻¹.
    pub gradient: f64,
    /// The part of the same that rounding of x explains.
    pub rounding: f64,
    /// Largest product of a force and its slack beside the energies of all rows, those of equalities among them.
    pub complementarity: f64,
    /// Duality gap beside the same.
    pub gap: f64,
    /// How far forces lie outside of what their rows can give (|f| ≤ η, f ≥ 0, the friction cone), relative to the largest.
    pub infeasibility: f64,
}

impl Certificate {
    /// Whether the answer is proved: [`GRADIENT`], [`GAP`].
    #[must_use]
    pub fn holds(&self) -> bool {
        self.gradient <= GRADIENT + self.rounding
            && self.complementarity <= GAP + self.rounding
            && self.gap <= GAP + self.rounding
            && self.infeasibility <= GAP + self.rounding
    }
}

/// What a certificate is made with; grows and never shrinks.
#[derive(Debug, Clone, Default)]
pub(super) struct Notary {
    /// J a.
    rates: Vec<f64>,
    x: Vec<f64>,
    f: Vec<f64>,
    pieces: Vec<Piece>,
    /// Rounding of x.
    noise: Vec<f64>,
    work: Vec<f64>,
}

impl Notary {
    /// The figures of the forces f (`m`) at an acceleration a (`nv`).
    ///
    /// # Errors
    /// [`Error::NonFinite`].
    pub(super) fn certify(
        &mut self,
        frame: &Frame,
        step: &InequalityStep<'_>,
        acceleration: &[f64],
        forces: &[f64],
    ) -> Result<Certificate, Error> {
        let m = step.aref.len();
        self.rates.resize(frame.room(), 0.0);
        frame.rates(acceleration, &mut self.rates);
        let rates = &self.rates[..m];
        check_finite("accelerations of the rows", rates)?;
        self.x.clear();
        self.x.extend(rates.iter().zip(step.aref).map(|(rate, aref)| rate - aref));
        self.f.resize(m, 0.0);
        self.pieces.resize(m, Piece::Free);
        let cost = evaluate(step, &self.x, &mut self.f, &mut self.pieces);
        check_finite("forces of the rows", &self.f)?;

        let Self { f, pieces, noise, work, .. } = self;
        let (lengths, terms) = (&frame.lengths[..m], &frame.terms[..m]);
        let size = length(work, lengths.iter().zip(forces).map(|(length, force)| length * force));
        let size = size.hypot(frame.fixed);
        noise.clear();
        noise.extend(
            terms
                .iter()
                .zip(rates)
                .zip(lengths)
                .map(|((terms, rate), length)| ROUNDING * (terms + rate.abs() + length * size)),
        );
        let pairs = || lengths.iter().zip(forces.iter().zip(&*f));
        let off = length(work, pairs().map(|(length, (force, own))| length * (force - own)));
        // Where x is on the other side of a kink than the forces, rounding may have put it there.
        let known = pairs().zip(&*pieces).zip(step.stiffness.iter().zip(&*noise));
        let noise = length(
            work,
            known.map(|(((length, (force, own)), piece), (stiffness, noise))| {
                let noisy = piece.is_curved() || force - own != 0.0;
                if noisy { length * stiffness * noise } else { 0.0 }
            }),
        );
        let (own, complementarity, gap, outside) = self.gaps(step, forces, cost);
        // Beside a mechanism that is hard at work, a row that hardly works is off by the rounding of the others.
        let energy = own + size * size;
        let relative = |value: f64, scale: f64| if value > 0.0 { value / scale } else { 0.0 };
        Ok(Certificate {
            gradient: relative(off, size),
            rounding: relative(noise, size),
            complementarity: relative(complementarity, energy),
            gap: relative(gap, energy),
            infeasibility: relative(
                outside,
                forces.iter().fold(0.0_f64, |most, force| most.max(force.abs())),
            ),
        })
    }

    /// Energies, largest complementarity, gap and infeasibility of all groups.
    fn gaps(&self, step: &InequalityStep<'_>, forces: &[f64], cost: f64) -> (f64, f64, f64, f64) {
        let (mut row, mut energy, mut gap) = (0, cost, cost);
        let (mut complementarity, mut outside) = (0.0_f64, 0.0_f64);
        for group in step.groups {
            let dim = group.rows();
            let (mut own, mut dual) = (0.0, 0.0);
            let rows = row..row + dim;
            let pairs = forces[rows.clone()].iter().zip(&self.x[rows.clone()]);
            for ((f, x), stiffness) in pairs.zip(&step.stiffness[rows]) {
                let (spent, product) = (f * f / stiffness, f * x);
                own += product + spent;
                dual += 0.5 * spent;
                gap += product;
                energy += product.abs() + spent;
            }
            gap += dual;
            match group {
                Group::Friction => {
                    let (f, loss) = (forces[row], step.friction_loss[row]);
                    outside = outside.max(f.abs() - loss);
                    // The slack of slipping against the room that the force has left.
                    let slip = (self.x[row] + f / step.stiffness[row]).abs();
                    own = (loss - f.abs()).max(0.0) * (slip - self.noise[row]).max(0.0);
                }
                Group::Unilateral => outside = outside.max(-forces[row]),
                Group::Cone { friction, .. } => {
                    let tangents = forces[row + 1..row + dim].iter().zip(friction);
                    let squares = tangents.map(|(force, friction)| (force / friction).powi(2));
                    outside = outside.max(squares.sum::<f64>().sqrt() - forces[row]);
                }
            }
            complementarity = complementarity.max(own.abs());
            row += dim;
        }
        (energy, complementarity, gap.abs(), outside)
    }
}

/// √Σ x², also where squares overflow or underflow; `work` is workspace.
#[inline]
fn length(work: &mut Vec<f64>, entries: impl Iterator<Item = f64>) -> f64 {
    work.clear();
    work.extend(entries);
    let squares = dot_in_lanes(work, work);
    if squares.is_normal() { squares.sqrt() } else { work.iter().copied().fold(0.0, f64::hypot) }
}
