//! The motion from which a drive is identified: sweeps of frequency on a slow swing.
//!
//! The swing turns the joint round through friction at several speeds and carries the gear from one
//! side to the other; the sweeps separate inertia from friction and show the delay. Every sweep covers all
//! frequencies, so that any part of the recording that is left out leaves the rest whole.

use robot_state::JointKind;
use std::f64::consts::TAU;

/// Sweeps on a slow swing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chirp {
    /// Whole duration, s.
    pub duration: f64,
    /// Number of sweeps.
    pub sweeps: usize,
    /// First and last frequency of a sweep, Hz.
    pub frequencies: [f64; 2],
    /// Largest amplitude of a sweep, rad; this and what follows of prismatic joints in m.
    pub amplitude: f64,
    /// Amplitude and frequency of the swing, rad and Hz.
    pub swing: [f64; 2],
    /// Largest velocity of a sweep, rad/s.
    pub velocity: f64,
    /// Largest acceleration of a sweep, rad/s².
    pub acceleration: f64,
}

/// One part of the same motion as plans of excitation have it: with a window, about the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Duration, s.
    pub duration: f64,
    /// First and last frequency, Hz: equal for a sine that grows.
    pub frequencies: [f64; 2],
    /// Amplitude at the first frequency, or at the end of the growth, rad.
    pub amplitude: f64,
    /// Power of the frequency with which the amplitude falls: 1 with velocity, 2 with acceleration constant.
    pub power: i32,
}

impl Part {
    /// Displacement, rad, velocity and acceleration at `t` since its beginning.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
        derivatives(|t| self.displacement(t), t)
    }

    fn displacement(&self, t: f64) -> f64 {
        if !(0.0..self.duration).contains(&t) {
            return 0.0;
        }
        let [first, last] = self.frequencies;
        let fade = (1.0 / first).min(0.25 * self.duration);
        let window = smooth_step(t / fade) * smooth_step((self.duration - t) / fade);
        let rate = (last / first).ln() / self.duration;
        let (phase, share) = if rate > 1e-9 {
            let growth = (rate * t).exp();
            (
                TAU * first * (growth - 1.0) / rate,
                growth.powi(-self.power),
            )
        } else {
            (TAU * first * t, t / self.duration)
        };
        window * self.amplitude * share * phase.sin()
    }
}

/// From 0 to 1, at rest at both ends.
fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
}

/// A function with two derivatives by differences.
fn derivatives(of: impl Fn(f64) -> f64, t: f64) -> [f64; 3] {
    const H: f64 = 1e-4;
    let [before, now, after] = [t - H, t, t + H].map(of);
    [
        now,
        (after - before) / (2.0 * H),
        (after - 2.0 * now + before) / (H * H),
    ]
}

/// Share of a joint's torque limit that sweeps may take.
const TORQUE_SHARE: f64 = 0.3;
/// Share of a joint's velocity limit that sweeps may take.
const VELOCITY_SHARE: f64 = 0.2;
/// Time over which the motion begins and ends, s.
const FADE_S: f64 = 0.5;

impl Chirp {
    /// For a joint of this kind with this velocity limit, rad/s or m/s, and acceleration that its torque
    /// limit gives it, rad/s² or m/s².
    #[must_use]
    pub fn of_joint(kind: JointKind, velocity_limit: f64, acceleration_limit: f64) -> Self {
        Self {
            duration: 12.0,
            sweeps: 4,
            frequencies: [0.8, 25.0],
            amplitude: kind.threshold(0.03),
            swing: [kind.threshold(0.06), 0.35],
            velocity: VELOCITY_SHARE * velocity_limit,
            acceleration: TORQUE_SHARE * acceleration_limit,
        }
    }

    /// The same shares of the limits, part after part: a growing sine, then low and high chirps in turn.
    #[must_use]
    pub fn parts(&self) -> [Part; 7] {
        let [first, last] = self.frequencies;
        let [swing, slow] = self.swing;
        let middle = (first * last).sqrt();
        let omega = TAU * first;
        let low = self.amplitude.min(self.velocity / omega);
        let low = low.min(self.acceleration / (omega * TAU * middle));
        let sine = Part {
            duration: 4.0,
            frequencies: [slow; 2],
            amplitude: swing,
            power: 0,
        };
        let low = Part {
            duration: 2.0,
            frequencies: [first, middle],
            amplitude: low,
            power: 1,
        };
        let high = Part {
            duration: 1.5,
            frequencies: [middle, last],
            amplitude: (self.acceleration / (TAU * middle).powi(2))
                .min(self.velocity / (TAU * middle)),
            power: 2,
        };
        [sine, low, high, low, high, low, high]
    }

    /// Displacement, rad, velocity and acceleration at `t` since the start.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
        derivatives(|t| self.displacement(t), t)
    }

    fn displacement(&self, t: f64) -> f64 {
        if !(0.0..self.duration).contains(&t) {
            return 0.0;
        }
        let fade = |x: f64| smooth_step(x / FADE_S);
        let whole = fade(t) * fade(self.duration - t);
        let length = self.duration / self.sweeps as f64;
        let since = t % length;
        let [first, last] = self.frequencies;
        // Up and down in turn, so that the frequency does not jump.
        let up = ((t / length) as usize).is_multiple_of(2);
        let since = if up { since } else { length - since };
        // Exponential: equal time for each octave.
        let growth = (last / first).ln() / length;
        let f = first * (growth * since).exp();
        let phase = TAU * first * ((growth * since).exp() - 1.0) / growth;
        let end = TAU * (last - first) / growth;
        let phase = if up { phase } else { 2.0 * end - phase };
        let omega = TAU * f;
        // A smooth minimum of the three bounds.
        let bounds = [
            self.amplitude,
            self.velocity / omega,
            self.acceleration / (omega * omega),
        ];
        let sum: f64 = bounds.iter().map(|b| b.powi(-4)).sum();
        let [amplitude, frequency] = self.swing;
        whole * (sum.powf(-0.25) * phase.sin() + amplitude * (TAU * frequency * t).sin())
    }
}
