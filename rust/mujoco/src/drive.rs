//! The drive: actuator controls as laws of time, written at the time of every stage of the integrator, or held over a step.

use crate::error::Error;
use crate::library::{Controls, Data};
use crate::time_law::TimeLaw;

/// Part of the time that a control is held for by which a time may miss its multiples: times are sums of timesteps.
const OFF: f64 = 1e-3;

/// Laws of some of the actuators.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    laws: Vec<(usize, TimeLaw)>,
    /// s; controls change at multiples of it only.
    held_s: Option<f64>,
    failed: Option<Error>,
}

impl Drive {
    /// Actuators with their laws, and for how long (s) a control is held; nothing: it follows its law at every stage.
    #[must_use]
    pub const fn new(laws: Vec<(usize, TimeLaw)>, held_s: Option<f64>) -> Self {
        Self { laws, held_s, failed: None }
    }

    /// Whether MuJoCo has to ask at the stages of an integrator.
    #[must_use]
    pub const fn is_staged(&self) -> bool {
        !self.laws.is_empty() && self.held_s.is_none()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.laws.is_empty()
    }

    /// Writes the controls at the data's time, the start of a step; one that is held stays as it is until its time is over.
    ///
    /// # Errors
    /// [`Error::Control`]: a law has no finite value there.
    pub fn apply(&mut self, data: &mut Data) -> Result<(), Error> {
        if let Some(held_s) = self.held_s {
            let ticks = data.time() / held_s;
            if (ticks - ticks.round()).abs() > OFF {
                return Ok(());
            }
        }
        self.write_at(data)
    }

    /// Writes the controls at the time of a later stage of a step; one that is held stays as it is.
    ///
    /// # Errors
    /// [`Error::Control`]: a law has no finite value there.
    pub fn apply_at_stage(&mut self, data: &mut Data) -> Result<(), Error> {
        if self.held_s.is_some() { Ok(()) } else { self.write_at(data) }
    }

    fn write_at(&mut self, data: &mut Data) -> Result<(), Error> {
        if self.laws.is_empty() {
            return Ok(());
        }
        let time = data.time();
        self.write(time, data.ctrl_mut());
        self.take_failure()
    }

    /// What went wrong while MuJoCo asked: it cannot be told there.
    ///
    /// # Errors
    /// [`Error::Control`].
    pub fn take_failure(&mut self) -> Result<(), Error> {
        self.failed.take().map_or(Ok(()), Err)
    }
}

impl Controls for Drive {
    fn write(&mut self, time: f64, ctrl: &mut [f64]) {
        for (law, (actuator, at)) in self.laws.iter_mut().enumerate() {
            let value = at.at(time);
            if !value.is_finite() {
                self.failed.get_or_insert(Error::Control { law, value, time });
            } else if let Some(control) = ctrl.get_mut(*actuator) {
                *control = value;
            }
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::library::testing::{data, model};
    use crate::library::with_controls;

    const DRIVEN: &str = r#"<mujoco>
      <option timestep=".25" integrator="RK4"/>
      <worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>
      <actuator><motor joint="j"/><motor joint="j"/></actuator>
    </mujoco>"#;

    fn drive(actuator: usize, law: &str) -> Drive {
        Drive::new(vec![(actuator, TimeLaw::parse(law, &BTreeMap::new()).expect(law))], None)
    }

    #[test]
    fn controls_are_the_laws_at_the_time_of_the_state_and_others_are_left_alone() {
        let model = model(DRIVEN);
        let mut state = data(&model, &[0.0], &[0.0]);
        state.set_time(3.0);
        state.ctrl_mut().copy_from_slice(&[7.0, 7.0]);
        drive(1, "2*t").apply(&mut state).expect("finite");
        assert_eq!(state.ctrl_mut(), [7.0, 6.0]);
        Drive::default().apply(&mut state).expect("nothing to do");
        assert_eq!(state.ctrl_mut(), [7.0, 6.0]);
    }

    #[test]
    fn a_held_control_changes_at_multiples_of_its_time_only_and_at_no_stage() {
        let model = model(DRIVEN);
        let mut state = data(&model, &[0.0], &[0.0]);
        let law = TimeLaw::parse("t", &BTreeMap::new()).expect("a law");
        let mut drive = Drive::new(vec![(0, law)], Some(0.25));
        assert!(!drive.is_staged());
        for (time, expected) in
            [(0.0, 0.0), (0.125, 0.0), (0.25, 0.25), (0.375, 0.25), (0.5 - 1e-9, 0.5 - 1e-9)]
        {
            state.set_time(time);
            drive.apply(&mut state).expect("finite");
            assert_eq!(state.ctrl_mut()[0].to_bits(), f64::to_bits(expected), "{time}");
        }
        state.set_time(0.75);
        drive.apply_at_stage(&mut state).expect("nothing");
        assert_eq!(state.ctrl_mut()[0].to_bits(), (0.5_f64 - 1e-9).to_bits());
    }

    #[test]
    fn a_law_without_a_value_is_told_once_with_its_number_and_time() {
        let model = model(DRIVEN);
        let mut state = data(&model, &[0.0], &[0.0]);
        state.set_time(2.0);
        let mut drive = drive(0, "sqrt(1 - t)");
        let Err(Error::Control { law: 0, value, time: 2.0 }) = drive.apply(&mut state) else {
            panic!("√−1")
        };
        assert!(value.is_nan());
        assert_eq!(drive.take_failure(), Ok(()));
        state.set_time(1.0);
        assert_eq!(drive.apply(&mut state), Ok(()));
    }

    #[test]
    fn runge_kutta_asks_at_the_time_of_each_stage() {
        struct Clock(Vec<f64>);
        impl Controls for Clock {
            fn write(&mut self, time: f64, ctrl: &mut [f64]) {
                assert_eq!(ctrl.len(), 2);
                self.0.push(time);
            }
        }
        let model = model(DRIVEN);
        let mut state = data(&model, &[0.0], &[0.0]);
        state.set_time(1.0);
        state.forward().expect("a state");
        let mut clock = Clock(Vec::new());
        with_controls(&model, &mut clock, || state.integrate()).expect("a step");
        assert_eq!(clock.0, [1.125, 1.125, 1.25]);
        state.forward().expect("nobody is asked any more");
        assert_eq!(clock.0.len(), 3);
    }
}
