//! Parameters of a robot, validated, in SI units.

use crate::sampling::Sampling;
use crate::units::BEYOND_LIMIT;
use control::predictive::LawParameters;
use control::{CartesianLimits, JointGains, MotionLimits, MotorModel, TrajectoryLimits};
use core::fmt;
use core::net::Ipv4Addr;
use core::ops::RangeInclusive;
use dynamics::Base;
use estimators::compliance::JointEstimatorParameters;
use estimators::encoder::EncoderParameters;
use estimators::filter_bank::FilterDesign;
use estimators::local_gp::LocalGpParameters;
use estimators::savitzky_golay::SavitzkyGolayParameters;
use joint_file::JointFile;
use robot_state::{JointKind, Reactions};
use supervisor::{
    Actuation, DriveProfile, FollowingParameters, Limits, PlausibilityParameters, SignalParameters,
};
use whole_body::{FtConditioning, Hypothesis, LoadRule, TareParameters, Weighting};

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
    /// What carries its frames; the same kind for every bus of a robot.
    pub carrier: Carrier,
    /// Place in the configuration that names the interface, as `file:line: key`.
    pub interface_place: String,
    /// Paths of the DBC files, resolved against the configuration's folder.
    pub dbc_paths: Vec<String>,
    /// The bus carries CAN FD frames.
    pub fd: bool,
}

/// What carries the frames of a bus.
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

/// One joint. Its link-side quantities are in the units of its kind: m where rad is written, N where N·m
/// is, and kg where kg·m² is, if it is prismatic.
#[derive(Debug, Clone, PartialEq)]
pub struct JointParameters {
    /// The URDF's name.
    pub name: String,
    /// Its kind, and with it the units of its quantities.
    pub kind: JointKind,
    /// Index of the joint in the model.
    pub model_index: usize,
    /// Index of its bus.
    pub bus: usize,
    /// Name of its kind of drive.
    pub drive: String,
    /// The joint has an encoder on its link. Without one `q` is `theta/N` less the torsion that the
    /// estimated torque explains, and `motor`, `actuation` and lead are those over the motor-side angle.
    pub has_link_encoder: bool,
    /// True if the drive sends a velocity.
    pub has_velocity: bool,
    /// True if the drive sends a status word.
    pub has_status: bool,
    /// States of the drive, by its status word; without control words it is only watched. None: it
    /// has no states, and counts as enabled.
    pub drive_profile: Option<DriveProfile>,
    /// J: inertia of the rotor, motor side, kg·m².
    pub rotor_inertia: f64,
    /// Sampling of its link encoder; the motor's is later by the encoders' skew.
    pub sampling: Sampling,
    /// Ranges, gear and timing of its encoders.
    pub encoders: EncoderParameters,
    /// From encoders and current to torque (Z), where there is no calibration.
    pub estimator: JointEstimatorParameters,
    /// The joint file whose estimators give the torque from encoders and current.
    pub calibration: Option<JointFile>,
    /// The learned feed-forward of mode low-gain tracking, with inputs
    /// [`motion_inputs`](crate::feed_forward::motion_inputs).
    pub feed_forward: Option<LocalGpParameters>,
    /// What the predictive torque law knows of joint and drive.
    pub law: LawParameters,
    /// Part of the law's delay that is within the drive's own loop, s.
    pub drive_lag: f64,
    /// Inertia at the joint with the robot stretched out and its other joints held, without the
    /// rotor, kg·m².
    pub link_inertia: f64,
    /// Its motor model, which also determines whether commands are positions or currents.
    pub motor: MotorModel,
    /// Feedback gains.
    pub gains: JointGains,
    /// Limits of what is commanded.
    pub limits: Limits,
    /// How the drive turns commands into torque.
    pub actuation: Actuation,
    /// Greatest |dq| in mode torque, rad/s.
    pub torque_velocity: f64,
    /// Limits of plausible samples.
    pub plausibility: PlausibilityParameters,
    /// Its drive takes currents, and is sent a current of zero from the withdrawal of its set-points
    /// until it is off.
    pub zero_current: bool,
    /// Limits of its following error and velocity.
    pub following: FollowingParameters,
    /// Range and noise of its current.
    pub current_signal: SignalParameters,
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

impl JointParameters {
    /// Greatest |ddq_d| of a reference, rad/s²: folded, a limb has less than half of that inertia.
    #[must_use]
    pub fn desired_acceleration(&self) -> f64 {
        2.0 * self.acceleration()
    }

    /// Positions that a reference may ask for, rad: a little beyond the limits, where the joint may be
    /// held by its load.
    #[must_use]
    pub fn desired_range(&self) -> RangeInclusive<f64> {
        let beyond = self.kind.threshold(BEYOND_LIMIT);
        self.limits.position_min - beyond..=self.limits.position_max + beyond
    }

    /// The drive takes positions, not currents.
    #[must_use]
    pub fn takes_position(&self) -> bool {
        matches!(self.motor, MotorModel::Position { .. })
    }

    /// Acceleration that the torque limit gives the joint with the robot stretched out, rad/s².
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        let rotor = self.rotor_inertia * self.encoders.gear_ratio.powi(2);
        self.limits.torque / (rotor + self.link_inertia)
    }
}

