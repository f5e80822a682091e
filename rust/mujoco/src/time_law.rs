//! Scalar laws of time, for drives: `omega*t - k*sin(omega*t)`.

use std::collections::BTreeMap;
use std::fmt;

use exmex::{Express, FlatEx, FloatOpsFactory, MatchLiteral, literal_matcher_from_pattern};

use crate::error::Error;

// exmex's own numbers have no exponents.
literal_matcher_from_pattern!(Decimal, r"^(\.?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?)");

/// Name of the time variable, in seconds.
const TIME: &str = "t";

/// A parsed law. The language is arithmetic (`+ - * / ^`), the usual functions (`sin`, `exp`, `sqrt`, …), `PI`, the
/// time `t` and the constants handed over; there is nothing in it that could have an effect.
#[derive(Debug, Clone)]
pub struct TimeLaw {
    source: String,
    expression: FlatEx<f64, FloatOpsFactory<f64>, Decimal>,
    /// Values in the order of the expression's variables; the slot of `t` is written by [`at`](Self::at).
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
        Ok(Self { source: source.to_owned(), expression, values, time_slot })
    }

    /// Whether it does not depend on the time.
    #[must_use]
    pub const fn is_constant(&self) -> bool {
        self.time_slot.is_none()
    }

    /// The value at time `t` in seconds; NaN where the law has none (√ of a negative number, say).
    pub fn at(&mut self, t: f64) -> f64 {
        if let Some(slot) = self.time_slot {
            self.values[slot] = t;
        }
        self.expression.eval(&self.values).unwrap_or(f64::NAN)
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
    fn outside_its_domain_a_law_is_nan() {
        assert!(law("sqrt(-1 - t)").unwrap().at(1.0).is_nan());
    }
}
