//! N four-bar loops side by side: 2N + 1 slender rods of 1 m and 1 kg, whose acceleration is known in closed form.
//!
//! N + 1 cranks stand on pivots (i, 0), i = 0…N; the top of crank i is at (i + sin θᵢ, cos θᵢ). Coupler i = 1…N hangs on
//! the top of crank i − 1, points along (cos φᵢ, sin φᵢ), and closes at the top of crank i:
//!
//! ```text
//!     q = (θ₀ … θ_N, φ₁ … φ_N)  rad             gᵢ = topᵢ₋₁ + (cos φᵢ, sin φᵢ) − topᵢ = 0,  2 rows a loop
//! ```
//!
//! On the parallelogram branch, θᵢ = θ and φᵢ = 0, all of it is one pendulum:
//!
//! ```text
//!     θ̈ = k sin θ,   k = 9.81 ((N+1)/2 + N) / ((N+1)/3 + N),   φ̈ = 0.
//! ```
//!
//! Where the cranks lie flat, cos θ = 0, the horizontal rows vanish: the rank drops from 2N to N, and another branch
//! opens. The acceleration of the branch then needs forces that grow as 1/cos θ: without these rows it is another one.
//! (Library of Computational Benchmark Problems of `IFToMM`, problem A02.)

use crate::problem::step::StepView;

/// Gravity, m/s², along −y.
pub const GRAVITY: f64 = 9.81;

/// First time (s) at which the cranks of N = 2 lie flat on their way from θ = 0, θ̇ = 1.
pub const FIRST_HORIZONTAL_OF_TWO: f64 = 0.714_355_529_3;

/// Longest step (s) of the Runge–Kutta scheme of [`trajectory`]: its error over 10 s stays near rounding.
const STEP: f64 = 1e-4;

/// One step of the mechanism: what a [`StepView`] borrows.
#[derive(Debug, Clone, PartialEq)]
pub struct NFourBar {
    /// M, `nv×nv` row-major, nv = 2N + 1; kg m².
    pub mass: Vec<f64>,
    /// J = ∂g/∂q, `n×nv` row-major, n = 2N, or 6N with two connects a loop; m.
    pub jacobian: Vec<f64>,
    /// f, `nv`: gravity and velocity terms; N m.
    pub force: Vec<f64>,
    /// −J̇v, `n`; m/s².
    pub aref: Vec<f64>,
    /// v, `nv`; rad/s.
    pub velocity: Vec<f64>,
    /// The right acceleration of the branch, `nv`: θ̈ for the cranks, 0 for the couplers; rad/s².
    pub acceleration: Vec<f64>,
}

