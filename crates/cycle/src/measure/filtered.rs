//! Filtered: all signals of the equations of motion through filters of one delay.
//!
//! In: one sample of every angle, wrench and IMU axis. Out: their filtered values, and those
//! derivatives that the equations need, at one common instant.

use dynamics::ImuMotion;
use nalgebra::Vector3;
use problem::Problem;
use robot_config::{AngularAcceleration, Robot, SignalFilters};
use robot_state::Wrench;
use whole_body::WholeBodyInput;

use super::align::{AlignedBank, signals};
use crate::time::Stamp;

/// Channels of one F/T sensor, and of one IMU.
pub(crate) const AXES: usize = 6;

/// Angles, wrenches and the IMU's motion at one instant, with derivatives.
#[derive(Debug)]
pub(crate) struct Filtered {
    /// q of every joint: value and two derivatives.
    encoders: AlignedBank,
    /// Every F/T sensor's axes, then every IMU's: value and first derivative.
    sensors: AlignedBank,
    /// The gyro's derivative is used, not neglected.
    differentiate: bool,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    ft: Vec<Wrench>,
    /// The motion of the first IMU, or what stands in for it.
    base: ImuMotion,
    imus: Vec<ImuMotion>,
}

impl Filtered {
    pub(crate) fn new(robot: &Robot, filters: SignalFilters) -> Result<Self, Problem> {
        let p = &robot.parameters;
        let period = p.timing.sample_period;
        let [encoders, _, sensors] = signals(robot);
        let mut sensor = filters.sensor;
        if sensors.iter().any(|signal| !signal.sampling.is_at_sync()) {
            // The effect of age on a rate follows from the curvature.
            sensor = sensor.with_derivatives(2);
        }
        let n = p.joints.len();
        let still = ImuMotion {
            angular_velocity: Vector3::zeros(),
            angular_acceleration: Vector3::zeros(),
            proper_acceleration: Vector3::zeros(),
        };
        Ok(Self {
            encoders: AlignedBank::new(&encoders, filters.encoder, period)?,
            sensors: AlignedBank::new(&sensors, sensor, period)?,
            differentiate: p.whole_body.angular_acceleration == AngularAcceleration::Differentiate,
            q: vec![0.0; n],
            dq: vec![0.0; n],
            ddq: vec![0.0; n],
            ft: vec![Wrench::default(); p.ft_sensors.len()],
            base: still,
            imus: vec![still; p.imus.len()],
        })
    }

    /// Takes one sample of every angle and axis, not finite where there is none.
    pub(crate) fn update(
        &mut self,
        angles: &[f64],
        axes: &[f64],
        stamps: &[Option<u64>],
        sync: Stamp,
    ) {
        self.encoders.update(angles, stamps, sync);
        self.sensors.update(axes, stamps, sync);
        (self.encoders).all_outputs([&mut self.q, &mut self.dq, &mut self.ddq]);
        let sensors = &self.sensors;
        let three =
            |first: usize| -> [f64; 3] { std::array::from_fn(|i| sensors.outputs(first + i)[0]) };
        for (s, wrench) in self.ft.iter_mut().enumerate() {
            wrench.force = three(AXES * s);
            wrench.torque = three(AXES * s + 3);
        }
        for (k, imu) in self.imus.iter_mut().enumerate() {
            let first = AXES * (self.ft.len() + k);
            imu.angular_velocity = three(first).into();
            imu.proper_acceleration = three(first + 3).into();
            if self.differentiate {
                let rate: [f64; 3] = std::array::from_fn(|i| sensors.outputs(first + i)[1]);
                imu.angular_acceleration = rate.into();
            }
        }
        if let Some(first) = self.imus.first() {
            self.base = *first;
        }
    }

    /// The motion that each IMU shows.
    pub(super) fn imus(&self) -> &[ImuMotion] {
        &self.imus
    }

    /// Lets another motion stand in for the first IMU's, with a share from 0 to 1, until the next update.
    pub(super) fn show_base(&mut self, motion: &ImuMotion, share: f64) {
        let base = &mut self.base;
        for (own, other) in [
            (&mut base.angular_velocity, motion.angular_velocity),
            (&mut base.angular_acceleration, motion.angular_acceleration),
            (&mut base.proper_acceleration, motion.proper_acceleration),
        ] {
            *own += (other - *own) * share;
        }
    }

    /// Forgets every sample.
    pub(crate) fn reset(&mut self) {
        self.encoders.reset();
        self.sensors.reset();
    }

    /// The input of whole-body estimators.
    pub(crate) fn input(&self) -> WholeBodyInput<'_> {
        WholeBodyInput {
            q: &self.q,
            dq: &self.dq,
            ddq: &self.ddq,
            ft: &self.ft,
            imu: self.base,
        }
    }

    /// Delay of all outputs, s.
    pub(crate) fn delay_s(&self) -> f64 {
        self.encoders.delay_s()
    }

    /// Whether a joint's window is not yet full of real samples.
    pub(crate) fn joint_settling(&self, joint: usize) -> bool {
        self.encoders.settling(joint)
    }

    /// Whether an F/T sensor's window is not yet full of real samples.
    pub(crate) fn sensor_settling(&self, sensor: usize) -> bool {
        self.sensors.settling(AXES * sensor)
    }

    /// Whether an IMU's window is not yet full of real samples.
    pub(crate) fn imu_settling(&self, imu: usize) -> bool {
        self.sensors.settling(AXES * (self.ft.len() + imu))
    }
}

/// One encoder's angle for its velocity: where encoders contradict each other it goes on by what the
/// encoder moves, without the step by which it may have slipped.
#[derive(Debug, Clone, Copy)]
pub(super) struct Course {
    /// Largest change in one period, rad.
    max_step: f64,
    /// The filter's last input, rad, and the reading behind it.
    given: f64,
    reading: f64,
    /// Difference of the two, rad; only changes are used.
    shift: f64,
    /// The last one was a change of readings.
    by_changes: bool,
}

impl Course {
    pub(super) fn new(max_step: f64) -> Self {
        Self {
            max_step,
            given: 0.0,
            reading: 0.0,
            shift: 0.0,
            by_changes: false,
        }
    }

    /// The angle for the filter, rad: `angle`, NaN where it is to bridge; or, where only the
    /// `reading` of a distrusted joint is known, further by its change.
    pub(super) fn follow(&mut self, angle: f64, reading: Option<f64>) -> f64 {
        if let Some(reading) = reading {
            let change = reading - self.reading;
            if change.abs() <= self.max_step {
                self.given += change;
            }
            (self.reading, self.by_changes) = (reading, true);
            return self.given;
        }
        if angle.is_nan() {
            return angle;
        }
        if std::mem::replace(&mut self.by_changes, false) {
            self.shift = self.given - angle;
        }
        (self.reading, self.given) = (angle, angle + self.shift);
        self.given
    }
}