/// Contacts, and the estimation of torques from F/T sensors and IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBodySettings {
    /// The link of a floating robot that a stand holds; none: the IMU measures the motion.
    pub stand: Option<Stand>,
    /// The link that an unknown wrench may act on (D 2.4); the root if none is named.
    pub unknown_wrench_link: Option<String>,
    /// Source of the IMU's angular acceleration.
    pub angular_acceleration: AngularAcceleration,
    /// Weights of the equations where there are fewer unknowns than equations.
    pub weighting: Weighting,
    /// Relative standard deviation of the model's masses, 1.
    pub sigma_model: f64,
    /// The contact sets; the first holds at the start. Empty: a full wrench beyond each
    /// F/T sensor and one on `unknown_wrench_link`.
    pub contacts: Vec<ContactSet>,
    /// Time over which one contact set is blended into the next, s.
    pub blend: f64,
    /// Forces at which an F/T sensor's part counts as loaded; none: only clients choose contact sets.
    pub load_rule: Option<LoadRule>,
}

/// A stand that holds a robot with a floating base.
#[derive(Debug, Clone, PartialEq)]
pub struct Stand {
    /// The link that stands still.
    pub link: String,
    /// g: acceleration of gravity in that link's axes, m/s² (3).
    pub gravity: [f64; 3],
}

/// A contact set.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactSet {
    /// Its name and its contacts.
    pub hypothesis: Hypothesis,
    /// The state of load at which the rule chooses it: indices of F/T sensors and whether each is
    /// loaded. Empty: only clients choose it.
    pub loaded: Vec<(usize, bool)>,
}

/// Detection of contacts by external torques, and what follows from one.
#[derive(Debug, Clone, PartialEq)]
pub struct ExternalTorqueSettings {
    /// Filters of all signals of the fast part.
    pub filters: SignalFilters,
    /// K: bandwidth of the momentum observer, 1/s.
    pub gain: f64,
    /// Lower thresholds.
    pub threshold: ContactThreshold,
    /// Upper threshold over the lower one, 1.
    pub upper_ratio: f64,
    /// Time for which a threshold must be exceeded, s.
    pub hold: f64,
    /// Time for which both torques must stay below two thirds of their thresholds until the contact is
    /// over, s.
    pub release: f64,
    /// Frame at which the contact force is estimated; none: it is not.
    pub frame: Option<String>,
    /// How a limb yields.
    pub reaction: ContactReaction,
}

/// Lower thresholds of external torques: multiples of the standard deviation, plus shares of each
/// joint's torque limit, 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactThreshold {
    /// Standard deviations.
    pub sigmas: f64,
    /// For the change of the external torque, a joint at rest.
    pub change: f64,
    /// For the external torque itself, a joint at rest.
    pub lasting: f64,
    /// More at the velocity limit, and proportionally less below.
    pub at_velocity_limit: f64,
    /// More at the acceleration that the torque limit gives the joint, and proportionally less below.
    pub at_acceleration_limit: f64,
    /// Of the change of the joint's torque within half a second.
    pub of_torque_change: f64,
}

/// How a limb yields to a contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactReaction {
    /// Greatest way of a joint that complies, of a revolute (rad) and of a prismatic joint (m); then it is
    /// stopped.
    pub comply: [f64; 2],
    /// Time without contact after which complying ends, s; none: only the operator ends it.
    pub comply_until_gone: Option<f64>,
    /// Way back of the joint that has come furthest, of a revolute (rad) and of a prismatic joint (m).
    pub retract: [f64; 2],
}

/// Thresholds from which on torque sources of a joint disagree.
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
    /// Shortest disagreement that counts, s.
    pub hold: f64,
}

/// Place and noise of an F/T sensor, for the whole-body estimator.
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
    /// Place and noise; the standard deviations are those of single samples.
    pub sensor: FtSensor,
    /// Index of its bus.
    pub bus: usize,
    /// Sampling of its signals.
    pub sampling: Sampling,
    /// From the raw signals to the wrench that the part beyond applies to the part before; includes
    /// the sign.
    pub conditioning: FtConditioning,
    /// Range and noise of its signals: force x y z, torque x y z.
    pub signals: Vec<SignalParameters>,
    /// True if the sensor sends a temperature.
    pub has_temperature: bool,
}

/// An IMU.
#[derive(Debug, Clone, PartialEq)]
pub struct ImuParameters {
    /// The link in whose frame it measures.
    pub frame: String,
    /// Index of its bus.
    pub bus: usize,
    /// Sampling of its signals.
    pub sampling: Sampling,
    /// Standard deviation of a sample of each gyro axis, rad/s.
    pub sigma_gyro: f64,
    /// Standard deviation of a sample of each accelerometer axis, m/s².
    pub sigma_accelerometer: f64,
    /// Range and noise of its signals: gyro x y z, accelerometer x y z.
    pub signals: Vec<SignalParameters>,
    /// Of an IMU beside the first one: mean difference from the motion that the first one shows, carried over
    /// by the joints, beyond which they disagree: of the angular velocity, rad/s, and of the acceleration, m/s².
    pub disagreement: [f64; 2],
}
