//! Parameters of a robot, validated, in SI units.

mod calibration;
mod joint;
mod mounted;
mod sensors;
mod torques;

pub use calibration::JointCalibration;
pub use joint::{JointParameters, Thermal};
pub use mounted::{ActuatorSheet, CanopenSheet, Mount, MountedDrive, NodeSheet};
pub use sensors::{FtParameters, FtSensor, ImuParameters};
pub use torques::{
    ContactReaction, ContactSet, ContactThreshold, CrossCheckSettings, ExternalTorqueSettings,
    Stand, WholeBodySettings,
};

use control::{CartesianLimits, MotionLimits, TrajectoryLimits};
use core::fmt;
use core::net::Ipv4Addr;
use dynamics::Base;
use estimators::filter_bank::FilterDesign;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use robot_state::{Content, Reactions};
use whole_body::TareParameters;

/// All parameters of a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// The robot's name, at most 48 bytes.
    pub name: String,
    /// Path of the URDF, resolved against the configuration's folder.
    pub urdf_path: String,
    /// Attachment of the root link to the world.
    pub base: Base,
    /// The loop's timing.
    pub timing: Timing,
    /// The buses; a frame's `bus` is an index into them.
    pub buses: Vec<BusParameters>,
    /// Filters of the signals.
    pub filters: Filters,
    /// Contacts, and the estimation of torques from F/T sensors and IMU.
    pub whole_body: WholeBodySettings,
    /// Detection of contacts by external torques; none: there is none.
    pub external_torque: Option<ExternalTorqueSettings>,
    /// Parameters of a tare of the F/T sensors.
    pub tare: TareParameters,
    /// Cross-check of the torque sources; none: they are not compared.
    pub cross_check: Option<CrossCheckSettings>,
    /// When the robot may move, and how long waits may last.
    pub safety: SafetySettings,
    /// How a desired torque becomes a command.
    pub torque_law: TorqueLaw,
    /// K_f: gain on the contact force error (D12), 1.
    pub k_f: f64,
    /// Limits of the motions that the loop plans.
    pub motion: MotionSettings,
    /// Gains of modes that have their own.
    pub modes: ModeSettings,
    /// The joints, in config order.
    pub joints: Vec<JointParameters>,
    /// The F/T sensors, in config order.
    pub ft_sensors: Vec<FtParameters>,
    /// The IMUs: the first one shows the base's motion, the others check it and stand in for it.
    pub imus: Vec<ImuParameters>,
    /// The frames that mode Cartesian can lead, in config order.
    pub frames: Vec<FrameParameters>,
    /// The recording that always runs; none: there is none.
    pub recorder: Option<RecorderSettings>,
}

/// A recording that runs as long as the daemon does, into files that are removed by age.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecorderSettings {
    /// What it holds of every cycle.
    pub content: Content,
    /// Messages a second, of torques; none: one for each cycle.
    pub rate_hz: Option<f64>,
    /// Size at which a file ends and the next one begins, bytes.
    pub file_bytes: u64,
    /// Size of all files together above which the oldest ones are removed, bytes.
    pub kept_bytes: u64,
    /// Age at which a file is removed, s.
    pub kept_s: f64,
}

/// A frame that mode Cartesian leads.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameParameters {
    /// Its name, as clients call it.
    pub name: String,
    /// Index of its frame in the model.
    pub link: usize,
    /// Index of the frame in whose axes it is led; the root's by default.
    pub base: usize,
    /// Indices of the joints between base and frame, in config order: its limb.
    pub joints: Vec<usize>,
    /// Index of the F/T sensor that measures the forces on the frame; none: external torques do, if at all.
    pub sensor: Option<usize>,
    /// Limits of force, stiffness and velocity.
    pub limits: CartesianLimits,
    /// Share of `K_s` with which the limb's joints keep their posture, 0 to 1.
    pub posture_stiffness: f64,
    /// Share of `K_d` with which they are damped, 0 to 1.
    pub posture_damping: f64,
    /// Share of each joint's velocity limit at which a force moves it where it meets nothing, 0 to 1.
    pub approach: f64,
}

/// When the robot may move, and how long waits may last.
#[derive(Debug, Clone, PartialEq)]
pub struct SafetySettings {
    /// Drives are enabled without an operator, as for simulated robots.
    pub automatic: bool,
    /// Longest time for enabling all drives, and for coming to rest, s.
    pub time_limit: f64,
    /// Longest time for which frames cannot be sent, s.
    pub send_failing: f64,
    /// Greatest share of late cycles within a second, 0 to 1.
    pub late_share: f64,
    /// Longest time without a sign of the thread that serves clients, s.
    pub publisher_timeout: f64,
    /// The reaction to each event.
    pub reactions: Reactions,
}

/// Limits of the motions that the loop plans, as shares of what each joint can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionSettings {
    /// Of the velocity limit, 0 to 1.
    pub velocity: f64,
    /// Of the acceleration that the torque limit gives the joint with the robot stretched out, 0 to 1.
    pub acceleration: f64,
    /// Time in which the acceleration rises from 0 to its limit, s.
    pub jerk_time: f64,
}

