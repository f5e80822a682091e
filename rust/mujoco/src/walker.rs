//! MuJoCo's integrators fed with a constraint force from elsewhere.
//!
//! The same as `oarlock.stepping`, operation for operation: that path is readable, and the oracle of this one.

use std::sync::Arc;

use crate::drive::Drive;
use crate::error::Error;
use crate::force::ForceLaw;
use crate::library::{Data, Integrator, Model};
use crate::projection::Projector;
use crate::vectors::{Vector, at, cross, dot, largest, plus, scaled};

/// rad. Below it (1 − (θ/2) cot(θ/2))/θ² is its limit 1/12: the next term, θ²/720 times θ²ω, is below rounding.
const SMALL_ANGLE: f64 = 1e-4;

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
        if model.na() > 0 && model.integrator() == Integrator::RungeKutta {
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
        self.data.smooth_stages()?;
        self.force.apply(&mut self.data)
    }

    /// MuJoCo's Euler or implicit step, or the Runge–Kutta step of order four; then the projection.
    ///
    /// A projection may move the state about as far as the step itself did; more is refused, and noted in its landing.
    ///
    /// # Errors
    /// What the stages, the force law or the projection say.
    pub fn step(&mut self) -> Result<(), Error> {
        let before = largest(self.data.qvel());
        if self.data.model().integrator() == Integrator::RungeKutta {
            self.runge_kutta()?;
        } else {
            self.data.integrate()?;
        }
        if let Some(projector) = &mut self.projector
            && is_finite(&self.data)
        {
            let fastest = before.max(largest(self.data.qvel()));
            let trust = self.data.model().timestep() * fastest;
            projector.project(&mut self.data, trust)?;
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
            self.look()?;
            self.tableau.take(&self.data, stage);
        }
        self.tableau.end(&mut self.data, step);
        self.data.set_time(time + step);
        Ok(())
    }
}

/// Whether positions and velocities are.
#[must_use]
pub fn is_finite(data: &Data) -> bool {
    data.qpos().iter().chain(data.qvel()).all(|entry| entry.is_finite())
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
