//! `sampled`, `latency_us`, `period_us`: the instants at which a drive or sensor samples.

use crate::reader::{Allowed, Section};

/// Largest latency, skew or sensor period, in periods of the loop.
pub(crate) const MAX_PERIODS: f64 = 16.0;

/// The instants at which samples are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// The event that determines a sample's instant.
    pub sampled: Sampled,
    /// Time by which a sample is older than that event, s: caused by a low-pass in the sensor or a
    /// slow interface, for example.
    pub latency: f64,
}

/// The event that determines a sample's instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampled {
    /// SYNC: the sensor samples when it receives SYNC, and answers later.
    AtSync,
    /// The frame's stamp: the sensor samples by a clock of its own and sends at once.
    WhenSent {
        /// Time between its samples, s.
        period: f64,
    },
}

impl Sampling {
    /// At SYNC, without latency.
    pub const AT_SYNC: Self = Self {
        sampled: Sampled::AtSync,
        latency: 0.0,
    };

    /// Samples belong to SYNC: they need no alignment.
    #[must_use]
    pub fn is_at_sync(&self) -> bool {
        self.sampled == Sampled::AtSync && self.latency == 0.0
    }

    /// Longest time between the samples of two successive cycles, s: the first may be almost one of
    /// the sensor's periods old, the second new.
    #[must_use]
    pub fn longest_gap(&self, sample_period: f64) -> f64 {
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
    let longest = MAX_PERIODS * sample_period * 1e6;
    let latency = section.number_or("latency_us", 0.0, Allowed::Within(-longest, longest));
    let allowed = Allowed::Within(0.01 * sample_period * 1e6, longest);
    let period = section.optional_number("period_us", allowed);
    if period.is_some() && !sent {
        section.problem(
            "period_us",
            "a source that is sampled at SYNC has no period of its own",
            "sampled = \"when_sent\", or no key period_us",
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
