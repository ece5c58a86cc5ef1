//! `sampled`, `latency_us`, `period_us`: when a drive or sensor takes its samples.

use crate::reader::{Allowed, Section};

/// Periods of the loop that a latency, a skew or a sensor's own period may last.
pub(crate) const LONGEST: f64 = 16.0;

/// When samples are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// What a sample's instant hangs on.
    pub sampled: Sampled,
    /// How much earlier than that it truly is, s: a low-pass in the sensor, a slow interface.
    pub latency: f64,
}

/// What a sample's instant hangs on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampled {
    /// SYNC: the sensor samples when it hears it, and answers later.
    AtSync,
    /// The frame's stamp: the sensor samples by a clock of its own and sends at once.
    WhenSent {
        /// Time between its samples, s.
        period: f64,
    },
}

impl Sampling {
    /// At SYNC, at once.
    pub const AT_SYNC: Self = Self {
        sampled: Sampled::AtSync,
        latency: 0.0,
    };

    /// Samples are as old as SYNC: there is nothing to align.
    #[must_use]
    pub fn is_at_sync(&self) -> bool {
        self.sampled == Sampled::AtSync && self.latency == 0.0
    }

    /// Longest time between the samples of two cycles, s: the first may be almost one of its own
    /// periods old, the second new.
    pub(crate) fn longest_gap(&self, sample_period: f64) -> f64 {
        match self.sampled {
            Sampled::AtSync => sample_period,
            Sampled::WhenSent { period } => sample_period + period,
        }
    }

    /// The sensor waits for SYNC before it sends.
    #[must_use]
    pub fn answers(&self) -> bool {
        self.sampled == Sampled::AtSync
    }
}

/// The keys in a table `[drive.NAME]`, `[imu]` or `[[ft_sensor]]`.
pub(crate) fn read(section: &Section<'_, '_>, sample_period: f64) -> Sampling {
    let sent = section.choice_or("sampled", false, &[("at_sync", false), ("when_sent", true)]);
    let longest = LONGEST * sample_period * 1e6;
    let latency = section.number_or("latency_us", 0.0, Allowed::Within(-longest, longest));
    let allowed = Allowed::Within(0.01 * sample_period * 1e6, longest);
    let period = section.optional_number("period_us", allowed);
    if period.is_some() && !sent {
        section.problem(
            "period_us",
            "a period of its own is not allowed for a sensor sampled at SYNC",
            "sampled = \"when_sent\", or no period_us",
        );
    }
    Sampling {
        sampled: if sent {
            Sampled::WhenSent {
                period: period.map_or(sample_period, |us| us * 1e-6),
            }
        } else {
            Sampled::AtSync
        },
        latency: latency * 1e-6,
    }
}
