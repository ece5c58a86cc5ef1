//! F/T sensors and IMU: from true quantities to readings with errors.

use crate::articulated::Dynamics;
use crate::parameters::{FtParameters, ImuParameters};
use crate::past::Past;
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
    past: Past<6>,
}

impl FtSensor {
    /// A sensor with errors of its own drawn from `random`, which keeps so many steps of past input.
    #[must_use]
    pub fn new(frame: &Frame, parameters: &FtParameters, mut random: Random, steps: usize) -> Self {
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
            past: Past::new(steps),
        }
    }

    /// The true wrench that the child side applies to the parent side, in the sensor's frame, from the last `Dynamics::wrenches`.
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

    /// Records the wrench of this step.
    pub fn record(&mut self, dynamics: &Dynamics) {
        let Wrench { force, torque } = self.truth(dynamics);
        let ([x, y, z], [a, b, c]) = (force, torque);
        self.past.push([x, y, z, a, b, c]);
    }

    /// The wrench of `ago` steps before the last one, as measured `time` seconds after the start.
    pub fn sense(&mut self, ago: f64, time: f64) -> Wrench {
        let p = &self.parameters;
        let wrench = Vector6::from(self.past.ago(ago));
        let bias = self.bias * (1.0 + p.drift * time / 60.0);
        let warmer = self.temperature(time) - p.neutral_temperature;
        let mut reading = self.mixing * wrench + bias;
        for (i, x) in reading.iter_mut().enumerate() {
            let (noise, warmth) = if i < 3 {
                (p.noise_force, p.warmth_force)
            } else {
                (p.noise_torque, p.warmth_torque)
            };
            *x += warmth * warmer + noise * self.random.normal();
        }
        Wrench {
            force: [reading[0], reading[1], reading[2]],
            torque: [reading[3], reading[4], reading[5]],
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
    past: Past<6>,
}

impl Imu {
    /// An IMU with errors of its own drawn from `random`, which keeps so many steps of past input.
    #[must_use]
    pub fn new(
        frame: &Frame,
        parameters: &ImuParameters,
        mut random: Random,
        steps: usize,
    ) -> Self {
        let mut draw = |limit: f64| Vector3::from_fn(|_, _| limit * random.symmetric());
        Self {
            frame: frame.clone(),
            gyro_bias: draw(parameters.gyro_bias),
            accelerometer_bias: draw(parameters.accelerometer_bias),
            parameters: parameters.clone(),
            random,
            past: Past::new(steps),
        }
    }

    /// Records angular velocity and proper acceleration of this step.
    pub fn record(&mut self, dynamics: &Dynamics) {
        let (rotation, position) = dynamics.placement(&self.frame);
        let omega = rotation.tr_mul(&dynamics.angular_velocity(self.frame.body));
        let acceleration = dynamics.proper_acceleration(self.frame.body, &position);
        let a = rotation.tr_mul(&acceleration);
        self.past.push([omega.x, omega.y, omega.z, a.x, a.y, a.z]);
    }

    /// Angular velocity (rad/s) and proper acceleration (m/s²) in the sensor's frame `ago` steps
    /// before the last one, measured.
    pub fn sense(&mut self, ago: f64) -> ([f64; 3], [f64; 3]) {
        let [x, y, z, a, b, c] = self.past.ago(ago);
        let omega = Vector3::new(x, y, z);
        let gyro = omega + self.gyro_bias + self.random.normal3(self.parameters.gyro_noise);
        let accelerometer = Vector3::new(a, b, c)
            + self.accelerometer_bias
            + self.random.normal3(self.parameters.accelerometer_noise);
        (gyro.into(), accelerometer.into())
    }
}
