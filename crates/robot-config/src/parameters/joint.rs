//! Parameters of a joint.

use super::JointCalibration;
use crate::sampling::Sampling;
use crate::units::BEYOND_LIMIT;
use control::predictive::LawParameters;
use control::{DriveModel, JointGains};
use core::ops::RangeInclusive;
use estimators::compliance::JointEstimatorParameters;
use estimators::encoder::EncoderParameters;
use estimators::local_gp::LocalGpParameters;
use robot_state::JointKind;
use supervisor::{
    DriveProfile, FollowingParameters, Limits, PlausibilityParameters, SignalParameters,
};

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
    /// What its drive reports of itself besides, bits of [`reported_flags`](robot_state::reported_flags).
    pub reports: u32,
    /// How hot its drive may get; none: it is not watched.
    pub thermal: Option<Thermal>,
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
    /// What gives the torque from encoders and current; see [`Self::torque_estimator`].
    pub calibration: Option<JointCalibration>,
    /// The learned feed-forward of mode low-gain tracking, with inputs
    /// [`motion_inputs`](crate::feed_forward::motion_inputs).
    pub feed_forward: Option<LocalGpParameters>,
    /// The predictive torque law's model of joint and drive.
    pub law: LawParameters,
    /// Part of the law's delay that is within the drive's own loop, s.
    pub drive_lag: f64,
    /// Inertia at the joint with the robot stretched out and its other joints held, without the
    /// rotor, kg·m².
    pub link_inertia: f64,
    /// What its drive makes of commands, which are positions or currents.
    pub drive_model: DriveModel,
    /// Feedback gains.
    pub gains: JointGains,
    /// Limits of what is commanded.
    pub limits: Limits,
    /// Greatest |dq| in mode torque, rad/s.
    pub torque_velocity: f64,
    /// Friction that the loop adds in mode torque, N·m; none: by the torque's error.
    pub torque_friction: Option<f64>,
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

/// How hot a drive may get.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thermal {
    /// Current that the motor bears for ever, A.
    pub continuous_current: f64,
    /// Time in which its winding reaches 63 % of a current's heat, s.
    pub time_constant: f64,
    /// Temperatures at which it is warned of, from which on the torque limit falls, and at which the robot
    /// stops, °C; none: only by the current.
    pub temperatures: Option<[f64; 3]>,
}

impl JointParameters {
    /// Torque of the continuous current, as a share of the torque limit, if its drive is watched.
    #[must_use]
    pub fn continuous_share(&self) -> Option<f64> {
        let wave_generator = &self.estimator.wave_generator;
        let per_current = self.encoders.gear_ratio * wave_generator.torque_constant;
        let torque = per_current * self.thermal?.continuous_current;
        Some((torque / self.limits.torque).min(1.0))
    }

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
        self.drive_model.takes_position()
    }

    /// Acceleration that the torque limit gives the joint with the robot stretched out, rad/s².
    #[must_use]
    pub fn acceleration(&self) -> f64 {
        self.limits.torque / (self.rotor_inertia_on_link_side() + self.link_inertia)
    }

    /// Way that a torque of the motor makes of its rotor within a time from rest, link side, rad/(N·m); the gear gives
    /// way meanwhile. `time`: s.
    #[must_use]
    pub fn rotor_way_per_torque(&self, time: f64) -> f64 {
        let inertia = self.rotor_inertia_on_link_side();
        if inertia > 0.0 {
            0.5 * time * time / inertia
        } else {
            0.0
        }
    }

    /// N² J, kg·m².
    fn rotor_inertia_on_link_side(&self) -> f64 {
        self.rotor_inertia * self.encoders.gear_ratio.powi(2)
    }
}
