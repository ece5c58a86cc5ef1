//! One record per arrow of the pipeline.

use crate::event::EVENT_COUNT;
use crate::layout::record;
use crate::name::Name;

/// Joints a record can hold.
pub const MAX_JOINTS: usize = 64;
/// Force/torque sensors a record can hold.
pub const MAX_FT_SENSORS: usize = 8;
/// Sets of contacts a robot can have.
pub const MAX_CONTACT_SETS: usize = 16;

/// A value of all zeros, the start of every record.
pub trait Zero {
    /// All zeros.
    const ZERO: Self;
}
impl Zero for u8 {
    const ZERO: Self = 0;
}
impl Zero for u32 {
    const ZERO: Self = 0;
}
impl Zero for u64 {
    const ZERO: Self = 0;
}
impl Zero for f64 {
    const ZERO: Self = 0.0;
}
impl<T: Zero, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

/// Flag bits of measured values.
pub mod measured_flags {
    /// No sample in this cycle: the last one bridges the gap.
    pub const MISSED: u32 = 1;
    /// No sample for longer than `loop.stale_after_ms`.
    pub const STALE: u32 = 2;
    /// The encoder moved further than the joint can: the sample was not used.
    pub const JUMP: u32 = 4;
    /// No sample has ever arrived.
    pub const NEVER: u32 = 8;
    /// The filters have not yet seen as many samples as their window holds.
    pub const SETTLING: u32 = 16;
}

/// Flag bits of a torque estimate.
pub mod torque_flags {
    /// The value may be used.
    pub const VALID: u32 = 1;
    /// The estimate reached the joint's torque limit.
    pub const SATURATED: u32 = 2;
    /// Filters are still filling, or the input was bridged.
    pub const DEGRADED: u32 = 4;
}

/// Where a torque estimate comes from.
pub mod torque_source {
    /// No source.
    pub const NONE: u32 = 0;
    /// Compliance model of the harmonic drive: encoders and current.
    pub const ENCODER: u32 = 1;
    /// Newton-Euler from F/T sensors and IMU.
    pub const WHOLE_BODY: u32 = 2;
    /// Motor current less friction (D3).
    pub const CURRENT: u32 = 3;
    /// Several sources weighted by their variances.
    pub const FUSED: u32 = 4;
}

/// What the robot is asked to do.
pub mod mode {
    /// Hold the measured position with the drives' own position loop.
    pub const HOLD: u32 = 0;
    /// Follow `tau_d` from the client.
    pub const TORQUE: u32 = 1;
    /// Follow `q_d dq_d ddq_d` and contact forces by inverse dynamics.
    pub const INVERSE_DYNAMICS: u32 = 2;
}

/// Flag bits of a joint's command.
pub mod control_flags {
    /// The position limit is active.
    pub const POSITION_LIMITED: u32 = 1;
    /// The torque limit is active.
    pub const TORQUE_LIMITED: u32 = 2;
    /// `|delta_q|` is at its limit.
    pub const DELTA_Q_LIMITED: u32 = 4;
}

record! {
    /// A force and a torque at one point, in that point's axes.
    pub struct Wrench {
        /// f: force, N, x y z.
        pub force: [f64; 3],
        /// n: torque about the frame's origin, N·m, x y z.
        pub torque: [f64; 3],
    }
}

impl Wrench {
    /// Force, then torque.
    #[must_use]
    pub const fn to_array(&self) -> [f64; 6] {
        let ([fx, fy, fz], [tx, ty, tz]) = (self.force, self.torque);
        [fx, fy, fz, tx, ty, tz]
    }

    /// Of force, then torque.
    #[must_use]
    pub const fn from_array([fx, fy, fz, tx, ty, tz]: [f64; 6]) -> Self {
        Self {
            force: [fx, fy, fz],
            torque: [tx, ty, tz],
        }
    }
}

