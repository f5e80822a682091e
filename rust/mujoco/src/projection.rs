//! Projection onto the constraint manifold: positions with r(q) = 0, velocities with J v = 0.
//!
//! Of all changes that close the rows the nearest in the metric of M is taken, δ = −M⁻¹ Jᵀ A⁺ r with A = J M⁻¹ Jᵀ. It has no
//! part along the motions that the rows admit; redundant rows and rows that contradict one another are met in the sense of
//! least squares; a violated limit or a penetrating contact is not pushed deeper where the loops leave a choice (Eich 1993, Convergence results for a coordinate projection method applied to mechanical systems with
//! algebraic constraints). The same as `oarlock.projection`, operation for operation.

use oarlock_core::{ConstrainedSystem, Group, Inequalities, InequalityStep, MultiplierSolver, Wanted};

use crate::error::Error;
use crate::gaps::Gaps;
use crate::inequalities::Rows;
use crate::inertia::Inertia;
use crate::library::{Data, EQ_JOINT, EQ_TENDON, Model};
use crate::vectors::{largest, sum};

/// Newton's rounds square the gap: from a gap that is worth projecting, three reach rounding.
const MAX_ROUNDS: i64 = 5;

/// A row counts as closed up to so many roundings: what long chains and large angles accumulate.
const LANDED: f64 = 1000.0;

/// rad or m: bounds of what a projection may move a coordinate by.
const TRUST: (f64, f64) = (1e-6, 0.1);

/// Stiffness of what a correction must not push deeper, in units of its inertia: a part of 1e-12 of what it would be pushed by is
/// left.
const FIRM: f64 = 1e12;

/// Inertia of a row, at least: what nothing moves is not pushed either.
const LEAST: f64 = 1e-100;

/// m or rad: a start is closed as far as its rows allow up to this, what six digits of a file leave open.
const CONSISTENT: f64 = 1e-6;

/// What the rows of a start leave open where they contradict one another, m or rad; 0 of a start that is merely open.
///
/// # Errors
/// [`Error::Mujoco`].
pub fn contradiction(data: &mut Data) -> Result<f64, Error> {
    data.position_stage()?;
    let left = largest(data.pos());
    Ok(if left <= CONSISTENT { left } else { 0.0 })
}

/// How a projection ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Landing {
    /// Every row is closed to rounding.
    Landed,
    /// The rows no longer fell before that.
    Open,
    /// Closing them takes more than the trust length, and the state was left as it was.
    TooFar,
}

impl Landing {
    /// The name used in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Landed => "landed",
            Self::Open => "open",
            Self::TooFar => "too-far",
        }
    }
}

/// What one projection did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// How it ended.
    pub landing: Landing,
    /// Corrections of the positions.
    pub rounds: i64,
    /// Solves, those for the velocities among them.
    pub solves: i64,
    /// Their iterations.
    pub iterations: i64,
    /// Largest change of a coordinate, rad or m.
    pub moved: f64,
}

/// Projects states of one model, with a solver of its own that carries what it learns.
pub struct Projector {
    /// What the last projection did.
    pub last: Option<Projection>,
    system: ConstrainedSystem,
    solver: Box<dyn MultiplierSolver>,
    rounding: f64,
    solves: i64,
    iterations: i64,
    /// rad or m: the way since rows were last closed.
    gone: f64,
    inertia: Inertia,
    gaps: Gaps,
    /// What the rows of a closed pose leave open where they contradict one another, m or rad.
    left: f64,
    /// Entry of qpos of each velocity that is the rate of one.
    coordinates: Vec<Option<usize>>,
    zero: Vec<f64>,
    /// Limits and contacts, those that are violated, and what finds a correction that does not push them deeper.
    others: Rows,
    held: Vec<f64>,
    whitened: Vec<f64>,
    stiffness: Vec<f64>,
    least: Vec<f64>,
    none: Vec<f64>,
    groups: Vec<Group>,
    change: Vec<f64>,
    holding: Inequalities,
    wanted: Vec<f64>,
    multipliers: Vec<f64>,
    qfrc: Vec<f64>,
    step: Vec<f64>,
    total: Vec<f64>,
    sums: Vec<f64>,
    given: Vec<f64>,
    before: Vec<f64>,
    changed: Vec<f64>,
}

