//! `sim.toml`: true parameters of the simulated robot that its configuration does not contain.

use problem::{Problem, line_at};
use read::*;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::de::{DeTable, Deserializer};
use units::ReadError;

mod drive;
mod read;
mod units;

pub use drive::*;

/// Everything in a `sim.toml`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimParameters {
    /// Seed of all randomness.
    #[serde(default)]
    pub seed: u64,
    /// Step of the simulation, s.
    #[serde(rename = "substep_us", deserialize_with = "micro")]
    pub substep: f64,
    /// URDF of the simulated robot; none: the configuration's. Relative to the file, once it is read.
    pub urdf: Option<String>,
    /// Masses, centres of mass and inertias differ from the URDF by up to this fraction.
    #[serde(
        default,
        rename = "inertia_error_per_cent",
        deserialize_with = "per_cent"
    )]
    pub inertia_error: f64,
    /// The pose at the start.
    #[serde(default)]
    pub start: StartParameters,
    /// The floor; absent: none.
    pub ground: Option<GroundParameters>,
    /// Links that can touch the floor.
    #[serde(default, rename = "foot")]
    pub feet: Vec<FootParameters>,
    /// A stand or harness that holds a link.
    pub harness: Option<HarnessParameters>,
    /// External pushes.
    #[serde(default, rename = "push")]
    pub pushes: Vec<PushParameters>,
    /// Losses of single drives' supplies.
    #[serde(default, rename = "power_loss")]
    pub power_losses: Vec<PowerLossParameters>,
    /// The way of the set-points to the drives.
    #[serde(default)]
    pub transport: TransportParameters,
    /// F/T sensors.
    #[serde(default)]
    pub ft_sensor: FtParameters,
    /// IMU.
    #[serde(default)]
    pub imu: ImuParameters,
    /// Kinds of drives, named as in `robot.toml`.
    #[serde(default, rename = "drive")]
    pub drives: BTreeMap<String, DriveParameters>,
}

/// `[transport]`: how the frames with set-points reach the drives.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransportParameters {
    /// Time from the sample from which a command was computed until it acts, s; one period of the
    /// loop if left out.
    #[serde(default, rename = "delay_us", deserialize_with = "optional_micro0")]
    pub delay: Option<f64>,
    /// Further delay, drawn for each frame up to this, s. Frames do not overtake each other.
    #[serde(default, rename = "jitter_us", deserialize_with = "micro0")]
    pub jitter: f64,
    /// Share of the frames that are lost, drawn for each.
    #[serde(default, rename = "lost_per_cent", deserialize_with = "per_cent")]
    pub lost: f64,
}

/// `[start]`: the pose at the start.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartParameters {
    /// Base position, m; its height is found if `on_ground`.
    #[serde(default, rename = "base_position_m", deserialize_with = "finite3")]
    pub base_position: [f64; 3],
    /// Base roll, pitch, yaw, rad.
    #[serde(default, rename = "base_rpy_deg", deserialize_with = "degrees3")]
    pub base_rpy: [f64; 3],
    /// Lower or lift the base until the feet carry the robot.
    #[serde(default)]
    pub on_ground: bool,
    /// Gears begin with a past, drawn: their hysteresis holds up to all of its torque, either way.
    #[serde(default)]
    pub gear_past: bool,
    /// Joint angles by name, rad; others are zero.
    #[serde(default, rename = "joints_deg", deserialize_with = "degrees_map")]
    pub joints: BTreeMap<String, f64>,
    /// Positions of prismatic joints by name, m; others are zero.
    #[serde(default, rename = "joints_mm", deserialize_with = "milli_map")]
    pub ways: BTreeMap<String, f64>,
}

/// `[ground]`: a level floor of springs and dampers, acting at the soles' corners.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundParameters {
    /// Height, m.
    #[serde(default, rename = "height_m", deserialize_with = "finite")]
    pub height: f64,
    /// Normal stiffness at one corner, N/m.
    #[serde(rename = "stiffness_N_per_m", deserialize_with = "positive")]
    pub stiffness: f64,
    /// Normal damping at one corner, N·s/m.
    #[serde(rename = "damping_Ns_per_m", deserialize_with = "non_negative")]
    pub damping: f64,
    /// Tangential stiffness at one corner while it sticks, N/m.
    #[serde(rename = "tangential_stiffness_N_per_m", deserialize_with = "positive")]
    pub tangential_stiffness: f64,
    /// Tangential damping at one corner while it sticks, N·s/m.
    #[serde(
        rename = "tangential_damping_Ns_per_m",
        deserialize_with = "non_negative"
    )]
    pub tangential_damping: f64,
    /// Coefficient of friction.
    #[serde(deserialize_with = "non_negative")]
    pub friction: f64,
}