record! {
    /// A joint as its sensors saw it, brought to link-side SI units.
    pub struct JointMeasured {
        /// q: link-side angle, rad, newest sample.
        pub q: f64,
        /// theta: motor-side angle, rad, unwrapped over many turns, newest sample.
        pub theta: f64,
        /// torsion: theta/N - q, rad.
        pub torsion: f64,
        /// i: motor current, A.
        pub current: f64,
        /// dq: link-side velocity from a short filter, rad/s; what control uses.
        pub dq: f64,
        /// q: filtered link-side angle, rad, late by `filter_delay_s`.
        pub q_hat: f64,
        /// dq: filtered link-side velocity, rad/s, late by `filter_delay_s`.
        pub dq_hat: f64,
        /// ddq: filtered link-side acceleration, rad/s², late by `filter_delay_s`.
        pub ddq_hat: f64,
        /// omega: motor-side velocity, rad/s.
        pub omega: f64,
        /// Age of the newest sample, s.
        pub age_s: f64,
        /// The drive's status word as received.
        pub status: u32,
        /// Bits of `measured_flags`.
        pub flags: u32,
    }
}

record! {
    /// A joint's torque, with what is needed to judge it.
    pub struct TorqueEstimate {
        /// tau: torque that the transmission applies to the child link along +q, N·m.
        pub tau: f64,
        /// sigma: standard deviation of tau, N·m.
        pub sigma: f64,
        /// How late the estimate is against the newest sample, s.
        pub delay_s: f64,
        /// One of `torque_source`.
        pub source: u32,
        /// Bits of `torque_flags`.
        pub flags: u32,
    }
}

