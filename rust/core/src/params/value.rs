//! The value of an option: a number, a whole number or a switch.

use std::fmt;

/// The value of an option.
///
/// An integer may stand for a number, and a whole float for an integer or a switch, because a string does not say which is
/// meant. A switch stands for nothing else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A number.
    Float(f64),
    /// A whole number.
    Integer(i64),
    /// On or off.
    Switch(bool),
}

impl Value {
    /// As a number; NaN, which no option takes, for a switch.
    #[allow(clippy::cast_precision_loss)] // Whole numbers beyond 2⁵³ are out of every range.
    pub(super) const fn number(self) -> f64 {
        match self {
            Self::Float(value) => value,
            Self::Integer(value) => value as f64,
            Self::Switch(_) => f64::NAN,
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Float(value) => value.fmt(formatter),
            Self::Integer(value) => value.fmt(formatter),
            Self::Switch(value) => value.fmt(formatter),
        }
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Float(value)
    }
}

impl From<i32> for Value {
    fn from(value: i32) -> Self {
        Self::Integer(value.into())
    }
}

impl From<i64> for Value {
    fn from(value: i64) -> Self {
        Self::Integer(value)
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Switch(value)
    }
}
