//! Numbers as counts of a range.

/// The count of `bits` bits nearest to a number, of a range from `low` to `high`.
pub(super) fn count(x: f64, low: f64, high: f64, bits: u32) -> u32 {
    let most = f64::from((1u32 << bits) - 1);
    let count = (x.max(low).min(high) - low) / (high - low) * most;
    count.round_ties_even() as u32
}

/// The number that a count stands for.
pub(super) fn number(count: u32, low: f64, high: f64, bits: u32) -> f64 {
    let most = f64::from((1u32 << bits) - 1);
    low + f64::from(count) / most * (high - low)
}

/// Bits in a row, the most significant first.
#[derive(Default)]
pub(super) struct Bits {
    value: u64,
    used: u32,
}

impl Bits {
    /// Appends a count.
    pub(super) fn push(mut self, count: u32, bits: u32) -> Self {
        self.value = self.value << bits | u64::from(count);
        self.used += bits;
        self
    }

    /// The bytes of a frame.
    pub(super) fn bytes(self) -> [u8; 8] {
        (self.value << (64 - self.used)).to_be_bytes()
    }
}

/// Bits `first` to `first + bits` of a frame, the most significant first.
pub(super) fn take(data: &[u8; 8], first: u32, bits: u32) -> u32 {
    let value = u64::from_be_bytes(*data) << first >> (64 - bits);
    value as u32
}

/// All numbers of a command are finite.
pub(super) fn is_finite(set_point: &super::SetPoint) -> bool {
    let s = set_point;
    [s.position, s.velocity, s.torque, s.kp, s.kd]
        .iter()
        .all(|x| x.is_finite())
}
