//! MuJoCo's integrators fed with a constraint force from elsewhere.
//!
//! The same as `oarlock.stepping`, operation for operation: that path is readable, and the oracle of this one.

use std::sync::Arc;

use crate::drive::Drive;
use crate::error::Error;
use crate::force::ForceLaw;
use crate::library::{Data, Model};
use crate::projection::{Landing, Projector};
use crate::vectors::{Vector, at, cross, dot, largest, plus, scaled};

/// rad. Below it (1 − (θ/2) cot(θ/2))/θ² is its limit 1/12: the next term, θ²/720 times θ²ω, is below rounding.
const SMALL_ANGLE: f64 = 1e-4;

/// m or rad. Rows that closing leaves open by more than six digits of a file leave admit no motion on which their rank stays
/// what it was: what would follow is no exact solution.
pub const LOST: f64 = 1e-6;

const FREE: i32 = 0;
const BALL: i32 = 1;

/// MuJoCo's smooth dynamics and integrators with the force of a [`ForceLaw`]; a projector ends every step.
pub struct ForcedWalker<F> {
    /// The state.
    pub data: Data,
    /// Its force law.
    pub force: F,
    /// Ends every step, if there is one.
    pub projector: Option<Projector>,
    drive: Drive,
    tableau: Tableau,
}

impl<F: ForceLaw> ForcedWalker<F> {
    /// From the state of a data.
    ///
    /// # Errors
    /// [`Error::Refused`]: the model has actuator activations and is to be integrated by Runge–Kutta.
    pub fn new(data: Data, drive: Drive, force: F, projector: Option<Projector>) -> Result<Self, Error> {
        let model = Arc::clone(data.model());
        if model.na() > 0 && model.is_staged() {
            return Err(Error::Refused(format!(
                "the model has {} actuator activation(s), expected none with rk4: use euler or implicitfast",
                model.na()
            )));
        }
        Ok(Self { data, force, projector, drive, tableau: Tableau::new(&model) })
    }

    /// The smooth stages, then the force law.
    ///
    /// # Errors
    /// What the stages or the force law say.
    pub fn look(&mut self) -> Result<(), Error> {
        self.drive.apply(&mut self.data)?;
        self.forces()
    }

    fn forces(&mut self) -> Result<(), Error> {
        self.data.smooth_stages()?;
        self.force.apply(&mut self.data)
    }

    /// MuJoCo's Euler or implicit step, or the Runge–Kutta step of order four; then the projection.
    ///
    /// A projection may move the state about as far as the steps did since rows were last closed; more is refused, and noted in
    /// its landing. How far is h max|v| + h² max|a|: at a turning point the velocities say nothing, and what a step leaves open
    /// there is of the order of h² a.
    ///
    /// # Errors
    /// [`Error::Lost`]: the nearest pose leaves a row open by more than [`LOST`]; what the stages, the force law or the projection say.
    pub fn step(&mut self) -> Result<(), Error> {
        let far = self.projector.is_some();
        let (before, hardest) =
            if far { (largest(self.data.qvel()), largest(self.data.qacc())) } else { (0.0, 0.0) };
        if self.data.model().is_staged() {
            self.runge_kutta()?;
        } else {
            self.data.integrate()?;
        }
        if let Some(projector) = &mut self.projector
            && is_sane(&self.data)
        {
            let fastest = before.max(largest(self.data.qvel()));
            let step = self.data.model().timestep();
            projector.project(&mut self.data, step * fastest + step * step * hardest)?;
            let open = projector.last.is_some_and(|last| last.landing == Landing::Open);
            if open && largest(self.data.pos()) > LOST {
                return Err(Error::Lost);
            }
        }
        Ok(())
    }

    /// The classical tableau; orientations as Runge–Kutta–Munthe–Kaas, as MuJoCo since 4.0.
    ///
    /// A stage's orientation is q₀ exp(u): what is summed is not the body's ω there but u̇ (Munthe-Kaas 1998).
    fn runge_kutta(&mut self) -> Result<(), Error> {
        let model = Arc::clone(self.data.model());
        let (step, time) = (model.timestep(), self.data.time());
        self.tableau.begin(&self.data);
        for (stage, fraction) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
            let part = fraction * step;
            self.tableau.place(&mut self.data, stage, part);
            self.data.set_time(time + part);
            self.drive.apply_at_stage(&mut self.data)?;
            self.forces()?;
            self.tableau.take(&self.data, stage);
        }
        self.tableau.end(&mut self.data, step);
        self.data.set_time(time + step);
        Ok(())
    }
}

