//! Limits, friction loss and contacts of a state, and the forces that they answer with beside the equality rows.
//!
//! Their forces are found first, with the loops as the form of the question has them; the equality rows are then asked with those
//! forces as smooth ones. Whoever solves for the multipliers answers the question that it would answer without them.

use oarlock_core::inequalities::{
    Certificate, Group, Inequalities as Solver, InequalityReport, InequalityStep,
};
use oarlock_core::{ConstrainedSystem, Status};

use crate::error::Error;
use crate::inertia::Inertia;
use crate::library::{Data, Jacobian};

/// Kinds of rows, as in mjtConstraint.
const FRICTION: [i32; 2] = [1, 2];
const LIMIT: [i32; 2] = [3, 4];
const PYRAMIDAL: i32 = 6;
const ELLIPTIC: i32 = 7;

/// Largest forces of the rows of one state.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Loads {
    /// Of a limit, N or N m.
    pub limit: f64,
    /// Of friction loss, N or N m.
    pub friction: f64,
    /// Of all contacts along their normals, together, N.
    pub contact: f64,
}

/// The rows of limits, friction loss and contacts of a state.
#[derive(Debug, Default)]
pub struct Rows {
    jacobian: Jacobian,
    groups: Vec<Group>,
    kinds: Vec<i32>,
    owners: Vec<i32>,
    pos: Vec<f64>,
    aref: Vec<f64>,
    stiffness: Vec<f64>,
    friction_loss: Vec<f64>,
}

impl Rows {
    /// Takes them from a data whose velocity stage is done.
    pub fn read(&mut self, data: &Data) {
        let rows = data.inequalities();
        self.kinds.clear();
        self.kinds.extend_from_slice(rows.kind);
        self.owners.clear();
        self.owners.extend_from_slice(rows.id);
        self.groups.clear();
        if rows.kind.is_empty() {
            return;
        }
        for (given, taken) in [
            (rows.aref, &mut self.aref),
            (rows.pos, &mut self.pos),
            (rows.stiffness, &mut self.stiffness),
            (rows.friction_loss, &mut self.friction_loss),
        ] {
            taken.clear();
            taken.extend_from_slice(given);
        }
        let mut row = 0;
        while row < rows.kind.len() {
            let group = match rows.kind[row] {
                kind if FRICTION.contains(&kind) => Group::Friction,
                ELLIPTIC => {
                    let cone = data.cone(rows.id[row]);
                    Group::Cone { dim: cone.dim, mu: cone.mu, friction: cone.friction }
                }
                _ => Group::Unilateral,
            };
            self.groups.push(group);
            row += group.rows().max(1);
        }
        self.jacobian.read_inequalities(data);
    }

    /// How many there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.kinds.len()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// What a solver sees of them.
    #[must_use]
    pub fn step(&self) -> InequalityStep<'_> {
        InequalityStep {
            jacobian: self.jacobian.entries(),
            aref: &self.aref,
            stiffness: &self.stiffness,
            friction_loss: &self.friction_loss,
            groups: &self.groups,
        }
    }

    /// Writes the rows (`k×nv`) of the limits that are violated and the normals of the contacts that penetrate.
    pub fn held(&self, nv: usize, held: &mut Vec<f64>) {
        held.clear();
        let of = |row: usize| &self.jacobian.entries()[row * nv..(row + 1) * nv];
        let mut row = 0;
        for group in &self.groups {
            let whose = (self.kinds[row], self.owners[row]);
            let again = row > 0 && (self.kinds[row - 1], self.owners[row - 1]) == whose;
            if !FRICTION.contains(&whose.0) && self.pos[row] < 0.0 && !again {
                if whose.0 == PYRAMIDAL {
                    // Edges of a pyramid come in pairs, n ± μt.
                    held.extend(of(row).iter().zip(of(row + 1)).map(|(one, other)| 0.5 * (one + other)));
                } else {
                    held.extend_from_slice(of(row));
                }
            }
            row += group.rows();
        }
    }

    /// How large some forces of them are.
    #[must_use]
    pub fn loads(&self, forces: &[f64]) -> Loads {
        let mut loads = Loads::default();
        let mut row = 0;
        for group in &self.groups {
            let force = forces[row].abs();
            match self.kinds[row] {
                kind if FRICTION.contains(&kind) => loads.friction = loads.friction.max(force),
                kind if LIMIT.contains(&kind) => loads.limit = loads.limit.max(force),
                // The first row of a cone is its normal; edges of a pyramid add up to the normal force.
                _ => loads.contact += force,
            }
            row += group.rows();
        }
        loads
    }
}

