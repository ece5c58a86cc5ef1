//! Sampling times of sensors: at SYNC or by clocks of their own, with latency.

use crate::parameters::{Sampled, SamplingParameters, SimParameters};
use crate::plan::Plan;
use crate::random::Random;

/// Sampling times of one sensor.
#[derive(Debug, Clone)]
pub struct Clock {
    parameters: SamplingParameters,
    /// Next instant of its own clock, s since the start, and its period, s; `None`: at SYNC.
    own: Option<(f64, f64)>,
    random: Random,
}

/// An instant at which a sensor is sampled by its own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Time of the measured quantity, s since the start.
    pub measured: f64,
    /// Time stamp of its frame, s since the start.
    pub stamp: f64,
}

impl Clock {
    /// A clock with phase and rate of its own drawn from `random`; `period` is the loop's.
    #[must_use]
    pub fn new(parameters: &SamplingParameters, period: f64, mut random: Random) -> Self {
        let p = parameters;
        let own = (p.sampled == Sampled::WhenSent).then(|| {
            let period = p.period.unwrap_or(period) * (1.0 + p.clock_error * random.symmetric());
            (period * random.unit(), period)
        });
        Self {
            parameters: p.clone(),
            own,
            random,
        }
    }

    /// True if it is sampled at SYNC.
    #[must_use]
    pub fn at_sync(&self) -> bool {
        self.own.is_none()
    }

    /// True if only the input at SYNC itself is ever measured: no past input is needed.
    #[must_use]
    pub fn needs_no_past(&self) -> bool {
        self.at_sync() && self.parameters.latency == 0.0
    }

    /// Age of the measured quantity when the sample is taken, s.
    #[must_use]
    pub fn latency(&self) -> f64 {
        self.parameters.latency
    }

    /// The next sample by its own clock if it is due not after `time`, s since the start.
    pub fn due(&mut self, time: f64) -> Option<Instant> {
        let (next, period) = self.own.as_mut()?;
        let taken = *next;
        (taken <= time).then(|| {
            *next += *period;
            Instant {
                measured: taken - self.parameters.latency,
                stamp: taken + self.parameters.stamp_jitter * self.random.unit(),
            }
        })
    }
}

/// Sampling times of all sensors.
#[derive(Debug, Clone)]
pub(crate) struct Clocks {
    /// In the plan's order.
    pub(crate) joints: Vec<Clock>,
    pub(crate) ft: Vec<Clock>,
    pub(crate) imus: Vec<Clock>,
    /// True if an F/T sensor or an IMU measures the input between two SYNCs.
    pub(crate) all_steps: bool,
}

impl Clocks {
    pub(crate) fn new(plan: &Plan, sim: &SimParameters) -> Self {
        let random = |stream: usize| Random::new(sim.seed, 1000 + stream as u64);
        let joints = (plan.joints.iter().enumerate()).map(|(j, joint)| {
            let sampling = sim.drives.get(&joint.drive).map(|d| &d.sensors.sampling);
            Clock::new(
                sampling.unwrap_or(&SamplingParameters::default()),
                plan.period,
                random(100 + j),
            )
        });
        let ft = (0..plan.ft_sensors.len())
            .map(|s| Clock::new(&sim.ft_sensor.sampling, plan.period, random(1 + s)));
        let (joints, ft): (_, Vec<Clock>) = (joints.collect(), ft.collect());
        // The first one's stream is that of robots with one.
        let imus = (0..plan.imus.len())
            .map(|i| if i == 0 { 0 } else { 50 + i })
            .map(|stream| Clock::new(&sim.imu.sampling, plan.period, random(stream)));
        let imus: Vec<Clock> = imus.collect();
        Self {
            all_steps: !imus.iter().chain(&ft).all(Clock::needs_no_past),
            joints,
            ft,
            imus,
        }
    }
}

/// Steps of past input that a sensor's latency needs.
pub(crate) fn steps_kept(sampling: &SamplingParameters, sim: &SimParameters) -> usize {
    2 + 2 * (sampling.latency / sim.substep).ceil() as usize
}
