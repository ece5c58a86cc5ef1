//! One joint's torque now: the fast source's changes, the late source's level.
//!
//! The torque `e` from encoders knows every change at once but drifts (hysteresis, kinematic error,
//! slipped counts) and tells too small or too large a change; the torque `l` from F/T sensors and
//! rigid-body model is right but late by its filters, whose smoothing is `h`. So
//!
//! ```text
//! tau_hat = g e + c        c: what is left of l - g h*e, now
//! ```
//!
//! The gain `g` is the regression of `l` on `h*e` where both change quickly: inside a hysteresis
//! loop a gear is stiffer than its catalogue says, and an encoder that shows mostly noise gets a
//! small gain. What is left changes slowly for a strong encoder signal and is nearly the torque
//! itself for a weak one: `remainder.rs` predicts it in several ways at once and trusts those that
//! proved right. So it does with `l` alone (`g = 0`), which is told instead where the fast source's
//! noise costs more than it is worth. A joint at rest is told by `l` averaged: rest is where neither
//! source leaves that average by more than its noise.

mod remainder;

use remainder::Remainder;
use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// How a joint's sources are joined.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictiveParameters {
    /// T: time between samples, s.
    pub sample_period: f64,
    /// h: weights of the samples in the late source's filters, oldest first, adding up to one.
    pub kernel: Vec<f64>,
    /// Standard deviation of the fast source's samples that its resolution alone explains, N·m;
    /// what goes beyond is found.
    pub fast_sigma: f64,
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// The late source's newest torque, valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateTorque {
    /// tau: N·m.
    pub tau: f64,
    /// sigma: its standard deviation, N·m.
    pub sigma: f64,
}

/// The fast source's newest samples are averaged over this time, s.
const SMOOTHING: f64 = 3e-3;
/// Changes quicker than this tell the gain, s; and how long they are remembered, s.
const QUICK: f64 = 25e-3;
const GAIN_MEMORY: f64 = 1.5;
/// Largest gain.
const MOST: f64 = 2.0;
/// Time over which the fast source's noise is found, s.
const NOISE_MEMORY: f64 = 0.5;
/// Over which a joint at rest is averaged, s.
const REST: f64 = 0.2;
/// How long motion is remembered, s.
const ACTIVITY: f64 = 0.3;
/// Standard deviations beyond which a joint is not at rest: in one sample of either source, and in
/// the fast one's root mean square over a time, s.
const PEAK: f64 = 6.0;
const LASTING: f64 = 2.0;
const LASTING_TIME: f64 = 0.05;
/// How many times the mean square error is still better than the late source's delay.
const WORTH: f64 = 4.0;
/// Share of the remainder's error that is its own noise and not its judge's.
const NOISY: f64 = 0.2;

/// See the module. One joint.
#[derive(Debug, Clone)]
pub struct Predictive {
    parameters: PredictiveParameters,
    /// Samples of `SMOOTHING`.
    smoothing: usize,
    /// Sum of the kernel's squares.
    power: f64,
    fast: Ring,
    missed: usize,
    noise: Noise,
    gain: Gain,
    remainder: Remainder,
    /// Newest of the late source, and cycles since.
    late: Option<LateTorque>,
    late_missed: usize,
    /// Average of a joint at rest; mean square of the fast source's distance from it, in its noise;
    /// square of how far beyond noise the sources have left it.
    rest: f64,
    lasting: f64,
    activity: f64,
    /// 0: at rest, 1: in motion.
    moving: f64,
    output: TorqueEstimate,
}

impl Predictive {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(parameters: PredictiveParameters) -> Self {
        let dt = parameters.sample_period;
        let smoothing = ((SMOOTHING / dt).round() as usize).max(1);
        let window = parameters.kernel.len().max(1);
        let power: f64 = parameters.kernel.iter().map(|h| h * h).sum();
        Self {
            smoothing,
            fast: Ring::new(window.max(smoothing)),
            missed: usize::MAX,
            noise: Noise::new(parameters.fast_sigma.powi(2)),
            gain: Gain::new(),
            power,
            remainder: Remainder::new(window, dt),
            late: None,
            late_missed: 0,
            rest: 0.0,
            lasting: 0.0,
            activity: 0.0,
            moving: 0.0,
            output: TorqueEstimate::default(),
            parameters,
        }
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        *self = Self::new(self.parameters.clone());
    }

