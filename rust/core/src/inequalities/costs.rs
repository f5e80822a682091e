//! Costs s(x) of inequality rows, x = J a − aref, with their forces f = −∂s and curvatures.
//!
//! ```text
//!     friction loss    ½ D x² while |D x| < η, else η |x| − η²/2D
//!     unilateral       ½ D min(x, 0)²
//!     elliptic cone    U = (μ x₀, friction_j x_j), N = U₀, T = ‖(U₁ …)‖, D₀ of the normal row:
//!                      0 where N ≥ μT;   ½ D₀/μ² (N² + T²) where μN + T ≤ 0;   else ½ D₀/(μ²(1 + μ²)) (N − μT)²
//! ```
//!
//! These are MuJoCo's (documentation, *Computation: constraint model*; Todorov, *Convex and analytically-invertible dynamics with
//! contacts and constraints*, ICRA 2014). All pieces but the slip of a friction loss are homogeneous of degree two, f = −∂²s x
//! exactly; that of slip is of degree one and has no curvature.

use super::rows::{Group, InequalityStep, WIDEST_CONE};
use crate::linalg::kernels::dot;

/// The piece of its cost that a row lies on. Rows of a cone share theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Piece {
    /// A unilateral row or a cone that is not touched: no force.
    Free,
    /// A unilateral row that pushes.
    On,
    /// A friction loss or a cone that holds.
    Stick,
    /// A friction loss that is overcome, x < 0: its force is η.
    SlipBackward,
    /// The same with x > 0: its force is −η.
    SlipForward,
    /// A cone that pushes and slides.
    Slide,
}

impl Piece {
    /// Returns the number used in tables: 0 to 5 in the order of the definition.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Whether its cost has curvature.
    pub(super) const fn is_curved(self) -> bool {
        matches!(self, Self::On | Self::Stick | Self::Slide)
    }
}

/// A row of C, where Cᵀ C is the Hessian of the cost of a group: entries of rows of the group, from a first one on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Curvature {
    pub(super) first: usize,
    pub(super) dim: usize,
    pub(super) entries: [f64; WIDEST_CONE],
}

impl Curvature {
    const fn single(row: usize, entry: f64) -> Self {
        let mut entries = [0.0; WIDEST_CONE];
        entries[0] = entry;
        Self { first: row, dim: 1, entries }
    }

    /// Each row with its entry.
    pub(super) fn entries(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        (self.first..).zip(self.entries[..self.dim].iter().copied())
    }
}

/// A cone at a point.
struct Cone {
    dim: usize,
    mu: f64,
    /// (μ, friction…): U = scales · x.
    scales: [f64; WIDEST_CONE],
    u: [f64; WIDEST_CONE],
    tangent: f64,
    /// D₀/μ².
    stiffness: f64,
}

impl Cone {
    fn at(dim: usize, mu: f64, friction: &[f64; WIDEST_CONE - 1], stiffness: f64, x: &[f64]) -> Self {
        let (mut scales, mut u) = ([0.0; WIDEST_CONE], [0.0; WIDEST_CONE]);
        scales[0] = mu;
        scales[1..].copy_from_slice(friction);
        for ((u, scale), x) in u.iter_mut().zip(&scales).zip(x) {
            *u = scale * x;
        }
        // Beyond the last row there is nothing.
        let tangent = dot(&u[1..], &u[1..]).sqrt();
        Self { dim, mu, scales, u, tangent, stiffness: stiffness / (mu * mu) }
    }

    fn piece(&self) -> Piece {
        let (normal, tangent) = (self.u[0], self.tangent);
        if normal >= self.mu * tangent {
            Piece::Free
        } else if self.mu * normal + tangent <= 0.0 {
            Piece::Stick
        } else {
            Piece::Slide
        }
    }

    /// D₀/(μ²(1 + μ²)).
    fn sliding(&self) -> f64 {
        self.stiffness / (1.0 + self.mu * self.mu)
    }