/// Gains of modes passive and low-gain tracking, as shares of each joint's configured ones, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeSettings {
    /// Damping of joints that are let go, of K_d.
    pub passive_damping: f64,
    /// Stiffness of low-gain tracking, of K_s.
    pub low_stiffness: f64,
    /// Its damping, of K_d.
    pub low_damping: f64,
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
    /// Longest wait for answers after SYNC, s.
    pub gather_deadline: f64,
    /// A joint without a new sample for longer is a fault, s.
    pub stale_after: f64,
    /// A client without a new reference for longer loses control, s.
    pub reference_timeout: f64,
    /// Start without real-time scheduling, or not.
    pub real_time: RealTime,
    /// SCHED_FIFO priority of the loop, 1 to 99.
    pub priority: u8,
    /// The core that the loop is bound to; any if none is named.
    pub cpu: Option<usize>,
}

/// Start without real-time scheduling, or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RealTime {
    /// Start anyway, and report what is missing.
    Try,
    /// Refuse to start.
    Require,
}

/// A CAN bus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BusParameters {
    /// Name, as joints and sensors call it.
    pub name: String,
    /// Carrier of its frames; the same kind for every bus of a robot.
    pub carrier: Carrier,
    /// Place in the configuration that names the interface, as `file:line: key`.
    pub interface_place: String,
    /// Paths of the DBC files, resolved against the configuration's folder.
    pub dbc_paths: Vec<String>,
    /// The bus carries CAN FD frames.
    pub fd: bool,
}

/// Carrier of a bus's frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carrier {
    /// The CAN interface of this name.
    SocketCan(String),
    /// Datagrams to a multicast group, for simulated robots.
    UdpMulticast(UdpGroup),
}

impl fmt::Display for Carrier {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SocketCan(interface) => f.write_str(interface),
            Self::UdpMulticast(UdpGroup { group, port, .. }) => write!(f, "{group}:{port}"),
        }
    }
}

/// A multicast group that carries CAN frames as python-can's `udp_multicast` does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdpGroup {
    /// Address of the group.
    pub group: Ipv4Addr,
    /// UDP port.
    pub port: u16,
    /// Name of the network interface; the one of the system's route to the group if none is named.
    pub interface: Option<String>,
    /// Routers that a datagram may pass, plus one; 0: it stays on this machine.
    pub hop_limit: u8,
}

/// Source of the IMU's angular acceleration (D 2.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngularAcceleration {
    /// The filtered gyro's derivative.
    Differentiate,
    /// It is taken as zero.
    Neglect,
}

/// How a desired torque becomes a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TorqueLaw {
    /// Feed-forward by the motor model, and PI feedback of the torque's error (D10-D12).
    ProportionalIntegral(TorqueFeedback),
    /// State feedback on the torque that will act when the command does.
    Predictive(FastTorqueFeedback),
}

impl TorqueLaw {
    /// The law feeds back what encoders or torsion measure.
    #[must_use]
    pub fn uses_encoders(self) -> bool {
        self != Self::ProportionalIntegral(TorqueFeedback::WholeBody)
    }

    /// The law feeds back what F/T sensors and IMU measure.
    #[must_use]
    pub fn uses_sensors(self) -> bool {
        use FastTorqueFeedback::Torsion;
        let without = [
            Self::ProportionalIntegral(TorqueFeedback::Encoder),
            Self::Predictive(Torsion),
        ];
        !without.contains(&self)
    }
}

/// Torque that the predictive law feeds back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FastTorqueFeedback {
    /// From the gear's torsion.
    Torsion,
    /// From the gear's torsion times its learned gain, with the level of F/T sensors and IMU.
    Levelled,
    /// `tau_hat`, the delay-compensated torque.
    DelayCompensated,
}

/// Torque estimate that the PI law feeds back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TorqueFeedback {
    /// From F/T sensors and IMU (D 2).
    WholeBody,
    /// From encoders and current (Z).
    Encoder,
}

/// Ratio of the links' frequency on their gears to the bandwidth of the explained torsion: its square is
/// the inverse of the loop's gain.
const TORSION_FREQUENCY_RATIO: f64 = 4.0;

impl Parameters {
    /// Bandwidth in which the torque explains the torsion of joints without a link-side encoder, rad/s:
    /// a share of the least frequency that their links can have on their gears, from the inertias with the
    /// robot stretched out and the gears without load, where they are softest. Infinite without such joints.
    #[must_use]
    pub fn torsion_bandwidth(&self) -> f64 {
        let joints = self.joints.iter().filter(|joint| !joint.has_link_encoder);
        let squares = joints.map(|joint| {
            let (gear, n) = (&joint.estimator.compliance, joint.encoders.gear_ratio);
            joint.link_inertia * (1.0 / gear.k_fs0 + 1.0 / (n * n * gear.k_wg0))
        });
        1.0 / (TORSION_FREQUENCY_RATIO * squares.sum::<f64>().sqrt())
    }

    /// Limits of each joint in motions that the loop plans.
    pub fn motion_limits(&self) -> impl Iterator<Item = MotionLimits> {
        self.joints.iter().map(|joint| {
            let acceleration = self.motion.acceleration * joint.acceleration();
            MotionLimits {
                velocity: self.motion.velocity * joint.limits.velocity,
                acceleration,
                jerk: acceleration / self.motion.jerk_time,
            }
        })
    }

    /// Limits of each joint on trajectories that clients send ahead.
    pub fn trajectory_limits(&self) -> impl Iterator<Item = TrajectoryLimits> {
        let joints = self.joints.iter().zip(self.motion_limits());
        joints.map(|(joint, stop)| TrajectoryLimits {
            position_min: *joint.desired_range().start(),
            position_max: *joint.desired_range().end(),
            velocity: joint.limits.velocity,
            acceleration: joint.desired_acceleration(),
            stop,
        })
    }
}
