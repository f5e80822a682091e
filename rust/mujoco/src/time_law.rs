//! Scalar laws of time, for drives: `omega*t - k*sin(omega*t)`, or samples of a log.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use exmex::{Express, FlatEx, FloatOpsFactory, MatchLiteral, literal_matcher_from_pattern};

use crate::error::Error;

// exmex's own numbers have no exponents.
literal_matcher_from_pattern!(Decimal, r"^(\.?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?)");

/// Name of the time variable, in seconds.
const TIME: &str = "t";

/// Part of an interval between samples by which the later one may be early: times are sums of timesteps, and rounded.
const EARLY: f64 = 1e-3;

/// A law: parsed, or the samples of a log. The language is arithmetic (`+ - * / ^`), the usual functions (`sin`, `exp`,
/// `sqrt`, …), `PI`, the time `t` and the constants handed over; there is nothing in it that could have an effect.
#[derive(Debug, Clone)]
pub struct TimeLaw {
    source: String,
    law: Law,
}

#[derive(Debug, Clone)]
enum Law {
    Expression(Box<Expression>),
    Samples { times: Arc<[f64]>, values: Arc<[f64]> },
}

#[derive(Debug, Clone)]
struct Expression {
    parsed: FlatEx<f64, FloatOpsFactory<f64>, Decimal>,
    /// Values in the order of the expression's variables; the slot of `t` is written by [`TimeLaw::at`].
    values: Vec<f64>,
    time_slot: Option<usize>,
}

impl TimeLaw {
    /// Parses `source`, with named constants.
    ///
    /// # Errors
    /// [`Error::TimeLaw`] if it does not parse, names something unknown, or a constant is not finite or called `t`.
    pub fn parse(source: &str, constants: &BTreeMap<String, f64>) -> Result<Self, Error> {
        let bad = |reason: String| Error::TimeLaw { law: source.to_owned(), reason };
        if source.trim().is_empty() {
            return Err(bad("is empty, expected an expression in t".to_owned()));
        }
        if constants.contains_key(TIME) {
            return Err(bad("a constant is called 't', which is the time".to_owned()));
        }
        if let Some(power) = signed_power(source) {
            let reason = format!("'{power}' can be read in two ways, expected -(a^b) or (-a)^b");
            return Err(bad(reason));
        }
        let expression = FlatEx::parse(source).map_err(|error| bad(error.msg().to_owned()))?;
        let mut values = Vec::new();
        let mut time_slot = None;
        for (slot, name) in expression.var_names().iter().enumerate() {
            if name == TIME {
                time_slot = Some(slot);
                values.push(0.0);
                continue;
            }
            let value = constants.get(name).copied().ok_or_else(|| {
                let known = constants.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
                bad(format!("unknown name '{name}', expected t, PI, a function or a constant ({known})"))
            })?;
            if !value.is_finite() {
                return Err(bad(format!("constant {name} = {value}, expected a finite number")));
            }
            values.push(value);
        }
        let parsed = Box::new(Expression { parsed: expression, values, time_slot });
        Ok(Self { source: source.to_owned(), law: Law::Expression(parsed) })
    }

    /// The law of a log: each value holds from its time (s) until the next one; the first also before, the last after it.
    ///
    /// A sample counts from a thousandth of the interval before its time on.
    ///
    /// # Errors
    /// [`Error::TimeLaw`] if there is no sample, not one value a time, a number is not finite, or the times do not rise.
    pub fn sampled(name: &str, times: &[f64], values: &[f64]) -> Result<Self, Error> {
        let bad = |reason: &str| Error::TimeLaw { law: name.to_owned(), reason: reason.to_owned() };
        if times.is_empty() || times.len() != values.len() {
            return Err(bad("has other times than values, or none, expected a value a time"));
        }
        if !times.iter().chain(values).all(|number| number.is_finite()) {
            return Err(bad("has a number that is not finite, expected finite ones"));
        }
        if !times.windows(2).all(|pair| pair[0] < pair[1]) {
            return Err(bad("has times that do not rise, expected each later than the one before"));
        }
        let law = Law::Samples { times: times.into(), values: values.into() };
        Ok(Self { source: name.to_owned(), law })
    }

    /// Whether it does not depend on the time.
    #[must_use]
    pub fn is_constant(&self) -> bool {
        match &self.law {
            Law::Expression(expression) => expression.time_slot.is_none(),
            Law::Samples { values, .. } => values.iter().all(|value| value.to_bits() == values[0].to_bits()),
        }
    }

    /// The value at time `t` in seconds; NaN where the law has none (√ of a negative number, say).
    pub fn at(&mut self, t: f64) -> f64 {
        match &mut self.law {
            Law::Expression(expression) => {
                if let Some(slot) = expression.time_slot {
                    expression.values[slot] = t;
                }
                expression.parsed.eval(&expression.values).unwrap_or(f64::NAN)
            }
            Law::Samples { times, values } => {
                let later = times.partition_point(|&time| time <= t);
                let reached = later.checked_sub(1).is_some_and(|last| {
                    times.get(later).is_some_and(|next| next - t <= EARLY * (next - times[last]))
                });
                values[(later + usize::from(reached)).saturating_sub(1)]
            }
        }
    }
}

