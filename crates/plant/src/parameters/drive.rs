//! `[drive.NAME]` of `sim.toml`: true parameters of a kind of drive.

use super::SamplingParameters;
use super::read::*;
use crate::kinematic_error::KinematicError;
use robot_state::JointKind;
use serde::Deserialize;

/// `[drive.NAME]`: true parameters of a kind of drive.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveParameters {
    /// Kind of the joints that it moves, by the units of its keys: what is said to be in rad and N·m on the
    /// link side is in m and N of a prismatic joint.
    #[serde(skip)]
    pub kind: JointKind,
    /// The gear.
    pub transmission: TransmissionParameters,
    /// Kinematic error besides the one in `robot.toml`.
    #[serde(default, deserialize_with = "kinematic_error")]
    pub kinematic_error: KinematicError,
    /// Friction at the motor.
    pub friction: MotorFrictionParameters,
    /// Friction of the output bearing.
    #[serde(default)]
    pub bearing: BearingParameters,
    /// Encoders and current sensor.
    #[serde(default)]
    pub sensors: DriveSensorParameters,
    /// The drive's own control loop.
    pub controller: ControllerParameters,
    /// Heat of its winding.
    #[serde(default)]
    pub winding: WindingParameters,
    /// Its states, where `robot.toml` knows some.
    #[serde(default)]
    pub states: StateParameters,
}

impl DriveParameters {
    /// The tables had the keys of a prismatic joint, whose values were read as those of a revolute one.
    pub(super) fn set_prismatic(&mut self) {
        self.kind = JointKind::Prismatic;
        let error = &mut self.kinematic_error;
        for amplitude in error.link.iter_mut().chain(&mut error.motor).flatten() {
            *amplitude = self.kind.si(amplitude.to_degrees());
        }
        // A way has no period of its own: that of an angle of as much.
        error.link_frequency = 1.0 / self.kind.threshold(1.0);
    }
}

/// `[drive.NAME.winding]`: heat of the motor's winding, and its supply.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindingParameters {
    /// Temperature of the surroundings, and at the start, °C.
    #[serde(rename = "ambient_C", deserialize_with = "finite")]
    pub ambient: f64,
    /// Rise of the temperature in the end for the square of the current, K/A².
    #[serde(rename = "rise_K_per_A2", deserialize_with = "non_negative")]
    pub rise: f64,
    /// Time in which 63 % of a rise are reached, s.
    #[serde(rename = "time_constant_s", deserialize_with = "positive")]
    pub time_constant: f64,
    /// Voltage of the supply, V.
    #[serde(rename = "supply_V", deserialize_with = "non_negative")]
    pub supply: f64,
}

impl Default for WindingParameters {
    fn default() -> Self {
        Self {
            ambient: 25.0,
            rise: 0.0,
            time_constant: 60.0,
            supply: 48.0,
        }
    }
}

/// `[drive.NAME.states]`: how fast the drive changes its state, and its holding brake.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StateParameters {
    /// Time from a control word to the state that it asks for, s.
    #[serde(rename = "step_ms", deserialize_with = "milli0")]
    pub step: f64,
    /// A brake on the rotor, held open by power while the drive is enabled.
    pub brake: bool,
    /// Time from enabled to an open brake, s.
    #[serde(rename = "brake_release_ms", deserialize_with = "milli0")]
    pub brake_release: f64,
    /// Time from disabled to a closed brake, s.
    #[serde(rename = "brake_engage_ms", deserialize_with = "milli0")]
    pub brake_engage: f64,
    /// Longest time without a set-point before the drive faults, s; absent: for ever.
    #[serde(rename = "command_timeout_ms", deserialize_with = "optional_milli")]
    pub command_timeout: Option<f64>,
}

impl Default for StateParameters {
    fn default() -> Self {
        Self {
            step: 2e-3,
            brake: true,
            brake_release: 20e-3,
            brake_engage: 5e-3,
            command_timeout: None,
        }
    }
}

/// `[drive.NAME.transmission]`: torque against torsion, link side.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransmissionParameters {
    /// K: stiffness beyond the wind-up zone, N·m/rad.
    #[serde(rename = "stiffness_Nm_per_rad", deserialize_with = "positive")]
    pub stiffness: f64,
    /// b: cubic stiffening, 1/rad².
    #[serde(
        default,
        rename = "stiffening_per_rad2",
        deserialize_with = "non_negative"
    )]
    pub stiffening: f64,
    /// r: stiffness at zero torsion over K.
    #[serde(default = "one", deserialize_with = "fraction")]
    pub windup_stiffness_ratio: f64,
    /// w: half width of the wind-up zone, rad.
    #[serde(
        default = "tenth_of_a_millirad",
        rename = "windup_rad",
        deserialize_with = "positive"
    )]
    pub windup: f64,
    /// Damping, N·m·s/rad.
    #[serde(
        default,
        rename = "damping_Nms_per_rad",
        deserialize_with = "non_negative"
    )]
    pub damping: f64,
    /// Half width of the hysteresis loop, N·m.
    #[serde(default, rename = "hysteresis_Nm", deserialize_with = "non_negative")]
    pub hysteresis: f64,
    /// Torsion over which hysteresis reverses, rad.
    #[serde(
        default = "tenth_of_a_millirad",
        rename = "hysteresis_rad",
        deserialize_with = "positive"
    )]
    pub hysteresis_span: f64,
}

