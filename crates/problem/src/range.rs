//! Ranges of numbers that an input may have.

use core::fmt;

/// Numbers that an input may have; never NaN or infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// Any finite number.
    Finite,
    /// Finite, above zero.
    Positive,
    /// Finite, zero or above.
    NonNegative,
    /// Both ends allowed.
    Within(f64, f64),
    /// The second end not allowed.
    Below(f64, f64),
}

impl Allowed {
    /// True if the number is allowed.
    #[must_use]
    pub fn admits(self, x: f64) -> bool {
        x.is_finite()
            && match self {
                Self::Finite => true,
                Self::Positive => x > 0.0,
                Self::NonNegative => x >= 0.0,
                Self::Within(min, max) => (min..=max).contains(&x),
                Self::Below(min, end) => (min..end).contains(&x),
            }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finite => f.write_str("a finite number"),
            Self::Positive => f.write_str("a finite number > 0"),
            Self::NonNegative => f.write_str("a finite number >= 0"),
            Self::Within(min, max) => write!(f, "a number from {min} to {max}"),
            Self::Below(min, end) => write!(f, "a number from {min} to below {end}"),
        }
    }
}
