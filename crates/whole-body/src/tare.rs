//! Tare of the F/T sensors: offsets from a robot at rest.
//!
//! The operator declares a contact set. An untouched part must have no net wrench: six equations for
//! the offsets of the sensors at its ends. So, with the robot
//!
//! - in the air, held by its harness at the root's part: each hand and foot gives its sensor's
//!   whole offset;
//! - on one foot: the root's part is untouched, and with the weight known in size, place and
//!   direction (all of the robot but that foot hangs on its ankle) the standing foot's sensor has
//!   its six equations too;
//! - on both feet: those six hold for the sum of both. The internal wrench between the feet
//!   cannot be determined at rest, so that part of the offsets stays as it was.
//!
//! Each offset is held to its last value by the standard deviation of its drift: offsets that the
//! equations do not reach stay as they were, those that they determine poorly change little. The
//! result is the most probable correction of independent drifts, with its standard deviation.

use crate::error::WholeBodyError;
use crate::estimator::{WholeBody, WholeBodyInput};
use crate::parameters::{FtSensorParameters, MotionSource, WholeBodyParameters};
use dynamics::{ImuMotion, Model};
use nalgebra::{DMatrix, DVector, Matrix6, Vector3};
use problem::Problem;
use robot_state::Wrench;

/// Bounds of a robot at rest, and standard deviations of drift and model.
#[derive(Debug, Clone, PartialEq)]
pub struct TareParameters {
    /// Samples that are averaged, at least.
    pub samples: usize,
    /// Largest |dq| of any joint at rest, rad/s.
    pub max_joint_velocity: f64,
    /// Largest angular velocity at rest, rad/s: the gyro's bias must pass.
    pub max_angular_velocity: f64,
    /// Largest change of any force and torque reading while taring, N and N·m: a robot on its feet
    /// sways. Ten standard deviations of the reading are allowed anyway.
    pub max_change: [f64; 2],
    /// Standard deviation of an offset's drift since the last tare, N and N·m.
    pub drift: [f64; 2],
    /// Standard deviation of the accelerometer's bias, m/s².
    pub accelerometer_bias: f64,
    /// Relative standard deviation of the model's masses.
    pub sigma_model: f64,
}

impl Default for TareParameters {
    fn default() -> Self {
        Self {
            samples: 500,
            max_joint_velocity: 0.01,
            max_angular_velocity: 0.02,
            max_change: [5.0, 3.0],
            drift: [20.0, 2.0],
            accelerometer_bias: 0.02,
            sigma_model: 0.01,
        }
    }
}

/// Why a tare is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}", self.problem())]
pub enum TareError {
    /// Sensors and contacts do not fit the robot.
    Setup(WholeBodyError),
    /// Every part has a contact with unknowns: no offset is known.
    NothingKnown,
    /// A number was not finite, or a vector too short.
    BadSample,
    /// The robot moved: the joint or sensor, its motion and the limit.
    Moving(String),
    /// Samples so far, and required.
    TooFew(usize, usize),
}

impl TareError {
    /// The refusal and its remedy.
    #[must_use]
    pub fn problem(&self) -> Problem {
        match self {
            Self::Setup(error) => error.problem(),
            Self::NothingKnown => Problem::new(
                "every part of the robot has a contact, so that no offset can be determined",
                "at least one untouched part (contact type `none`)",
            ),
            Self::BadSample => Problem::new(
                "a sample is not finite or lacks joints or sensors",
                "finite numbers of all joints and sensors",
            ),
            Self::Moving(motion) => {
                Problem::new(format!("the robot moves: {motion}"), "a robot at rest")
            }
            Self::TooFew(n, required) => {
                Problem::new(format!("{n} samples"), format!("at least {required}"))
            }
        }
    }
}

/// Result of a tare for one sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct TareResult {
    /// The sensor's name.
    pub sensor: String,
    /// Correction to be added to its offset, N and N·m (6).
    pub correction: [f64; 6],
    /// Standard deviation of the offset now (6).
    pub sigma: [f64; 6],
    /// Whether the tare has at least halved the component's standard deviation.
    pub known: [bool; 6],
}

