//! One joint's torque now: the fast source's changes, the late source's level.
//!
//! The torque from encoders knows every change at once but drifts (hysteresis, kinematic error,
//! slipped counts); the torque from F/T sensors and the rigid-body model is right but late by its
//! filters. The fast one, sent through the same filter, is compared with the late one: their
//! difference is the fast one's bias, which changes slowly (a random walk, by a Kalman filter).
//! What is left is followed by three Kalman filters side by side, each with the probability that the
//! measurements give it (interacting multiple models: Blom and Bar-Shalom, IEEE Trans. Automatic
//! Control 33, 1988): a load at rest, which the late source knows best; a load of nearly steady
//! rate; and one whose rate changes. So a load at rest is as quiet as the late source, and a load
//! that changes is followed at once.

use robot_state::{TorqueEstimate, torque_flags, torque_source};

/// How a joint's sources are joined.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictiveParameters {
    /// T: time between samples, s.
    pub sample_period: f64,
    /// Samples over which the late source's filters average; its delay is half of them.
    pub window: usize,
    /// Standard deviation of a sample of the fast source, its bias apart, N·m.
    pub fast_sigma: f64,
    /// Standard deviation of the late source, N·m.
    pub late_sigma: f64,
    /// How fast the fast source's bias wanders, N·m/√s.
    pub bias_walk: f64,
    /// How fast a torque at rest wanders, N·m/√s.
    pub rest_walk: f64,
    /// How fast the torque's rate wanders, steady and changing, N·m/s/√s.
    pub rate_walk: [f64; 2],
    /// Largest |tau| that is ever reported, N·m.
    pub torque_limit: f64,
}

/// How often a load goes from one of the three kinds to a certain other, 1/s.
const SWITCHES_PER_SECOND: f64 = 2.0;
/// The tracks.
const REST: usize = 0;
const CHANGING: usize = 2;
/// The late source's samples share most of their window with the last ones.
const FORGETTING: f64 = 1e12;

/// See the module. One joint.
#[derive(Debug, Clone)]
pub struct Predictive {
    parameters: PredictiveParameters,
    /// The fast source over the late source's window.
    ring: Vec<f64>,
    newest: usize,
    filled: usize,
    sum: f64,
    /// Bias and its variance.
    bias: f64,
    bias_variance: f64,
    tracks: [Track; 3],
    output: TorqueEstimate,
}

impl Predictive {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(parameters: PredictiveParameters) -> Self {
        let mut predictive = Self {
            ring: vec![0.0; parameters.window.max(1)],
            newest: 0,
            filled: 0,
            sum: 0.0,
            bias: 0.0,
            bias_variance: FORGETTING,
            tracks: [Track::default(); 3],
            output: TorqueEstimate::default(),
            parameters,
        };
        predictive.reset();
        predictive
    }

    /// Forgets every sample.
    pub fn reset(&mut self) {
        (self.newest, self.filled, self.sum) = (0, 0, 0.0);
        (self.bias, self.bias_variance) = (0.0, FORGETTING);
        self.tracks = [Track::default(); 3];
        self.output = TorqueEstimate::default();
    }

    /// Takes the sources' newest torques, none where one is not valid; gives the torque now.
    pub fn update(&mut self, fast: Option<f64>, late: Option<f64>) -> TorqueEstimate {
        let p = &self.parameters;
        let dt = p.sample_period;
        let fast = fast.filter(|x| x.is_finite());
        let late = late.filter(|x| x.is_finite());
        self.bias_variance = (self.bias_variance + p.bias_walk.powi(2) * dt).min(FORGETTING);
        match fast {
            Some(fast) => self.remember(fast),
            // The window must be without gaps.
            None => (self.filled, self.sum) = (0, 0.0),
        }
        if let (Some(late), true) = (late, self.filled == self.ring.len()) {
            self.learn_bias(late - self.sum / self.ring.len() as f64);
        }
        self.follow(fast, late);
        self.tell(fast.is_some(), late.is_some());
        self.output
    }

