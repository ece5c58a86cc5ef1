//! The tables of JOINT.toml: keys with units on this side, field letters on the other.

mod sources;

pub use sources::*;

use estimators::compliance::ComplianceParameters;
use estimators::creep::CreepElement;
use estimators::hysteresis::{GearParameters, SlipElement};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::tracking::{MODELS, TrackingParameters};
use serde::{Deserialize, Serialize};

/// The joint, by its data sheet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointTable {
    /// The joint's name.
    pub name: String,
    /// N: gear ratio, 1.
    pub gear_ratio: f64,
    /// K_t: torque constant, motor side, N·m/A.
    #[serde(rename = "torque_constant_Nm_per_A")]
    pub torque_constant: f64,
    /// J_m: inertia of rotor and wave generator, motor side, kg·m².
    #[serde(rename = "rotor_inertia_kg_m2")]
    pub rotor_inertia: f64,
    /// Rated torque, link side, N·m.
    #[serde(rename = "rated_torque_Nm")]
    pub rated_torque: f64,
    /// Counts of the link-side encoder per turn of the link.
    pub link_counts_per_turn: f64,
    /// Counts of the motor-side encoder per turn of the motor.
    pub motor_counts_per_turn: f64,
    /// Samples a second, Hz.
    #[serde(rename = "sample_rate_hz")]
    pub sample_rate: f64,
    /// Largest |tau| that is ever reported, N·m; 2.5 times the rated torque if absent.
    #[serde(rename = "torque_limit_Nm", skip_serializing_if = "Option::is_none")]
    pub torque_limit: Option<f64>,
    /// Largest |dq|, rad/s: a faster change of a reading is a jump.
    #[serde(rename = "max_velocity_rad_per_s", default = "fast")]
    pub max_velocity: f64,
    /// Stiffness at rated torque by the gear's catalogue, N·m/rad: the fits' prior; that of a usual gear of the
    /// rated torque if absent.
    #[serde(
        rename = "stiffness_Nm_per_rad",
        skip_serializing_if = "Option::is_none"
    )]
    pub stiffness: Option<f64>,
    /// Of a prismatic joint, m: the radius of the circle along which its way is taken for an arc. Angles of this file
    /// are ways over it, torques forces times it, the gear ratio is the motor's angle over such an angle.
    #[serde(rename = "radius_m", skip_serializing_if = "Option::is_none")]
    pub radius: Option<f64>,
    /// w_l of the kinematic error that fits find, per rad of q; 1 if absent. Of a prismatic joint, whose way has no
    /// period of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub w_link: Option<f64>,
}

impl JointTable {
    /// The kinematic error before anything is known of it.
    #[must_use]
    pub fn no_kinematic_error(&self) -> KinematicErrorTable {
        KinematicErrorTable {
            w_link: self.w_link.unwrap_or(1.0),
            ..KinematicErrorTable::default()
        }
    }
}

/// No joint with a gear turns faster than this, rad/s.
fn fast() -> f64 {
    30.0
}

/// Skew and velocity filter.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncodersTable {
    /// Skew: delay of the motor-side encoder's sample after the link-side one's, s.
    #[serde(rename = "skew_s")]
    pub skew: f64,
    /// Samples of the straight line that velocities come from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_window: Option<usize>,
    /// Whether the encoders' zeros are others after each start: the torsion's zero then follows the
    /// current after the start, until a tare.
    #[serde(default)]
    pub zero_unknown: bool,
}

/// Z18.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct KinematicErrorTable {
    /// a0, rad.
    #[serde(rename = "a0_rad")]
    pub a0: f64,
    /// w_l, per rad of q.
    pub w_link: f64,
    /// (a_ln, b_ln), rad.
    #[serde(rename = "link_rad")]
    pub link: Vec<(f64, f64)>,
    /// w_w, per rad of theta.
    pub w_motor: f64,
    /// (a_wn, b_wn), rad.
    #[serde(rename = "motor_rad")]
    pub motor: Vec<(f64, f64)>,
}

impl Default for KinematicErrorTable {
    fn default() -> Self {
        Self {
            a0: 0.0,
            w_link: 1.0,
            link: Vec::new(),
            w_motor: 1.0,
            motor: Vec::new(),
        }
    }
}

impl From<KinematicErrorTable> for KinematicErrorParameters {
    fn from(t: KinematicErrorTable) -> Self {
        Self {
            a0: t.a0,
            w_link: t.w_link,
            link: t.link,
            w_motor: t.w_motor,
            motor: t.motor,
        }
    }
}

impl From<KinematicErrorParameters> for KinematicErrorTable {
    fn from(p: KinematicErrorParameters) -> Self {
        Self {
            a0: p.a0,
            w_link: p.w_link,
            link: p.link,
            w_motor: p.w_motor,
            motor: p.motor,
        }
    }
}

/// Motor friction, motor side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FrictionTable {
    /// tau_fm, N·m.
    #[serde(rename = "coulomb_Nm")]
    pub coulomb: f64,
    /// B_m, N·m·s/rad.
    #[serde(rename = "viscous_Nms_per_rad")]
    pub viscous: f64,
    /// eps: velocity below which the wave generator's torque is held, rad/s.
    #[serde(rename = "epsilon_rad_per_s")]
    pub epsilon: f64,
    /// Friction when braking as printed in Z, instead of the physical rule.
    pub published: bool,
}

