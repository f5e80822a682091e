//! How far equality rows stand open, as a part of the lengths that they turn on.

use oarlock_core::ConstrainedSystem;

use crate::library::{Data, EQ_JOINT, EQ_WELD, Model};

/// The gaps of the rows of one model's states.
#[derive(Debug, Clone)]
pub struct Gaps {
    /// Entries of qvel that are angular velocities.
    turns: Vec<usize>,
    nv: usize,
    /// Of each row.
    relative: Vec<f64>,
}

impl Gaps {
    /// For states of one model.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let mut turns = Vec::new();
        for (&kind, &first) in model.jnt_type().iter().zip(model.jnt_dofadr()) {
            let first = usize::try_from(first).unwrap_or(0);
            // Of mjtJoint: free, ball, slide, hinge.
            let angular = match kind {
                0 => first + 3..first + 6,
                1 => first..first + 3,
                2 => first..first,
                _ => first..first + 1,
            };
            turns.extend(angular);
        }
        Self { turns, nv: model.nv(), relative: Vec::new() }
    }

    /// Asks to hold the rank of the rows along the path that a data is on, with what the rows are of; `jacobian` (ne×nv) is
    /// theirs.
    ///
    /// A row of a connect tilts by its gap over the longest lever of a joint that moves it, a rotation by its gap. Rows of
    /// joint equalities do not turn.
    pub fn hold(&mut self, data: &Data, jacobian: &[f64], system: &mut ConstrainedSystem) {
        let (nv, ids, kinds) = (self.nv, data.id(), data.model().eq_type());
        self.relative.clear();
        let mut row = 0;
        while row < ids.len() {
            let owner = ids[row];
            let end = row + ids[row..].iter().take_while(|&&other| other == owner).count();
            let kind = kinds[usize::try_from(owner).unwrap_or(0)];
            let moved = if kind == EQ_WELD { (row + 3).min(end) } else { end };
            // Levers are looked for where they decide: rows that are closed do not tilt.
            let open = data.pos()[row..moved].iter().any(|deviation| *deviation != 0.0);
            let mut length = 0.0_f64;
            if open && kind != EQ_JOINT {
                for entries in jacobian[row * nv..moved * nv].chunks_exact(nv) {
                    for &velocity in &self.turns {
                        let lever = entries[velocity].abs();
                        length = if lever > length { lever } else { length };
                    }
                }
            }
            for (index, deviation) in (row..end).zip(&data.pos()[row..end]) {
                let still = index < moved && (kind == EQ_JOINT || length == 0.0);
                let unit = if index < moved { length } else { 1.0 };
                self.relative.push(if still { 0.0 } else { deviation.abs() / unit });
            }
            row = end;
        }
        system.hold_rank(&self.relative);
        system.set_constraints(ids.iter().map(|&owner| usize::try_from(owner).unwrap_or(usize::MAX)));
    }
}
