//! What a configuration says, validated, in SI units.

use crate::sampling::Sampling;
use control::{JointGains, JointLimits, MotorModel};
use dynamics::Base;
use estimators::compliance::JointEstimatorParameters;
use estimators::encoder::EncoderParameters;
use estimators::filter_bank::FilterDesign;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use joint_file::JointFile;
use whole_body::{FtConditioning, Hypothesis, LoadRule, TareParameters, Weighting};

/// Everything that a configuration says.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The robot's name, at most 48 bytes.
    pub name: String,
    /// Path of the URDF, resolved against the configuration's folder.
    pub urdf_path: String,
    /// How the root link is attached to the world.
    pub base: Base,
    /// The loop's timing.
    pub timing: Timing,
    /// The buses; a frame's `bus` is an index into them.
    pub buses: Vec<BusParameters>,
    /// Filters of the signals.
    pub filters: Filters,
    /// Contacts, and how torques follow from F/T sensors and IMU.
    pub whole_body: WholeBodySettings,
    /// How external torques are observed; none: they are not.
    pub external_torque: Option<ExternalTorqueSettings>,
    /// How F/T sensors are tared.
    pub tare: TareParameters,
    /// How torque sources watch each other; none: they do not.
    pub cross_check: Option<CrossCheckSettings>,
    /// Which torque estimate is fed back.
    pub torque_feedback: TorqueFeedback,
    /// K_f: gain on the contact force error (D12), 1.
    pub k_f: f64,
    /// The joints, in config order.
    pub joints: Vec<JointParameters>,
    /// The F/T sensors, in config order.
    pub ft_sensors: Vec<FtParameters>,
    /// The IMU, if there is one.
    pub imu: Option<ImuParameters>,
}

/// Filters of the signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filters {
    /// The long filters: for the torque from F/T sensors and IMU, contact wrenches and feedback.
    pub long: SignalFilters,
    /// Samples of the longer of the long filters' windows.
    pub window: usize,
    /// The short filters: for the delay-compensated torque.
    pub short: SignalFilters,
    /// Of the velocities that control uses: short, as delay costs stability.
    pub control: SavitzkyGolayParameters,
}

/// Filters of all signals of the equations of motion, equally late.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalFilters {
    /// Of encoders: value and two derivatives.
    pub encoder: FilterDesign,
    /// Of F/T sensors and IMU: value and one derivative.
    pub sensor: FilterDesign,
}

/// The loop's timing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// T: time between cycles, s.
    pub sample_period: f64,
    /// How long after SYNC answers are waited for, s.
    pub gather_deadline: f64,
    /// A joint that is silent for longer is a fault, s.
    pub stale_after: f64,
    /// A client that is silent for longer has lost control, s.
    pub reference_timeout: f64,
    /// Whether to start without real-time scheduling.
    pub real_time: RealTime,
    /// SCHED_FIFO priority of the loop, 1 to 99.
    pub priority: u8,
    /// The core that the loop is bound to; any if none is named.
    pub cpu: Option<usize>,
}

/// Whether to start without real-time scheduling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RealTime {
    /// Start anyway, and say what is missing.
    Try,
    /// Refuse to start.
    Require,
}

/// A CAN bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusParameters {
    /// Name, as joints and sensors call it.
    pub name: String,
    /// Name of the network interface.
    pub interface: String,
    /// Where the configuration names it, as `file:line: key`.
    pub interface_place: String,
    /// Paths of the DBC files, resolved against the configuration's folder.
    pub dbc_paths: Vec<String>,
    /// The bus carries CAN FD frames.
    pub fd: bool,
}

/// Where the angular acceleration of the IMU comes from (D 2.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngularAcceleration {
    /// The filtered gyro's derivative.
    Differentiate,
    /// It is taken as zero.
    Neglect,
}

/// Which torque estimate is fed back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TorqueFeedback {
    /// From F/T sensors and IMU (D 2).
    WholeBody,
    /// From encoders and current (Z).
    Encoder,
}

/// One joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointParameters {
    /// The URDF's name.
    pub name: String,
    /// Index of the joint in the model.
    pub model_index: usize,
    /// Index of its bus.
    pub bus: usize,
    /// Name of its kind of drive.
    pub drive: String,
    /// Whether a velocity comes over the bus.
    pub has_velocity: bool,
    /// Whether a status word comes over the bus.
    pub has_status: bool,
    /// J: inertia of the rotor, motor side, kg·m².
    pub rotor_inertia: f64,
    /// When its link encoder is sampled; the motor's is later by the encoders' skew.
    pub sampling: Sampling,
    /// How its encoders are read.
    pub encoders: EncoderParameters,
    /// From encoders and current to torque (Z), where there is no calibration.
    pub estimator: JointEstimatorParameters,
    /// The joint file whose estimators give the torque from encoders and current.
    pub calibration: Option<JointFile>,
    /// What its command means: position or current.
    pub motor: MotorModel,
    /// Feedback gains.
    pub gains: JointGains,
    /// Limits of what is commanded.
    pub limits: JointLimits,
}

