//! F/T sensors and IMU: what they feel, and what they make of it.

use crate::articulated::Dynamics;
use crate::parameters::{FtParameters, ImuParameters};
use crate::random::Random;
use crate::tree::Frame;
use nalgebra::{Matrix6, Vector3, Vector6};
use robot_state::Wrench;

/// A force/torque sensor between a frame's body and the body before it.
#[derive(Debug, Clone)]
pub struct FtSensor {
    frame: Frame,
    parameters: FtParameters,
    bias: Vector6<f64>,
    mixing: Matrix6<f64>,
    random: Random,
}

impl FtSensor {
    /// A sensor with errors of its own drawn from `random`.
    #[must_use]
    pub fn new(frame: &Frame, parameters: &FtParameters, mut random: Random) -> Self {
        let p = parameters;
        let limits = [p.bias_force; 3].into_iter().chain([p.bias_torque; 3]);
        let bias = Vector6::from_iterator(limits.map(|limit| limit * random.symmetric()));
        let mixing = Matrix6::from_fn(|i, j| match (i == j, i / 3 == j / 3) {
            (true, _) => 1.0,
            (false, true) => p.cross_talk * random.symmetric(),
            (false, false) => 0.0,
        });
        Self {
            frame: frame.clone(),
            parameters: p.clone(),
            bias,
            mixing,
            random,
        }
    }

    /// The true wrench that what lies beyond the sensor applies to what lies before it, in the
    /// sensor's frame, from the last `Dynamics::wrenches`.
    #[must_use]
    pub fn truth(&self, dynamics: &Dynamics) -> Wrench {
        let (force, torque) = dynamics.wrench_at(&self.frame);
        Wrench {
            force: (-force).into(),
            torque: (-torque).into(),
        }
    }

    /// Its temperature `time` seconds after the start, °C.
    #[must_use]
    pub fn temperature(&self, time: f64) -> f64 {
        self.parameters.temperature + self.parameters.warming * time / 60.0
    }

    /// The same wrench as measured `time` seconds after the start.
    pub fn sense(&mut self, dynamics: &Dynamics, time: f64) -> Wrench {
        let p = &self.parameters;
        let truth = self.truth(dynamics);
        let felt = Vector6::from_iterator(truth.force.into_iter().chain(truth.torque));
        let bias = self.bias * (1.0 + p.drift * time / 60.0);
        let warmer = self.temperature(time) - p.neutral_temperature;
        let mut shown = self.mixing * felt + bias;
        for (i, x) in shown.iter_mut().enumerate() {
            let (noise, warmth) = match i < 3 {
                true => (p.noise_force, p.warmth_force),
                false => (p.noise_torque, p.warmth_torque),
            };
            *x += warmth * warmer + noise * self.random.normal();
        }
        Wrench {
            force: [shown[0], shown[1], shown[2]],
            torque: [shown[3], shown[4], shown[5]],
        }
    }
}

/// An inertial measurement unit on any link.
#[derive(Debug, Clone)]
pub struct Imu {
    frame: Frame,
    parameters: ImuParameters,
    gyro_bias: Vector3<f64>,
    accelerometer_bias: Vector3<f64>,
    random: Random,
}

impl Imu {
    /// An IMU with errors of its own drawn from `random`.
    #[must_use]
    pub fn new(frame: &Frame, parameters: &ImuParameters, mut random: Random) -> Self {
        let mut draw = |limit: f64| Vector3::from_fn(|_, _| limit * random.symmetric());
        Self {
            frame: frame.clone(),
            gyro_bias: draw(parameters.gyro_bias),
            accelerometer_bias: draw(parameters.accelerometer_bias),
            parameters: parameters.clone(),
            random,
        }
    }

    /// Angular velocity (rad/s) and proper acceleration (m/s²) in the sensor's frame, measured.
    pub fn sense(&mut self, dynamics: &Dynamics) -> ([f64; 3], [f64; 3]) {
        let (rotation, position) = dynamics.placement(&self.frame);
        let omega = rotation.tr_mul(&dynamics.angular_velocity(self.frame.body));
        let felt = dynamics.proper_acceleration(self.frame.body, &position);
        let gyro = omega + self.gyro_bias + self.random.normal3(self.parameters.gyro_noise);
        let accelerometer = rotation.tr_mul(&felt)
            + self.accelerometer_bias
            + self.random.normal3(self.parameters.accelerometer_noise);
        (gyro.into(), accelerometer.into())
    }
}
