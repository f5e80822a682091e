//! The paper's rowing boat in closed form, for tests and benchmarks that need no MuJoCo.
//!
//! q = (φ, ψ₂, θ₂, ψ₃, θ₃): crank angle, horizontal and vertical angle of each oar. Constants are the paper's, in SI
//! units. The motion is prescribed, φ(t) = ωt − k sin ωt, so that every state lies on the constraint manifold exactly
//! and b is in range(A) to rounding, while null(A) turns: its two directions are those of the oars.

use crate::problem::step::StepView;

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
    let mut step = BoatStep {
        mass: [0.0; NV * NV],
        jacobian: [0.0; ROWS * NV],
        force: [0.0; NV],
        aref: [0.0; ROWS],
        velocity: [phi_dot, 0.0, 0.0, 0.0, 0.0],
    };
    let parts = Parts {
        nv: NV,
        mass: &mut step.mass,
        jacobian: &mut step.jacobian,
        force: &mut step.force,
        aref: &mut step.aref,
        velocity: &mut step.velocity,
    };
    fill(parts, |_| (0.0, 1.0), phi, phi_dot, t);
    step
}

/// Where [`fill`] writes.
struct Parts<'a> {
    nv: usize,
    mass: &'a mut [f64],
    jacobian: &'a mut [f64],
    force: &'a mut [f64],
    aref: &'a mut [f64],
    velocity: &'a mut [f64],
}

/// A shaft at angle `phi` and speed `phi_dot` with the motor's moment of time `t`, and oars with `(phase, size)`: the
/// angle of the crank from the shaft, and the inertia and weight as a multiple of the boat's.
fn fill(parts: Parts<'_>, oars: impl Fn(usize) -> (f64, f64), phi: f64, phi_dot: f64, t: f64) {
    let Parts { nv, mass, jacobian, force, aref, velocity } = parts;
    let ratio = CRANK_RADIUS / HANDLE_RADIUS;
    let depth = (1.0 - ratio * ratio).sqrt();
    let phi_target = OMEGA * t - STROKE * (OMEGA * t).sin();
    let phi_dot_target = OMEGA * (1.0 - STROKE * (OMEGA * t).cos());
    mass[0] = CRANK_INERTIA;
    force[0] = -STIFFNESS * (phi - phi_target) - DAMPING * (phi_dot - phi_dot_target);
    for oar in 0..aref.len() / 3 {
        let (phase, size) = oars(oar);
        let (inertia, weight) = (size * OAR_INERTIA, size * OAR_WEIGHT_MOMENT);
        let (sin_phi, cos_phi) = (phi + phase).sin_cos();
        // The handle runs on a circle: sin θ = ratio cos φ, tan ψ = −ratio sin φ / √(1 − ratio²).
        let theta = (ratio * cos_phi).asin();
        let psi = (-ratio * sin_phi).atan2(depth);
        let (sin_theta, cos_theta) = theta.sin_cos();
        let (sin_psi, cos_psi) = psi.sin_cos();
        let theta_dot = -ratio * sin_phi * phi_dot / cos_theta;
        let psi_dot = -ratio * cos_phi * phi_dot * cos_psi * cos_psi / depth;
        let squares = psi_dot * psi_dot + theta_dot * theta_dot;
        let cross = 2.0 * psi_dot * theta_dot;
        let (psi_col, theta_col) = (1 + 2 * oar, 2 + 2 * oar);
        (velocity[psi_col], velocity[theta_col]) = (psi_dot, theta_dot);
        mass[psi_col * nv + psi_col] = inertia * cos_theta * cos_theta;
        mass[theta_col * nv + theta_col] = inertia;
        force[psi_col] = inertia * psi_dot * theta_dot * (2.0 * theta).sin();
        force[theta_col] = weight * cos_theta - 0.5 * inertia * psi_dot * psi_dot * (2.0 * theta).sin();

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
        let curvature = [
            CRANK_RADIUS * sin_phi * phi_dot * phi_dot
                + HANDLE_RADIUS * (cos_theta * sin_psi * squares + sin_theta * cos_psi * cross),
            HANDLE_RADIUS * (sin_psi * sin_theta * cross - cos_psi * cos_theta * squares),
            CRANK_RADIUS * cos_phi * phi_dot * phi_dot - HANDLE_RADIUS * sin_theta * theta_dot * theta_dot,
        ];
        for (row, (entries, value)) in rows.into_iter().zip(curvature).enumerate() {
            let row = 3 * oar + row;
            for (col, entry) in [0, psi_col, theta_col].into_iter().zip(entries) {
                jacobian[row * nv + col] = entry;
            }
            aref[row] = value;
        }
    }
}