impl JointParameters {
    /// The drive takes positions, not currents.
    #[must_use]
    pub fn takes_position(&self) -> bool {
        matches!(self.motor, MotorModel::Position { .. })
    }
}

/// Contacts, and how torques follow from F/T sensors and IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodySettings {
    /// The link of a floating robot that a stand holds; none: the IMU tells how it moves.
    pub stand: Option<Stand>,
    /// The link that an unknown wrench may act on (D 2.4); the root if none is named.
    pub unknown_wrench_link: Option<String>,
    /// Where the angular acceleration of the IMU comes from.
    pub angular_acceleration: AngularAcceleration,
    /// How equations weigh where there are fewer unknowns than equations.
    pub weighting: Weighting,
    /// Relative standard deviation of the model's masses, 1.
    pub sigma_model: f64,
    /// What may touch the robot; the first holds at the start. Empty: a full wrench beyond each
    /// F/T sensor and one on `unknown_wrench_link`.
    pub contacts: Vec<ContactSet>,
    /// Time over which one set of contacts gives way to another, s.
    pub blend: f64,
    /// When an F/T sensor's part counts as loaded; none: only clients change contacts.
    pub load_rule: Option<LoadRule>,
}

/// What holds a robot whose root could move.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// The link that stands still.
    pub link: String,
    /// g: acceleration of gravity in that link's axes, m/s² (3).
    pub gravity: [f64; 3],
}

/// A set of contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSet {
    /// Its name and its contacts.
    pub hypothesis: Hypothesis,
    /// The state of load at which the rule chooses it: indices of F/T sensors and whether each is
    /// loaded. Empty: only clients choose it.
    pub loaded: Vec<(usize, bool)>,
}

/// How external torques are observed.
#[derive(Debug, Clone, PartialEq)]
pub struct ExternalTorqueSettings {
    /// K: bandwidth of the observer, 1/s.
    pub gain: f64,
    /// External torque that tells a contact, as a share of the torque limit, 1.
    pub threshold_share: f64,
    /// How long it must last, s.
    pub hold: f64,
}

/// When torque sources of a joint disagree.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossCheckSettings {
    /// Normal difference of encoders and F/T sensors, as a share of the torque limit, 1.
    pub encoder_share: f64,
    /// Torque from which on the current is judged, as a share of the torque limit, 1.
    pub current_load_share: f64,
    /// Smallest and largest normal ratio of the current's torque to the others'.
    pub current_ratio: [f64; 2],
    /// Normal residual of a part, in standard deviations.
    pub residual_ratio: f64,
    /// Time over which differences are averaged, s.
    pub average: f64,
    /// How long a disagreement must last, s.
    pub hold: f64,
}

/// What the whole-body estimator needs to know of an F/T sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct FtSensor {
    /// The sensor's name.
    pub name: String,
    /// The link in whose frame it measures; it and all beyond it is the end-effector.
    pub frame: String,
    /// The link beyond the sensor that the environment touches; the sensor's own if none is
    /// named.
    pub contact_link: Option<String>,
    /// Standard deviation of each force axis of a sample, N.
    pub sigma_force: f64,
    /// Standard deviation of each torque axis of a sample, N·m.
    pub sigma_torque: f64,
}

/// One F/T sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct FtParameters {
    /// What the estimator needs; the standard deviations are those of single samples.
    pub sensor: FtSensor,
    /// Index of its bus.
    pub bus: usize,
    /// When it samples.
    pub sampling: Sampling,
    /// From what comes over the bus to the wrench that the part beyond applies to the part before;
    /// the sign is already in it.
    pub conditioning: FtConditioning,
    /// Whether a temperature comes over the bus.
    pub has_temperature: bool,
}

/// The IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuParameters {
    /// The link in whose frame it measures.
    pub frame: String,
    /// Index of its bus.
    pub bus: usize,
    /// When it samples.
    pub sampling: Sampling,
    /// Standard deviation of a sample of each gyro axis, rad/s.
    pub sigma_gyro: f64,
    /// Standard deviation of a sample of each accelerometer axis, m/s².
    pub sigma_accelerometer: f64,
}