    /// The fast source's bias, N·m: what the late source says it is wrong by.
    #[must_use]
    pub fn bias(&self) -> f64 {
        -self.bias
    }

    fn remember(&mut self, fast: f64) {
        self.newest = (self.newest + 1) % self.ring.len();
        if self.filled == self.ring.len() {
            self.sum -= self.ring[self.newest];
        } else {
            self.filled += 1;
        }
        self.ring[self.newest] = fast;
        self.sum += fast;
        if self.newest == 0 && self.filled == self.ring.len() {
            // Once a turn without the rounding of all the turns before.
            self.sum = self.ring.iter().sum();
        }
    }

    fn learn_bias(&mut self, difference: f64) {
        let p = &self.parameters;
        // Neighbouring differences have all but two of their samples in common: only as many as
        // windows are independent. The bias has wandered since, too.
        let window = self.ring.len() as f64;
        let delay = 0.5 * window * p.sample_period;
        let variance =
            p.fast_sigma.powi(2) / window + p.late_sigma.powi(2) + p.bias_walk.powi(2) * delay;
        let gain = self.bias_variance / (self.bias_variance + variance * window);
        self.bias += gain * (difference - self.bias);
        self.bias_variance *= 1.0 - gain;
        if self.bias_variance > 0.5 * FORGETTING {
            // The first difference is all that is known.
            (self.bias, self.bias_variance) = (difference, variance);
        }
    }

    fn follow(&mut self, fast: Option<f64>, late: Option<f64>) {
        let p = &self.parameters;
        let dt = p.sample_period;
        mix(&mut self.tracks, (SWITCHES_PER_SECOND * dt).min(0.3));
        self.tracks[REST].rest(p.rest_walk.powi(2) * dt);
        for (track, walk) in self.tracks[REST + 1..].iter_mut().zip(p.rate_walk) {
            track.predict(dt, walk * walk);
        }
        if let Some(fast) = fast {
            let corrected = fast + self.bias;
            let variance = p.fast_sigma.powi(2).max(1e-12);
            for (kind, track) in self.tracks.iter_mut().enumerate() {
                track.correct(corrected, variance, kind != REST);
            }
            let sum: f64 = self.tracks.iter().map(|t| t.weight).sum();
            for track in &mut self.tracks {
                track.weight = if sum > 0.0 {
                    track.weight / sum
                } else {
                    1.0 / 3.0
                };
            }
        }
        if let (Some(late), true) = (late, self.filled == self.ring.len()) {
            // What it tells is half a window old: as much as the load has changed since, it is wrong.
            let mean = self.sum / self.ring.len() as f64;
            let since = self.tracks[CHANGING].tau - self.bias - mean;
            let window = self.ring.len() as f64;
            let variance = (p.late_sigma.powi(2) + since * since) * window;
            self.tracks[REST].learn(late, variance);
        }
    }

    fn tell(&mut self, fast: bool, late: bool) {
        let limit = self.parameters.torque_limit;
        // Squared: the track that is clearly right is not disturbed by the others' noise.
        let squares = self.tracks.map(|t| t.weight * t.weight);
        let sum = squares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let share = squares.map(|s| s / sum);
        let tracks = || share.iter().zip(&self.tracks);
        let tau: f64 = tracks().map(|(s, t)| s * t.tau).sum();
        let own: f64 = tracks()
            .map(|(s, t)| s * (t.variance[0] + (t.tau - tau).powi(2)))
            .sum();
        let known = self.bias_variance < 0.5 * FORGETTING;
        let mut flags = 0;
        if known && self.tracks[REST].seen && tau.is_finite() {
            flags |= torque_flags::VALID;
        }
        if !fast || !late {
            flags |= torque_flags::DEGRADED;
        }
        if tau.abs() > limit {
            flags |= torque_flags::SATURATED;
        }
        let sigma = (own + if known { self.bias_variance } else { 0.0 }).sqrt();
        self.output = TorqueEstimate {
            tau: tau.clamp(-limit, limit),
            sigma,
            delay_s: self.tracks[CHANGING].half_time() * self.parameters.sample_period,
            source: torque_source::FUSED,
            flags,
        };
    }
}