impl NFourBar {
    /// `loops` loops on the parallelogram branch at crank angle `theta` (rad) and speed `theta_dot` (rad/s).
    ///
    /// `two_connects` closes every loop by two points at ±z on the hinge's axis, three rows each, as a three-dimensional
    /// model would: every row twice, and two zero rows.
    #[must_use]
    pub fn new(loops: usize, theta: f64, theta_dot: f64, two_connects: bool) -> Self {
        let nv = 2 * loops + 1;
        let (sin, cos) = theta.sin_cos();
        let (mut mass, mut force) = (vec![0.0; nv * nv], vec![0.0; nv]);
        for crank in 0..=loops {
            let carries = if crank < loops { 1.0 } else { 0.0 };
            mass[crank * nv + crank] = 1.0 / 3.0 + carries;
            force[crank] = GRAVITY * (0.5 + carries) * sin;
        }
        let (mut jacobian, mut aref) = (Vec::new(), Vec::new());
        for bar in 0..loops {
            let coupler = loops + 1 + bar;
            mass[coupler * nv + coupler] = 1.0 / 3.0;
            mass[coupler * nv + bar] = -0.5 * sin;
            mass[bar * nv + coupler] = -0.5 * sin;
            force[coupler] = 0.5 * (theta_dot * theta_dot * cos - GRAVITY);

            let (mut along, mut across) = (vec![0.0; nv], vec![0.0; nv]);
            (along[bar], along[bar + 1]) = (cos, -cos);
            (across[bar], across[coupler], across[bar + 1]) = (-sin, 1.0, sin);
            for _ in 0..if two_connects { 2 } else { 1 } {
                jacobian.extend_from_slice(&along);
                jacobian.extend_from_slice(&across);
                // Both cranks' tops run on the same circle at the same speed: their centripetal terms cancel.
                aref.extend_from_slice(&[0.0; 2]);
                if two_connects {
                    jacobian.extend(std::iter::repeat_n(0.0, nv));
                    aref.push(0.0);
                }
            }
        }
        let cranks = |value: f64| {
            let mut entries = vec![0.0; nv];
            entries[..=loops].fill(value);
            entries
        };
        let acceleration = cranks(stiffness(loops) * sin);
        Self { mass, jacobian, force, aref, velocity: cranks(theta_dot), acceleration }
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

/// k of θ̈ = k sin θ for `loops` loops, 1/s².
#[must_use]
pub fn stiffness(loops: usize) -> f64 {
    let n = loops as f64;
    GRAVITY * (0.5 * (n + 1.0) + n) / ((n + 1.0) / 3.0 + n)
}

/// (θ, θ̇) in rad and rad/s at `times` (s, rising, from 0 on), from θ = 0, θ̇ = 1 at t = 0.
#[must_use]
pub fn trajectory(loops: usize, times: &[f64]) -> Vec<(f64, f64)> {
    let k = stiffness(loops);
    let (mut now, mut state) = (0.0, (0.0, 1.0));
    let mut states = Vec::with_capacity(times.len());
    for &time in times {
        let steps = ((time - now) / STEP).ceil().max(1.0);
        let h = (time - now) / steps;
        let mut taken = 0.0;
        while taken < steps {
            state = runge_kutta(k, h, state);
            taken += 1.0;
        }
        now = time;
        states.push(state);
    }
    states
}

/// The time (s) between `from` and `to` at which cos θ changes its sign, by bisection; `None` if it does not.
#[must_use]
pub fn horizontal(loops: usize, from: f64, to: f64) -> Option<f64> {
    let state = trajectory(loops, &[from])[0];
    let k = stiffness(loops);
    let cos_after = |time: f64| {
        let mut at = state;
        let steps = (time / STEP).ceil().max(1.0);
        let mut taken = 0.0;
        while taken < steps {
            at = runge_kutta(k, time / steps, at);
            taken += 1.0;
        }
        at.0.cos()
    };
    let (mut low, mut high) = (0.0, to - from);
    let start = state.0.cos();
    if start * cos_after(high) > 0.0 {
        return None;
    }
    // 60 halvings are more than a double can tell apart.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if start * cos_after(middle) > 0.0 { low = middle } else { high = middle }
    }
    Some(from + 0.5 * (low + high))
}

fn runge_kutta(k: f64, h: f64, (angle, speed): (f64, f64)) -> (f64, f64) {
    let (a1, s1) = (k * angle.sin(), speed);
    let (a2, s2) = (k * (angle + 0.5 * h * s1).sin(), speed + 0.5 * h * a1);
    let (a3, s3) = (k * (angle + 0.5 * h * s2).sin(), speed + 0.5 * h * a2);
    let (a4, s4) = (k * (angle + h * s3).sin(), speed + h * a3);
    (angle + h / 6.0 * (s1 + 2.0 * (s2 + s3) + s4), speed + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ConstrainedSystem, Options, Wanted, make_solver};

    fn rate(step: &NFourBar, velocity: &[f64]) -> Vec<f64> {
        let row = |row: &[f64]| row.iter().zip(velocity).map(|(j, v)| j * v).sum();
        step.jacobian.chunks_exact(velocity.len()).map(row).collect()
    }

    #[test]
    fn velocities_obey_the_constraints() {
        for connects in [false, true] {
            let step = NFourBar::new(3, 0.7, -2.0, connects);
            assert!(rate(&step, &step.velocity).iter().all(|value| value.abs() < 1e-15));
        }
    }

    #[test]
    fn aref_is_minus_the_curvature_term() {
        let (theta, speed, delta) = (0.7, -2.0, 1e-5);
        let step = NFourBar::new(3, theta, speed, true);
        let ahead = rate(&NFourBar::new(3, theta + delta * speed, speed, true), &step.velocity);
        let behind = rate(&NFourBar::new(3, theta - delta * speed, speed, true), &step.velocity);
        for ((ahead, behind), aref) in ahead.iter().zip(&behind).zip(&step.aref) {
            assert!((-(ahead - behind) / (2.0 * delta) - aref).abs() < 1e-8);
        }
    }

    #[test]
    fn acceleration_is_the_pendulums() {
        for (loops, connects, theta) in [(1, false, 0.3), (2, true, 2.0), (10, true, -0.4), (10, false, 4.0)]
        {
            let step = NFourBar::new(loops, theta, 3.0, connects);
            let mut system = ConstrainedSystem::new();
            system.assemble(&step.view()).unwrap();
            let mut solver = make_solver("pinv", &Options::new()).unwrap();
            let mut x = vec![0.0; system.len()];
            system.solve(&mut *solver, Wanted::Multipliers, &mut x).unwrap();
            let (mut qfrc, mut qacc) = (vec![0.0; system.nv()], vec![0.0; system.nv()]);
            system.acceleration(&x, &mut qfrc, &mut qacc).unwrap();
            for (got, want) in qacc.iter().zip(&step.acceleration) {
                assert!((got - want).abs() < 1e-10, "{loops} loops: {qacc:?} {:?}", step.acceleration);
            }
        }
    }

    #[test]
    fn trajectory_is_the_published_one() {
        let states = trajectory(2, &[1.0, 10.0]);
        let tops = [(-0.195_020_301_9, -0.980_799_205_7), (0.328_458_111_5, 0.944_518_538_2)];
        for ((theta, _), (x, y)) in states.into_iter().zip(tops) {
            assert!((theta.sin() - x).abs() < 2e-10 && (theta.cos() - y).abs() < 2e-10, "{theta}");
        }
        let first = horizontal(2, 0.5, 1.0).unwrap();
        assert!((first - FIRST_HORIZONTAL_OF_TWO).abs() < 1e-10, "{first}");
    }
}
