//! Signals that no longer measure: values that stay the same for longer than their noise explains,
//! or that stand at an end of their range.
//!
//! A sample whose noise has the standard deviation `sigma` falls on a given count of width
//! `resolution` with a probability of at most `p = resolution / (sqrt(2 pi) sigma)`, the greatest
//! density times the width. So many equal samples in a row that `p` to their power is one in 10¹²
//! are a sensor that has stopped; a sensor whose noise is below a count may rest for ever, and is
//! not judged, unless the configuration gives a time.

use core::f64::consts::TAU;

use crate::in_a_row::count_in_a_row;

/// Probability at which equal samples are no chance: thirty signals at 1 kHz make 10¹² samples in a
/// year.
const CHANCE: f64 = 1e-12;
/// The least noise that a sensor has, as a share of the standard deviation that its data sheet gives as the greatest.
/// Chosen; no experiment recorded.
const LEAST_NOISE: f64 = 0.25;
/// Successive samples that depend on each other: a sensor's own low-pass may be this much slower than its samples.
/// Chosen; no experiment recorded.
const DEPENDENT_SAMPLES: f64 = 10.0;
/// Samples after which no judgement is made: ten seconds at 1 kHz. Chosen; no experiment recorded.
const MOST_SAMPLES: f64 = 10_000.0;

/// Range and noise of one signal, in the units of its value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalParameters {
    /// Least value that it may have.
    pub min: f64,
    /// Greatest value that it may have.
    pub max: f64,
    /// One count; 0 for floats.
    pub resolution: f64,
    /// Equal samples in a row after which it is flat; none: it may rest for ever.
    pub flat_after: Option<u32>,
}

impl SignalParameters {
    /// The parameters of a sensor that measures up to `range` in either direction.
    #[must_use]
    pub fn within(self, range: f64) -> Self {
        Self {
            min: self.min.max(-range),
            max: self.max.min(range),
            ..self
        }
    }

    /// Equal samples in a row that noise of this standard deviation makes by chance at most once
    /// in 10¹² samples; none where it may rest for ever.
    #[must_use]
    pub fn flat_after(resolution: f64, sigma: f64) -> Option<u32> {
        let density = 1.0 / (TAU.sqrt() * LEAST_NOISE * sigma);
        let share = resolution * density;
        let samples = match share {
            share if share.is_nan() || share >= 1.0 => return None,
            0.0 => 1.0,
            share => CHANCE.ln() / share.ln(),
        };
        let samples = (DEPENDENT_SAMPLES * samples.max(1.0)).ceil();
        (sigma > 0.0 && samples <= MOST_SAMPLES).then_some(samples as u32)
    }
}

/// Whether a sensor's signals can be measured values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Liveness {
    /// The signals can be measured values.
    Live,
    /// One of them stands at an end of its range.
    Saturated,
    /// One of them has stayed the same for too long.
    Flat,
}

/// One signal with its last value.
#[derive(Debug, Clone)]
struct Followed {
    parameters: SignalParameters,
    last: f64,
    /// Samples in a row that were the same as `last`.
    same: u32,
}

/// Follows the signals of one sensor.
#[derive(Debug, Clone)]
pub struct SignalMonitor {
    signals: Vec<Followed>,
}

impl SignalMonitor {
    /// Monitor of a sensor that has not sent anything.
    #[must_use]
    pub fn new(parameters: &[SignalParameters]) -> Self {
        let followed = |&parameters| Followed {
            parameters,
            last: f64::NAN,
            same: 0,
        };
        Self {
            signals: parameters.iter().map(followed).collect(),
        }
    }

    /// Takes one sample of each signal.
    pub fn update(&mut self, values: impl Iterator<Item = f64>) -> Liveness {
        let mut worst = Liveness::Live;
        for (signal, value) in self.signals.iter_mut().zip(values) {
            worst = worst.max(signal.update(value));
        }
        worst
    }
}

impl Followed {
    fn update(&mut self, value: f64) -> Liveness {
        let SignalParameters {
            min,
            max,
            resolution,
            flat_after,
        } = self.parameters;
        let same = count_in_a_row(&mut self.same, value == self.last);
        self.last = value;
        let half = 0.5 * resolution;
        // One that stays at an end of its range is no less saturated.
        if value <= min + half || value >= max - half {
            Liveness::Saturated
        } else if flat_after.is_some_and(|most| same >= most) {
            Liveness::Flat
        } else {
            Liveness::Live
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of twelve uniform numbers by a linear congruential generator, of deviation 1.
    fn noise(state: &mut u64) -> f64 {
        (0..12).fold(-6.0, |sum, _| {
            *state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum + (*state >> 11) as f64 / (1u64 << 53) as f64
        })
    }

    fn monitor(resolution: f64, sigma: f64) -> SignalMonitor {
        SignalMonitor::new(&[SignalParameters {
            min: -100.0,
            max: 100.0,
            resolution,
            flat_after: SignalParameters::flat_after(resolution, sigma),
        }])
    }

    #[test]
    fn a_live_sensor_is_never_flat_even_with_a_quarter_of_its_noise_and_a_low_pass() {
        for (resolution, pole) in [(0.01, 0.0), (0.1, 0.0), (0.3, 0.0), (0.1, 0.9)] {
            let mut monitor = monitor(resolution, 0.5);
            let mut state = 1;
            // The low-pass keeps the deviation.
            let (mut x, gain): (f64, f64) = (0.0, (1.0 - f64::powi(pole, 2)).sqrt());
            for _ in 0..300_000 {
                x = pole * x + gain * noise(&mut state);
                let value = (0.125 * x / resolution).round() * resolution;
                assert_eq!(monitor.update([value].into_iter()), Liveness::Live);
            }
        }
    }

    #[test]
    fn a_sensor_that_has_stopped_is_flat_until_it_moves() {
        for resolution in [0.0, 0.01, 0.1] {
            let mut monitor = monitor(resolution, 0.5);
            let mut state = 1;
            for _ in 0..100 {
                monitor.update([noise(&mut state)].into_iter());
            }
            let flat = (0..1000).position(|_| monitor.update([3.3].into_iter()) == Liveness::Flat);
            let after = flat.expect("flat");
            assert!((9..500).contains(&after), "{resolution}: {after}");
            assert_eq!(monitor.update([3.4].into_iter()), Liveness::Live);
        }
    }

    #[test]
    fn noise_below_a_count_is_not_judged() {
        assert_eq!(SignalParameters::flat_after(1.0, 0.3), None);
        assert_eq!(SignalParameters::flat_after(1.0, 0.0), None);
        assert_eq!(SignalParameters::flat_after(0.0, 0.0), None);
    }

    #[test]
    fn an_end_of_the_range_is_no_measured_value() {
        let mut monitor = monitor(0.1, 0.5);
        assert!((0..1000).all(|_| monitor.update([100.0].into_iter()) == Liveness::Saturated));
        for (value, expected) in [
            (99.9, Liveness::Live),
            (100.0, Liveness::Saturated),
            (-100.0, Liveness::Saturated),
            (-99.9, Liveness::Live),
        ] {
            assert_eq!(monitor.update([value].into_iter()), expected);
        }
    }
}
