//! Tells whether a position stage still stands in a data that others may have written to.

use std::ffi::c_int;

use super::{Data, array, size};

/// What a position stage read and left: the pose, what is switched on, and, of every part of the stage, what another pose or
/// another call would have left otherwise. Not the poses of mocap bodies.
#[derive(Debug, Default)]
pub struct Placement {
    numbers: Vec<f64>,
    active: Vec<bool>,
    owners: Vec<c_int>,
}

impl Placement {
    /// Takes down the position stage of a data, or forgets the one before where it is not that of the data's pose.
    pub fn take(&mut self, data: &Data) {
        self.forget();
        if data.placed {
            for part in numbers(data) {
                self.numbers.extend_from_slice(part);
            }
            self.active.extend_from_slice(data.eq_active());
            self.owners.extend_from_slice(owners(data));
        }
    }

    /// Knows none.
    pub fn forget(&mut self) {
        self.numbers.clear();
        self.active.clear();
        self.owners.clear();
    }

    /// Whether a data still has what was taken down.
    #[must_use]
    pub fn stands(&self, data: &Data) -> bool {
        let parts = numbers(data);
        let mut rest = self.numbers.as_slice();
        !rest.is_empty()
            && parts.iter().map(|part| part.len()).sum::<usize>() == rest.len()
            && parts.into_iter().all(|part| {
                let (own, after) = rest.split_at(part.len());
                rest = after;
                own == part
            })
            && self.active == data.eq_active()
            && self.owners == owners(data)
    }
}

/// Kinematics, centres of mass, tendons, the factor of M, and the rows: J, deviations, stiffnesses.
fn numbers(data: &Data) -> [&[f64]; 9] {
    let (rows, nefc) = (&data.rows, data.nefc());
    let entries = if data.model.is_sparse() { size(rows.njacobian) } else { nefc * data.model.nv() };
    // SAFETY: `rows` was taken after the last call that can move them; nJ is the number of entries where J is sparse.
    let (jacobian, pos, stiffness) =
        unsafe { (array(rows.jacobian, entries), array(rows.pos, nefc), array(rows.stiffness, nefc)) };
    [
        data.qpos(),
        data.subtree_com(),
        data.geom_xpos(),
        data.site_xpos(),
        data.ten_length(),
        data.inverse_diagonal(),
        jacobian,
        pos,
        stiffness,
    ]
}

/// What each row is of, an equality or another one's number, nefc.
fn owners(data: &Data) -> &[c_int] {
    // SAFETY: as for the numbers.
    unsafe { array(data.rows.id, data.nefc()) }
}