/// Answers the rows of one state after another, in one form and beside one system of equality rows.
#[derive(Debug, Default)]
pub struct Inequalities {
    solver: Solver,
    /// Figures of the last answer; none of a state without such rows.
    pub report: Option<InequalityReport>,
    /// What proves it, once there is an acceleration.
    pub certificate: Option<Certificate>,
    /// Acceleration of the answer before, nv; empty where there is none.
    last: Vec<f64>,
    change: Vec<f64>,
    force: Vec<f64>,
}

impl Inequalities {
    /// Finds the forces of the rows beside an assembled `system`, whose smooth acceleration was `unconstrained` (nv), and asks the
    /// system anew with them. `aref` is that of its rows.
    ///
    /// # Errors
    /// Those of the solver, and [`Error::Mujoco`].
    pub fn answer(
        &mut self,
        data: &mut Data,
        rows: &Rows,
        inertia: &mut Inertia,
        system: &mut ConstrainedSystem,
        unconstrained: &mut [f64],
        aref: &[f64],
    ) -> Result<(), Error> {
        (self.report, self.certificate) = (None, None);
        if rows.is_empty() {
            return Ok(());
        }
        let mut said = Ok(());
        let report = self.solver.solve(
            system,
            &rows.step(),
            (!self.last.is_empty()).then_some(&self.last[..]),
            Some(&mut |_, given, whitened| said = inertia.whiten(data, given, whitened)),
        )?;
        said?;
        self.change.resize(unconstrained.len(), 0.0);
        data.solve_mass(&mut self.change, self.solver.generalised_force())?;
        for (entry, change) in unconstrained.iter_mut().zip(&self.change) {
            *entry += change;
        }
        system.renew(unconstrained, aref)?;
        self.force.clear();
        self.force.extend_from_slice(self.solver.forces());
        self.report = Some(report);
        Ok(())
    }

    /// Forces of the rows of the last answer; empty of a state without.
    #[must_use]
    pub fn forces(&self) -> &[f64] {
        if self.report.is_some() { &self.force } else { &[] }
    }

    /// Adds the forces of the rows to the constraint force `qfrc` (nv) of somebody's multipliers, and proves them by the acceleration
    /// (nv) that came out. Tells whether they are proved.
    ///
    /// # Errors
    /// Those of the solver.
    pub fn conclude(&mut self, qacc: &[f64], qfrc: &mut [f64]) -> Result<bool, Error> {
        let Some(report) = self.report else { return Ok(true) };
        for (entry, force) in qfrc.iter_mut().zip(self.solver.generalised_force()) {
            *entry += force;
        }
        let certificate = match self.solver.certify(qacc, &self.force) {
            Err(oarlock_core::Error::NonFinite { .. }) => return Ok(false),
            certificate => certificate?,
        };
        self.certificate = Some(certificate);
        Ok(report.status == Status::Converged && certificate.holds())
    }

    /// Begins the next answer at an acceleration (nv) near it, that of this step.
    pub fn remember(&mut self, qacc: &[f64]) {
        self.last.clear();
        if qacc.iter().all(|entry| entry.is_finite()) {
            self.last.extend_from_slice(qacc);
        }
    }
}
