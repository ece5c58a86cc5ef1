//! Texts of fixed length, for records.

use crate::layout::{Layout, Shape};
use crate::records::Zero;

/// UTF-8 text of at most `N` bytes, padded with zero bytes.
#[repr(transparent)]
#[derive(
    Clone, Copy, PartialEq, Eq, zerocopy::FromBytes, zerocopy::IntoBytes, zerocopy::Immutable,
)]
pub struct Text<const N: usize>([u8; N]);

/// A name: at most 48 bytes.
pub type Name = Text<48>;

impl<const N: usize> Text<N> {
    /// The text; a longer one is cut at a character's border.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let mut end = text.len().min(N);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut bytes = [0; N];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        Self(bytes)
    }

    /// The text; empty if the bytes are not UTF-8 (written by another process).
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(N);
        core::str::from_utf8(&self.0[..end]).unwrap_or_default()
    }
}

impl<const N: usize> Layout for Text<N> {
    const SHAPE: Shape = <[u8; N]>::SHAPE;
}

impl<const N: usize> Zero for Text<N> {
    const ZERO: Self = Self([0; N]);
}

impl<const N: usize> core::fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

impl<const N: usize> core::fmt::Display for Text<N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::Name;

    #[test]
    fn keeps_short_names_and_cuts_long_ones_between_characters() {
        assert_eq!(Name::new("hip_yaw").as_str(), "hip_yaw");
        let long = "é".repeat(40);
        assert_eq!(Name::new(&long).as_str(), "é".repeat(24));
        let odd = format!("a{long}");
        assert_eq!(Name::new(&odd).as_str(), format!("a{}", "é".repeat(23)));
    }
}
