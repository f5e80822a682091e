//! Steps with equality rows and inequality rows, at random, and their whole answer.

use oarlock_core::inequalities::Certificate;
use oarlock_core::test_problems::sequence::Random;
use oarlock_core::{
    ConstrainedSystem, Group, Inequalities, InequalityReport, InequalityStep, StepView, Wanted, make_solver,
};

use super::Options;

/// A step: M, f, equality rows and inequality rows.
#[derive(Debug, Clone, Default)]
pub struct Touching {
    /// M (`nv×nv`).
    pub mass: Vec<f64>,
    /// f (`nv`).
    pub force: Vec<f64>,
    /// Equality rows.
    pub equalities: Vec<f64>,
    /// What they ask for.
    pub wanted: Vec<f64>,
    /// R of them, if they are soft.
    pub softness: Option<Vec<f64>>,
    /// Inequality rows.
    pub jacobian: Vec<f64>,
    /// aref of them.
    pub aref: Vec<f64>,
    /// D of them.
    pub stiffness: Vec<f64>,
    /// η of them.
    pub loss: Vec<f64>,
    /// What they are.
    pub groups: Vec<Group>,
}

/// The whole answer of a step.
#[derive(Debug, Clone)]
pub struct Whole {
    /// Accelerations.
    pub qacc: Vec<f64>,
    /// Multipliers of the equality rows.
    pub multipliers: Vec<f64>,
    /// Forces of the inequality rows.
    pub forces: Vec<f64>,
    /// How they were found.
    pub report: InequalityReport,
    /// What proves them.
    pub certificate: Certificate,
}

impl Touching {
    /// Number of velocities.
    pub fn nv(&self) -> usize {
        self.force.len()
    }

