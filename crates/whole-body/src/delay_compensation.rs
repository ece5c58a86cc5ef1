//! One joint's delay-compensated torque `tau_hat`: changes of a fast source, level of a delayed one.
//!
//! In: the torque `e` from encoders (or motor current), which shows every change at once but drifts
//! (hysteresis, kinematic error, slipped counts) and scales changes wrongly; and the torque `l` from
//! F/T sensors and rigid-body model, which is right but delayed by its filters, whose smoothing is
//! `h`. Out:
//!
//! ```text
//! tau_hat = g e + r        r: the residual l - g h*e, predicted from half a window ago to now
//! ```
//!
//! The gain `g` is the regression of `l` on `h*e` over fast changes: inside a hysteresis loop a gear
//! is stiffer than its catalogue value, and an encoder that shows mostly noise gets a small gain.
//! The residual changes slowly for a strong encoder signal and is nearly the torque itself for a
//! weak one: `residual.rs` runs several predictors side by side and weights each by its past errors.
//! The same predictors run on `l` alone (`g = 0`); that prediction is used instead where the fast
//! source's noise costs more than the delay it saves. A joint at rest gets `l` averaged: rest means
//! that neither source leaves that average by more than its noise.
//!
//! A complementary filter, but for two departures: it assumes neither that the fast source's scale is
//! right nor that its errors are slow.

mod gain;
mod residual;
mod stand;

use gain::Gain;
use residual::ResidualPredictor;
use robot_state::{TorqueEstimate, torque_flags, torque_source};
pub use stand::LEVEL_CREEP_SHARE;
use stand::Stand;

/// Parameters of a joint's [`DelayCompensator`].
#[derive(Debug, Clone, PartialEq)]
pub struct DelayCompensatorParameters {
    /// T: time between samples, s.
    pub sample_period: f64,
    /// h: weights of the samples in the delayed source's filters, oldest first, adding up to one.
    pub kernel: Vec<f64>,
    /// Standard deviation of the fast source's samples due to its resolution alone, N·m; a lower
    /// bound of the noise that is estimated.
    pub fast_sigma: f64,
    /// Largest |tau_hat| that is reported, N·m.
    pub torque_limit: f64,
    /// Way within which the joint counts as standing for the level, rad.
    pub stands_within: f64,
    /// g before any change of the torque has shown it, 1.
    pub gain: f64,
    /// Error of the fast source's torque per angle, N·m/rad: of its kinematic error.
    pub error_per_angle: f64,
}

/// The delayed source's newest valid torque.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelayedTorque {
    /// tau: N·m.
    pub tau: f64,
    /// sigma: its standard deviation, N·m.
    pub sigma: f64,
}

/// The fast source's newest samples are averaged over this time, s.
const SMOOTHING_TIME: f64 = 3e-3;
/// Time constant of the levelled torque's level, s.
const LEVEL_TIME: f64 = 0.5;
/// The same while it moves nothing: a mode must not begin on a level that still follows what came before, as one
/// that stands then keeps it.
const UNFOLLOWED_LEVEL_TIME: f64 = 0.1;
/// Least gain of the levelled torque: feedback needs every change.
const MIN_LEVELLED_GAIN: f64 = 0.5;
/// Changes from which on the scale is known, share of the torque limit: smaller ones show kinematic error and windup.
const SCALE_SHARE: f64 = 0.03;
/// Averaging time of the fast source's noise, s.
const NOISE_AVERAGING_TIME: f64 = 0.5;
/// Averaging time of the torque of a joint at rest, s.
const REST_AVERAGING_TIME: f64 = 0.2;
/// Time constant with which the motion statistic decays, s.
const MOTION_DECAY_TIME: f64 = 0.3;
/// Standard deviations by which one sample of either source leaves the average of a joint at rest
/// before it counts as in motion.
const PEAK_GATE: f64 = 6.0;
/// The same for the fast source's root mean square over `REST_STATISTIC_TIME`.
const RMS_GATE: f64 = 2.0;
/// Averaging time of the rest statistic, s.
const REST_STATISTIC_TIME: f64 = 0.05;
/// Ratio of mean square errors up to which `g e + r` is preferred to the prediction from `l` alone:
/// less delay is worth more noise.
const MAX_VARIANCE_RATIO: f64 = 4.0;
/// Share of the residual's mean square error that is its own noise; the rest is noise of the
/// measurement by which it is judged.
const RESIDUAL_NOISE_SHARE: f64 = 0.2;

