//! The humanoid plant, stepping on the spot in a springy harness, and the signals of its sensors
//! brought to one instant. Shared by tests and by the results page.

pub(crate) mod station;

use dynamics::{Base, ImuMotion, Model};
use estimators::filter_bank::{FilterBank, FilterDesign};
use estimators::matched_filter::MatchedFilterParameters;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use plant::parameters::HarnessParameters;
use plant::{CanRobot, Readings, SimParameters, SimRobot, Truth};
use robot_config::Robot;
use robot_state::Wrench;
use std::f64::consts::TAU;
use test_support::{read_project_file, read_with_drives_always_on};
use whole_body::{
    ContactKind, ContactParameters, FtConditioning, FtSensorParameters, Hypothesis, ImuParameters,
    MotionSource, Place, Residual, Weighting, WholeBodyInput, WholeBodyParameters,
};

pub(crate) const PERIOD: f64 = 1e-3;

/// The filters of encoders, F/T sensors and IMU, by their samples.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Filters {
    /// As in D 5.1: of second order for encoders, of first order for the rest.
    SavitzkyGolay(usize),
    /// One smoothing for all.
    Matched(usize),
}

/// D 5.1.
pub(crate) const PAPER: Filters = Filters::SavitzkyGolay(80);
/// Short ones, for the torque now.
pub(crate) const OURS: Filters = Filters::Matched(16);

impl Filters {
    pub(crate) fn window(self) -> usize {
        let (Self::SavitzkyGolay(window) | Self::Matched(window)) = self;
        window
    }

    /// Delay of the estimate, samples.
    pub(crate) fn delay(self) -> f64 {
        0.5 * (self.window() - 1) as f64
    }

    fn bank(self, channels: usize, derivatives: usize) -> FilterBank {
        let design: FilterDesign = match self {
            Self::SavitzkyGolay(window) => {
                let order = derivatives;
                SavitzkyGolayParameters::centred(window, order, derivatives, PERIOD).into()
            }
            Self::Matched(window) => MatchedFilterParameters {
                window,
                derivatives,
                sample_period: PERIOD,
            }
            .into(),
        };
        FilterBank::new(channels, design).unwrap()
    }

    fn encoders(self, joints: usize) -> FilterBank {
        self.bank(joints, 2)
    }

    fn sensors(self, axes: usize) -> FilterBank {
        self.bank(axes, 1)
    }

    /// Weights of the samples in a torque.
    pub(crate) fn kernel(self) -> Vec<f64> {
        self.sensors(1).kernel()
    }
}
/// The harness's link.
pub(crate) const CHEST: &str = "chest_pitch_link";

/// The humanoid's configuration.
pub(crate) fn config() -> Robot {
    robot_config::load("config/humanoid/robot.toml", &read_with_drives_always_on).unwrap()
}

/// Its model with a free base.
pub(crate) fn model(robot: &Robot) -> Model {
    let file = &robot.parameters.urdf_path;
    Model::from_urdf(&read_project_file(file).unwrap(), file, Base::Floating).unwrap()
}

/// The simulation's parameters: F/T sensors that need a tare, a harness that lets the feet carry
/// most of the weight, soles some millimetres above the floor at the start.
pub(crate) fn simulation(seed: u64) -> SimParameters {
    let file = "config/humanoid/sim.toml";
    let mut sim = SimParameters::parse(&read_project_file(file).unwrap(), file).unwrap();
    sim.seed = seed;
    sim.ft_sensor.bias_force = 10.0;
    sim.ft_sensor.bias_torque = 1.0;
    sim.start.on_ground = false;
    sim.start.base_position = [0.0, 0.0, 0.692];
    sim.harness = Some(HarnessParameters {
        link: CHEST.into(),
        stiffness: 30_000.0,
        damping: 3_000.0,
        angular_stiffness: 5_000.0,
        angular_damping: 200.0,
        slack: 0.0,
        angular_slack: 0.0,
    });
    sim
}

/// The robot, its joints' commands, and its sensors' offsets.
pub(crate) struct Walk {
    pub(crate) robot: SimRobot,
    pub(crate) joints: Vec<String>,
    start: Vec<f64>,
    time: f64,
    pub(crate) stepping_since: Option<f64>,
    pub(crate) pose: fn(&str) -> f64,
}