impl Projector {
    /// For states of one model.
    #[must_use]
    pub fn new(model: &Model, solver: Box<dyn MultiplierSolver>) -> Self {
        let (nq, nv) = (model.nq(), model.nv());
        Self {
            last: None,
            system: ConstrainedSystem::new(),
            solver,
            // A row is the difference of two positions, and each is rounded.
            rounding: 2.0 * f64::EPSILON * (model.extent() + largest(&model.center())),
            solves: 0,
            iterations: 0,
            gone: 0.0,
            inertia: Inertia::new(nv),
            gaps: Gaps::new(model),
            left: 0.0,
            coordinates: coordinates(model),
            zero: vec![0.0; nv],
            others: Rows::default(),
            held: Vec::new(),
            whitened: Vec::new(),
            stiffness: Vec::new(),
            least: Vec::new(),
            none: Vec::new(),
            groups: Vec::new(),
            change: Vec::new(),
            holding: Inequalities::new(),
            wanted: Vec::new(),
            multipliers: Vec::new(),
            qfrc: vec![0.0; nv],
            step: vec![0.0; nv],
            total: vec![0.0; nv],
            sums: vec![0.0; nv],
            given: vec![0.0; nq],
            before: vec![0.0; nq],
            changed: vec![0.0; nv],
        }
    }

    /// The same, which takes rows for closed that stand open by no more than twice this, m or rad: what is left of them at
    /// the start, where they contradict one another.
    #[must_use]
    pub const fn leaving(mut self, left: f64) -> Self {
        self.left = left;
        self
    }

