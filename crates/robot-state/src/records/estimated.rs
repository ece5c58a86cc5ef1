//! Estimated values: written by the stage `estimate` from measured ones.

use super::{MAX_FT_SENSORS, MAX_JOINTS, Wrench};
use crate::layout::record;

/// Flag bits of a torque estimate.
pub mod torque_flags {
    /// The value may be used.
    pub const VALID: u32 = 1;
    /// The estimate reached the joint's torque limit.
    pub const SATURATED: u32 = 2;
    /// An input was bridged over a missing sample, or filters are still filling.
    pub const DEGRADED: u32 = 4;
}

/// Source of a torque estimate.
pub mod torque_source {
    /// No source.
    pub const NONE: u32 = 0;
    /// Compliance model of the harmonic drive: encoders and current (Z).
    pub const ENCODER: u32 = 1;
    /// Newton-Euler from F/T sensors and IMU (D 2).
    pub const WHOLE_BODY: u32 = 2;
    /// Motor current less friction (D3).
    pub const CURRENT: u32 = 3;
    /// Several sources weighted by their variances.
    pub const FUSED: u32 = 4;
}

record! {
    /// An estimate of a joint's torque, with its uncertainty.
    pub struct TorqueEstimate {
        /// tau: torque that the transmission applies to the child link along +q, N·m.
        pub tau: f64,
        /// sigma: standard deviation of tau, N·m.
        pub sigma: f64,
        /// Delay of the estimate against the newest sample, s.
        pub delay_s: f64,
        /// One of `torque_source`.
        pub source: u32,
        /// Bits of `torque_flags`.
        pub flags: u32,
    }
}

record! {
    /// Estimated torques of one joint.
    pub struct JointEstimated {
        /// Torque from encoders and current (Z): without delay, but with slow errors of the
        /// deformation model. No source and never valid without a link-side encoder.
        pub tau_encoder: TorqueEstimate,
        /// Torque from F/T sensors and IMU (D 2): independent of the joint's gear and motor, but
        /// delayed by the filters.
        pub tau_whole_body: TorqueEstimate,
        /// Torque from the motor current less friction (D3), a third opinion for the cross-check;
        /// not valid without `[cross_check]`, but for joints without a link-side encoder.
        pub tau_current: TorqueEstimate,
        /// tau_hat: delay-compensated torque: the present torque, from the changes of
        /// `tau_encoder` (without a link-side encoder `tau_current`) and the level of F/T sensors and
        /// rigid-body model.
        pub tau_hat: TorqueEstimate,
        /// tau_ext: torque of the environment on the joint apart from the contact wrenches that
        /// the F/T sensors determine, N·m, by a momentum observer; zero without
        /// `[external_torque]`.
        pub tau_ext: f64,
        /// Change of that torque within the last half second, N·m: much later known by `tau_ext`,
        /// here some 6 ms old.
        pub tau_ext_change: f64,
        /// The greater of |tau_ext| and |tau_ext_change|, each over its lower threshold, 1: 1 sets
        /// `contact_flag`, `external_torque.upper_ratio` raises event 209.
        pub contact_ratio: f64,
        /// Heat of the motor's winding by its current, as a share of what the continuous current makes in
        /// the end (I²t); zero without `[drive.NAME.thermal]`.
        pub thermal_load: f64,
        /// 1: contact detected.
        pub contact_flag: u32,
        /// Fills the record to a multiple of eight bytes.
        pub reserved: u32,
    }
}

record! {
    /// Estimated wrenches at one F/T sensor.
    pub struct FtEstimated {
        /// f_hat: wrench that the environment applies to the end-effector, at the sensor's frame,
        /// inertia and weight of the end-effector removed (D 2.2).
        pub contact_wrench: Wrench,
        /// Residual of the part beyond the sensor: the wrench that its contacts cannot explain, in
        /// the frame of the sensor's first link.
        pub residual: Wrench,
        /// Expected standard deviation of `residual`; zero where the contacts explain any wrench.
        pub residual_sigma: Wrench,
    }
}

record! {
    /// Estimated values of one cycle.
    pub struct EstimatedRecord {
        /// The joints, in config order.
        pub joints: [JointEstimated; MAX_JOINTS],
        /// The F/T sensors, in config order.
        pub ft: [FtEstimated; MAX_FT_SENSORS],
        /// f_u: wrench that no F/T sensor measures: that of the last contact of the contact set,
        /// by default at the unknown-wrench link (D 2.4).
        pub unknown_wrench: Wrench,
        /// Expected standard deviation of `unknown_wrench`.
        pub unknown_wrench_sigma: Wrench,
        /// Residual of the part with the root: the wrench that its contacts cannot explain, in the
        /// root's frame.
        pub residual: Wrench,
        /// Expected standard deviation of `residual`; zero where the contacts explain any wrench.
        pub residual_sigma: Wrench,
        /// Force of the environment at `external_torque.frame` that explains `tau_ext` best, in the
        /// root's axes, N; zero without a frame or while it does not follow from the torques.
        pub contact_force: [f64; 3],
        /// Standard deviation of `contact_force`, N; zero where that is.
        pub contact_force_sigma: [f64; 3],
        /// The contact set in use, an index of `Description::contact_set_names`.
        pub contact_set: u32,
        /// 1: the automatic rule chooses the contact set; 0: a client or the configuration does.
        pub contact_set_automatic: u32,
        /// Number of the first active event of the cross-check (204 to 208), or else of a hot drive (415), or 0.
        pub warning: u32,
        /// The joint that `warning` is about, or the F/T sensor (events 205 and 208).
        pub warning_subject: u32,
    }
}