/// Collects samples of a robot at rest.
#[derive(Debug, Clone)]
pub struct Tare {
    whole_body: WholeBody,
    parameters: TareParameters,
    joints: Vec<String>,
    sensors: Vec<String>,
    /// Largest change of each sensor's force and torque axes.
    max_change: Vec<[f64; 2]>,
    untouched: Vec<usize>,
    samples: usize,
    first_ft: Vec<[f64; 6]>,
    sums: [Vec<f64>; 2],
    accelerometer: Vector3<f64>,
    gyro: Vector3<f64>,
}

impl Tare {
    /// `p.hypotheses[0]` is the declared contact set; standard deviations of sensors are those of
    /// single samples.
    ///
    /// # Errors
    /// Sensors or contacts that do not fit, or nothing that is known.
    pub fn new(
        model: &Model,
        p: &WholeBodyParameters,
        parameters: TareParameters,
    ) -> Result<Self, TareError> {
        let mut p = p.clone();
        if let MotionSource::Imu(imu) = &mut p.source {
            imu.sigma_accelerometer = parameters.accelerometer_bias;
            imu.sigma_angular_acceleration = 0.0;
            imu.lasting_accelerometer = 0.0;
        }
        p.sigma_ddq.fill(0.0);
        p.sigma_model = parameters.sigma_model;
        let max_change = |s: &FtSensorParameters| {
            let [force, torque] = parameters.max_change;
            [
                force.max(10.0 * s.sigma_force),
                torque.max(10.0 * s.sigma_torque),
            ]
        };
        let max_change = p.ft_sensors.iter().map(max_change).collect();
        let average = (parameters.samples.max(1) as f64).sqrt();
        for s in &mut p.ft_sensors {
            s.sigma_force /= average;
            s.sigma_torque /= average;
        }
        let whole_body = WholeBody::new(model, &p).map_err(TareError::Setup)?;
        let untouched = whole_body.untouched_parts();
        if untouched.is_empty() {
            return Err(TareError::NothingKnown);
        }
        Ok(Self {
            whole_body,
            parameters,
            max_change,
            joints: p.joints.clone(),
            sensors: p.ft_sensors.iter().map(|s| s.name.clone()).collect(),
            untouched,
            samples: 0,
            first_ft: Vec::new(),
            sums: [vec![0.0; p.joints.len()], vec![0.0; 6 * p.ft_sensors.len()]],
            accelerometer: Vector3::zeros(),
            gyro: Vector3::zeros(),
        })
    }

    /// Takes one sample, its F/T readings conditioned with the offsets so far.
    ///
    /// # Errors
    /// A bad sample, or a moving robot: the tare is over.
    pub fn add(&mut self, input: &WholeBodyInput) -> Result<(), TareError> {
        let ft: Vec<[f64; 6]> = input.ft.iter().map(Wrench::to_array).collect();
        let all = [input.q, input.dq].concat();
        let finite = all.iter().chain(ft.iter().flatten());
        let imu = [input.imu.proper_acceleration, input.imu.angular_velocity];
        let mut finite = finite.chain(imu.iter().flat_map(|v| v.iter()));
        let [q_sum, ft_sum] = &mut self.sums;
        if !finite.all(|x| x.is_finite())
            || input.q.len() != q_sum.len()
            || input.dq.len() != q_sum.len()
            || 6 * ft.len() != ft_sum.len()
        {
            return Err(TareError::BadSample);
        }
        let p = &self.parameters;
        for (j, dq) in input.dq.iter().enumerate() {
            if dq.abs() > p.max_joint_velocity {
                let (name, limit) = (&self.joints[j], p.max_joint_velocity);
                return Err(TareError::Moving(format!(
                    "joint `{name}` moves at {dq:.4} rad/s, limit {limit} rad/s"
                )));
            }
        }
        self.first_ft.extend(ft.iter().skip(self.first_ft.len()));
        for (s, (now, first)) in ft.iter().zip(&self.first_ft).enumerate() {
            for k in 0..6 {
                let limit = self.max_change[s][k / 3];
                let change = now[k] - first[k];
                if change.abs() > limit {
                    let name = &self.sensors[s];
                    let axis = AXES[k];
                    return Err(TareError::Moving(format!(
                        "{axis} of F/T sensor `{name}` changed by {change:.2}, limit {limit:.2}"
                    )));
                }
            }
        }
        q_sum.iter_mut().zip(input.q).for_each(|(s, x)| *s += x);
        ft_sum
            .iter_mut()
            .zip(ft.iter().flatten())
            .for_each(|(s, x)| *s += x);
        self.accelerometer += input.imu.proper_acceleration;
        self.gyro += input.imu.angular_velocity;
        self.samples += 1;
        Ok(())
    }