/// A boat with many pairs of oars on one shaft: what a [`StepView`] borrows.
///
/// n = 6 rows a pair, one of three redundant, 4 velocities a pair and one for the shaft, which makes A dense. The cranks
/// of a pair stand at the golden angle from those of the pair before, and its oars are up to a hundred times as heavy as
/// the lightest, so that no two pairs do the same and the eigenvalues of A spread; one pair is the boat.
#[derive(Debug, Clone, PartialEq)]
pub struct Galley {
    mass: Vec<f64>,
    jacobian: Vec<f64>,
    force: Vec<f64>,
    aref: Vec<f64>,
}

impl Galley {
    /// `pairs` pairs of oars at time `t` seconds of the boat's prescribed motion.
    #[must_use]
    pub fn new(pairs: usize, t: f64) -> Self {
        let (nv, n) = (4 * pairs + 1, 6 * pairs);
        let mut galley = Self {
            mass: vec![0.0; nv * nv],
            jacobian: vec![0.0; n * nv],
            force: vec![0.0; nv],
            aref: vec![0.0; n],
        };
        let phi = OMEGA * t - STROKE * (OMEGA * t).sin();
        let phi_dot = OMEGA * (1.0 - STROKE * (OMEGA * t).cos());
        let parts = Parts {
            nv,
            mass: &mut galley.mass,
            jacobian: &mut galley.jacobian,
            force: &mut galley.force,
            aref: &mut galley.aref,
            velocity: &mut vec![0.0; nv],
        };
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let oars = |oar: usize| {
            let pair = (oar / 2) as f64;
            (golden * pair, 100.0_f64.powf((0.618 * pair).fract()))
        };
        fill(parts, oars, phi, phi_dot, t);
        galley
    }

    /// Adds to the accelerations that the rows ask for (m/s²): redundant rows then contradict one another.
    pub fn contradict(&mut self, of_row: impl Fn(usize) -> f64) {
        self.aref.iter_mut().enumerate().for_each(|(row, aref)| *aref += of_row(row));
    }

    /// As the solvers see it, without softness.
    #[must_use]
    pub fn view(&self) -> StepView<'_> {
        StepView {
            mass: &self.mass,
            jacobian: &self.jacobian,
            force: &self.force,
            aref: &self.aref,
            regularisation: None,
        }
    }
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
    fn a_galley_of_one_pair_is_the_boat_and_each_further_pair_adds_its_rank() {
        let (step, galley) = (boat(1.3), Galley::new(1, 1.3));
        assert_eq!(
            (&galley.mass[..], &galley.jacobian[..], &galley.force[..], &galley.aref[..]),
            (&step.mass[..], &step.jacobian[..], &step.force[..], &step.aref[..])
        );
        let mut system = crate::ConstrainedSystem::new();
        system.assemble(&Galley::new(4, 1.3).view()).unwrap();
        let matrix = nalgebra::DMatrix::from_vec(4 * ROWS, 4 * ROWS, system.full_matrix());
        let rank = matrix.symmetric_eigenvalues().iter().filter(|&&value| value > 1e-10).count();
        assert_eq!((system.len(), rank), (4 * ROWS, 4 * RANK));
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
