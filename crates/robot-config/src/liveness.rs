//! `flat_after_ms`, and what makes a signal flat or saturated.

use crate::reader::{Allowed, Section};
use crate::sampling::{Sampled, Sampling};
use crate::wiring::Reach;
use supervisor::SignalParameters;

/// Equal samples in a row after which a sensor is flat, by its key; none: by its noise.
pub(crate) fn flat_after(
    section: &Section<'_, '_>,
    sampling: &Sampling,
    sample_period: f64,
) -> Option<u32> {
    let period = match sampling.sampled {
        Sampled::AtSync => sample_period,
        Sampled::WhenSent { period } => period,
    };
    let ms = section.optional_number("flat_after_ms", Allowed::Within(1.0, 3_600_000.0))?;
    Some((ms * 1e-3 / period).ceil().max(1.0) as u32)
}

/// Range and noise of a signal; `sigma`: of one sample, zero where it is not known.
pub(crate) fn signal(
    reach: Option<Reach>,
    sigma: f64,
    flat_after: Option<u32>,
) -> SignalParameters {
    let (resolution, [min, max]) = match reach {
        Some(reach) => (reach.resolution, reach.ends),
        None => (0.0, [f64::NEG_INFINITY, f64::INFINITY]),
    };
    SignalParameters {
        min,
        max,
        resolution,
        flat_after: flat_after.or_else(|| SignalParameters::flat_after(resolution, sigma)),
    }
}
