//! How far equality rows stand open, as a part of the lengths that they turn on.

use std::ops::Range;

use oarlock_core::ConstrainedSystem;

use crate::kinematics::index;
use crate::library::{Data, EQ_CONNECT, EQ_JOINT, EQ_WELD, Element, Model};

/// The gaps of the rows of one model's states.
#[derive(Debug, Clone)]
pub struct Gaps {
    /// By equality, the entries of qvel that are angular velocities and that its rows can touch.
    turns: Vec<Vec<Range<usize>>>,
    nv: usize,
    /// Of each row.
    relative: Vec<f64>,
}

impl Gaps {
    /// For states of one model.
    #[must_use]
    pub fn new(model: &Model) -> Self {
        let mut angular = vec![false; model.nv()];
        for (&kind, &first) in model.jnt_type().iter().zip(model.jnt_dofadr()) {
            let first = index(first);
            // Of mjtJoint: free, ball, slide, hinge.
            let turning = match kind {
                0 => first + 3..first + 6,
                1 => first..first + 3,
                2 => first..first,
                _ => first..first + 1,
            };
            angular[turning].fill(true);
        }
        let turns = (0..model.eq_type().len()).map(|equality| {
            let mut touched = angular.clone();
            touched.iter_mut().zip(moving(model, equality)).for_each(|(touched, moves)| *touched &= moves);
            ranges(&touched)
        });
        Self { turns: turns.collect(), nv: model.nv(), relative: Vec::new() }
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
                let turns = &self.turns[index(owner)];
                for entries in jacobian[row * nv..moved * nv].chunks_exact(nv) {
                    for lever in turns.iter().flat_map(|turns| &entries[turns.clone()]) {
                        length = if lever.abs() > length { lever.abs() } else { length };
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

/// Which entries of qvel can move the rows of an equality: those of joints that its bodies hang on, or all where that is not
/// known.
fn moving(model: &Model, equality: usize) -> Vec<bool> {
    let whole = |body: usize| {
        let count = index(model.body_dofnum()[body]);
        let first = if count == 0 { 0 } else { index(model.body_dofadr()[body]) };
        first..first + count
    };
    if ![EQ_CONNECT, EQ_WELD].contains(&model.eq_type()[equality]) {
        return vec![true; model.nv()];
    }
    let mut moving = vec![false; model.nv()];
    for id in [model.eq_obj1id()[equality], model.eq_obj2id()[equality]] {
        let sites = model.eq_objtype()[equality] == Element::Site as i32;
        let mut body = index(if sites { model.site_bodyid()[index(id)] } else { id });
        while body != 0 {
            moving[whole(body)].fill(true);
            body = index(model.body_parentid()[body]);
        }
    }
    moving
}

/// Where entries follow one another that are true.
fn ranges(entries: &[bool]) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for (at, _) in entries.iter().enumerate().filter(|(_, entry)| **entry) {
        match ranges.last_mut() {
            Some(last) if last.end == at => last.end += 1,
            _ => ranges.push(at..at + 1),
        }
    }
    ranges
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::library::Jacobian;
    use crate::library::testing::{data, model, somewhere};

    #[test]
    fn rows_touch_no_angular_velocity_but_those_that_are_looked_at() {
        let model = model(
            r#"<mujoco><worldbody>
              <body name="a"><freejoint/><geom size=".1"/>
                <body name="b" pos=".4 0 0"><joint type="ball"/><geom size=".1"/><site name="s"/>
                  <body name="c" pos=".3 0 0"><joint axis="0 1 0"/><joint type="slide"/><geom size=".1"/></body></body>
                <body name="d" pos="-.4 0 0"><joint axis="1 1 0"/><geom size=".1"/><site name="t"/></body></body>
              <body name="e" pos="0 0 1"><joint axis="1 0 0"/><geom size=".1" pos=".1 0 0"/></body></worldbody>
              <equality>
                <connect body1="c" body2="d" anchor=".1 .2 .3"/><connect site1="s" site2="t"/>
                <weld body1="b" body2="e"/><connect body1="e" anchor="0 .1 0"/>
              </equality></mujoco>"#,
        );
        let (qpos, qvel) = somewhere(&model);
        let (state, gaps) = (data(&model, &qpos, &qvel), Gaps::new(&model));
        let mut jacobian = Jacobian::default();
        jacobian.read(&state);
        // Velocities 0 to 2 and 10 are those of slides.
        let angular = |velocity: usize| velocity > 2 && velocity != 10;
        for (row, &owner) in jacobian.entries().chunks_exact(model.nv()).zip(state.id()) {
            let turns = &gaps.turns[index(owner)];
            for (velocity, entry) in row.iter().enumerate() {
                let looked_at = turns.iter().any(|turns| turns.contains(&velocity));
                assert!(looked_at <= angular(velocity), "{velocity} is no angle");
                assert!(looked_at || !angular(velocity) || *entry == 0.0, "{velocity} of equality {owner}");
            }
        }
        assert_eq!(gaps.turns[3], vec![12..13; 1]);
    }
}
