//! Gain: the scale of a joint's fast torque, by regression over its changes.

use super::MIN_LEVELLED_GAIN;

/// Time constant of the high-pass that selects the changes, s.
const HIGH_PASS_TIME: f64 = 25e-3;
/// Averaging time of the regression, s.
const AVERAGING_TIME: f64 = 1.5;
/// Largest gain.
const MAX_GAIN: f64 = 2.0;

/// Regression of the delayed source's fast changes on the filtered fast source's.
#[derive(Debug, Clone)]
pub(super) struct Gain {
    /// Of `tau_hat`: noise of the fast source lowers it.
    pub(super) value: f64,
    /// Of the torque that is judged: the fast source's scale.
    pub(super) scale: f64,
    /// Where no changes exceed the noise.
    known: f64,
    /// Share of a new sample in the high-pass's averages, and in those of the regression.
    high_pass_share: f64,
    share: f64,
    /// Averages of both sources.
    pub(super) means: Option<[f64; 2]>,
    /// Average product of both sources' changes, and average square of the fast one's.
    product: f64,
    square: f64,
    /// The same square without the fast source's noise.
    clean: f64,
}

impl Gain {
    pub(super) fn new(known: f64, dt: f64) -> Self {
        let known = known.clamp(0.0, MAX_GAIN);
        Self {
            value: known,
            scale: known.max(MIN_LEVELLED_GAIN),
            known,
            high_pass_share: (dt / HIGH_PASS_TIME).min(1.0),
            share: (dt / AVERAGING_TIME).min(1.0),
            means: None,
            product: 0.0,
            square: 0.0,
            clean: 0.0,
        }
    }

    /// At rest (`moving` = 0) both gains stay; they are the known one before changes exceed the noise.
    /// Variances: of the filtered fast source's noise, and of what else makes both differ.
    pub(super) fn update(
        &mut self,
        [fast, delayed]: [f64; 2],
        [noise, delayed_noise]: [f64; 2],
        moving: f64,
    ) {
        let Some(means) = &mut self.means else {
            self.means = Some([fast, delayed]);
            return;
        };
        let share = self.high_pass_share;
        means[0] += share * (fast - means[0]);
        means[1] += share * (delayed - means[1]);
        let (x, y) = (fast - means[0], delayed - means[1]);
        let share = moving * self.share;
        self.product += share * (x * y - self.product);
        self.square += share * (x * x - self.square);
        self.clean += share * (x * x - noise - self.clean);
        let prior = (noise + delayed_noise).max(f64::MIN_POSITIVE);
        let scale = (self.product + prior * self.known) / (self.clean.max(0.0) + prior);
        self.scale = scale.clamp(MIN_LEVELLED_GAIN, MAX_GAIN);
        let noise = noise.max(f64::MIN_POSITIVE);
        let known = self.known * noise;
        self.value = ((self.product + known) / (self.square + noise)).clamp(0.0, MAX_GAIN);
    }
}