/// See the module. One joint.
#[derive(Debug, Clone)]
pub struct DelayCompensator {
    parameters: DelayCompensatorParameters,
    /// Samples in `SMOOTHING_TIME`.
    smoothing: usize,
    /// Sum of the kernel's squares.
    power: f64,
    shares: Shares,
    fast: Ring,
    missed: usize,
    noise: Noise,
    gain: Gain,
    residual: ResidualPredictor,
    /// b: level of the delayed above the fast source, N·m: freely, and as far as a joint that stands explains it.
    free_level: Option<f64>,
    level: Option<f64>,
    /// The joint's angle while the levelled torque moves it, rad, and where it stands.
    followed: Option<f64>,
    stand: Option<Stand>,
    /// Delayed less fast source, N·m, of one instant; none where either newest sample is missing.
    difference: Option<f64>,
    /// Newest torque of the delayed source, and samples since.
    delayed: Option<DelayedTorque>,
    delayed_missed: usize,
    /// Average of a joint at rest, N·m.
    rest: f64,
    /// Mean square of the fast source's distance from `rest`, over its variance.
    rest_statistic: f64,
    /// Largest recent distance of either source from `rest`, squared, over its gate.
    motion_statistic: f64,
    /// 0: at rest, 1: in motion.
    moving: f64,
    output: TorqueEstimate,
}

/// Shares of a new sample in the averages of these times.
#[derive(Debug, Clone, Copy)]
struct Shares {
    level: f64,
    unfollowed_level: f64,
    rest: f64,
    rest_statistic: f64,
    motion: f64,
}

impl DelayCompensator {
    /// Before the first sample.
    #[must_use]
    pub fn new(parameters: DelayCompensatorParameters) -> Self {
        let dt = parameters.sample_period;
        let smoothing = ((SMOOTHING_TIME / dt).round() as usize).max(1);
        let window = parameters.kernel.len().max(1);
        let share = |time: f64| (dt / time).min(1.0);
        let power: f64 = parameters.kernel.iter().map(|h| h * h).sum();
        Self {
            smoothing,
            fast: Ring::new(window.max(smoothing)),
            missed: usize::MAX,
            noise: Noise::new(parameters.fast_sigma.powi(2), share(NOISE_AVERAGING_TIME)),
            gain: Gain::new(parameters.gain, dt),
            power,
            shares: Shares {
                level: share(LEVEL_TIME),
                unfollowed_level: share(UNFOLLOWED_LEVEL_TIME),
                rest: share(REST_AVERAGING_TIME),
                rest_statistic: share(REST_STATISTIC_TIME),
                motion: share(MOTION_DECAY_TIME),
            },
            residual: ResidualPredictor::new(window, dt),
            free_level: None,
            level: None,
            followed: None,
            stand: None,
            difference: None,
            delayed: None,
            delayed_missed: 0,
            rest: 0.0,
            rest_statistic: 0.0,
            motion_statistic: 0.0,
            moving: 0.0,
            output: TorqueEstimate::default(),
            parameters,
        }
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        *self = Self::new(self.parameters.clone());
    }

    /// `tau_hat` from the sources' newest torques; `None` where one is not valid.
    ///
    /// Without the fast source the output follows the delayed one alone; without the delayed one it
    /// follows the fast one's changes from the last known level.
    pub fn update(&mut self, fast: Option<f64>, delayed: Option<DelayedTorque>) -> TorqueEstimate {
        let fast = fast.filter(|x| x.is_finite());
        let delayed = delayed.filter(|l| l.tau.is_finite() && l.sigma.is_finite());
        self.take_fast(fast);
        self.difference = None;
        match delayed {
            Some(delayed) => self.take_delayed(delayed),
            None => self.delayed_missed = self.delayed_missed.saturating_add(1),
        }
        self.estimate(fast.is_some() && delayed.is_some());
        self.output
    }

    /// Before `update`: the joint's angle while its levelled torque moves it, rad.
    pub fn follow(&mut self, angle: Option<f64>) {
        self.followed = angle.filter(|angle| angle.is_finite());
    }

    /// The delayed less the fast source's torque, both at the delayed one's instant, N·m; none where either newest
    /// sample is missing.
    #[must_use]
    pub fn difference(&self) -> Option<f64> {
        self.difference
    }

    /// The fast source's torque as `tau_hat` takes it: a short average, N·m.
    #[must_use]
    pub fn fast(&self) -> f64 {
        self.fast.mean(self.smoothing)
    }

