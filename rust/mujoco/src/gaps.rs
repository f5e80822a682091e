//! How far equality rows stand open, as a part of the lengths that they turn on.

use oarlock_core::ConstrainedSystem;

use crate::kinematics::index;
use crate::library::{Data, EQ_JOINT, EQ_WELD, Model};

/// Part of a lever that a row has to stand open by for its length to be looked for anew: solvers ask no smaller ones.
const CLOSED: f64 = 1e-12;

/// The gaps of the rows of one model's states.
#[derive(Debug, Clone)]
pub struct Gaps {
    /// Which entries of qvel are angular velocities.
    turning: Vec<bool>,
    /// Lever of each equality as it was last looked for, m; 0 before.
    levers: Vec<f64>,
    /// Of each row.
    relative: Vec<f64>,
}

impl Gaps {
    /// For states of one model.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let mut turning = vec![false; model.nv()];
        for (&kind, &first) in model.jnt_type().iter().zip(model.jnt_dofadr()) {
            let first = index(first);
            // Of mjtJoint: free, ball, slide, hinge.
            let turns = match kind {
                0 => first + 3..first + 6,
                1 => first..first + 3,
                2 => first..first,
                _ => first..first + 1,
            };
            turning[turns].fill(true);
        }
        Self { turning, levers: vec![0.0; model.eq_type().len()], relative: Vec::new() }
    }

    /// Asks to hold the rank of the rows along the path that a data is on, with what the rows are of.
    ///
    /// A row of a connect tilts by its gap over the longest lever of a joint that moves it, a rotation by its gap. Rows of
    /// joint equalities do not turn.
    pub fn hold(&mut self, data: &Data, system: &mut ConstrainedSystem) {
        let (ids, kinds, rows) = (data.id(), data.model().eq_type(), data.jacobian());
        self.relative.clear();
        let mut row = 0;
        while row < ids.len() {
            let owner = ids[row];
            let end = row + ids[row..].iter().take_while(|&&other| other == owner).count();
            let kind = kinds[usize::try_from(owner).unwrap_or(0)];
            let moved = if kind == EQ_WELD { (row + 3).min(end) } else { end };
            let open = data.pos()[row..moved].iter().fold(0.0_f64, |most, gap| most.max(gap.abs()));
            let length = &mut self.levers[index(owner)];
            if kind != EQ_JOINT && open > CLOSED * *length {
                *length = 0.0;
                for row in row..moved {
                    rows.each(row, self.turning.len(), |velocity, lever: f64| {
                        if self.turning[velocity] && lever.abs() > *length {
                            *length = lever.abs();
                        }
                    });
                }
            }
            let length = *length;
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

#[cfg(all(test, unix))]
mod tests {
    use oarlock_core::ConstrainedSystem;

    use super::*;
    use crate::library::testing::{data, model};

    #[test]
    fn a_row_that_stands_open_tilts_by_its_gap_over_the_longest_lever() {
        // A rod of 0.5 m on a hinge, its end tied to a point 0.1 m beyond it, and a slide that moves it too.
        let model = model(
            r#"<mujoco><worldbody><body><joint type="slide" axis="1 0 0"/><geom size=".1"/>
              <body><joint axis="0 1 0"/><geom size=".1" pos=".25 0 0"/><site name="end" pos=".5 0 0"/></body></body>
              <site name="point" pos=".6 0 0"/></worldbody>
              <equality><connect site1="end" site2="point"/></equality></mujoco>"#,
        );
        let state = data(&model, &[0.0, 0.0], &[0.0, 0.0]);
        let mut gaps = Gaps::new(&model);
        let mut system = ConstrainedSystem::new();
        gaps.hold(&state, &mut system);
        let most = gaps.relative.iter().fold(0.0_f64, |most, gap| most.max(*gap));
        assert!((most - 0.1 / 0.5).abs() < 1e-12, "{:?}", gaps.relative);
    }
}
