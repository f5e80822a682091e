//! The numbers that systems are made of.

use arbitrary::{Result, Unstructured};

/// Numbers at the edges of what floats can do, and just where tolerances lie.
pub const SPECIAL: [f64; 24] = [
    0.0,
    -0.0,
    5e-324,
    f64::MIN_POSITIVE,
    1e-300,
    1e-200,
    1e-154,
    1e-100,
    1e-16,
    f64::EPSILON,
    1e-12,
    1e-10,
    1e-8,
    1.0 + f64::EPSILON,
    1e8,
    1e100,
    1e154,
    1e200,
    1e300,
    f64::MAX,
    -f64::MAX,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

/// Where the numbers of an array come from.
#[derive(Debug, Clone, Copy)]
pub enum Palette {
    /// Halves from −4 to 4: sums of their products are exact, so that ranks are what they look like.
    Small,
    /// The same times a power of two.
    Scaled(f64),
    /// Those and the special ones.
    Wild,
}

impl Palette {
    /// One of them.
    ///
    /// # Errors
    /// None in practice.
    pub fn read(u: &mut Unstructured<'_>) -> Result<Self> {
        Ok(match u.int_in_range(0..=7_u8)? {
            0..=4 => Self::Small,
            5 | 6 => Self::Scaled(f64::from(u.int_in_range(-510..=510_i16)?).exp2()),
            _ => Self::Wild,
        })
    }

    /// A positive number of its scale.
    #[must_use]
    pub const fn unit(self) -> f64 {
        match self {
            Self::Small | Self::Wild => 1.0,
            Self::Scaled(scale) => scale,
        }
    }

    /// A number.
    ///
    /// # Errors
    /// None in practice.
    pub fn number(self, u: &mut Unstructured<'_>) -> Result<f64> {
        let byte = u.arbitrary::<u8>()?;
        if matches!(self, Self::Wild) && byte >= 128 {
            return Ok(SPECIAL[usize::from(byte) % SPECIAL.len()]);
        }
        Ok(0.5 * (f64::from((u16::from(byte) + 8) % 17) - 8.0) * self.unit())
    }

    /// As many.
    ///
    /// # Errors
    /// None in practice.
    pub fn numbers(self, u: &mut Unstructured<'_>, count: usize) -> Result<Vec<f64>> {
        (0..count).map(|_| self.number(u)).collect()
    }
}