/// MuJoCo's own bound (mjMAXVAL): a position, velocity or acceleration beyond it counts as diverged.
pub const HUGE: f64 = 1e10;

/// Whether all entries are below [`HUGE`]; NaN is not.
#[must_use]
pub fn bounded(entries: &[f64]) -> bool {
    entries.iter().all(|entry| entry.abs() < HUGE)
}

/// Whether positions and velocities are finite and below [`HUGE`].
#[must_use]
pub fn is_sane(data: &Data) -> bool {
    bounded(data.qpos()) && bounded(data.qvel())
}

/// Where a Runge–Kutta step began, and the rates at its stages.
struct Tableau {
    model: Arc<Model>,
    /// First entries in qvel of the angular velocities of ball and free joints.
    turns: Vec<usize>,
    qpos: Vec<f64>,
    qvel: Vec<f64>,
    moved: Vec<f64>,
    velocities: [Vec<f64>; 4],
    accelerations: [Vec<f64>; 4],
}

impl Tableau {
    fn new(model: &Arc<Model>) -> Self {
        let (nq, nv) = (model.nq(), model.nv());
        let first = |kind, address: i32| {
            let address = usize::try_from(address).unwrap_or(0);
            match kind {
                FREE => Some(address + 3),
                BALL => Some(address),
                _ => None,
            }
        };
        let joints = model.jnt_type().iter().zip(model.jnt_dofadr());
        Self {
            turns: joints.filter_map(|(&kind, &address)| first(kind, address)).collect(),
            model: Arc::clone(model),
            qpos: vec![0.0; nq],
            qvel: vec![0.0; nv],
            moved: vec![0.0; nv],
            velocities: std::array::from_fn(|_| vec![0.0; nv]),
            accelerations: std::array::from_fn(|_| vec![0.0; nv]),
        }
    }

    fn begin(&mut self, data: &Data) {
        self.qpos.copy_from_slice(data.qpos());
        self.qvel.copy_from_slice(data.qvel());
        self.velocities[0].copy_from_slice(data.qvel());
        self.accelerations[0].copy_from_slice(data.qacc());
    }

    /// Puts the data where a stage is looked at, after `part` of the step, s.
    fn place(&mut self, data: &mut Data, stage: usize, part: f64) {
        for (moved, velocity) in self.moved.iter_mut().zip(&self.velocities[stage - 1]) {
            *moved = part * velocity;
        }
        data.qpos_mut().copy_from_slice(&self.qpos);
        self.model.integrate(data.qpos_mut(), &self.moved, 1.0);
        let start = self.qvel.iter().zip(&self.accelerations[stage - 1]);
        for (velocity, (start, acceleration)) in data.qvel_mut().iter_mut().zip(start) {
            *velocity = start + part * acceleration;
        }
    }

    /// Takes the rates of a stage.
    fn take(&mut self, data: &Data, stage: usize) {
        self.accelerations[stage].copy_from_slice(data.qacc());
        let velocity = &mut self.velocities[stage];
        velocity.copy_from_slice(data.qvel());
        for &first in &self.turns {
            let rate = rotation_vector_rate(at(&self.moved[first..], 0), at(&data.qvel()[first..], 0));
            velocity[first..first + 3].copy_from_slice(&rate);
        }
    }

    /// Puts the data at the end of the step.
    fn end(&mut self, data: &mut Data, step: f64) {
        data.qpos_mut().copy_from_slice(&self.qpos);
        for (i, moved) in self.moved.iter_mut().enumerate() {
            *moved = mean(&self.velocities, i);
        }
        self.model.integrate(data.qpos_mut(), &self.moved, step);
        for (i, (velocity, start)) in data.qvel_mut().iter_mut().zip(&self.qvel).enumerate() {
            *velocity = start + step * mean(&self.accelerations, i);
        }
    }
}

/// The weighted mean of an entry over the stages.
fn mean(stages: &[Vec<f64>; 4], i: usize) -> f64 {
    (stages[0][i] + 2.0 * stages[1][i] + 2.0 * stages[2][i] + stages[3][i]) / 6.0
}