    /// g: torque per torque of the fast source.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.gain.value
    }

    /// `g e + b`: the fast source's newest torque on the delayed one's level, N·m, for feedback: it
    /// has all of the fast source's noise, and none of `tau_hat`'s delay, and no state of rest. None
    /// where the fast source's newest sample is missing or the level is not known yet.
    ///
    /// The errors of torsion that the level makes up for belong to the angle (kinematic error) and to
    /// the torque (stiffness, hysteresis). So while the torque is followed by a joint that stands, the
    /// level changes by what turning and torque explain and no more: an F/T sensor that fails must not
    /// set the joint in motion.
    ///
    /// `held_back`: what a filter of the fast source still holds back of its newest torque, N·m.
    #[must_use]
    pub fn levelled(&self, held_back: f64) -> Option<f64> {
        let level = self.level.filter(|_| self.missed == 0)?;
        let gain = self.gain.value.max(MIN_LEVELLED_GAIN);
        Some(gain * (self.fast.newest() + held_back) + level)
    }

    /// The same where it moves nothing: with the fast source's scale, on a level that follows at a stand, too.
    #[must_use]
    pub fn levelled_freely(&self) -> Option<f64> {
        let level = self.free_level.filter(|_| self.missed == 0)?;
        Some(self.gain.scale * self.fast.newest() + level)
    }

    fn take_fast(&mut self, fast: Option<f64>) {
        let Some(fast) = fast else {
            // Held: a lost sample must not step the torque.
            self.fast.push(self.fast.newest());
            self.missed = self.missed.saturating_add(1);
            return;
        };
        if self.missed > self.parameters.kernel.len() / 4 {
            // Changes during the gap have arrived by the delayed source.
            self.fast.fill(fast);
            self.noise.restart(fast);
            self.gain.means = None;
            if let Some(delayed) = self.delayed {
                self.residual.restart([delayed.tau, fast], self.gain.value);
            }
        } else {
            self.fast.push(fast);
            self.noise.update(fast);
        }
        self.missed = 0;
    }

    fn take_delayed(&mut self, delayed: DelayedTorque) {
        let fast = self.fast.through(&self.parameters.kernel);
        self.difference = (self.missed == 0).then_some(delayed.tau - fast);
        let noise = self.power * self.noise.variance;
        let last = [self.gain.value.max(MIN_LEVELLED_GAIN), self.gain.scale];
        let small = SCALE_SHARE * self.parameters.torque_limit;
        let variances = [noise, delayed.sigma.powi(2) + small * small];
        self.gain
            .update([fast, delayed.tau], variances, self.moving);
        let (gain, scale) = (self.gain.value, self.gain.scale);
        let gains = [gain.max(MIN_LEVELLED_GAIN), scale];
        let levels = gains.map(|gain| delayed.tau - gain * fast);
        // Gains turn about the torque that is.
        let turned: [f64; 2] = std::array::from_fn(|i| (gains[i] - last[i]) * fast);
        let led = |i: usize, last: Option<f64>| {
            let last = last.map_or(levels[i], |last| last - turned[i]);
            let share = match (i, self.followed) {
                (0, None) => self.shares.unfollowed_level,
                _ => self.shares.level,
            };
            last + share * (levels[i] - last)
        };
        let level = led(0, self.level);
        self.free_level = Some(led(1, self.free_level));
        self.level = Some(match self.followed {
            Some(angle) => {
                let stand = self.stand.get_or_insert(Stand::at(angle, level, 0.0));
                stand.level -= turned[0];
                stand.bound(&self.parameters, angle, fast, level)
            }
            None => {
                self.stand = None;
                level
            }
        });
        if self.delayed.is_none() {
            self.residual.restart([delayed.tau, fast], gain);
            self.rest = delayed.tau;
        } else {
            self.residual.update([delayed.tau, fast], gain);
        }
        self.delayed = Some(delayed);
        self.delayed_missed = 0;
    }

    fn estimate(&mut self, complete: bool) {
        let Some(delayed) = self.delayed else {
            return;
        };
        let gain = self.gain.value;
        let noise = gain * gain * self.noise.variance / self.smoothing as f64;
        let (with, without) = (&self.residual.with, &self.residual.without);
        // Prediction with the fast source, and without.
        let compensated = gain * self.fast.mean(self.smoothing) + with.value;
        let innovation = compensated - without.value;
        let variance = noise + with.variance;
        let gate = innovation * innovation
            / (PEAK_GATE.powi(2) * (noise + RESIDUAL_NOISE_SHARE * with.variance));
        let trust = share_of(MAX_VARIANCE_RATIO * without.variance, variance, 2)
            .max(share_of(gate, 1.0, 6));
        let moving = without.value + trust * innovation;
        let variance = trust * variance + (1.0 - trust) * without.variance;

        let share = self.moving_share(
            compensated,
            delayed,
            noise + RESIDUAL_NOISE_SHARE * with.variance,
        );
        self.moving = share;
        let p = &self.parameters;
        let tau = self.rest + share * (moving - self.rest);
        let resting = (1.0 - share) * delayed.tau + share * moving;
        self.rest += self.shares.rest * (resting - self.rest);

        // Without samples of the delayed source its last one ages: once more each window.
        let window = p.kernel.len().max(1) as f64;
        let age = 1.0 + self.delayed_missed as f64 / window;
        let variance = delayed.sigma.powi(2) + share * variance * age;
        let mut flags = torque_flags::VALID;
        if !complete {
            flags |= torque_flags::DEGRADED;
        }
        if tau.abs() > p.torque_limit {
            flags |= torque_flags::SATURATED;
        }
        // Share of a change that comes by the fast source; the rest comes by the delayed one.
        let fast_share = gain.min(1.0) * trust;
        let samples =
            0.5 * (fast_share * (self.smoothing - 1) as f64 + (1.0 - fast_share) * (window - 1.0));
        self.output = TorqueEstimate {
            // max and min, not clamp: they cannot panic.
            tau: tau.max(-p.torque_limit).min(p.torque_limit),
            sigma: variance.sqrt(),
            delay_s: samples * p.sample_period,
            source: torque_source::FUSED,
            flags,
        };
    }

    /// 0: at rest, 1: in motion.
    fn moving_share(&mut self, compensated: f64, delayed: DelayedTorque, noise: f64) -> f64 {
        let distance = |x: f64, variance: f64| {
            let square = (x - self.rest).powi(2) / variance.max(f64::MIN_POSITIVE);
            square.min(100.0)
        };
        let fast = distance(compensated, noise);
        self.rest_statistic += self.shares.rest_statistic * (fast - self.rest_statistic);
        let delayed = distance(delayed.tau, delayed.sigma.powi(2));
        let newest = (fast / PEAK_GATE.powi(2))
            .max(delayed / PEAK_GATE.powi(2))
            .max(self.rest_statistic / RMS_GATE.powi(2));
        let kept = 1.0 - self.shares.motion;
        // Bounded, so that the return to rest takes no longer after a large motion.
        self.motion_statistic = (self.motion_statistic * kept).max(newest.min(4.0));
        share_of(self.motion_statistic, 1.0, 6)
    }
}

