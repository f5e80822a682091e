//! Friction loss, limits and contacts beside exact or soft equality rows: what they push, in one convex problem.
//!
//! # The problem
//!
//! Rows e are equalities, rows i the others, with MuJoCo's D = 1/R and aref of each. The acceleration is the minimum of
//!
//! ```text
//!     ½ (a − a₀)ᵀ M (a − a₀) + Σ s_i(J_i a − aref_i)        s_i: MuJoCo's own convex costs
//!     exact rows e:   subject to J_e a = aref_e, in the least-squares sense and with the rank of the equality answer
//!     soft rows e:    with ½ D_e (J_e a − aref_e)² in the sum
//! ```
//!
//! It is strictly convex: there is one answer (MuJoCo documentation, *Computation*; Todorov, ICRA 2014). Its forces
//! f = −∂s are one more smooth force to the equality rows, whose b they change and whose A they do not, so that each solver goes on
//! answering the question that it knows: [`ConstrainedSystem::renew`] asks it.
//!
//! # The method
//!
//! | part | it is |
//! |---|---|
//! | `rows` | [`InequalityStep`]: what a step hands over, in [`Group`]s |
//! | `costs` | the costs with forces and curvatures, and the [`Piece`] that each row lies on |
//! | `basis` | the frame of a block of equality rows: what they fix, or how they stiffen |
//! | `frame` | the rows in the coordinates that are left; blocks that no row touches take no part |
//! | `newton`, `factor`, `search` | Newton's method with exact Hessian and a line search that ends |
//! | [`certificate`] | what proves an answer |

mod basis;
pub mod certificate;
mod costs;
mod factor;
mod frame;
mod newton;
mod rows;
mod search;

pub use certificate::Certificate;
pub use costs::Piece;
pub use frame::IMMOBILE;
pub use newton::{CONVERGED, ITERATIONS};
pub use rows::{CONE_TOLERANCE, Group, InequalityStep, WIDEST_CONE};

use self::certificate::Notary;
use self::frame::Frame;
use self::newton::Newton;
use crate::error::{Error, LARGEST, check_finite, check_len};
use crate::info::Status;
use crate::problem::{Wanted, Whiten};
use crate::solvers::RANK_CUT;
use crate::solvers::auto::{Auto, AutoParams};
use crate::solvers::solver::Solver;
use crate::system::ConstrainedSystem;

/// Violation that counts as a push against equality rows, relative to what it is the difference of: two bodies that touch
/// exactly are off by the rounding of their poses, which stiffness turns into a force.
pub const BLOCKED: f64 = 1e-9;

/// The figures of one solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InequalityReport {
    /// [`Converged`](Status::Converged): the gradient is at rounding, or within [`CONVERGED`] where it cannot come nearer. Otherwise
    /// [`IterationLimit`](Status::IterationLimit) or [`Breakdown`](Status::Breakdown), no progress.
    pub status: Status,
    /// Newton steps, a factorisation each; 0 where the start was the answer.
    pub iterations: usize,
    /// Evaluations of all rows in the line searches.
    pub evaluations: usize,
    /// Norm of the gradient that is left, relative to the forces that it is the difference of.
    pub gradient: f64,
    /// Number of rows that push: limits and contacts that are not free, and all friction loss.
    pub active: usize,
    /// Whether rows that push are others than in the solve before, or lie on other pieces; `true` of the first one.
    pub changed: bool,
    /// Number of rows that are violated and push, though no motion that the equality rows admit moves them.
    pub blocked: usize,
    /// Number of coordinates that equality rows leave to the velocities that a row touches.
    pub coordinates: usize,
    /// Whether the acceleration given led nearer than none.
    pub warm: bool,
}

/// Solves the inequality rows of one step after another, and remembers which of them pushed.
#[derive(Clone, Default)]
pub struct Inequalities {
    frame: Frame,
    newton: Newton,
    notary: Notary,
    force: Vec<f64>,
    blocked: Vec<usize>,
    /// Rows that pushed, without their numbers, which contacts change: kind and piece.
    pushing: Vec<(u8, Piece)>,
    before: Vec<(u8, Piece)>,
    solved: bool,
    /// Decides ranks that are to be held and that nobody has decided.
    decider: Option<Box<Auto>>,
    multipliers: Vec<f64>,
    /// The rows as they were given.
    aref: Vec<f64>,
    stiffness: Vec<f64>,
    friction_loss: Vec<f64>,
    groups: Vec<Group>,
}

impl std::fmt::Debug for Inequalities {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Inequalities").field("rows", &self.forces().len()).finish_non_exhaustive()
    }
}