    /// Samples taken.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The corrections, in the order of the sensors.
    ///
    /// # Errors
    /// Too few samples, or a robot that turned.
    pub fn finish(&self) -> Result<Vec<TareResult>, TareError> {
        let p = &self.parameters;
        if self.samples < p.samples.max(1) {
            return Err(TareError::TooFew(self.samples, p.samples.max(1)));
        }
        let n = self.samples as f64;
        let angular_velocity = (self.gyro / n).norm();
        if angular_velocity > p.max_angular_velocity {
            let limit = p.max_angular_velocity;
            return Err(TareError::Moving(format!(
                "the IMU turns at {angular_velocity:.4} rad/s, limit {limit} rad/s"
            )));
        }
        let mean = |x: &[f64]| x.iter().map(|x| x / n).collect::<Vec<f64>>();
        let [q, ft] = [mean(&self.sums[0]), mean(&self.sums[1])];
        let readings: Vec<Wrench> = ft
            .chunks_exact(6)
            .map(|w| Wrench {
                force: [w[0], w[1], w[2]],
                torque: [w[3], w[4], w[5]],
            })
            .collect();
        let still = vec![0.0; q.len()];
        let mut whole_body = self.whole_body.clone();
        let input = WholeBodyInput {
            q: &q,
            dq: &still,
            ddq: &still,
            ft: &readings,
            imu: ImuMotion {
                angular_velocity: Vector3::zeros(),
                angular_acceleration: Vector3::zeros(),
                proper_acceleration: self.accelerometer / n,
            },
        };
        if !whole_body.update(&input).valid {
            return Err(TareError::BadSample);
        }
        Ok(self.most_probable(&whole_body))
    }

    fn most_probable(&self, whole_body: &WholeBody) -> Vec<TareResult> {
        let size = 6 * self.sensors.len();
        let drift = |k: usize| self.parameters.drift[usize::from(k % 6 >= 3)].max(1e-9);
        let mut information =
            DMatrix::from_fn(
                size,
                size,
                |i, j| if i == j { drift(i).powi(-2) } else { 0.0 },
            );
        let mut pull = DVector::zeros(size);
        for &part in &self.untouched {
            let equations = whole_body.tare_equations(part);
            let mut a = DMatrix::zeros(6, size);
            for (sensor, columns) in &equations.ends {
                a.view_mut((0, 6 * sensor), (6, 6)).copy_from(columns);
            }
            // Masses known without error would make it infinite.
            let floor = Matrix6::from_diagonal_element(1e-8);
            let Some(weight) = (equations.covariance + floor).try_inverse() else {
                continue;
            };
            let weighted = a.transpose() * weight;
            information += &weighted * &a;
            pull -= weighted * equations.net.to_vector();
        }
        let Some(covariance) = information.cholesky().map(|c| c.inverse()) else {
            return Vec::new();
        };
        let correction = &covariance * pull;
        let result = |(s, name): (usize, &String)| {
            let sigma: [f64; 6] =
                std::array::from_fn(|k| covariance[(6 * s + k, 6 * s + k)].sqrt());
            TareResult {
                sensor: name.clone(),
                correction: std::array::from_fn(|k| correction[6 * s + k]),
                known: std::array::from_fn(|k| sigma[k] < 0.5 * drift(k)),
                sigma,
            }
        };
        self.sensors.iter().enumerate().map(result).collect()
    }
}

const AXES: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];