    fn cost(&self, piece: Piece) -> f64 {
        match piece {
            Piece::Stick => 0.5 * self.stiffness * (self.u[0] * self.u[0] + self.tangent * self.tangent),
            Piece::Slide => 0.5 * self.sliding() * self.depth() * self.depth(),
            _ => 0.0,
        }
    }

    /// N − μT, negative where it slides.
    fn depth(&self) -> f64 {
        self.u[0] - self.mu * self.tangent
    }
}

/// Cost, force and piece of a single row.
fn single(step: &InequalityStep<'_>, row: usize, x: f64, friction: bool) -> (f64, f64, Piece) {
    let stiffness = step.stiffness[row];
    if friction {
        let loss = step.friction_loss[row];
        if (stiffness * x).abs() < loss {
            (0.5 * stiffness * x * x, -stiffness * x, Piece::Stick)
        } else if x < 0.0 {
            (loss * (-x - 0.5 * loss / stiffness), loss, Piece::SlipBackward)
        } else {
            (loss * (x - 0.5 * loss / stiffness), -loss, Piece::SlipForward)
        }
    } else if x < 0.0 {
        (0.5 * stiffness * x * x, -stiffness * x, Piece::On)
    } else {
        (0.0, 0.0, Piece::Free)
    }
}

/// Forces f (`m`) and the piece of every row at x (`m`); gives the cost.
pub(super) fn evaluate(step: &InequalityStep<'_>, x: &[f64], f: &mut [f64], pieces: &mut [Piece]) -> f64 {
    let (mut row, mut cost) = (0, 0.0);
    for group in step.groups {
        let dim = group.rows();
        let (at, pushed) = (&x[row..row + dim], &mut f[row..row + dim]);
        let piece = match group {
            Group::Friction | Group::Unilateral => {
                let (part, force, piece) = single(step, row, at[0], matches!(group, Group::Friction));
                cost += part;
                pushed[0] = force;
                piece
            }
            Group::Cone { mu, friction, .. } => {
                let cone = Cone::at(dim, *mu, friction, step.stiffness[row], at);
                let piece = cone.piece();
                cost += cone.cost(piece);
                cone_force(&cone, piece, pushed);
                piece
            }
        };
        // A call that fills memory costs more than a few bytes do.
        match &mut pieces[row..row + dim] {
            [one] => *one = piece,
            [one, two, three] => (*one, *two, *three) = (piece, piece, piece),
            others => others.fill(piece),
        }
        row += dim;
    }
    cost
}

/// Σ s(x).
pub(super) fn total(step: &InequalityStep<'_>, x: &[f64]) -> f64 {
    let mut row = 0;
    let cost = |group: &Group| {
        let (first, dim) = (row, group.rows());
        row += dim;
        match group {
            Group::Cone { mu, friction, .. } => {
                let cone = Cone::at(dim, *mu, friction, step.stiffness[first], &x[first..row]);
                cone.cost(cone.piece())
            }
            single_row => single(step, first, x[first], matches!(single_row, Group::Friction)).0,
        }
    };
    step.groups.iter().map(cost).sum()
}

/// Forces of a cone.
fn cone_force(cone: &Cone, piece: Piece, f: &mut [f64]) {
    match piece {
        Piece::Stick => {
            for ((f, u), scale) in f.iter_mut().zip(&cone.u).zip(&cone.scales) {
                *f = -cone.stiffness * u * scale;
            }
        }
        Piece::Slide => {
            let push = cone.sliding() * cone.depth() * cone.mu;
            f[0] = -push;
            for (j, f) in f.iter_mut().enumerate().skip(1) {
                *f = push * (cone.u[j] / cone.tangent) * cone.scales[j];
            }
        }
        _ => f.fill(0.0),
    }
}

