//! Place and coding of a signal's bits in a frame.

use crate::frame::MAX_DATA;

/// Bytes read at once: nine would do for 64 bits that begin inside a byte.
const WINDOW: usize = 16;

/// Meaning of a signal's bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// Unsigned integer.
    Unsigned,
    /// Two's complement integer.
    Signed,
    /// 32-bit IEEE 754 float.
    Float32,
    /// 64-bit IEEE 754 float.
    Float64,
}

impl Coding {
    /// The signal counts: it is no float.
    #[must_use]
    pub fn is_integer(self) -> bool {
        matches!(self, Self::Unsigned | Self::Signed)
    }
}

/// A signal's place, compiled: one load, one shift, one mask.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Packing {
    /// First byte of the window that holds the signal; the window never leaves the frame's data.
    window: u8,
    /// Bits to the right of the signal once the window is read as a number.
    shift: u8,
    /// Bits of the signal, 1 to 64.
    size: u8,
    big_endian: bool,
    coding: Coding,
}

impl Packing {
    /// The place of a signal as a DBC file gives it: `start_bit` is the least significant bit's
    /// number for little endian and the most significant bit's for big endian, bit 0 being the
    /// least significant of byte 0 and bit 7 its most significant.
    pub(crate) fn new(start_bit: usize, size: usize, big_endian: bool, coding: Coding) -> Self {
        debug_assert!((1..=64).contains(&size) && start_bit < 8 * MAX_DATA);
        let window = (start_bit / 8).min(MAX_DATA - WINDOW);
        let start_byte = start_bit / 8 - window;
        let shift = if big_endian {
            let bits_before = 8 * start_byte + 7 - start_bit % 8;
            (8 * WINDOW).saturating_sub(bits_before + size)
        } else {
            8 * start_byte + start_bit % 8
        };
        Self {
            window: window as u8,
            shift: shift as u8,
            size: size as u8,
            big_endian,
            coding,
        }
    }

    fn mask(self) -> u64 {
        u64::MAX >> (64 - u32::from(self.size))
    }

    fn read_window(self, data: &[u8; MAX_DATA]) -> u128 {
        let mut bytes = [0; WINDOW];
        let first = usize::from(self.window);
        bytes.copy_from_slice(&data[first..first + WINDOW]);
        if self.big_endian {
            u128::from_be_bytes(bytes)
        } else {
            u128::from_le_bytes(bytes)
        }
    }

    /// The signal's count or float as a number, before any scaling.
    pub(crate) fn read(self, data: &[u8; MAX_DATA]) -> f64 {
        let bits = (self.read_window(data) >> self.shift) as u64 & self.mask();
        match self.coding {
            Coding::Unsigned => bits as f64,
            Coding::Signed => {
                let unused = 64 - u32::from(self.size);
                (((bits << unused) as i64) >> unused) as f64
            }
            Coding::Float32 => f64::from(f32::from_bits(bits as u32)),
            Coding::Float64 => f64::from_bits(bits),
        }
    }

    /// Puts the nearest count, or the float, into the frame's data.
    pub(crate) fn write(self, data: &mut [u8; MAX_DATA], raw: f64) {
        let bits = match self.coding {
            // A number beyond the type becomes its end.
            Coding::Unsigned => (raw.round_ties_even() as u64).min(self.mask()),
            Coding::Signed => {
                let most = (self.mask() >> 1) as i64;
                (raw.round_ties_even() as i64).clamp(-most - 1, most) as u64
            }
            Coding::Float32 => u64::from((raw as f32).to_bits()),
            Coding::Float64 => raw.to_bits(),
        };
        let mask = u128::from(self.mask()) << self.shift;
        let value = (u128::from(bits) << self.shift) & mask;
        let window = self.read_window(data) & !mask | value;
        let bytes = if self.big_endian {
            window.to_be_bytes()
        } else {
            window.to_le_bytes()
        };
        let first = usize::from(self.window);
        data[first..first + WINDOW].copy_from_slice(&bytes);
    }

    fn integer_range(self) -> (i128, i128) {
        match self.coding {
            Coding::Signed => {
                let half = 1i128 << (self.size - 1);
                (-half, half - 1)
            }
            _ => (0, i128::from(self.mask())),
        }
    }

    /// Least and greatest number that the signal's bits can hold.
    pub(crate) fn range(self) -> (f64, f64) {
        match self.coding {
            Coding::Float32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
            Coding::Float64 => (f64::MIN, f64::MAX),
            _ => {
                let (min, max) = self.integer_range();
                (min as f64, max as f64)
            }
        }
    }
}

/// The bits of a frame that a signal covers, as numbers 8 · byte + bit of significance.
pub(crate) fn covered_bits(
    start_bit: usize,
    size: usize,
    big_endian: bool,
) -> impl Iterator<Item = usize> {
    (0..size).map(move |i| {
        if big_endian {
            // Downwards inside a byte, then on to the next byte's most significant bit.
            let position = 8 * (start_bit / 8) + 7 - start_bit % 8 + i;
            8 * (position / 8) + 7 - position % 8
        } else {
            start_bit + i
        }
    })
}