/// One Kalman filter of torque and rate.
#[derive(Debug, Clone, Copy)]
struct Track {
    tau: f64,
    rate: f64,
    /// Of torque, of both, of rate.
    variance: [f64; 3],
    /// Gains of the last correction.
    gain: [f64; 2],
    weight: f64,
    seen: bool,
}

impl Default for Track {
    fn default() -> Self {
        Self {
            tau: 0.0,
            rate: 0.0,
            variance: [0.0; 3],
            gain: [1.0, 0.0],
            weight: 1.0 / 3.0,
            seen: false,
        }
    }
}

impl Track {
    fn predict(&mut self, dt: f64, walk: f64) {
        if !self.seen {
            return;
        }
        self.tau += dt * self.rate;
        let [a, b, c] = self.variance;
        self.variance = [
            a + 2.0 * dt * b + dt * dt * c + walk * dt.powi(3) / 3.0,
            b + dt * c + 0.5 * walk * dt * dt,
            c + walk * dt,
        ];
    }

    /// `use_it`: false if the measurement tells how likely the track is and nothing else.
    fn correct(&mut self, measured: f64, variance: f64, use_it: bool) {
        if !self.seen {
            // Any rate is possible at first.
            *self = Self {
                tau: measured,
                variance: [variance, 0.0, 1e6],
                seen: true,
                ..*self
            };
            return;
        }
        let [a, b, c] = self.variance;
        let spread = a + variance;
        let innovation = measured - self.tau;
        if use_it {
            self.gain = [a / spread, b / spread];
            self.tau += self.gain[0] * innovation;
            self.rate += self.gain[1] * innovation;
            self.variance = [
                a * (1.0 - self.gain[0]),
                b * (1.0 - self.gain[0]),
                c - self.gain[1] * b,
            ];
        }
        let likelihood = (-0.5 * innovation * innovation / spread).exp() / spread.sqrt();
        // Neither may die out: it could not come back.
        self.weight *= likelihood.max(1e-30);
    }

    /// Nothing but rest: no rate.
    fn rest(&mut self, walk: f64) {
        self.rate = 0.0;
        self.variance = [self.variance[0] + walk, 0.0, 0.0];
    }

    /// A measurement that does not tell the kind of load.
    fn learn(&mut self, measured: f64, variance: f64) {
        let gain = self.variance[0] / (self.variance[0] + variance).max(f64::MIN_POSITIVE);
        self.tau += gain * (measured - self.tau);
        self.variance[0] *= 1.0 - gain;
    }

    /// Samples until half of a sudden change is in the output.
    fn half_time(&self) -> f64 {
        let kept = 1.0 - self.gain[0];
        if kept > 0.0 && kept < 1.0 {
            0.5f64.ln() / kept.ln()
        } else {
            0.0
        }
    }
}

/// Mixes the tracks by the chance that the load has gone from one kind to another.
fn mix(tracks: &mut [Track; 3], change: f64) {
    let before = *tracks;
    if !before[REST].seen {
        return;
    }
    for (i, track) in tracks.iter_mut().enumerate() {
        let from: [f64; 3] = std::array::from_fn(|j| {
            let chance = if i == j { 1.0 - 2.0 * change } else { change };
            chance * before[j].weight
        });
        let weight: f64 = from.iter().sum();
        let share = from.map(|f| f / weight.max(f64::MIN_POSITIVE));
        let mean = |f: fn(&Track) -> f64| share.iter().zip(&before).map(|(s, t)| s * f(t)).sum();
        track.tau = mean(|t| t.tau);
        track.rate = mean(|t| t.rate);
        track.weight = weight.max(1e-9);
        track.variance = [0.0; 3];
        for (share, t) in share.iter().zip(&before) {
            let (d, e) = (t.tau - track.tau, t.rate - track.rate);
            let spread = [d * d, d * e, e * e];
            for (sum, (own, spread)) in
                (track.variance.iter_mut()).zip(t.variance.iter().zip(spread))
            {
                *sum += share * (own + spread);
            }
        }
    }
}