/// θ′ and θ″ of θ(α) = Σ s(x + αq) at the point x.
pub(super) fn along(step: &InequalityStep<'_>, x: &[f64], q: &[f64]) -> (f64, f64) {
    let (mut row, mut slope, mut bend) = (0, 0.0, 0.0);
    for group in step.groups {
        match group {
            Group::Friction | Group::Unilateral => {
                let (_, force, piece) = single(step, row, x[row], matches!(group, Group::Friction));
                slope -= force * q[row];
                if piece.is_curved() {
                    bend += step.stiffness[row] * q[row] * q[row];
                }
                row += 1;
            }
            Group::Cone { dim, mu, friction } => {
                let cone = Cone::at(*dim, *mu, friction, step.stiffness[row], &x[row..row + dim]);
                let piece = cone.piece();
                if piece != Piece::Free {
                    let (part, curved) = cone_along(&cone, piece, &q[row..row + dim]);
                    slope += part;
                    bend += curved;
                }
                row += dim;
            }
        }
    }
    (slope, bend)
}

fn cone_along(cone: &Cone, piece: Piece, q: &[f64]) -> (f64, f64) {
    let mut turned = [0.0; WIDEST_CONE];
    for ((turned, scale), q) in turned.iter_mut().zip(&cone.scales).zip(q) {
        *turned = scale * q;
    }
    let (u, turned) = (&cone.u[..cone.dim], &turned[..cone.dim]);
    if piece == Piece::Stick {
        return (cone.stiffness * dot(u, turned), cone.stiffness * dot(turned, turned));
    }
    let outward = dot(&u[1..], &turned[1..]) / cone.tangent;
    let (sliding, depth, sinking) = (cone.sliding(), cone.depth(), turned[0] - cone.mu * outward);
    let across = (dot(&turned[1..], &turned[1..]) - outward * outward).max(0.0);
    (sliding * depth * sinking, sliding * (sinking * sinking - depth * cone.mu / cone.tangent * across))
}

/// Appends the rows of C of every group at x.
pub(super) fn curvatures(step: &InequalityStep<'_>, x: &[f64], pieces: &[Piece], found: &mut Vec<Curvature>) {
    found.clear();
    let mut row = 0;
    for group in step.groups {
        let (first, dim, piece) = (row, group.rows(), pieces[row]);
        row += dim;
        if !piece.is_curved() {
            continue;
        }
        let Group::Cone { mu, friction, .. } = group else {
            found.push(Curvature::single(first, step.stiffness[first].sqrt()));
            continue;
        };
        if piece == Piece::Stick {
            let root = (step.stiffness[first] / (mu * mu)).sqrt();
            found.push(Curvature::single(first, root * mu));
            let tangents = (first + 1..first + dim).zip(friction);
            found.extend(tangents.map(|(row, scale)| Curvature::single(row, root * scale)));
        } else {
            let cone = Cone::at(dim, *mu, friction, step.stiffness[first], &x[first..first + dim]);
            sliding_curvature(&cone, first, found);
        }
    }
}

/// The depth N − μT, and T's curvature across the direction of sliding: rows of the reflector that takes the direction to an axis.
fn sliding_curvature(cone: &Cone, first: usize, found: &mut Vec<Curvature>) {
    let dim = cone.dim;
    let mut direction = [0.0; WIDEST_CONE];
    for (entry, u) in direction[1..dim].iter_mut().zip(&cone.u[1..dim]) {
        *entry = u / cone.tangent;
    }
    let root = cone.sliding().sqrt();
    let mut entries = [0.0; WIDEST_CONE];
    entries[0] = root * cone.scales[0];
    for j in 1..dim {
        entries[j] = -root * cone.mu * direction[j] * cone.scales[j];
    }
    found.push(Curvature { first, dim, entries });
    let across = (-cone.depth() * cone.mu / cone.tangent).sqrt() * root;
    let sign = if direction[1] < 0.0 { -1.0 } else { 1.0 };
    let mut mirror = direction;
    mirror[1] += sign;
    // ‖mirror‖² = 2 (1 + |direction₁|)
    let weight = 1.0 / (1.0 + sign * direction[1]);
    for k in 2..dim {
        let mut entries = [0.0; WIDEST_CONE];
        for j in 1..dim {
            let identity = f64::from(u8::from(j == k));
            entries[j] = across * (identity - weight * mirror[k] * mirror[j]) * cone.scales[j];
        }
        found.push(Curvature { first, dim, entries });
    }
}