    /// Takes rows for closed as [`leaving`](Self::leaving) does, by what they leave open at a state.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn begin_at(&mut self, data: &mut Data) -> Result<(), Error> {
        self.left = contradiction(data)?;
        Ok(())
    }

    /// One for states of another copy of the model, with a solver that starts as this one's stands.
    #[must_use]
    pub fn twin(&self, model: &Model) -> Self {
        Self::new(model, self.solver.clone_box()).leaving(self.left)
    }

    /// What rounding leaves open: of a point, of the mechanism's place; of a coupling, of the coordinates that it adds up.
    fn rounding(&self, data: &Data) -> f64 {
        let kinds = data.model().eq_type();
        let coupled =
            |owner: &i32| matches!(kinds[usize::try_from(*owner).unwrap_or(0)], EQ_JOINT | EQ_TENDON);
        if !data.id().iter().any(coupled) {
            return self.rounding;
        }
        let (rows, nv) = (data.jacobian(), self.coordinates.len());
        let mut most = self.rounding;
        for (row, _) in data.id().iter().enumerate().filter(|(_, owner)| coupled(owner)) {
            let part = |(column, entry): (usize, f64)| {
                self.coordinates[column].map_or(0.0, |at| entry.abs() * data.qpos()[at].abs())
            };
            most = most.max(2.0 * f64::EPSILON * sum(rows.row(row, nv).map(part)));
        }
        most
    }

    /// Projects positions, then velocities; leaves the position stage valid. `gone` is how far a coordinate may have gone in
    /// this step, rad or m.
    ///
    /// A correction may be as long as the way since rows were last closed; a longer one would lead to another pose. Where it is
    /// refused the gap goes on growing, and what is trusted grows with it: the next step tries again.
    ///
    /// # Errors
    /// Those of the solver and of MuJoCo.
    pub fn project(&mut self, data: &mut Data, gone: f64) -> Result<(), Error> {
        (self.solves, self.iterations) = (0, 0);
        self.gone += gone;
        let (landing, rounds, moved) = self.positions(data, self.gone.clamp(TRUST.0, TRUST.1))?;
        if landing != Landing::TooFar {
            self.velocities(data)?;
            self.gone = 0.0;
        }
        let (solves, iterations) = (self.solves, self.iterations);
        self.last = Some(Projection { landing, rounds, solves, iterations, moved });
        Ok(())
    }

    fn positions(&mut self, data: &mut Data, trust: f64) -> Result<(Landing, i64, f64), Error> {
        let model = data.model().clone();
        self.given.copy_from_slice(data.qpos());
        self.total.fill(0.0);
        let mut rounds = 0;
        data.position_stage()?;
        let rounding = self.rounding(data);
        let mut error = largest(data.pos());
        while error > rounding && rounds < MAX_ROUNDS {
            self.wanted.clear();
            self.wanted.extend(data.pos().iter().map(|deviation| -deviation));
            self.correct(data, false)?;
            for ((sum, total), step) in self.sums.iter_mut().zip(&self.total).zip(&self.step) {
                *sum = total + step;
            }
            // A NaN is too far as well.
            if !largest(&self.sums).le(&trust) {
                data.qpos_mut().copy_from_slice(&self.given);
                data.position_stage()?;
                return Ok((Landing::TooFar, 0, 0.0));
            }
            self.before.copy_from_slice(data.qpos());
            model.integrate(data.qpos_mut(), &self.step, 1.0);
            data.position_stage()?;
            let after = largest(data.pos());
            if !after.lt(&error) {
                data.qpos_mut().copy_from_slice(&self.before);
                data.position_stage()?;
                break;
            }
            (error, rounds) = (after, rounds + 1);
            self.total.copy_from_slice(&self.sums);
        }
        let landing =
            if error <= (LANDED * rounding).max(2.0 * self.left) { Landing::Landed } else { Landing::Open };
        Ok((landing, rounds, largest(&self.total)))
    }

    fn velocities(&mut self, data: &mut Data) -> Result<(), Error> {
        self.wanted.resize(data.ne(), 0.0);
        data.jacobian_times(data.qvel(), &mut self.wanted);
        let mut error = largest(&self.wanted);
        for _ in 0..MAX_ROUNDS {
            if error <= f64::EPSILON * largest_sum(data) {
                return Ok(());
            }
            self.wanted.iter_mut().for_each(|rate| *rate = -*rate);
            self.correct(data, true)?;
            for ((changed, given), step) in self.changed.iter_mut().zip(data.qvel()).zip(&self.step) {
                *changed = given + step;
            }
            data.jacobian_times(&self.changed, &mut self.wanted);
            let after = largest(&self.wanted);
            if !after.lt(&error) {
                return Ok(());
            }
            data.qvel_mut().copy_from_slice(&self.changed);
            error = after;
        }
        Ok(())
    }

    /// `step` = M⁻¹ Jᵀ A⁺ `wanted`: of those nearest to J δ = c the one with the least ½ δᵀ M δ; of those that push no violated limit
    /// and no penetrating contact deeper, unless the loops ask for it. One of velocities may slow down what leaves a limit, but not
    /// turn it back.
    fn correct(&mut self, data: &mut Data, of_velocities: bool) -> Result<(), Error> {
        self.gaps.hold(data, &mut self.system);
        self.inertia.assemble(data, &self.zero, &self.wanted, None, &mut self.system)?;
        self.solve(data)?;
        if data.nefc() > data.ne() {
            self.guard(data, of_velocities)?;
        }
        Ok(())
    }

    fn solve(&mut self, data: &mut Data) -> Result<(), Error> {
        self.multipliers.resize(self.wanted.len(), 0.0);
        let info =
            self.system.solve_unchecked(&mut *self.solver, Wanted::Multipliers, &mut self.multipliers)?;
        self.solves += 1;
        self.iterations += i64::try_from(info.iterations).unwrap_or(i64::MAX);
        self.inertia.acceleration(data, &mut self.system, &self.multipliers, &mut self.qfrc, &mut self.step)
    }

    /// Corrects anew where `step` would push what is violated deeper.
    fn guard(&mut self, data: &mut Data, of_velocities: bool) -> Result<(), Error> {
        let nv = self.zero.len();
        let Self { others, held, step, least, .. } = self;
        others.read(data);
        others.held(nv, held);
        let along =
            |row: &[f64], change: &[f64]| sum(row.iter().zip(change).map(|(entry, part)| entry * part));
        let bound = |row: &[f64]| if of_velocities { -along(row, data.qvel()).max(0.0) } else { 0.0 };
        least.clear();
        least.extend(held.chunks_exact(nv).map(bound));
        if !held.chunks_exact(nv).zip(&*least).any(|(row, least)| along(row, step) < *least) {
            return Ok(());
        }
        let count = least.len();
        self.whitened.resize(held.len(), 0.0);
        self.inertia.whiten(data, held, &mut self.whitened)?;
        let firm = |row: &[f64]| FIRM / sum(row.iter().map(|entry| entry * entry)).max(LEAST);
        self.stiffness.clear();
        self.stiffness.extend(self.whitened.chunks_exact(nv).map(firm));
        self.none.resize(count, 0.0);
        self.groups.resize(count, Group::Unilateral);
        let rows = InequalityStep {
            jacobian: held,
            aref: least,
            stiffness: &self.stiffness,
            friction_loss: &self.none,
            groups: &self.groups,
        };
        let whitened = &self.whitened;
        let mut whiten = |indices: &[usize], _: &[f64], out: &mut [f64]| {
            for (&row, out) in indices.iter().zip(out.chunks_exact_mut(nv)) {
                out.copy_from_slice(&whitened[row * nv..(row + 1) * nv]);
            }
        };
        self.holding.solve(&mut self.system, &rows, None, Some(&mut whiten))?;
        self.change.resize(nv, 0.0);
        data.solve_mass(&mut self.change, self.holding.generalised_force())?;
        self.system.renew(&self.change, &self.wanted)?;
        self.solve(data)
    }
}

/// Largest Σ |J| |v| of an equality row.
fn largest_sum(data: &Data) -> f64 {
    let (rows, qvel) = (data.jacobian(), data.qvel());
    let row_sum =
        |row| sum(rows.row(row, qvel.len()).map(|(column, entry)| entry.abs() * qvel[column].abs()));
    (0..data.ne()).map(row_sum).fold(0.0, f64::max)
}

