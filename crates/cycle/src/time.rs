//! Instants of a cycle.

/// Seconds of a nanosecond.
pub(crate) const SECONDS_PER_NS: f64 = 1e-9;

/// An instant, ns on the caller's clock. Only differences matter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Stamp(pub u64);

/// The instants of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Instants {
    /// Transmission of SYNC: drives and sensors that follow SYNC sample at this instant.
    pub sync: Stamp,
    /// End of the collection of answers: now.
    pub now: Stamp,
}