/// `[drive.NAME.friction]`: friction of the rotor, motor side.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorFrictionParameters {
    /// Sliding friction without load, N·m.
    #[serde(rename = "coulomb_Nm", deserialize_with = "positive")]
    pub coulomb: f64,
    /// Breakaway friction over sliding friction.
    #[serde(default = "one", deserialize_with = "at_least_one")]
    pub static_ratio: f64,
    /// Velocity over which static friction fades, rad/s.
    #[serde(
        default = "one",
        rename = "stribeck_rad_per_s",
        deserialize_with = "positive"
    )]
    pub stribeck: f64,
    /// Viscous friction, N·m·s/rad.
    #[serde(
        default,
        rename = "viscous_Nms_per_rad",
        deserialize_with = "non_negative"
    )]
    pub viscous: f64,
    /// Angle that the bristles bend before they slide, rad.
    #[serde(
        default = "hundredth",
        rename = "presliding_rad",
        deserialize_with = "positive"
    )]
    pub presliding: f64,
    /// Meshing of the gear: friction per torque carried, both motor side.
    #[serde(default, deserialize_with = "fraction")]
    pub meshing: f64,
    /// Ripple of the friction over the motor's position (2 periods per turn) and over the link's
    /// (3 periods per turn), as fraction.
    #[serde(default, rename = "ripple_per_cent", deserialize_with = "per_cent")]
    pub ripple: f64,
}

/// `[drive.NAME.bearing]`: friction between gear output and link.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BearingParameters {
    /// Sliding friction, N·m.
    #[serde(default, rename = "coulomb_Nm", deserialize_with = "non_negative")]
    pub coulomb: f64,
    /// Viscous friction, N·m·s/rad.
    #[serde(
        default,
        rename = "viscous_Nms_per_rad",
        deserialize_with = "non_negative"
    )]
    pub viscous: f64,
}

/// `[drive.NAME.sensors]`: errors of the drive's sensors besides quantisation.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveSensorParameters {
    /// Noise of the motor encoder, standard deviation, counts.
    #[serde(default, deserialize_with = "non_negative")]
    pub motor_noise_counts: f64,
    /// Noise of the link encoder, counts.
    #[serde(default, deserialize_with = "non_negative")]
    pub link_noise_counts: f64,
    /// Lead of the motor encoder's sample over the link encoder's, s.
    #[serde(default, rename = "motor_lead_us", deserialize_with = "micro0")]
    pub motor_lead: f64,
    /// Noise of the current, A.
    #[serde(default, rename = "current_noise_A", deserialize_with = "non_negative")]
    pub current_noise: f64,
    /// Offset of the current, drawn up to this, A.
    #[serde(
        default,
        rename = "current_offset_A",
        deserialize_with = "non_negative"
    )]
    pub current_offset: f64,
    /// Gain error of the current, drawn up to this fraction.
    #[serde(
        default,
        rename = "current_gain_error_per_cent",
        deserialize_with = "per_cent"
    )]
    pub current_gain: f64,
    /// Torque constant's difference from `robot.toml`, drawn up to this fraction.
    #[serde(
        default,
        rename = "torque_constant_error_per_cent",
        deserialize_with = "per_cent"
    )]
    pub torque_constant: f64,
    /// Sampling times of all of them.
    #[serde(default)]
    pub sampling: SamplingParameters,
}

/// `[drive.NAME.controller]`: the drive's position loop (D5) and current loop.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControllerParameters {
    /// Rate of the position loop, Hz.
    #[serde(rename = "rate_hz", deserialize_with = "positive")]
    pub rate: f64,
    /// K4: current per position error, A/rad link side.
    #[serde(default, rename = "K_4_A_per_rad", deserialize_with = "non_negative")]
    pub k_4: f64,
    /// K5: current per velocity, A·s/rad link side.
    #[serde(default, rename = "K_5_As_per_rad", deserialize_with = "non_negative")]
    pub k_5: f64,
    /// Errors smaller than this count as zero (D 3.2.1), rad link side.
    #[serde(default, rename = "dead_zone_rad", deserialize_with = "non_negative")]
    pub dead_zone: f64,
    /// T_i: integral time of its velocity loop (P-PI), s; absent: it has no integral.
    #[serde(
        default,
        rename = "integral_time_ms",
        deserialize_with = "optional_milli"
    )]
    pub integral_time: Option<f64>,
    /// Resolution of the drive's own interpolated motor angle, counts per turn.
    #[serde(default = "sixteen_bits", deserialize_with = "positive")]
    pub interpolated_counts_per_turn: f64,
    /// Time constant of the velocity's low-pass, s.
    #[serde(default, rename = "velocity_filter_us", deserialize_with = "micro0")]
    pub velocity_filter: f64,
    /// Current limit, A.
    #[serde(rename = "current_limit_A", deserialize_with = "positive")]
    pub current_limit: f64,
    /// Time constant of the current loop, s.
    #[serde(default, rename = "current_loop_us", deserialize_with = "micro0")]
    pub current_loop: f64,
}
