//! MuJoCo's constraint solver, and whether its answer is the minimum that it should be.
//!
//! The same as `oarlock.mechanics.newton`, which says where a sparse Newton errs.

use std::ffi::c_int;
use std::sync::Arc;

use super::data::{Data, Stage};
use super::size;
use crate::error::Error;
use crate::vectors::norm;

/// Gradient that the rounding of a right factor leaves, relative to the forces that it is the sum of: 1e-15 to 2e-13 were
/// seen, and of wrong ones 4e-7 and more.
const ROUNDING: f64 = 1e-11;

/// The same, relative to the terms of those forces: 1e-15 at most, and of wrong ones 9e-14 and more.
const TERMS: f64 = 3e-14;

impl Data {
    /// `mj_forward`. Where the model is [`doubted`](super::Model::doubted) and the answer is no minimum to rounding, once more
    /// with a Jacobian that is dense, from there on.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn forward(&mut self) -> Result<(), Error> {
        self.run(Stage::Forward)?;
        self.confirm()
    }

    /// MuJoCo's constraint solver, after the smooth stages; of a doubted model as [`forward`](Self::forward).
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn constraint_stage(&mut self) -> Result<(), Error> {
        self.run(Stage::Constraint)?;
        self.confirm()
    }

    fn confirm(&mut self) -> Result<(), Error> {
        if !self.model.is_doubted() || self.nefc() == 0 || self.is_minimum()? {
            return Ok(());
        }
        self.model = Arc::new(self.model.dense()?);
        self.run(Stage::Forward)
    }

    /// Whether MuJoCo's answer here, of a sparse Jacobian, is the minimum that it is after, to rounding.
    fn is_minimum(&mut self) -> Result<bool, Error> {
        let left = self.gradient()?;
        if left <= ROUNDING || left.is_nan() {
            return Ok(left <= ROUNDING);
        }
        let (smooth, constraint) = (norm(self.qfrc_smooth()), norm(self.qfrc_constraint()));
        Ok(left * (smooth + constraint) <= TERMS * (smooth + norm(&self.terms())))
    }

    /// |J|ᵀ D (|J| |a| + |aref|) of the rows that push: what Jᵀ λ is made of, for λ = D (aref − J a).
    fn terms(&self) -> Vec<f64> {
        let (aref, stiffness) = self.laws();
        let mut terms = vec![0.0; self.model.nv()];
        for (row, (columns, values)) in self.sparse_rows().enumerate() {
            if self.force()[row] == 0.0 {
                continue;
            }
            let place = |column: &c_int| size((*column).into());
            let moved = columns
                .iter()
                .zip(values)
                .map(|(column, value)| value.abs() * self.qacc()[place(column)].abs());
            let push = (moved.fold(0.0, |sum, product| sum + product) + aref[row].abs()) * stiffness[row];
            for (column, value) in columns.iter().zip(values) {
                terms[place(column)] += value.abs() * push;
            }
        }
        terms
    }

    /// How far MuJoCo's answer here is from the minimum that it is after: ‖M a − f − Jᵀ λ‖ over ‖f‖ + ‖Jᵀ λ‖.
    ///
    /// # Errors
    /// [`Error::Mujoco`].
    pub fn gradient(&mut self) -> Result<f64, Error> {
        let mut left = std::mem::take(&mut self.left);
        left.resize(self.model.nv(), 0.0);
        let found = self.multiply_mass(&mut left, self.qacc()).map(|()| {
            let (smooth, constraint) = (self.qfrc_smooth(), self.qfrc_constraint());
            for ((entry, smooth), force) in left.iter_mut().zip(smooth).zip(constraint) {
                *entry = *entry - smooth - force;
            }
            let (left, whole) = (norm(&left), norm(smooth) + norm(constraint));
            if whole > 0.0 { left / whole } else { left }
        });
        self.left = left;
        found
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::library::testing::{data, model, some};
    use crate::library::{Jacobian, Model};

    /// Nine hinges, and connects by which MuJoCo 4.0.0 groups rows of different patterns where the Jacobian is sparse.
    const GROUPED: &str = r#"<mujoco>
  <option jacobian="JACOBIAN"><flag contact="disable"/></option>
  <default><geom size=".1" mass="1"/><joint axis="0 1 0"/></default>
  <worldbody>
    <body pos=".1 0 -.1"><joint/><geom/>
      <body pos=".2 0 -.4"><joint/><geom/>
        <body pos=".3 0 -.3"><joint/><geom/>
          <body pos=".2 0 -.1"><joint/><geom/></body>
          <body name="a" pos=".2 0 -.2"><joint/><geom/></body>
        </body>
        <body name="b" pos=".3 0 -.1"><joint/><geom/></body>
      </body>
      <body name="c" pos=".1 0 -.2"><joint/><geom/><body pos=".3 0 -.4"><joint/><geom/></body></body>
      <body name="d" pos=".1 0 -.3"><joint/><geom/></body>
    </body>
  </worldbody>
  <equality>
    <connect body1="a" body2="d" anchor=".01 0 .05"/>
    <connect body1="c" body2="b" anchor=".02 0 .05"/>
    <connect body1="b" body2="a" anchor=".03 0 .05"/>
  </equality>
</mujoco>"#;

    fn grouped(jacobian: &str) -> Arc<Model> {
        model(&GROUPED.replace("JACOBIAN", jacobian))
    }

    fn asked(model: &Arc<Model>) -> Data {
        let mut state = data(model, model.qpos0(), &some(model.nv(), 0.0));
        state.forward().expect("a state");
        state
    }

    fn entries(state: &Data) -> Vec<f64> {
        let mut rows = Jacobian::default();
        rows.read(state);
        rows.entries().to_vec()
    }

    #[test]
    fn an_answer_that_is_no_minimum_is_asked_for_once_more() {
        let (sparse, dense) = (grouped("sparse"), asked(&grouped("dense")));
        let mut undoubted = asked(&sparse);
        let wrong = undoubted.gradient().expect("a state") > ROUNDING;
        let doubted = Arc::new(Arc::into_inner(grouped("sparse")).expect("nobody else's").doubted());
        let mut staged = data(&doubted, doubted.qpos0(), &some(doubted.nv(), 0.0));
        staged.constraint_stage().expect("a state");
        for mut state in [asked(&doubted), staged] {
            assert!(state.gradient().expect("a state") <= ROUNDING);
            assert_eq!(state.model().is_sparse(), !wrong, "dense where it has to be");
            for (got, expected) in state.qacc().iter().zip(dense.qacc()) {
                assert!((got - expected).abs() <= 1e-10 * expected.abs(), "{got}, not {expected}");
            }
            assert_eq!(entries(&state), entries(&dense));
        }
    }
}
