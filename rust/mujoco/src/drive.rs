//! The drive: actuator controls as laws of time, written at the time of every stage of the integrator.

use crate::error::Error;
use crate::library::{Controls, Data};
use crate::time_law::TimeLaw;

/// Laws of some of the actuators.
#[derive(Debug, Clone, Default)]
pub struct Drive {
    laws: Vec<(usize, TimeLaw)>,
    failed: Option<Error>,
}

impl Drive {
    /// Actuators with their laws.
    #[must_use]
    pub const fn new(laws: Vec<(usize, TimeLaw)>) -> Self {
        Self { laws, failed: None }
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.laws.is_empty()
    }

    /// Writes the controls at the data's time.
    ///
    /// # Errors
    /// [`Error::Control`]: a law has no finite value there.
    pub fn apply(&mut self, data: &mut Data) -> Result<(), Error> {
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
        Drive::new(vec![(actuator, TimeLaw::parse(law, &BTreeMap::new()).expect(law))])
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