/// u̇ (rad/s) of a rotation vector u (rad) when q₀ exp(u) turns with ω (rad/s, body frame).
///
/// u̇ = ω + ½ u×ω + (1 − (θ/2) cot(θ/2))/θ² u×(u×ω), θ = |u|: the inverse of the exponential's right differential (Iserles,
/// Munthe-Kaas, Nørsett and Zanna, Lie-group methods, 2000).
fn rotation_vector_rate(vector: Vector, omega: Vector) -> Vector {
    let square = dot(vector, vector);
    let bend = if square > SMALL_ANGLE * SMALL_ANGLE {
        let half = 0.5 * square.sqrt();
        (1.0 - half / half.tan()) / (4.0 * half * half)
    } else {
        1.0 / 12.0
    };
    let first = cross(vector, omega);
    plus(plus(omega, scaled(0.5, first)), scaled(bend, cross(vector, first)))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::force::MujocoForce;
    use crate::library::testing::{data, model};
    use crate::vectors::{minus, norm};

    /// A product of quaternions.
    fn compose([a, b, c, d]: [f64; 4], [e, f, g, h]: [f64; 4]) -> [f64; 4] {
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ]
    }

    /// The rotation by a rotation vector.
    fn exponential(vector: Vector) -> [f64; 4] {
        let half = 0.5 * norm(&vector);
        let [x, y, z] = scaled(if half > 0.0 { 0.5 * half.sin() / half } else { 0.5 }, vector);
        [half.cos(), x, y, z]
    }

    #[test]
    fn a_rotation_vector_changes_at_the_rate_that_turns_its_rotation_with_omega() {
        const STEP: f64 = 1e-6;
        let omega = [0.7, -1.1, 0.4];
        for vector in [[0.0; 3], [3e-5, -2e-5, 1e-5], [0.3, 0.2, -0.1], [1.0, -2.0, 0.5]] {
            let moved = plus(vector, scaled(STEP, rotation_vector_rate(vector, omega)));
            let turned = compose(exponential(vector), exponential(scaled(STEP, omega)));
            let gap = largest(&exponential(moved).iter().zip(turned).map(|(a, b)| a - b).collect::<Vec<_>>());
            // Of second order in the step.
            assert!(gap < 4.0 * STEP * STEP, "{vector:?}: off by {gap:e}");
        }
    }

    /// A box that spins about its middle, m² kg: its moments are 8/3 (b² + c²) a b c ρ …, so momentum is what counts.
    const SPINNING: &str = r#"<mujoco>
      <option timestep="TIMESTEP" integrator="RK4" gravity="0 0 0"/>
      <worldbody><body><joint type="ball"/><geom type="box" size=".1 .2 .4"/><inertial pos="0 0 0" mass="1" diaginertia="1 2 2.5"/></body></worldbody>
    </mujoco>"#;

    /// How far a free body's angular momentum (kg m²/s) in world axes has gone after 1 s, where it stands still.
    fn lost(timestep: f64) -> f64 {
        let model = model(&SPINNING.replace("TIMESTEP", &timestep.to_string()));
        let state = data(&model, &[1.0, 0.0, 0.0, 0.0], &[1.0, 2.0, 0.5]);
        let mut walker =
            ForcedWalker::new(state, Drive::default(), MujocoForce::new(3), None).expect("no activations");
        let momentum = |data: &Data| {
            let [w, x, y, z] = [data.qpos()[0], data.qpos()[1], data.qpos()[2], data.qpos()[3]];
            let spin = [data.qvel()[0], 2.0 * data.qvel()[1], 2.5 * data.qvel()[2]];
            let axis = [x, y, z];
            let twice = scaled(2.0, cross(axis, spin));
            plus(plus(spin, scaled(w, twice)), cross(axis, twice))
        };
        let before = momentum(&walker.data);
        while walker.data.time() < 1.0 - 0.5 * timestep {
            walker.look().expect("a state");
            walker.step().expect("a step");
        }
        norm(&minus(momentum(&walker.data), before))
    }

    #[test]
    fn a_spinning_body_keeps_its_momentum_to_the_fourth_order() {
        let (coarse, fine) = (lost(0.02), lost(0.01));
        assert!(coarse < 1e-5, "{coarse:e}");
        let order = (coarse / fine).log2();
        assert!(order > 3.7, "of order {order:.2}: {coarse:e}, {fine:e}");
    }

    #[test]
    fn activations_are_refused_with_runge_kutta() {
        let model = model(
            r#"<mujoco><option integrator="RK4"/><worldbody><body><joint name="j"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
              <actuator><general joint="j" dyntype="filter" dynprm="1"/></actuator></mujoco>"#,
        );
        let state = data(&model, model.qpos0(), &[0.0]);
        let refused =
            ForcedWalker::new(state, Drive::default(), MujocoForce::new(1), None).err().expect("refused");
        assert!(
            refused.to_string().contains("1 actuator activation(s), expected none with rk4"),
            "{refused}"
        );
    }
}