/// A power whose base carries a sign, `-t^2`: exmex would take the sign first, a textbook the power.
fn signed_power(source: &str) -> Option<&str> {
    let bytes = source.as_bytes();
    let spaces = |mut at: usize| {
        while bytes.get(at).is_some_and(u8::is_ascii_whitespace) {
            at += 1;
        }
        at
    };
    (0..bytes.len()).filter(|&at| matches!(bytes[at], b'-' | b'+')).find_map(|sign| {
        // A sign, not a difference: nothing, an opening bracket, a comma or an operator stands before it.
        let before = source[..sign].trim_end().bytes().last();
        if !before.is_none_or(|byte| b"(,+-*/^".contains(&byte)) {
            return None;
        }
        let start = spaces(sign + 1);
        let mut end = start;
        while bytes
            .get(end)
            .is_some_and(|&byte| byte.is_ascii_alphanumeric() || b"._".contains(&byte) || !byte.is_ascii())
        {
            end += 1;
        }
        if bytes.get(end) == Some(&b'(') {
            let mut depth = 0;
            while let Some(byte) = bytes.get(end) {
                depth += i32::from(*byte == b'(') - i32::from(*byte == b')');
                end += 1;
                if depth == 0 {
                    break;
                }
            }
        }
        (end > start && bytes.get(spaces(end)) == Some(&b'^')).then(|| &source[sign..end])
    })
}

impl fmt::Display for TimeLaw {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn law(source: &str) -> Result<TimeLaw, Error> {
        let constants = BTreeMap::from([("omega".to_owned(), 2.0), ("k".to_owned(), 0.7)]);
        TimeLaw::parse(source, &constants)
    }

    #[test]
    fn evaluates_the_drive_of_the_boat() {
        let mut drive = law("omega*t - k*sin(omega*t)").unwrap();
        for t in [0.0_f64, 0.3, 11.9] {
            let expected = 2.0 * t - 0.7 * (2.0 * t).sin();
            assert!((drive.at(t) - expected).abs() <= 4.0 * f64::EPSILON * expected.abs().max(1.0));
        }
    }

    #[test]
    fn numbers_may_have_exponents() {
        assert!((law("1.5e-3*t + 2E2").unwrap().at(2.0) - 200.003).abs() < 1e-12);
    }

    #[test]
    fn a_sign_before_a_power_is_refused() {
        for source in ["-t^2", "k*-t^2", "3 - (-t ^2)", "-sin(t)^2", "-(1 + t)^2", "2^-t^2"] {
            assert!(law(source).expect_err(source).to_string().contains("two ways"), "{source}");
        }
        for source in ["1-t^2", "(-t)^2", "-(t^2)", "t^-2", "-t*k^2", "sin(t)-t^2"] {
            assert!(law(source).is_ok(), "{source}");
        }
    }

    #[test]
    fn a_law_without_time_is_constant() {
        let mut constant = law("k + 0.3").unwrap();
        assert_eq!(constant.at(5.0).to_bits(), constant.at(0.0).to_bits());
        assert!((constant.at(5.0) - 1.0).abs() < f64::EPSILON);
    }

    #[test]
    fn bad_laws_are_refused_by_name() {
        for (source, part) in
            [("", "empty"), ("sin(", "sin("), ("omega*u", "unknown name 'u'"), ("import os", "import")]
        {
            let message = law(source).expect_err(source).to_string();
            assert!(message.contains(part), "{source}: {message}");
        }
    }

    #[test]
    fn a_log_holds_each_value_until_the_next() {
        let mut log = TimeLaw::sampled("log", &[0.0, 0.1, 0.3], &[1.0, 2.0, 3.0]).unwrap();
        for (t, expected) in [
            (-1.0, 1.0),
            (0.0, 1.0),
            (0.0998, 1.0),
            (0.1 - 1e-9, 2.0),
            (0.1, 2.0),
            (0.29, 2.0),
            (0.3, 3.0),
            (9.0, 3.0),
        ] {
            assert_eq!(log.at(t).to_bits(), f64::to_bits(expected), "{t}");
        }
        assert!(!log.is_constant());
        assert!(TimeLaw::sampled("log", &[0.0, 1.0], &[2.0, 2.0]).unwrap().is_constant());
    }

    #[test]
    fn a_bad_log_is_refused() {
        for (times, values) in [
            (vec![], vec![]),
            (vec![0.0], vec![]),
            (vec![0.0, 0.0], vec![1.0; 2]),
            (vec![0.0], vec![f64::NAN]),
        ] {
            assert!(TimeLaw::sampled("log", &times, &values).is_err(), "{times:?} {values:?}");
        }
    }

    #[test]
    fn outside_its_domain_a_law_is_nan() {
        assert!(law("sqrt(-1 - t)").unwrap().at(1.0).is_nan());
    }
}