impl Inequalities {
    /// Returns a solver before its first step.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds the forces of the rows beside the equality rows of `system`, which is assembled.
    ///
    /// `near` is an acceleration (`nv`) near the answer, that of the step before. `whiten` multiplies rows by H, M⁻¹ = Hᵀ H, as in
    /// [`assemble_factored`](ConstrainedSystem::assemble_factored); without it, and of a
    /// [sparse](ConstrainedSystem::assemble_sparse) system always, the system's own factor of M does.
    ///
    /// # Errors
    /// Those of [`InequalityStep::check`]; [`Error::Empty`] of a system that has no velocities; [`Error::Factored`] where `whiten` is needed and
    /// not given; [`Error::NonFinite`] or [`Error::TooLarge`] where products overflow.
    pub fn solve(
        &mut self,
        system: &mut ConstrainedSystem,
        step: &InequalityStep<'_>,
        near: Option<&[f64]>,
        whiten: Option<&mut Whiten<'_>>,
    ) -> Result<InequalityReport, Error> {
        let nv = system.nv();
        if nv == 0 {
            return Err(Error::Empty { what: "system" });
        }
        step.check_beside_jacobian(nv)?;
        if let Some(near) = near {
            check_len("near", near.len(), &[nv])?;
            check_finite("near", near)?;
        }
        self.decide(system)?;
        system.form_whitened();
        self.take(step);
        // What is not finite in J is not in its product with H either.
        let unfit = |error| step.check(nv).err().unwrap_or(error);
        self.frame.find(system, step, whiten).map_err(unfit)?;
        let near = near.filter(|near| near.iter().all(|entry| entry.abs() < LARGEST));
        let (course, warm) = self.newton.run(&self.frame, step, near);
        check_finite("forces of the rows", &self.newton.f)?;
        self.force.resize(nv, 0.0);
        self.frame.combine(&self.newton.f, &mut self.force);
        check_finite("force of the rows", &self.force)?;
        let (active, changed) = self.compare();
        self.find_blocked();
        Ok(InequalityReport {
            status: course.status,
            iterations: course.iterations,
            evaluations: course.evaluations,
            gradient: course.gradient,
            active,
            changed,
            blocked: self.blocked.len(),
            coordinates: self.frame.size,
            warm,
        })
    }

    /// A rank that is to be held is decided before anything stands on it.
    fn decide(&mut self, system: &mut ConstrainedSystem) -> Result<(), Error> {
        if system.blocks().is_undecided() {
            let decider =
                self.decider.get_or_insert_with(|| Box::new(Auto::new(AutoParams { rank_cut: RANK_CUT })));
            self.multipliers.resize(system.len(), 0.0);
            system.solve_unchecked(&mut **decider, Wanted::Acceleration, &mut self.multipliers)?;
        }
        Ok(())
    }

    fn take(&mut self, step: &InequalityStep<'_>) {
        fn copy<T: Copy>(to: &mut Vec<T>, from: &[T]) {
            to.clear();
            to.extend_from_slice(from);
        }
        copy(&mut self.aref, step.aref);
        copy(&mut self.stiffness, step.stiffness);
        copy(&mut self.friction_loss, step.friction_loss);
        copy(&mut self.groups, step.groups);
    }

    /// Number of rows that push, and whether they are others than before.
    fn compare(&mut self) -> (usize, bool) {
        std::mem::swap(&mut self.pushing, &mut self.before);
        self.pushing.clear();
        let (mut row, mut active) = (0, 0);
        for group in &self.groups {
            let (piece, dim) = (self.newton.pieces[row], group.rows());
            if piece != Piece::Free {
                active += dim;
                let kind = match group {
                    Group::Friction => 0,
                    #[allow(clippy::cast_possible_truncation)] // 1 to 6
                    _ => dim as u8,
                };
                self.pushing.push((kind, piece));
            }
            row += dim;
        }
        let changed = !self.solved || self.pushing != self.before;
        self.solved = true;
        (active, changed)
    }

    /// Limits and contacts that push against equality rows alone.
    fn find_blocked(&mut self) {
        self.blocked.clear();
        let mut row = 0;
        for group in &self.groups {
            let least = BLOCKED * self.stiffness[row] * self.frame.terms[row];
            let pushes = !matches!(group, Group::Friction) && self.newton.f[row] > least;
            if pushes && self.frame.immobile[row] {
                self.blocked.push(row);
            }
            row += group.rows();
        }
    }

    /// Returns the forces f (`m`) of the last solve.
    #[must_use]
    pub fn forces(&self) -> &[f64] {
        &self.newton.f[..self.newton.pieces.len()]
    }

    /// Returns Jᵀ f (`nv`) of the last solve.
    #[must_use]
    pub fn generalised_force(&self) -> &[f64] {
        &self.force
    }

    /// Returns the piece that each row (`m`) lies on; rows of a cone share theirs.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.newton.pieces
    }

    /// Returns the rows, of a contact the normal one, that are violated and push, though no motion that the equality rows admit
    /// moves them: a limit that an exact loop fights. Equality rows bear all of their force.
    #[must_use]
    pub fn blocked(&self) -> &[usize] {
        &self.blocked
    }

    /// Returns what proves `forces` (`m`) at the acceleration a (`nv`) of the whole answer of the last step.
    ///
    /// # Errors
    /// [`Error::Shape`]; [`Error::NonFinite`], also where J a overflows.
    pub fn certify(&mut self, acceleration: &[f64], forces: &[f64]) -> Result<Certificate, Error> {
        check_len("acceleration", acceleration.len(), &[self.force.len()])?;
        check_len("forces of the rows", forces.len(), &[self.aref.len()])?;
        check_finite("acceleration", acceleration)?;
        check_finite("forces of the rows", forces)?;
        let step = InequalityStep {
            jacobian: &[],
            aref: &self.aref,
            stiffness: &self.stiffness,
            friction_loss: &self.friction_loss,
            groups: &self.groups,
        };
        self.notary.certify(&self.frame, &step, acceleration, forces)
    }

    /// Forgets all earlier steps.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}