    /// The smooth part and the equality rows.
    pub fn smooth(&self) -> StepView<'_> {
        StepView {
            mass: &self.mass,
            jacobian: &self.equalities,
            force: &self.force,
            aref: &self.wanted,
            regularisation: self.softness.as_deref(),
        }
    }

    /// The inequality rows.
    pub fn rows(&self) -> InequalityStep<'_> {
        InequalityStep {
            jacobian: &self.jacobian,
            aref: &self.aref,
            stiffness: &self.stiffness,
            friction_loss: &self.loss,
            groups: &self.groups,
        }
    }

    /// Adds a group of rows; `friction` (η or coefficients) as it needs.
    pub fn push(&mut self, group: Group, rows: &[f64], aref: &[f64], stiffness: f64, loss: f64) {
        self.jacobian.extend_from_slice(rows);
        self.aref.extend_from_slice(aref);
        self.loss.extend(aref.iter().map(|_| loss));
        self.stiffness.push(stiffness);
        if let Group::Cone { dim, mu, friction } = group {
            self.stiffness.extend(friction[..dim - 1].iter().map(|f| stiffness * (f / mu).powi(2)));
        }
        self.groups.push(group);
    }

    /// J x of the inequality rows.
    pub fn rates(&self, x: &[f64]) -> Vec<f64> {
        let row = |row: &[f64]| row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
        self.jacobian.chunks_exact(self.nv()).map(row).collect()
    }

    /// M a − f of an acceleration.
    pub fn needed(&self, qacc: &[f64]) -> Vec<f64> {
        let row = |(row, f): (&[f64], &f64)| row.iter().zip(qacc).map(|(m, a)| m * a).sum::<f64>() - f;
        self.mass.chunks_exact(self.nv()).zip(&self.force).map(row).collect()
    }

    /// The whole answer, by a solver of the registry for the equality rows.
    pub fn solve(&self, inequalities: &mut Inequalities, name: &str, near: Option<&[f64]>) -> Whole {
        let mut system = ConstrainedSystem::new();
        self.solve_in(&mut system, inequalities, name, near)
    }

    /// The same in a system that was there before.
    pub fn solve_in(
        &self,
        system: &mut ConstrainedSystem,
        inequalities: &mut Inequalities,
        name: &str,
        near: Option<&[f64]>,
    ) -> Whole {
        let nv = self.nv();
        system.assemble(&self.smooth()).expect("a good step");
        let report = inequalities.solve(system, &self.rows(), near, None).expect("good rows");
        let forces = inequalities.forces().to_vec();
        // Another start: one solve with M, by a system without inequality rows.
        let start = self.pushed(inequalities.generalised_force());
        system.renew(&start, &self.wanted).expect("finite");
        let mut solver = make_solver(name, &Options::new()).expect(name);
        let mut multipliers = vec![0.0; self.wanted.len()];
        system.solve(&mut *solver, Wanted::Multipliers, &mut multipliers).expect("good input");
        let (mut qfrc, mut qacc) = (vec![0.0; nv], vec![0.0; nv]);
        system.acceleration(&multipliers, &mut qfrc, &mut qacc).expect("finite");
        let certificate = inequalities.certify(&qacc, &forces).expect("finite");
        Whole { qacc, multipliers, forces, report, certificate }
    }

    /// M⁻¹ (f + `extra`).
    pub fn pushed(&self, extra: &[f64]) -> Vec<f64> {
        let force: Vec<f64> = self.force.iter().zip(extra).map(|(a, b)| a + b).collect();
        let mut system = ConstrainedSystem::new();
        system.assemble(&StepView { force: &force, ..self.smooth() }).expect("a good step");
        system.unconstrained().to_vec()
    }

    /// A step at random: up to 12 velocities, up to 8 equality rows of which some say the same, and groups of all kinds, their stiffness
    /// 10^`low` to 10^`high` of what their inertia asks for.
    pub fn random(random: &mut Random, low: f64, high: f64) -> Self {
        let nv = 1 + random.below(12);
        let mut case = Self { mass: mass(random, nv), ..Self::default() };
        case.force = numbers(random, nv, 10.0);
        for index in 0..=random.below(8) {
            if index > 0 && random.one_in(3) {
                let (one, other) = (random.below(index), random.below(index));
                let (a, b) = (random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0));
                let row =
                    (0..nv).map(|k| a * case.equalities[one * nv + k] + b * case.equalities[other * nv + k]);
                let row: Vec<f64> = row.collect();
                case.equalities.extend(row);
            } else {
                let row = row(random, nv);
                case.equalities.extend(row);
            }
        }
        // Rows that agree: what some acceleration does.
        let motion = numbers(random, nv, 10.0);
        let asked = |row: &[f64]| row.iter().zip(&motion).map(|(a, b)| a * b).sum::<f64>();
        case.wanted = case.equalities.chunks_exact(nv).map(asked).collect();
        if random.one_in(2) {
            case.softness =
                Some(case.wanted.iter().map(|_| 10.0_f64.powf(random.uniform(-6.0, 0.0))).collect());
        }
        for _ in 0..=random.below(8) {
            case.push_random(random, low, high);
        }
        case
    }

    /// Adds a group at random.
    pub fn push_random(&mut self, random: &mut Random, low: f64, high: f64) {
        let nv = self.nv();
        let stiffness = 10.0_f64.powf(random.uniform(low, high));
        let dims = [1, 1, 2, 3, 4, 6];
        let (group, dim) = match random.below(8) {
            0 | 1 => (Group::Friction, 1),
            kind => {
                let dim = dims[kind - 2];
                let friction = std::array::from_fn(|_| random.uniform(0.05, 1.5));
                let cone = Group::Cone { dim, mu: friction[0] * random.uniform(0.3, 1.0), friction };
                (if dim == 1 { Group::Unilateral } else { cone }, dim)
            }
        };
        let mut rows = Vec::new();
        let mut aref = Vec::new();
        for _ in 0..dim {
            rows.extend(row(random, nv));
            aref.push(random.uniform(-20.0, 20.0));
        }
        let loss = 10.0_f64.powf(random.uniform(-2.0, 2.0));
        self.push(group, &rows, &aref, stiffness, loss);
    }
}

fn numbers(random: &mut Random, n: usize, size: f64) -> Vec<f64> {
    (0..n).map(|_| random.uniform(-size, size)).collect()
}

/// One to four entries.
fn row(random: &mut Random, nv: usize) -> Vec<f64> {
    let mut row = vec![0.0; nv];
    for _ in 0..=random.below(4) {
        row[random.below(nv)] = random.uniform(-1.0, 1.0);
    }
    row
}

/// M = L Lᵀ of masses that differ by up to 1e4.
fn mass(random: &mut Random, nv: usize) -> Vec<f64> {
    let mut factor = vec![0.0; nv * nv];
    for i in 0..nv {
        let size = 10.0_f64.powf(random.uniform(-1.0, 1.0));
        for j in 0..i {
            factor[i * nv + j] = size * random.uniform(-0.5, 0.5);
        }
        factor[i * nv + i] = size;
    }
    let entry = |i: usize, j: usize| (0..nv).map(|k| factor[i * nv + k] * factor[j * nv + k]).sum::<f64>();
    (0..nv * nv).map(|at| entry(at / nv, at % nv)).collect()
}
