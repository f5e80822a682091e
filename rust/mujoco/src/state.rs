//! What one state says: M's factor, J, the smooth acceleration and the constraint rows, straight from MuJoCo's arrays; and the question that
//! it puts to a solver.

use oarlock_core::ConstrainedSystem;

use crate::curvature::Curvature;
use crate::error::Error;
use crate::gaps::Gaps;
use crate::inequalities::{Inequalities, Rows};
use crate::inertia::Inertia;
use crate::library::{Data, Model};

/// The form of a question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// MuJoCo's own aref and R.
    Matched,
    /// aref = −J̇v − 2β Jv − k r and R = 0 (Baumgarte 1972).
    Hard,
}

/// Baumgarte's terms: β in 1/s, k in 1/s².
#[derive(Debug, Clone, Copy, Default)]
pub struct Baumgarte {
    /// Of the rates, 1/s.
    pub beta: f64,
    /// Of the deviations, 1/s².
    pub k: f64,
}

/// The fields of a state whose smooth stages are done.
pub struct State {
    rows: Curvature,
    beta2: f64,
    k: f64,
    inertia: Inertia,
    unconstrained: Vec<f64>,
    softness: Vec<f64>,
    curvature: Vec<f64>,
    aref: Vec<f64>,
    gaps: Gaps,
    others: Rows,
}

impl State {
    /// For states of one model.
    ///
    /// # Errors
    /// [`Error::Refused`]: an equality whose J̇v is not known.
    pub fn new(model: &Model, baumgarte: Baumgarte) -> Result<Self, Error> {
        Ok(Self {
            rows: Curvature::new(model)?,
            beta2: 2.0 * baumgarte.beta,
            k: baumgarte.k,
            inertia: Inertia::new(model.nv()),
            unconstrained: vec![0.0; model.nv()],
            softness: Vec::new(),
            curvature: Vec::new(),
            aref: Vec::new(),
            gaps: Gaps::new(model),
            others: Rows::default(),
        })
    }

    /// Takes the fields from the data.
    ///
    /// # Errors
    /// Those of [`Curvature::write`].
    pub fn read(&mut self, data: &mut Data) -> Result<(), Error> {
        self.others.read(data);
        let ne = data.ne();
        if self.curvature.len() != ne {
            self.curvature.resize(ne, 0.0);
            self.aref.resize(ne, 0.0);
            self.softness.resize(ne, 0.0);
        }
        self.rows.write(data, &mut self.curvature)
    }

    /// J̇v, ne, m/s² or rad/s².
    #[must_use]
    pub fn curvature(&self) -> &[f64] {
        &self.curvature
    }

    /// Limits, friction loss and contacts.
    #[must_use]
    pub const fn others(&self) -> &Rows {
        &self.others
    }

    /// Assembles the question of the state as it was last read, with the forces of its limits, friction loss and contacts among
    /// the smooth ones: those that `inequalities` finds.
    ///
    /// # Errors
    /// Those of [`Inertia::assemble`] and [`Inequalities::answer`].
    pub fn ask(
        &mut self,
        data: &mut Data,
        form: Form,
        system: &mut ConstrainedSystem,
        inequalities: &mut Inequalities,
    ) -> Result<(), Error> {
        self.ask_equalities(data, form, system)?;
        let Self { others, inertia, unconstrained, aref, .. } = self;
        inequalities.answer(data, others, inertia, system, unconstrained, aref)
    }

    /// The question of the equality rows alone.
    ///
    /// # Errors
    /// As [`ask`](Self::ask).
    pub fn ask_equalities(
        &mut self,
        data: &mut Data,
        form: Form,
        system: &mut ConstrainedSystem,
    ) -> Result<(), Error> {
        match form {
            Form::Matched => {
                self.aref.copy_from_slice(data.aref());
                self.softness.copy_from_slice(data.softness());
            }
            Form::Hard => {
                let given = self.curvature.iter().zip(data.vel()).zip(data.pos());
                for (aref, ((curvature, rate), deviation)) in self.aref.iter_mut().zip(given) {
                    *aref = -curvature - self.beta2 * rate - self.k * deviation;
                }
            }
        }
        self.unconstrained.copy_from_slice(data.qacc_smooth());
        self.gaps.hold(data, system);
        let softness = (form == Form::Matched).then_some(&self.softness[..]);
        self.inertia.assemble(data, &self.unconstrained, &self.aref, softness, system)
    }

    /// Accelerations and constraint forces of multipliers, as [`Inertia::acceleration`].
    ///
    /// # Errors
    /// Those of [`Inertia::acceleration`].
    pub fn acceleration(
        &mut self,
        data: &mut Data,
        system: &mut ConstrainedSystem,
        multipliers: &[f64],
        qfrc: &mut [f64],
        qacc: &mut [f64],
    ) -> Result<(), Error> {
        self.inertia.acceleration(data, system, multipliers, qfrc, qacc)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use crate::library::Jacobian;
    use crate::library::testing::{LENGTH, PENDULUM, data, model};

    #[test]
    fn j_is_the_same_dense_and_in_compressed_rows() {
        let kept = |kind: &str| {
            let model = model(&PENDULUM.replace("<option ", &format!(r#"<option jacobian="{kind}" "#)));
            let state = data(&model, &[0.3, 0.1], &[1.0, -0.5]);
            let mut jacobian = Jacobian::default();
            jacobian.read(&state);
            (model.is_sparse(), jacobian.entries().to_vec())
        };
        let ((dense, entries), (sparse, same)) = (kept("dense"), kept("sparse"));
        assert_eq!((dense, sparse), (false, true));
        assert_eq!(entries, same);
        // The direction of the rope.
        let length = f64::hypot(0.3, 0.1 - LENGTH);
        for (entry, expected) in entries.iter().zip([0.3 / length, (0.1 - LENGTH) / length]) {
            assert!((entry - expected).abs() < 1e-15, "{entries:?}");
        }
    }
}
