//! When sensors are sampled: at SYNC or by clocks of their own, and how late.

use crate::joint::DriveReading;
use crate::parameters::{Sampled, SamplingParameters, SimParameters};
use crate::random::Random;
use crate::robot::{Plan, SimRobot};
use robot_config::slots::Source;
use robot_state::Wrench;

/// What a sensor felt over the last steps, newest last.
#[derive(Debug, Clone)]
pub struct Past<const N: usize> {
    ring: Vec<[f64; N]>,
    newest: usize,
    started: bool,
}

impl<const N: usize> Past<N> {
    /// Room for `steps` steps before the newest.
    #[must_use]
    pub fn new(steps: usize) -> Self {
        Self {
            ring: vec![[0.0; N]; steps + 2],
            newest: 0,
            started: false,
        }
    }

    /// What is felt at the end of a step; before the first one it was always so.
    pub fn push(&mut self, felt: [f64; N]) {
        if !self.started {
            self.started = true;
            self.ring.fill(felt);
        }
        self.newest = (self.newest + 1) % self.ring.len();
        self.ring[self.newest] = felt;
    }

    /// What was felt that many steps before the newest, on straight lines between steps.
    #[must_use]
    pub fn ago(&self, steps: f64) -> [f64; N] {
        let len = self.ring.len();
        let steps = steps.clamp(0.0, (len - 2) as f64);
        let (whole, part) = (steps.floor() as usize, steps.fract());
        let at = |back: usize| &self.ring[(self.newest + len - back % len) % len];
        let (newer, older) = (at(whole), at(whole + 1));
        std::array::from_fn(|i| newer[i] * (1.0 - part) + older[i] * part)
    }
}

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

/// A sample that a sensor has sent by its own clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sent {
    /// Whose it is.
    pub source: Source,
    /// Its frame's stamp, s since the start.
    pub stamp: f64,
    /// F/T sensor: force, torque; IMU: gyro, accelerometer; drive: theta, q, current, omega.
    pub values: [f64; 6],
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

impl SimRobot {
    /// Samples what is sampled at SYNC.
    pub(crate) fn sample(&mut self, time: f64) {
        for j in 0..self.order.len() {
            if self.clocks.joints[j].at_sync() {
                self.sense_joint(j, self.clocks.joints[j].latency() / self.dt);
            }
        }
        for s in 0..self.ft.len() {
            if self.clocks.ft[s].at_sync() {
                self.sense_ft(s, self.clocks.ft[s].latency() / self.dt, time);
            }
        }
        if self.clocks.imu.at_sync() {
            self.sense_imu(self.clocks.imu.latency() / self.dt);
        }
    }

    /// Samples what its own clock says.
    pub(crate) fn sample_own(&mut self, time: f64) {
        let (now, dt) = (self.time(), self.dt);
        for j in 0..self.order.len() {
            while let Some(Instant { shown, stamp }) = self.clocks.joints[j].due(now) {
                let r = self.sense_joint(j, (now - shown) / dt);
                let values = [r.theta, r.q, r.current, r.omega, 0.0, 0.0];
                self.send(Source::Joint(j), stamp, values);
            }
        }
        for s in 0..self.ft.len() {
            while let Some(Instant { shown, stamp }) = self.clocks.ft[s].due(now) {
                let Wrench { force, torque } = self.sense_ft(s, (now - shown) / dt, time);
                self.send(Source::Ft(s), stamp, six(force, torque));
            }
        }
        while let Some(Instant { shown, stamp }) = self.clocks.imu.due(now) {
            let (gyro, accelerometer) = self.sense_imu((now - shown) / dt);
            self.send(Source::Imu, stamp, six(gyro, accelerometer));
        }
    }

    fn send(&mut self, source: Source, stamp: f64, values: [f64; 6]) {
        self.readings.sent.push(Sent {
            source,
            stamp,
            values,
        });
    }

    fn sense_joint(&mut self, j: usize, ago: f64) -> DriveReading {
        let reading = self.joints[self.order[j]].sense(ago, self.dt);
        self.readings.joints[j] = reading;
        reading
    }

    fn sense_ft(&mut self, s: usize, ago: f64, time: f64) -> Wrench {
        self.readings.ft_temperature[s] = self.ft[s].temperature(time);
        self.readings.ft[s] = self.ft[s].sense(ago, time);
        self.readings.ft[s]
    }

    fn sense_imu(&mut self, ago: f64) -> ([f64; 3], [f64; 3]) {
        if let Some(imu) = &mut self.imu {
            (self.readings.gyro, self.readings.accelerometer) = imu.sense(ago);
        }
        (self.readings.gyro, self.readings.accelerometer)
    }
}

pub(crate) fn six([x, y, z]: [f64; 3], [a, b, c]: [f64; 3]) -> [f64; 6] {
    [x, y, z, a, b, c]
}
