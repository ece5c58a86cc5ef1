//! When sensors are sampled: at SYNC or by clocks of their own, and how late.

use crate::parameters::{Sampled, SamplingParameters, SimParameters};
use crate::plan::Plan;
use crate::random::Random;

/// When one sensor is sampled.
#[derive(Debug, Clone)]
pub struct Clock {
    parameters: SamplingParameters,
    /// Its own next instant, s since the start, and time between two; none: at SYNC.
    own: Option<(f64, f64)>,
    random: Random,
}

/// An instant at which a sensor is sampled by its own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// What it shows was so then, s since the start.
    pub shown: f64,
    /// Its frame is stamped then, s since the start.
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

    /// It is sampled at SYNC.
    #[must_use]
    pub fn at_sync(&self) -> bool {
        self.own.is_none()
    }

    /// Only what is felt at SYNC itself is ever shown.
    #[must_use]
    pub fn forgets(&self) -> bool {
        self.at_sync() && self.parameters.latency == 0.0
    }

    /// How long before the sample is taken what it shows was so, s.
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
                shown: taken - self.parameters.latency,
                stamp: taken + self.parameters.stamp_jitter * self.random.unit(),
            }
        })
    }
}

/// When each sensor is sampled.
#[derive(Debug, Clone)]
pub(crate) struct Clocks {
    /// In the plan's order.
    pub(crate) joints: Vec<Clock>,
    pub(crate) ft: Vec<Clock>,
    pub(crate) imu: Clock,
    /// Some F/T sensor or the IMU shows what was felt between two SYNCs.
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
        let imu = Clock::new(&sim.imu.sampling, plan.period, random(0));
        Self {
            all_steps: !imu.forgets() || !ft.iter().all(Clock::forgets),
            joints,
            ft,
            imu,
        }
    }
}

/// Steps that a sensor must remember to be as late as it is.
pub(crate) fn steps_kept(sampling: &SamplingParameters, sim: &SimParameters) -> usize {
    2 + 2 * (sampling.latency / sim.substep).ceil() as usize
}
