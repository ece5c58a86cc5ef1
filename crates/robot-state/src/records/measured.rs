//! Measured values: written by the stage `measure`, read by all later ones.

use super::{MAX_FT_SENSORS, MAX_FURTHER_IMUS, MAX_JOINTS, Wrench};
use crate::layout::record;

/// Flag bits of measured values.
pub mod measured_flags {
    /// No usable sample in this cycle: the value is bridged from the last one.
    pub const MISSED: u32 = 1;
    /// No sample for longer than `loop.stale_after_ms`.
    pub const STALE: u32 = 2;
    /// The encoder moved further than the joint can: the sample was not used.
    pub const JUMP: u32 = 4;
    /// No sample has ever arrived.
    pub const NEVER: u32 = 8;
    /// The filters have not yet seen as many samples as their window holds.
    pub const SETTLING: u32 = 16;
    /// The two encoders contradict each other: the sample was not used.
    pub const IMPLAUSIBLE: u32 = 32;
    /// A value has stayed the same for longer than its noise explains (of a joint: its current).
    pub const FLAT: u32 = 64;
    /// A value stands at an end of its range (of a joint: its current).
    pub const SATURATED: u32 = 128;
    /// Of the first IMU: it sends no usable sample, and another one, carried over by the joints between
    /// them, stands in for it.
    pub const STANDS_IN: u32 = 256;
}

/// Flag bits of what a drive reports of itself, and has reported lately.
pub mod reported_flags {
    /// Its temperature.
    pub const TEMPERATURE: u32 = 1;
    /// The voltage of its supply.
    pub const VOLTAGE: u32 = 2;
    /// Its own torque.
    pub const TORQUE: u32 = 4;
    /// Its error.
    pub const ERROR: u32 = 8;
}

record! {
    /// Measured values of one joint, on the link side of the gear unless stated.
    pub struct JointMeasured {
        /// q: joint angle, rad, newest sample; without a link-side encoder theta/N less `torsion`.
        pub q: f64,
        /// theta: motor-side angle, rad, unwrapped over many turns, newest sample.
        pub theta: f64,
        /// torsion: theta/N - q, rad; positive when the motor drives the joint. Without a link-side
        /// encoder it is the one that the torque from F/T sensors and IMU explains.
        pub torsion: f64,
        /// i: motor current, A, newest sample.
        pub current: f64,
        /// dq: joint velocity, rad/s, from a short filter; used by control.
        pub dq: f64,
        /// q_hat: filtered joint angle, rad, delayed by `filter_delay_s`.
        pub q_hat: f64,
        /// dq_hat: filtered joint velocity, rad/s, delayed by `filter_delay_s`.
        pub dq_hat: f64,
        /// ddq_hat: filtered joint acceleration, rad/s², delayed by `filter_delay_s`.
        pub ddq_hat: f64,
        /// omega: motor-side velocity, rad/s: the drive's own, or from a short filter.
        pub omega: f64,
        /// Temperature that the drive reports, of its winding where it reports more than one, °C; as long
        /// as `reported` has its bit, as the next three.
        pub temperature: f64,
        /// Voltage of the drive's supply, V.
        pub voltage: f64,
        /// The drive's own torque, N·m at the joint.
        pub tau_drive: f64,
        /// Age of the newest sample, s.
        pub age_s: f64,
        /// Status word of the drive, as received.
        pub status: u32,
        /// Number of the drive's error; 0: none.
        pub drive_error: u32,
        /// Bits of `reported_flags`.
        pub reported: u32,
        /// Bits of `measured_flags`.
        pub flags: u32,
    }
}

impl JointMeasured {
    /// The defect for which the joint's samples cannot be relied on, in words after its name.
    #[must_use]
    pub fn defect(&self) -> Option<&'static str> {
        use measured_flags::{IMPLAUSIBLE, NEVER, STALE};
        match self.flags {
            flags if flags & NEVER != 0 => Some("has never answered"),
            flags if flags & STALE != 0 => Some("has sent no sample"),
            flags if flags & IMPLAUSIBLE != 0 => Some("is not plausible: its encoders disagree"),
            _ => None,
        }
    }
}

record! {
    /// Measured values of one F/T sensor, in the sensor's frame.
    pub struct FtMeasured {
        /// Wrench that the part beyond the sensor applies to the part before it, newest sample,
        /// calibrated, `offset` subtracted.
        pub wrench: Wrench,
        /// The same, filtered, delayed by `filter_delay_s`.
        pub wrench_hat: Wrench,
        /// Offset that is subtracted from the calibrated reading: configuration and tare.
        pub offset: Wrench,
        /// Temperature, °C; zero if the sensor does not measure it.
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
    /// Measured values of the inertial measurement unit, in the sensor's frame.
    pub struct ImuMeasured {
        /// Angular velocity, rad/s, newest sample.
        pub gyro: [f64; 3],
        /// Acceleration minus gravity, m/s², newest sample.
        pub accelerometer: [f64; 3],
        /// Filtered angular velocity, rad/s, delayed by `filter_delay_s`.
        pub gyro_hat: [f64; 3],
        /// Filtered acceleration minus gravity, m/s², delayed by `filter_delay_s`.
        pub accelerometer_hat: [f64; 3],
        /// Angular acceleration from the filtered gyro, rad/s²; zero if it is neglected.
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
    /// Measured values of one cycle, in SI units.
    pub struct MeasuredRecord {
        /// Delay of the filtered quantities, s.
        pub filter_delay_s: f64,
        /// The joints, in config order.
        pub joints: [JointMeasured; MAX_JOINTS],
        /// The F/T sensors, in config order.
        pub ft: [FtMeasured; MAX_FT_SENSORS],
        /// The first IMU, which shows the base's motion, or what stands in for it; zero if there is none.
        pub imu: ImuMeasured,
        /// The other IMUs, in config order.
        pub further_imus: [ImuMeasured; MAX_FURTHER_IMUS],
    }
}
