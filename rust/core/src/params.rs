//! Options by name, for solvers that are made from a string such as `sr1:eps_abs=1e-7`.

pub(crate) mod value;

use std::collections::BTreeMap;

pub use value::Value;

use crate::error::Error;

/// Options of a solver: values by name. A solver reads its own through a [`Reader`], which refuses unknown names.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options(BTreeMap<String, Value>);

impl Options {
    /// Returns no options, which stand for the defaults of any solver.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an option; a name that is given twice keeps the last value.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> Self {
        self.0.insert(name.to_owned(), value.into());
        self
    }

    /// Starts reading the options of `solver`.
    fn reader(&self, solver: &'static str) -> Reader<'_> {
        Reader { solver, given: &self.0, known: Vec::new() }
    }
}

/// Reads the options of one solver and remembers the names that it knows.
#[derive(Debug)]
pub struct Reader<'a> {
    solver: &'static str,
    given: &'a BTreeMap<String, Value>,
    known: Vec<(&'static str, Value)>,
}

impl Reader<'_> {
    fn read(
        &mut self,
        option: &'static str,
        default: impl Into<Value>,
        expected: &'static str,
        valid: impl Fn(f64) -> bool,
    ) -> Result<f64, Error> {
        let value = self.value(option, default);
        if valid(value.number()) {
            Ok(value.number())
        } else {
            Err(Error::OptionValue { solver: self.solver, option, value, expected })
        }
    }

    /// What was given, or the default.
    fn value(&mut self, option: &'static str, default: impl Into<Value>) -> Value {
        let default = default.into();
        self.known.push((option, default));
        self.given.get(option).copied().unwrap_or(default)
    }

    /// Reads a number in (0, ∞).
    ///
    /// # Errors
    /// [`Error::OptionValue`] outside that range.
    pub fn positive(&mut self, option: &'static str, default: f64) -> Result<f64, Error> {
        self.read(option, default, "a finite number > 0", |v| v.is_finite() && v > 0.0)
    }

    /// Reads a number in [0, ∞).
    ///
    /// # Errors
    /// [`Error::OptionValue`] outside that range.
    pub fn non_negative(&mut self, option: &'static str, default: f64) -> Result<f64, Error> {
        self.read(option, default, "a finite number ≥ 0", |v| v.is_finite() && v >= 0.0)
    }

    /// Reads a number in [0, 1).
    ///
    /// # Errors
    /// [`Error::OptionValue`] outside that range.
    pub fn fraction(&mut self, option: &'static str, default: f64) -> Result<f64, Error> {
        self.read(option, default, "a number in [0, 1)", |v| (0.0..1.0).contains(&v))
    }

    /// Reads a whole number from 1 to 10⁶.
    ///
    /// # Errors
    /// [`Error::OptionValue`] outside that range or with a fraction.
    pub fn count(&mut self, option: &'static str, default: u32) -> Result<usize, Error> {
        let valid = |v: f64| v.fract() == 0.0 && (1.0..=1e6).contains(&v);
        let value = self.read(option, i64::from(default), "a whole number from 1 to 1000000", valid)?;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked just above
        Ok(value as usize)
    }

    /// Reads a whole number from 0 to `most`.
    ///
    /// # Errors
    /// [`Error::OptionValue`] outside that range or with a fraction.
    pub fn count_to(&mut self, option: &'static str, default: u32, most: usize) -> Result<usize, Error> {
        let valid = |v: f64| v.fract() == 0.0 && v >= 0.0 && v <= most as f64;
        let value = self.read(option, i64::from(default), "a small whole number ≥ 0", valid)?;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked just above
        Ok(value as usize)
    }

    /// Reads a switch: off (false or 0) or on (true or 1).
    ///
    /// # Errors
    /// [`Error::OptionValue`] for anything else.
    pub fn switch(&mut self, option: &'static str, default: bool) -> Result<bool, Error> {
        match self.value(option, default) {
            Value::Switch(value) => Ok(value),
            Value::Integer(0) | Value::Float(0.0) => Ok(false),
            Value::Integer(1) | Value::Float(1.0) => Ok(true),
            value => {
                let expected = "a switch: 0 or 1";
                Err(Error::OptionValue { solver: self.solver, option, value, expected })
            }
        }
    }

    /// Refuses the options that nobody read.
    fn finish(&self) -> Result<(), Error> {
        let unknown = self.given.keys().find(|name| self.known.iter().all(|(known, _)| known != name));
        match unknown {
            None => Ok(()),
            Some(option) => {
                let valid = self.known.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
                Err(Error::UnknownOption { solver: self.solver, option: option.clone(), valid })
            }
        }
    }
}

/// The parameters of one solver.
pub trait Params: Sized {
    /// Name of the solver that they belong to.
    const SOLVER: &'static str;

    /// Reads every option of the solver, with its default.
    ///
    /// # Errors
    /// [`Error::OptionValue`].
    fn read(reader: &mut Reader<'_>) -> Result<Self, Error>;

    /// Reads the options and refuses unknown names.
    ///
    /// # Errors
    /// [`Error::OptionValue`], [`Error::UnknownOption`].
    fn from_options(options: &Options) -> Result<Self, Error> {
        let mut reader = options.reader(Self::SOLVER);
        let params = Self::read(&mut reader)?;
        reader.finish()?;
        Ok(params)
    }

    /// Returns the names and defaults of the options.
    fn defaults() -> Vec<(&'static str, Value)> {
        let options = Options::new();
        let mut reader = options.reader(Self::SOLVER);
        // The defaults are valid: a test builds every solver from them.
        let _ = Self::read(&mut reader);
        reader.known
    }
}