/// `[[foot]]`: a sole.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FootParameters {
    /// The link's name.
    pub link: String,
    /// The sole's corners in the link's frame, m.
    #[serde(rename = "corners_m")]
    pub corners: Vec<[f64; 3]>,
}

/// `[harness]`: a spring-damper in all six directions between a link and where it is at the start.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HarnessParameters {
    /// The link's name.
    pub link: String,
    /// Stiffness against displacement, N/m.
    #[serde(rename = "stiffness_N_per_m", deserialize_with = "positive")]
    pub stiffness: f64,
    /// Damping of displacement, N·s/m.
    #[serde(rename = "damping_Ns_per_m", deserialize_with = "non_negative")]
    pub damping: f64,
    /// Stiffness against rotation, N·m/rad.
    #[serde(rename = "stiffness_Nm_per_rad", deserialize_with = "non_negative")]
    pub angular_stiffness: f64,
    /// Damping of rotation, N·m·s/rad.
    #[serde(rename = "damping_Nms_per_rad", deserialize_with = "non_negative")]
    pub angular_damping: f64,
    /// Displacement that meets no resistance, m: a harness that only catches a fall.
    #[serde(default, rename = "slack_m", deserialize_with = "non_negative")]
    pub slack: f64,
    /// Rotation that meets no resistance, rad.
    #[serde(default, rename = "slack_deg", deserialize_with = "degrees")]
    pub angular_slack: f64,
}

/// `[[push]]`: a wrench on a link for a while, at the link's origin in the world's axes.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PushParameters {
    /// The link's name.
    pub link: String,
    /// Start of the push, s since the start of the simulation.
    #[serde(rename = "start_s", deserialize_with = "non_negative")]
    pub start: f64,
    /// Duration, s; it swells and fades as half a sine.
    #[serde(rename = "duration_s", deserialize_with = "positive")]
    pub duration: f64,
    /// Peak force, N.
    #[serde(default, rename = "force_N", deserialize_with = "finite3")]
    pub force: [f64; 3],
    /// Peak torque, N·m.
    #[serde(default, rename = "torque_Nm", deserialize_with = "finite3")]
    pub torque: [f64; 3],
}

/// `[[power_loss]]`: a drive that is a node loses its supply for a while, and wakes up again.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PowerLossParameters {
    /// The joint's name.
    pub joint: String,
    /// Begin, s since the first SYNC.
    #[serde(rename = "start_s", deserialize_with = "non_negative")]
    pub start: f64,
    /// Duration, s.
    #[serde(rename = "duration_s", deserialize_with = "positive")]
    pub duration: f64,
}

/// `[ft_sensor]`: errors of the F/T sensors.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FtParameters {
    /// Noise of the forces, standard deviation, N.
    #[serde(default, rename = "noise_N", deserialize_with = "non_negative")]
    pub noise_force: f64,
    /// Noise of the torques, N·m.
    #[serde(default, rename = "noise_Nm", deserialize_with = "non_negative")]
    pub noise_torque: f64,
    /// Bias of each force axis, drawn up to this, N.
    #[serde(default, rename = "bias_N", deserialize_with = "non_negative")]
    pub bias_force: f64,
    /// Bias of each torque axis, drawn up to this, N·m.
    #[serde(default, rename = "bias_Nm", deserialize_with = "non_negative")]
    pub bias_torque: f64,
    /// The readings without load are the biases alone, not those and the configuration's `offset`.
    #[serde(default)]
    pub ignores_offset: bool,
    /// Growth of the biases, fraction of the bias per minute.
    #[serde(
        default,
        rename = "drift_per_minute",
        deserialize_with = "non_negative"
    )]
    pub drift: f64,
    /// Thermal drift of each force axis per degree above `neutral_temperature`, N/K.
    #[serde(default, rename = "warmth_N_per_K", deserialize_with = "finite")]
    pub warmth_force: f64,
    /// Thermal drift of each torque axis, N·m/K.
    #[serde(default, rename = "warmth_Nm_per_K", deserialize_with = "finite")]
    pub warmth_torque: f64,
    /// Temperature without thermal drift, °C.
    #[serde(default, rename = "neutral_temperature_C", deserialize_with = "finite")]
    pub neutral_temperature: f64,
    /// Temperature at the start, °C.
    #[serde(default, rename = "temperature_C", deserialize_with = "finite")]
    pub temperature: f64,
    /// Rate of warming of the sensors, K per minute.
    #[serde(default, rename = "warming_K_per_minute", deserialize_with = "finite")]
    pub warming: f64,
    /// Cross-talk of each force axis on the others, and of each torque axis likewise, drawn up to
    /// this fraction.
    #[serde(default, rename = "cross_talk_per_cent", deserialize_with = "per_cent")]
    pub cross_talk: f64,
    /// Sampling times.
    #[serde(default)]
    pub sampling: SamplingParameters,
}