/// Entry of qpos of each velocity of a slide or hinge.
fn coordinates(model: &Model) -> Vec<Option<usize>> {
    let mut found = vec![None; model.nv()];
    let joints = model.jnt_type().iter().zip(model.jnt_dofadr()).zip(model.jnt_qposadr());
    for ((&kind, &dof), &address) in joints {
        if let (2 | 3, Ok(dof), Ok(address)) = (kind, usize::try_from(dof), usize::try_from(address)) {
            found[dof] = Some(address);
        }
    }
    found
}

#[cfg(all(test, unix))]
mod tests {
    use oarlock_core::{Options, make_solver};

    use super::*;
    use crate::library::testing::{data, model};

    /// A bob of 2 kg on two slides, held by a rope of 1.5 m from the origin: x and z are relative to its place below.
    const PENDULUM: &str = r#"<mujoco>
      <option timestep="1e-3" integrator="RK4"><flag contact="disable"/></option>
      <worldbody>
        <site name="hook"/>
        <body pos="0 0 -1.5">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
          <geom size=".1" mass="2"/><site name="bob"/>
        </body>
      </worldbody>
      <tendon><spatial name="rope"><site site="hook"/><site site="bob"/></spatial></tendon>
      <equality><tendon tendon1="rope"/>EXTRA</equality>
    </mujoco>"#;

    const LENGTH: f64 = 1.5;

    /// Angle and speeds along and across the rope.
    const ANGLE: f64 = 0.7;
    const ALONG: f64 = 0.2;
    const ACROSS: f64 = 1.1;

    /// The pendulum with a rope too long by so much, projected with this trust.
    fn projected(extra: &str, too_long: f64, trust: f64) -> (Data, Projection) {
        let model = model(&PENDULUM.replace("EXTRA", extra));
        let (sin, cos) = ANGLE.sin_cos();
        let length = LENGTH + too_long;
        let qvel = [ALONG * sin + ACROSS * cos, -ALONG * cos + ACROSS * sin];
        let mut state = data(&model, &[length * sin, LENGTH - length * cos], &qvel);
        let mut projector = Projector::new(&model, make_solver("pinv", &Options::new()).expect("registered"));
        projector.project(&mut state, trust).expect("solvable");
        (state, projector.last.expect("it has projected"))
    }

    /// Length of the rope and its angle, and speeds along and across it.
    fn polar(data: &Data) -> [f64; 4] {
        let (x, z) = (data.qpos()[0], data.qpos()[1] - LENGTH);
        let (length, angle) = (x.hypot(z), x.atan2(-z));
        let (sin, cos) = angle.sin_cos();
        let [vx, vz] = [data.qvel()[0], data.qvel()[1]];
        [length, angle, vx * sin - vz * cos, vx * cos + vz * sin]
    }

    #[track_caller]
    fn assert_near(got: [f64; 4], expected: [f64; 4], tolerance: f64) {
        let far = got.iter().zip(expected).any(|(got, expected)| (got - expected).abs() > tolerance);
        assert!(!far, "{got:?}, not {expected:?}");
    }

    #[test]
    fn the_nearest_point_of_a_circle_lies_along_its_radius_and_velocities_lose_what_leaves_it() {
        for too_long in [1e-3, -1e-2] {
            let (state, last) = projected("", too_long, 0.1);
            assert_near(polar(&state), [LENGTH, ANGLE, 0.0, ACROSS], 1e-12);
            assert_eq!(last.landing, Landing::Landed, "{last:?}");
            let largest_part = too_long.abs() * ANGLE.sin().max(ANGLE.cos());
            assert!((last.moved - largest_part).abs() < 1e-12, "{last:?}, not {largest_part}");
        }
    }

    #[test]
    fn what_is_farther_than_the_trust_is_left_as_it_was() {
        let (state, last) = projected("", 0.01, 1e-3);
        assert_near(polar(&state), [LENGTH + 0.01, ANGLE, ALONG, ACROSS], 1e-15);
        assert_eq!((last.landing, last.rounds, last.moved), (Landing::TooFar, 0, 0.0));
    }

    #[test]
    fn rows_that_contradict_one_another_are_met_half_way_and_stay_open() {
        let other = r#"<tendon tendon1="rope" polycoef=".02 0 0 0 0"/>"#;
        let (state, last) = projected(other, 0.0, 0.1);
        assert_eq!(last.landing, Landing::Open, "{last:?}");
        assert_near(polar(&state), [LENGTH + 0.01, ANGLE, 0.0, ACROSS], 1e-9);
    }
}