impl Walk {
    pub(crate) fn new(config: &Robot, sim: &SimParameters) -> Self {
        let urdf = read_project_file(&config.parameters.urdf_path).unwrap();
        let robot = CanRobot::new(config, &urdf, sim).unwrap().robot().clone();
        let joints: Vec<String> = config
            .parameters
            .joints
            .iter()
            .map(|j| j.name.clone())
            .collect();
        let start = (0..joints.len()).map(|j| robot.set_point(j)).collect();
        Self {
            robot,
            joints,
            start,
            time: 0.0,
            stepping_since: None,
            pose: |_| 0.0,
        }
    }

    /// One period later. `pose` is added to the start's angles, reached at 1 rad/s.
    pub(crate) fn advance(&mut self) -> &Readings {
        self.time += PERIOD;
        for j in 0..self.joints.len() {
            let name = &self.joints[j];
            let since = self.stepping_since.map_or(0.0, |t| self.time - t);
            let offset = if since > 0.0 { step(name, since) } else { 0.0 };
            self.robot
                .command(j, self.start[j] + offset + (self.pose)(name));
        }
        self.robot.advance()
    }

    pub(crate) fn truth(&self) -> &Truth {
        self.robot.truth()
    }

    pub(crate) fn time(&self) -> f64 {
        self.time
    }
}

/// Of a whole cycle of two steps, s.
pub(crate) const CYCLE: f64 = 2.4;
/// How long a foot is in the air, s; between the steps both are on the floor.
const SWING: f64 = 0.9;

/// Stepping on the spot: one leg stretched on the floor, the other drawn up, then the reverse; the
/// arms swing, the trunk turns. Feet leave and meet the floor slowly.
fn step(joint: &str, since: f64) -> f64 {
    let ramp = 0.5 * (1.0 - (std::f64::consts::PI * (since / 1.5).min(1.0)).cos());
    let phase = TAU * since / CYCLE;
    let (side, name) = match joint.split_once('_') {
        Some(("left", name)) => (1.0, name),
        Some(("right", name)) => (-1.0, name),
        _ => (0.0, joint),
    };
    let swing = side * phase.sin();
    let own = (since + if side < 0.0 { 0.5 * CYCLE } else { 0.0 }) % CYCLE;
    let drawn_up = if own < SWING && since >= CYCLE {
        0.5 * (1.0 - (TAU * own / SWING).cos())
    } else {
        0.0
    };
    // Stretched by 7 degrees, drawn up by 19 more than at the start.
    let lift = -0.12 + 0.45 * drawn_up;
    let angle = match name {
        "hip_pitch" => -lift,
        "knee" => 2.0 * lift,
        "ankle_pitch" => -lift,
        "hip_roll" => 0.04 * phase.sin(),
        "ankle_roll" => -0.04 * phase.sin(),
        "hip_yaw" => 0.05 * swing,
        "shoulder_pitch" => 0.4 * swing,
        "shoulder_roll" => 0.1 * side * (1.0 - phase.cos()),
        "shoulder_yaw" => 0.3 * swing,
        "elbow" => -0.25 * (1.0 - (phase).cos()),
        "wrist_yaw" | "wrist_pitch" | "wrist_roll" => 0.3 * swing,
        "chest_yaw" => 0.05 * phase.sin(),
        "chest_pitch" => 0.01 * (1.0 - phase.cos()),
        "head_yaw" => 0.3 * phase.sin(),
        "head_pitch" => 0.15 * phase.sin(),
        _ => 0.0,
    };
    ramp * angle
}

pub(crate) fn contact(link: &str, kind: ContactKind) -> ContactParameters {
    ContactParameters {
        link: link.into(),
        point: [0.0; 3].into(),
        kind,
    }
}

