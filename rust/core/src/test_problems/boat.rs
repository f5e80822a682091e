//! The paper's rowing boat in closed form, for tests and benchmarks that need no MuJoCo.
//!
//! q = (φ, ψ₂, θ₂, ψ₃, θ₃): crank angle, horizontal and vertical angle of each oar. Constants are the paper's, in SI
//! units. The motion is prescribed, φ(t) = ωt − k sin ωt, so that every state lies on the constraint manifold exactly
//! and b is in range(A) to rounding, while null(A) turns: its two directions are those of the oars.

use crate::step::StepView;

/// Velocities of the boat.
pub const NV: usize = 5;
/// Constraint rows of the boat; their rank is [`RANK`].
pub const ROWS: usize = 6;
/// Rank of the constraint rows, in every pose.
pub const RANK: usize = 4;
/// Mean iterations a step that the paper reports for its boat.
pub const PAPER_ITERATIONS: f64 = 1.994;

const CRANK_RADIUS: f64 = 0.5;
const HANDLE_RADIUS: f64 = 1.0;
const CRANK_INERTIA: f64 = 1.0;
const OAR_INERTIA: f64 = 13.0;
const OAR_WEIGHT_MOMENT: f64 = 4.0 * 9.81 * 1.25;
const STROKE: f64 = 0.7;
const OMEGA: f64 = std::f64::consts::TAU / 5.0;
const STIFFNESS: f64 = 10_000.0;
const DAMPING: f64 = 100.0;

/// One step of the boat: what a [`StepView`] borrows.
#[derive(Debug, Clone, PartialEq)]
pub struct BoatStep {
    /// M, `5×5` row-major.
    pub mass: [f64; NV * NV],
    /// G = ∂g/∂q, `6×5` row-major.
    pub jacobian: [f64; ROWS * NV],
    /// f, `5`.
    pub force: [f64; NV],
    /// h = −Ġ v, `6`.
    pub aref: [f64; ROWS],
    /// v, `5`.
    pub velocity: [f64; NV],
}

impl BoatStep {
    /// As the solvers see it, without softness.
    #[must_use]
    pub const fn view(&self) -> StepView<'_> {
        StepView {
            mass: &self.mass,
            jacobian: &self.jacobian,
            force: &self.force,
            aref: &self.aref,
            regularisation: None,
        }
    }
}

/// The boat at time `t` seconds of its prescribed motion.
#[must_use]
pub fn boat(t: f64) -> BoatStep {
    let phi = OMEGA * t - STROKE * (OMEGA * t).sin();
    let phi_dot = OMEGA * (1.0 - STROKE * (OMEGA * t).cos());
    boat_at(phi, phi_dot, t)
}