/// `a^n / (a^n + b^n)`, of positive numbers.
fn share_of(a: f64, b: f64, n: i32) -> f64 {
    let ratio = (b / a.max(f64::MIN_POSITIVE)).min(1e6);
    1.0 / (1.0 + ratio.powi(n))
}

/// The fast source's last samples.
#[derive(Debug, Clone)]
struct Ring {
    /// A ring twice in a row: the last ones lie side by side.
    samples: Vec<f64>,
    length: usize,
    newest: usize,
}

impl Ring {
    fn new(length: usize) -> Self {
        Self {
            samples: vec![0.0; 2 * length],
            length,
            newest: 0,
        }
    }

    fn newest(&self) -> f64 {
        self.samples[self.newest]
    }

    fn fill(&mut self, x: f64) {
        self.samples.fill(x);
    }

    fn push(&mut self, x: f64) {
        self.newest = match self.newest + 1 {
            next if next < self.length => next,
            _ => 0,
        };
        self.samples[self.newest] = x;
        self.samples[self.newest + self.length] = x;
    }

    /// The last ones, at most as many as the ring is long, the newest last.
    fn last(&self, count: usize) -> &[f64] {
        let end = self.newest + self.length + 1;
        &self.samples[end - count.min(self.length)..end]
    }

    /// Weighted sum; the kernel's last weight is the newest sample's.
    fn through(&self, kernel: &[f64]) -> f64 {
        let (samples, rest) = self.last(kernel.len()).as_chunks::<4>();
        let (weights, last) = kernel.as_chunks::<4>();
        // Four sums side by side.
        let mut sums = [0.0; 4];
        for (samples, weights) in samples.iter().zip(weights) {
            for ((sum, x), h) in sums.iter_mut().zip(samples).zip(weights) {
                *sum += x * h;
            }
        }
        let rest = rest.iter().zip(last).map(|(x, h)| x * h).sum::<f64>();
        sums.iter().sum::<f64>() + rest
    }

    fn mean(&self, count: usize) -> f64 {
        self.last(count).iter().sum::<f64>() / count as f64
    }
}

/// The fast source's white noise, from third differences, to which motion hardly contributes.
#[derive(Debug, Clone)]
struct Noise {
    /// Lower bound of the variance.
    min_variance: f64,
    variance: f64,
    /// Share of a new sample in it.
    share: f64,
    last: [f64; 3],
}

impl Noise {
    fn new(min_variance: f64, share: f64) -> Self {
        Self {
            min_variance,
            variance: min_variance,
            share,
            last: [0.0; 3],
        }
    }

    fn restart(&mut self, x: f64) {
        self.last = [x; 3];
    }

    fn update(&mut self, x: f64) {
        let [a, b, c] = self.last;
        self.last = [x, a, b];
        // 1 + 9 + 9 + 1 = 20. Bounded, because a jolt is not noise.
        let square = (x - 3.0 * a + 3.0 * b - c).powi(2) / 20.0;
        let square = square.min(9.0 * self.variance);
        let next = self.variance + self.share * (square - self.variance);
        self.variance = next.max(self.min_variance);
    }
}