/// Full wrenches on chest and feet, hands free, with the filters' standard deviations.
pub(crate) fn parameters(config: &Robot, filters: Filters) -> WholeBodyParameters {
    let p = &config.parameters;
    let (sensors, encoders) = (filters.sensors(1), filters.encoders(1));
    let ft_sensor = |ft: &robot_config::FtParameters| FtSensorParameters {
        name: ft.sensor.name.clone(),
        cut: ft.sensor.frame.clone(),
        frame: Place::link(&ft.sensor.frame),
        sigma_force: sensors.noise_gain(0) * ft.sensor.sigma_force,
        sigma_torque: sensors.noise_gain(0) * ft.sensor.sigma_torque,
        lasting: ft.sensor.lasting,
    };
    let imu = p.imus.first().unwrap();
    WholeBodyParameters {
        joints: p.joints.iter().map(|j| j.name.clone()).collect(),
        // Rounding and noise of the encoders: 0.29 and 0.5 counts.
        sigma_ddq: (p.joints.iter())
            .map(|j| encoders.noise_gain(2) * 0.58 * j.estimator.link_resolution)
            .collect(),
        ft_sensors: p.ft_sensors.iter().map(ft_sensor).collect(),
        source: MotionSource::Imu(ImuParameters {
            frame: Place::link(&imu.frame),
            sigma_accelerometer: sensors.noise_gain(0) * imu.sigma_accelerometer,
            lasting_accelerometer: 0.02,
            sigma_angular_acceleration: sensors.noise_gain(1) * imu.sigma_gyro,
        }),
        hypotheses: vec![Hypothesis {
            name: "stepping".into(),
            contacts: vec![
                contact(CHEST, ContactKind::FullWrench),
                contact("left_foot", ContactKind::FullWrench),
                contact("right_foot", ContactKind::FullWrench),
                contact("left_hand", ContactKind::Nothing),
                contact("right_hand", ContactKind::Nothing),
            ],
        }],
        weighting: Weighting::Expected,
        residual: Residual::Stays,
        sigma_model: 0.01,
    }
}

/// Filters of equal delay on everything that enters the estimator.
pub(crate) struct Front {
    encoders: FilterBank,
    sensors: FilterBank,
    pub(crate) conditioning: Vec<FtConditioning>,
    q: Vec<f64>,
    axes: Vec<f64>,
    ft: Vec<Wrench>,
}

impl Front {
    pub(crate) fn new(joints: usize, ft_sensors: usize, filters: Filters) -> Self {
        let axes = 6 * (ft_sensors + 1);
        Self {
            encoders: filters.encoders(joints),
            sensors: filters.sensors(axes),
            conditioning: vec![FtConditioning::default(); ft_sensors],
            q: vec![0.0; joints],
            axes: vec![0.0; axes],
            ft: vec![Wrench::default(); ft_sensors],
        }
    }

    pub(crate) fn update(&mut self, readings: &Readings) -> WholeBodyInput<'_> {
        for (q, joint) in self.q.iter_mut().zip(&readings.joints) {
            *q = joint.q;
        }
        let sensors = readings.ft.iter().zip(&self.conditioning);
        for (axes, (raw, conditioning)) in self.axes.chunks_exact_mut(6).zip(sensors) {
            let raw: Vec<f64> = raw.force.iter().chain(&raw.torque).copied().collect();
            let w = conditioning.apply(&raw.try_into().unwrap(), None);
            axes[..3].copy_from_slice(&w.force);
            axes[3..].copy_from_slice(&w.torque);
        }
        let imu = self.axes.len() - 6;
        self.axes[imu..].copy_from_slice(&readings.imus[0]);
        self.encoders.update(&self.q);
        self.sensors.update(&self.axes);
        let values = self.sensors.values();
        for (w, x) in self.ft.iter_mut().zip(values.chunks_exact(6)) {
            w.force.copy_from_slice(&x[..3]);
            w.torque.copy_from_slice(&x[3..]);
        }
        let three = |x: &[f64], from: usize| [x[from], x[from + 1], x[from + 2]];
        WholeBodyInput {
            q: self.encoders.values(),
            dq: self.encoders.first_derivatives(),
            ddq: self.encoders.second_derivatives(),
            ft: &self.ft,
            imu: ImuMotion {
                angular_velocity: three(values, imu).into(),
                angular_acceleration: three(self.sensors.first_derivatives(), imu).into(),
                proper_acceleration: three(values, imu + 3).into(),
            },
        }
    }
}

/// Root mean square.
pub(crate) fn rms(x: &[f64]) -> f64 {
    (x.iter().map(|x| x * x).sum::<f64>() / x.len().max(1) as f64).sqrt()
}

/// Largest magnitude.
pub(crate) fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// Another pose to tare in: knees, elbows and wrists bent further.
pub(crate) fn bent(joint: &str) -> f64 {
    match joint.split_once('_').map_or(joint, |(_, name)| name) {
        "hip_pitch" => -0.5,
        "knee" => 0.6,
        "ankle_pitch" => 0.3,
        "elbow" => -0.6,
        "wrist_yaw" => 0.6,
        "wrist_pitch" => 0.5,
        _ => 0.0,
    }
}