record! {
    /// A joint's command and what it is made of.
    pub struct JointControl {
        /// tau_d: wanted torque, N·m (D12).
        pub tau_d: f64,
        /// tau*: wanted torque with feedback on the estimated torque, N·m (D11).
        pub tau_star: f64,
        /// delta_q: commanded offset to the measured position, rad (D10).
        pub delta_q: f64,
        /// q_c: commanded position after all limits, rad.
        pub q_c: f64,
        /// i_c: commanded current after all limits, A (current-commanded drives).
        pub current_c: f64,
        /// Contribution to delta_q of the torque feed-forward, rad (D 5.5).
        pub feedforward_torque: f64,
        /// Contribution to delta_q of the friction feed-forward, rad.
        pub feedforward_friction: f64,
        /// Contribution to delta_q of the position error, rad.
        pub feedback_position: f64,
        /// Contribution to delta_q of the velocity error, rad.
        pub feedback_velocity: f64,
        /// Contribution to delta_q of the acceleration error, rad.
        pub feedback_acceleration: f64,
        /// Contribution to delta_q of the contact force error, rad.
        pub feedback_force: f64,
        /// Bits of `control_flags`.
        pub flags: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// All of one joint in one cycle.
    pub struct JointRecord {
        /// What the sensors saw.
        pub measured: JointMeasured,
        /// Torque from encoders and current (Z).
        pub tau_encoder: TorqueEstimate,
        /// Torque from F/T sensors and IMU (D 2).
        pub tau_whole_body: TorqueEstimate,
        /// Torque from the current less friction (D3); not valid without `[cross_check]`.
        pub tau_current: TorqueEstimate,
        /// tau_hat: torque now, from encoders, F/T sensors and rigid-body model.
        pub tau_hat: TorqueEstimate,
        /// tau_ext: torque that the environment applies to the joint where no F/T sensor tells it,
        /// N·m; zero without `[external_torque]`.
        pub tau_ext: f64,
        /// 1: `tau_ext` tells a contact.
        pub contact: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// What is commanded.
        pub control: JointControl,
    }
}

record! {
    /// One F/T sensor in one cycle.
    pub struct FtRecord {
        /// Wrench that the part beyond the sensor applies to the part before it, in the sensor's
        /// frame, newest sample.
        pub measured: Wrench,
        /// The same, filtered.
        pub filtered: Wrench,
        /// f_hat: wrench that the environment applies to the end-effector, at the sensor's frame,
        /// inertia and weight of the end-effector removed (D 2.2).
        pub contact: Wrench,
        /// What conditioning takes off the calibrated reading: config and tare.
        pub offset: Wrench,
        /// What the contacts of the part beyond the sensor cannot explain, in the frame of the
        /// sensor's first link.
        pub residual: Wrench,
        /// Expected standard deviation of `residual`; zero where the contacts explain anything.
        pub residual_sigma: Wrench,
        /// Temperature, °C; zero if the sensor tells none.
        pub temperature: f64,
        /// Age of the newest sample, s.
        pub age_s: f64,
        /// Bits of `measured_flags`.
        pub flags: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// The inertial measurement unit in one cycle.
    pub struct ImuRecord {
        /// Angular velocity in the sensor's frame, rad/s, newest sample.
        pub gyro: [f64; 3],
        /// Acceleration minus gravity in the sensor's frame, m/s², newest sample.
        pub accelerometer: [f64; 3],
        /// Filtered angular velocity, rad/s.
        pub gyro_hat: [f64; 3],
        /// Filtered acceleration minus gravity, m/s².
        pub accelerometer_hat: [f64; 3],
        /// Angular acceleration from the filtered gyro, rad/s²; zero if neglected.
        pub angular_acceleration_hat: [f64; 3],
        /// Age of the newest sample, s.
        pub age_s: f64,
        /// Bits of `measured_flags`.
        pub flags: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// Everything that one cycle measured, estimated and commanded.
    pub struct CycleRecord {
        /// Cycle number since start.
        pub sequence: u64,
        /// Instant of the cycle, ns on the caller's clock.
        pub stamp_ns: u64,
        /// One of `mode`: what the robot is doing now.
        pub mode: u32,
        /// Number of the latched fault's event, or 0.
        pub fault: u32,
        /// Joints in use.
        pub joint_count: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// Number of the cross-check's event that stands first, or 0.
        pub warning: u32,
        /// The joint that `warning` is about, or the F/T sensor (events 205 and 208).
        pub warning_subject: u32,
        /// Place in `Description::contact_names` of the contacts that the robot is taken to have.
        pub contacts: u32,
        /// 1: the automatic rule chooses contacts; 0: a client has chosen, or there is no rule.
        pub contacts_automatic: u32,
        /// Delay of the filtered quantities, s.
        pub filter_delay_s: f64,
        /// The joints, in config order.
        pub joints: [JointRecord; MAX_JOINTS],
        /// The F/T sensors, in config order.
        pub ft: [FtRecord; MAX_FT_SENSORS],
        /// The IMU; zero if there is none.
        pub imu: ImuRecord,
        /// f_u: wrench not explained by the F/T sensors: that of the last contact of the set, by
        /// default at the unknown-wrench link (D 2.4).
        pub unknown_wrench: Wrench,
        /// Expected standard deviation of `unknown_wrench`.
        pub unknown_wrench_sigma: Wrench,
        /// What the contacts of the part with the root cannot explain, in the root's frame.
        pub residual: Wrench,
        /// Expected standard deviation of `residual`; zero where the contacts explain anything.
        pub residual_sigma: Wrench,
        /// How often each event occurred since start, in the order of `Event::ALL`.
        pub events: [u64; EVENT_COUNT],
    }
}

record! {
    /// What the loop around the cycle measured of itself.
    pub struct LoopRecord {
        /// Cycles run.
        pub cycles: u64,
        /// Cycles that ended after the next one should have begun.
        pub late_cycles: u64,
        /// Cycles whose start was passed over.
        pub skipped_cycles: u64,
        /// How late the thread woke, ns.
        pub wake_late_ns: u64,
        /// From SYNC until every joint had answered or the deadline had passed, ns.
        pub gather_ns: u64,
        /// Computing time of the cycle, ns.
        pub compute_ns: u64,
        /// Time to hand the commands to the bus, ns.
        pub send_ns: u64,
        /// Frames received since start.
        pub frames_received: u64,
        /// Frames sent since start.
        pub frames_sent: u64,
    }
}

record! {
    /// What shared memory carries each cycle.
    pub struct SharedRecord {
        /// The cycle.
        pub cycle: CycleRecord,
        /// The loop around it.
        pub timing: LoopRecord,
    }
}

record! {
    /// Names and constants of the robot, published once.
    pub struct Description {
        /// The robot's name.
        pub robot: Name,
        /// Cycles a second, Hz.
        pub rate_hz: f64,
        /// Joints in use.
        pub joint_count: u32,
        /// F/T sensors in use.
        pub ft_count: u32,
        /// The joints' names, in the order of `CycleRecord::joints`.
        pub joint_names: [Name; MAX_JOINTS],
        /// The F/T sensors' names, in the order of `CycleRecord::ft`.
        pub ft_names: [Name; MAX_FT_SENSORS],
        /// The joints' torque limits, N·m.
        pub torque_limits: [f64; MAX_JOINTS],
        /// Sets of contacts in use.
        pub contact_count: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// The names of the sets of contacts; the first holds at the start.
        pub contact_names: [Name; MAX_CONTACT_SETS],
    }
}

record! {
    /// What a client wants of one joint.
    pub struct JointReference {
        /// q_d: wanted link-side angle, rad.
        pub q_d: f64,
        /// dq_d: wanted velocity, rad/s.
        pub dq_d: f64,
        /// ddq_d: wanted acceleration, rad/s².
        pub ddq_d: f64,
        /// tau_d: wanted torque, N·m (mode torque; not used by inverse dynamics).
        pub tau_d: f64,
    }
}

record! {
    /// What a client wants of the robot.
    pub struct Reference {
        /// Counts up with each message of the client.
        pub sequence: u64,
        /// One of `mode`.
        pub mode: u32,
        /// Joints in use; must equal the robot's.
        pub joint_count: u32,
        /// The joints, in the order of `CycleRecord::joints`.
        pub joints: [JointReference; MAX_JOINTS],
        /// f_d: wrench that the environment shall apply to each end-effector, at its F/T sensor's
        /// frame, in the order of `CycleRecord::ft`.
        pub contact: [Wrench; MAX_FT_SENSORS],
        /// 1 where `contact` is meant; 0: the estimated contact wrench is used as it is.
        pub contact_given: u32,
        /// 1 asks for the reset of a latched fault.
        pub reset_fault: u32,
    }
}

record! {
    /// What changes seldom, at the request of clients: the loop takes it over as it comes.
    pub struct Settings {
        /// Counts up with each change.
        pub sequence: u64,
        /// 0: the automatic rule chooses contacts, or the first set holds where there is none; else
        /// the chosen set's place in `Description::contact_names`, plus one.
        pub contacts: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
        /// What a tare found: to be taken off each F/T sensor's reading besides the config's offset.
        pub ft_offset: [Wrench; MAX_FT_SENSORS],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{Layout, Shape, layout_hash};

    fn assert_packed(shape: &Shape) -> usize {
        match shape {
            Shape::U8 => 1,
            Shape::U32 => 4,
            Shape::U64 | Shape::F64 => 8,
            Shape::Array(element, count) => assert_packed(element) * count,
            Shape::Record(name, fields, size) => {
                let mut end = 0;
                for field in *fields {
                    assert_eq!(field.offset, end, "{name}.{} leaves a hole", field.name);
                    end += assert_packed(&field.shape);
                }
                assert_eq!(end, *size, "{name} has padding at its end");
                end
            }
        }
    }

    #[test]
    fn records_have_no_hidden_padding() {
        assert_packed(&SharedRecord::SHAPE);
        assert_packed(&Description::SHAPE);
        assert_packed(&Reference::SHAPE);
        assert_packed(&Settings::SHAPE);
        assert_packed(&crate::Request::SHAPE);
        assert_packed(&crate::Answer::SHAPE);
    }

    #[test]
    fn different_records_have_different_hashes() {
        assert_ne!(layout_hash::<SharedRecord>(), layout_hash::<Reference>());
        assert_ne!(layout_hash::<Description>(), layout_hash::<Reference>());
    }
}