/// `[imu]`: errors of the IMU.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuParameters {
    /// Noise of the gyro, standard deviation, rad/s.
    #[serde(
        default,
        rename = "gyro_noise_rad_per_s",
        deserialize_with = "non_negative"
    )]
    pub gyro_noise: f64,
    /// Bias of each gyro axis, drawn up to this, rad/s.
    #[serde(
        default,
        rename = "gyro_bias_rad_per_s",
        deserialize_with = "non_negative"
    )]
    pub gyro_bias: f64,
    /// Noise of the accelerometer, m/s².
    #[serde(
        default,
        rename = "accelerometer_noise_m_per_s2",
        deserialize_with = "non_negative"
    )]
    pub accelerometer_noise: f64,
    /// Bias of each accelerometer axis, drawn up to this, m/s².
    #[serde(
        default,
        rename = "accelerometer_bias_m_per_s2",
        deserialize_with = "non_negative"
    )]
    pub accelerometer_bias: f64,
    /// Sampling times.
    #[serde(default)]
    pub sampling: SamplingParameters,
}

/// `[ft_sensor.sampling]`, `[imu.sampling]`, `[drive.NAME.sensors.sampling]`: sampling times.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplingParameters {
    /// At SYNC, or by a clock of its own, whose phase is drawn for each sensor.
    #[serde(default)]
    pub sampled: Sampled,
    /// Age of the measured quantity when the sample is taken, s; of a drive: of both angles.
    #[serde(default, rename = "latency_us", deserialize_with = "micro0")]
    pub latency: f64,
    /// Time between its own samples, s; the loop's period if left out.
    #[serde(default, rename = "period_us", deserialize_with = "optional_micro")]
    pub period: Option<f64>,
    /// Rate error of its clock, drawn up to this fraction.
    #[serde(default, rename = "clock_error_ppm", deserialize_with = "per_million")]
    pub clock_error: f64,
    /// Delay between sample and time stamp of a frame that waits for the bus, drawn for each up to
    /// this, s.
    #[serde(default, rename = "stamp_jitter_us", deserialize_with = "micro0")]
    pub stamp_jitter: f64,
}

/// Trigger of a sensor's samples.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampled {
    /// SYNC.
    #[default]
    AtSync,
    /// Its own clock: it samples and sends.
    WhenSent,
}

impl SimParameters {
    fn read(text: &str) -> Result<Self, ReadError> {
        let mut root = DeTable::parse(text)?;
        let prismatic = units::to_revolute(root.get_mut())?;
        let mut parameters = Self::deserialize(Deserializer::from(root))?;
        for drive in prismatic {
            if let Some(drive) = parameters.drives.get_mut(&drive) {
                drive.set_prismatic();
            }
        }
        Ok(parameters)
    }

    /// The first table of a sensor with a clock of its own.
    #[must_use]
    pub fn free_running(&self) -> Option<String> {
        let drives = self.drives.iter();
        let drives = drives.map(|(name, d)| (format!("drive.{name}.sensors"), &d.sensors.sampling));
        let mut all = [
            ("ft_sensor".to_owned(), &self.ft_sensor.sampling),
            ("imu".to_owned(), &self.imu.sampling),
        ]
        .into_iter()
        .chain(drives);
        let own = all.find(|(_, sampling)| sampling.sampled == Sampled::WhenSent);
        own.map(|(name, _)| format!("{name}.sampling"))
    }

    /// The simulated robot's URDF beside that of its configuration.
    #[must_use]
    pub fn urdf_or<'a>(&'a self, configured: &'a str) -> &'a str {
        self.urdf.as_deref().unwrap_or(configured)
    }

    /// Reads a `sim.toml`.
    ///
    /// # Errors
    /// A [`Problem`] with file, line and key.
    pub fn parse(text: &str, file: &str) -> Result<Self, Problem> {
        let mut parameters = Self::read(text).map_err(|error| match error {
            ReadError::Toml(error) => locate(text, file, &error),
            ReadError::Units(problem, place) => problem.at(file, line_at(text, place)),
        })?;
        let beside = |urdf: &String| Path::new(file).with_file_name("").join(urdf);
        let urdf = parameters.urdf.as_ref().map(beside);
        parameters.urdf = urdf.map(|path| path.to_string_lossy().into_owned());
        if parameters.substep > 1e-3 {
            let us = 1e6 * parameters.substep;
            return Err(Problem::new(format!("substep_us: {us}"), "at most 1000").at(file, 0));
        }
        if parameters.start.on_ground && (parameters.ground.is_none() || parameters.feet.is_empty())
        {
            let reason = "start.on_ground: needs [ground] and at least one [[foot]]";
            return Err(Problem::new(reason, "").at(file, 0));
        }
        Ok(parameters)
    }
}
