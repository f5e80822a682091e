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