    /// Takes the sources' newest torques, none where one is not valid; gives the torque now.
    ///
    /// Without the fast source the late one is followed alone; without the late one, the fast one's
    /// changes from where it was last known.
    pub fn update(&mut self, fast: Option<f64>, late: Option<LateTorque>) -> TorqueEstimate {
        let fast = fast.filter(|x| x.is_finite());
        let late = late.filter(|l| l.tau.is_finite() && l.sigma.is_finite());
        self.take_fast(fast);
        match late {
            Some(late) => self.take_late(late),
            None => self.late_missed = self.late_missed.saturating_add(1),
        }
        self.tell(fast.is_some() && late.is_some());
        self.output
    }

    /// g: torque by torque of the fast source.
    #[must_use]
    pub fn gain(&self) -> f64 {
        self.gain.value
    }

    fn take_fast(&mut self, fast: Option<f64>) {
        let Some(fast) = fast else {
            // Held: a lost sample must not step the torque.
            self.fast.push(self.fast.newest());
            self.missed = self.missed.saturating_add(1);
            return;
        };
        if self.missed > self.parameters.kernel.len() / 4 {
            // What happened meanwhile has come by the late source.
            self.fast.fill(fast);
            self.noise.restart(fast);
            self.gain.quick = None;
            if let Some(late) = self.late {
                self.remainder.restart([late.tau, fast], self.gain.value);
            }
        } else {
            self.fast.push(fast);
            self.noise.update(fast, self.parameters.sample_period);
        }
        self.missed = 0;
    }

    fn take_late(&mut self, late: LateTorque) {
        let dt = self.parameters.sample_period;
        let fast = self.fast.through(&self.parameters.kernel);
        let noise = self.power * self.noise.variance;
        self.gain.update([fast, late.tau], noise, self.moving, dt);
        let gain = self.gain.value;
        if self.late.is_none() {
            self.remainder.restart([late.tau, fast], gain);
            self.rest = late.tau;
        } else {
            self.remainder.update([late.tau, fast], gain);
        }
        self.late = Some(late);
        self.late_missed = 0;
    }