impl Default for FrictionTable {
    fn default() -> Self {
        Self {
            coulomb: 0.0,
            viscous: 0.0,
            epsilon: 0.5,
            published: false,
        }
    }
}

/// Z Table II and low-pass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComplianceTable {
    /// K_fs0, N·m/rad.
    #[serde(rename = "K_fs0_Nm_per_rad")]
    pub k_fs0: f64,
    /// C_fs, 1/(N·m).
    #[serde(rename = "C_fs_per_Nm")]
    pub c_fs: f64,
    /// K_wg0, motor side, N·m/rad.
    #[serde(rename = "K_wg0_Nm_per_rad")]
    pub k_wg0: f64,
    /// C_wg, 1/(N·m).
    #[serde(rename = "C_wg_per_Nm")]
    pub c_wg: f64,
    /// Pole of the torque's low-pass, 0 to below 1.
    #[serde(default)]
    pub low_pass_pole: f64,
    /// Standard deviation of the torsion that the model leaves, rad.
    #[serde(rename = "torsion_sigma_rad", default)]
    pub torsion_sigma: f64,
}

impl From<ComplianceTable> for ComplianceParameters {
    fn from(t: ComplianceTable) -> Self {
        Self {
            k_fs0: t.k_fs0,
            c_fs: t.c_fs,
            k_wg0: t.k_wg0,
            c_wg: t.c_wg,
        }
    }
}

/// Elastic curve and slipping springs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HysteresisTable {
    /// Stiffness of the linear part, N·m/rad.
    #[serde(rename = "linear_Nm_per_rad")]
    pub linear: f64,
    /// Growth of the stiffness, N·m/rad³.
    #[serde(rename = "cubic_Nm_per_rad3")]
    pub cubic: f64,
    /// Wind-up: width (rad) and stiffness (N·m/rad).
    pub wind_up: Vec<(f64, f64)>,
    /// Springs: stretch at which they slip (rad) and stiffness (N·m/rad).
    pub slipping: Vec<(f64, f64)>,
    /// Creep: springs behind dampers, by the time in which they relax (s) and stiffness (N·m/rad).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub creeping: Vec<(f64, f64)>,
    /// The output bearing's springs: way of q after which they slip (rad) and stiffness (N·m/rad).
    #[serde(default)]
    pub bearing: Vec<(f64, f64)>,
    /// Viscous friction of the output bearing, N·m·s/rad.
    #[serde(rename = "bearing_viscous_Nms_per_rad", default)]
    pub bearing_viscous: f64,
    /// Damping of the gear, N·m·s/rad of torsion.
    #[serde(rename = "damping_Nms_per_rad", default)]
    pub damping: f64,
    /// Poles of the filters that follow the torsion, 0 (none) to below 1: for fast, moderate and
    /// slow changes.
    #[serde(default)]
    pub tracking_poles: [f64; MODELS],
    /// Standard deviation of the torsion's noise, rad; 0: the first filter alone.
    #[serde(rename = "tracking_sigma_rad", default)]
    pub tracking_sigma: f64,
    /// Standard deviation of the torsion that the model leaves, rad.
    #[serde(rename = "torsion_sigma_rad")]
    pub torsion_sigma: f64,
    /// Error on held-out blocks over that on the fitted ones.
    #[serde(default = "one")]
    pub held_out_ratio: f64,
    /// Directions `d_k` of the parameters' covariance `sum_k d_k d_k'`: linear, cubic, wind-up, slipping,
    /// bearing, creeping, the bearing's viscous friction, damping, skew, zero, harmonics.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncertainty: Vec<Vec<f64>>,
}

fn one() -> f64 {
    1.0
}

impl HysteresisTable {
    /// Filters that track the torsion.
    pub(super) fn tracking(&self) -> TrackingParameters {
        TrackingParameters {
            poles: self.tracking_poles,
            sigma: self.tracking_sigma,
        }
    }
}

impl From<HysteresisTable> for GearParameters {
    fn from(t: HysteresisTable) -> Self {
        Self {
            slipping: elements(&t.slipping),
            creeping: (t.creeping.iter())
                .map(|&(time, stiffness)| CreepElement { time, stiffness })
                .collect(),
            bearing: elements(&t.bearing),
            linear: t.linear,
            cubic: t.cubic,
            wind_up: t.wind_up,
            damping: t.damping,
            bearing_viscous: t.bearing_viscous,
        }
    }
}

impl From<GearParameters> for HysteresisTable {
    fn from(p: GearParameters) -> Self {
        let pairs =
            |e: Vec<SlipElement>| e.iter().map(|e| (e.limit, e.stiffness)).collect::<Vec<_>>();
        Self {
            slipping: pairs(p.slipping),
            creeping: (p.creeping.iter()).map(|e| (e.time, e.stiffness)).collect(),
            bearing: pairs(p.bearing),
            linear: p.linear,
            cubic: p.cubic,
            wind_up: p.wind_up,
            damping: p.damping,
            bearing_viscous: p.bearing_viscous,
            tracking_poles: [0.0; MODELS],
            tracking_sigma: 0.0,
            torsion_sigma: 0.0,
            held_out_ratio: 1.0,
            uncertainty: Vec::new(),
        }
    }
}

/// Springs from pairs of slip and stiffness.
fn elements(pairs: &[(f64, f64)]) -> Vec<SlipElement> {
    pairs
        .iter()
        .map(|&(limit, stiffness)| SlipElement { limit, stiffness })
        .collect()
}