/// The boat at crank angle `phi` (rad) and speed `phi_dot` (rad/s), with the motor's moment of time `t`.
#[must_use]
pub fn boat_at(phi: f64, phi_dot: f64, t: f64) -> BoatStep {
    let ratio = CRANK_RADIUS / HANDLE_RADIUS;
    let (sin_phi, cos_phi) = phi.sin_cos();
    // The handle runs on a circle: sin θ = ratio cos φ, tan ψ = −ratio sin φ / √(1 − ratio²).
    let depth = (1.0 - ratio * ratio).sqrt();
    let theta = (ratio * cos_phi).asin();
    let psi = (-ratio * sin_phi).atan2(depth);
    let (sin_theta, cos_theta) = theta.sin_cos();
    let (sin_psi, cos_psi) = psi.sin_cos();
    let theta_dot = -ratio * sin_phi * phi_dot / cos_theta;
    let psi_dot = -ratio * cos_phi * phi_dot * cos_psi * cos_psi / depth;

    let mut step = BoatStep {
        mass: [0.0; NV * NV],
        jacobian: [0.0; ROWS * NV],
        force: [0.0; NV],
        aref: [0.0; ROWS],
        velocity: [phi_dot, psi_dot, theta_dot, psi_dot, theta_dot],
    };
    let phi_target = OMEGA * t - STROKE * (OMEGA * t).sin();
    let phi_dot_target = OMEGA * (1.0 - STROKE * (OMEGA * t).cos());
    step.mass[0] = CRANK_INERTIA;
    step.force[0] = -STIFFNESS * (phi - phi_target) - DAMPING * (phi_dot - phi_dot_target);
    let squares = psi_dot * psi_dot + theta_dot * theta_dot;
    let cross = 2.0 * psi_dot * theta_dot;
    for oar in 0..2 {
        let (psi_col, theta_col) = (1 + 2 * oar, 2 + 2 * oar);
        step.mass[psi_col * NV + psi_col] = OAR_INERTIA * cos_theta * cos_theta;
        step.mass[theta_col * NV + theta_col] = OAR_INERTIA;
        step.force[psi_col] = OAR_INERTIA * psi_dot * theta_dot * (2.0 * theta).sin();
        step.force[theta_col] =
            OAR_WEIGHT_MOMENT * cos_theta - 0.5 * OAR_INERTIA * psi_dot * psi_dot * (2.0 * theta).sin();

        let rows = [
            // g₁ = r₀ sin φ + r_h cos θ sin ψ
            [
                CRANK_RADIUS * cos_phi,
                HANDLE_RADIUS * cos_theta * cos_psi,
                -HANDLE_RADIUS * sin_theta * sin_psi,
            ],
            // g₂ = r_h √(1 − r₀²/r_h²) − r_h cos ψ cos θ
            [0.0, HANDLE_RADIUS * sin_psi * cos_theta, HANDLE_RADIUS * cos_psi * sin_theta],
            // g₃ = r₀ cos φ − r_h sin θ
            [-CRANK_RADIUS * sin_phi, 0.0, -HANDLE_RADIUS * cos_theta],
        ];
        // −d²/dt² of each row without accelerations.
        let aref = [
            CRANK_RADIUS * sin_phi * phi_dot * phi_dot
                + HANDLE_RADIUS * (cos_theta * sin_psi * squares + sin_theta * cos_psi * cross),
            HANDLE_RADIUS * (sin_psi * sin_theta * cross - cos_psi * cos_theta * squares),
            CRANK_RADIUS * cos_phi * phi_dot * phi_dot - HANDLE_RADIUS * sin_theta * theta_dot * theta_dot,
        ];
        for (row, (entries, value)) in rows.into_iter().zip(aref).enumerate() {
            let row = 3 * oar + row;
            for (col, entry) in [0, psi_col, theta_col].into_iter().zip(entries) {
                step.jacobian[row * NV + col] = entry;
            }
            step.aref[row] = value;
        }
    }
    step
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rate(step: &BoatStep) -> [f64; ROWS] {
        let mut rate = [0.0; ROWS];
        for (row, value) in rate.iter_mut().enumerate() {
            *value = (0..NV).map(|col| step.jacobian[row * NV + col] * step.velocity[col]).sum();
        }
        rate
    }

    #[test]
    fn velocities_obey_the_constraints() {
        for t in [0.0, 0.4, 1.7, 3.0, 4.9] {
            assert!(rate(&boat(t)).iter().all(|value| value.abs() < 1e-14), "t = {t}");
        }
    }

    #[test]
    fn aref_is_minus_the_curvature_term() {
        // J(t+δ) v(t) − J(t−δ) v(t) over 2δ is J̇v, to O(δ²).
        let (t, delta) = (1.3, 1e-5);
        let (step, ahead, behind) = (boat(t), boat(t + delta), boat(t - delta));
        let with = |other: &BoatStep| rate(&BoatStep { velocity: step.velocity, ..other.clone() });
        for (row, (a, b)) in with(&ahead).into_iter().zip(with(&behind)).enumerate() {
            let numeric = -(a - b) / (2.0 * delta);
            assert!((numeric - step.aref[row]).abs() < 1e-8, "row {row}: {numeric} {}", step.aref[row]);
        }
    }
}