    fn tell(&mut self, whole: bool) {
        let Some(late) = self.late else {
            return;
        };
        let gain = self.gain.value;
        let noise = gain * gain * self.noise.variance / self.smoothing as f64;
        let (with, without) = (&self.remainder.with, &self.remainder.without);
        // What can be told with the fast source, and what without.
        let quick = gain * self.fast.mean(self.smoothing) + with.value;
        let apart = quick - without.value;
        let doubt = noise + with.variance;
        let beyond = apart * apart / (PEAK.powi(2) * (noise + NOISY * with.variance));
        let trust = share_of(WORTH * without.variance, doubt, 2).max(share_of(beyond, 1.0, 6));
        let moving = without.value + trust * apart;
        let doubt = trust * doubt + (1.0 - trust) * without.variance;

        let share = self.moving_share(quick, late, noise + NOISY * with.variance);
        self.moving = share;
        let p = &self.parameters;
        let tau = self.rest + share * (moving - self.rest);
        let resting = (1.0 - share) * late.tau + share * moving;
        self.rest += (p.sample_period / REST).min(1.0) * (resting - self.rest);

        // While the late source is silent its last word ages by as much again each window.
        let window = p.kernel.len().max(1) as f64;
        let age = 1.0 + self.late_missed as f64 / window;
        let variance = late.sigma.powi(2) + share * doubt * age;
        let mut flags = torque_flags::VALID;
        if !whole {
            flags |= torque_flags::DEGRADED;
        }
        if tau.abs() > p.torque_limit {
            flags |= torque_flags::SATURATED;
        }
        // The part of a change that the fast source shows, and the part that the late one does.
        let shown = gain.min(1.0) * trust;
        let samples = 0.5 * (shown * (self.smoothing - 1) as f64 + (1.0 - shown) * (window - 1.0));
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
    fn moving_share(&mut self, quick: f64, late: LateTorque, noise: f64) -> f64 {
        let dt = self.parameters.sample_period;
        let beyond = |x: f64, variance: f64| {
            let square = (x - self.rest).powi(2) / variance.max(f64::MIN_POSITIVE);
            square.min(100.0)
        };
        let fast = beyond(quick, noise);
        self.lasting += (dt / LASTING_TIME).min(1.0) * (fast - self.lasting);
        let late = beyond(late.tau, late.sigma.powi(2));
        let now = (fast / PEAK.powi(2))
            .max(late / PEAK.powi(2))
            .max(self.lasting / LASTING.powi(2));
        let kept = 1.0 - (dt / ACTIVITY).min(1.0);
        // Not so high that rest would be long in coming.
        self.activity = (self.activity * kept).max(now.min(4.0));
        share_of(self.activity, 1.0, 6)
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
    samples: Vec<f64>,
    newest: usize,
}

impl Ring {
    fn new(length: usize) -> Self {
        Self {
            samples: vec![0.0; length],
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
        self.newest = (self.newest + 1) % self.samples.len();
        self.samples[self.newest] = x;
    }

    /// Weighted sum; the kernel's last weight is the newest sample's.
    fn through(&self, kernel: &[f64]) -> f64 {
        let (new, old) = self.samples.split_at(self.newest + 1);
        let backwards = new.iter().rev().chain(old.iter().rev());
        backwards.zip(kernel.iter().rev()).map(|(x, h)| x * h).sum()
    }

    fn mean(&self, count: usize) -> f64 {
        let (new, old) = self.samples.split_at(self.newest + 1);
        let backwards = new.iter().rev().chain(old.iter().rev());
        backwards.take(count).sum::<f64>() / count as f64
    }
}

/// The fast source's white noise: what third differences show, in which motion hardly counts.
#[derive(Debug, Clone)]
struct Noise {
    least: f64,
    variance: f64,
    last: [f64; 3],
}

impl Noise {
    fn new(least: f64) -> Self {
        Self {
            least,
            variance: least,
            last: [0.0; 3],
        }
    }

    fn restart(&mut self, x: f64) {
        self.last = [x; 3];
    }

    fn update(&mut self, x: f64, dt: f64) {
        let [a, b, c] = self.last;
        self.last = [x, a, b];
        // 1 + 9 + 9 + 1 = 20; a jolt is no noise.
        let square = (x - 3.0 * a + 3.0 * b - c).powi(2) / 20.0;
        let square = square.min(9.0 * self.variance);
        let next = self.variance + (dt / NOISE_MEMORY).min(1.0) * (square - self.variance);
        self.variance = next.max(self.least);
    }
}

/// Regression of the late source's quick changes on the fast source's.
#[derive(Debug, Clone)]
struct Gain {
    value: f64,
    /// Averages of both sources.
    quick: Option<[f64; 2]>,
    /// Of products and squares of what is left.
    product: f64,
    square: f64,
}

impl Gain {
    fn new() -> Self {
        Self {
            value: 1.0,
            quick: None,
            product: 0.0,
            square: 0.0,
        }
    }

    /// At rest there is nothing to learn: `moving` is 0. The gain is one as long as changes do not
    /// stand out of `noise`: the variance of the fast source after the filter.
    fn update(&mut self, [fast, late]: [f64; 2], noise: f64, moving: f64, dt: f64) {
        let Some(means) = &mut self.quick else {
            self.quick = Some([fast, late]);
            return;
        };
        let share = (dt / QUICK).min(1.0);
        means[0] += share * (fast - means[0]);
        means[1] += share * (late - means[1]);
        let (x, y) = (fast - means[0], late - means[1]);
        let share = moving * (dt / GAIN_MEMORY).min(1.0);
        self.product += share * (x * y - self.product);
        self.square += share * (x * x - self.square);
        let noise = noise.max(f64::MIN_POSITIVE);
        self.value = ((self.product + noise) / (self.square + noise)).clamp(0.0, MOST);
    }
}
