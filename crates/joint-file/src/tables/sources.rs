//! Tables of the torque sources besides the gear's laws, of their fusion and of their validity.

use estimators::deformation::COEFFICIENTS;
use estimators::fusion::{BOUNDS, REGIMES};
use estimators::kalman::ADDED_STATES;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// D3 and the rotor's inertia, link side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurrentTable {
    /// K1, N·m/A.
    #[serde(rename = "K_1_Nm_per_A")]
    pub k_1: f64,
    /// K2, N·m·s/rad.
    #[serde(rename = "K_2_Nms_per_rad")]
    pub k_2: f64,
    /// K3, N·m.
    #[serde(rename = "K_3_Nm")]
    pub k_3: f64,
    /// K4: friction per torque carried, 1.
    #[serde(rename = "K_4", default)]
    pub k_4: f64,
    /// J N², kg·m².
    #[serde(rename = "inertia_kg_m2")]
    pub inertia: f64,
    /// Current without torque, A.
    #[serde(rename = "offset_A")]
    pub offset: f64,
    /// |dq| at which sign(dq) is smoothed, rad/s; without presliding.
    #[serde(rename = "sign_smoothing_rad_per_s")]
    pub sign_smoothing: f64,
    /// Ways of theta/N over which friction builds up (rad), and the share of each; the first three count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub presliding: Vec<(f64, f64)>,
    /// Pole of the low-pass on current and acceleration, 0 to below 1.
    pub low_pass_pole: f64,
    /// Standard deviation of the torque in motion, N·m.
    #[serde(rename = "sigma_Nm")]
    pub sigma: f64,
    /// Directions of the parameters' covariance: K_1, offset (as torque), K_2, K_3, inertia, K_4.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncertainty: Vec<Vec<f64>>,
}

/// Feed-forward as a source.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeedForwardTable {
    /// Torque per feed-forward, 1.
    pub gain: f64,
    /// Torque without feed-forward, N·m.
    #[serde(rename = "offset_Nm")]
    pub offset: f64,
    /// Viscous friction in the feed-forward that the joint's torque lacks, N·m·s/rad.
    #[serde(rename = "viscous_Nms_per_rad", default)]
    pub viscous: f64,
    /// Coulomb friction in it, N·m.
    #[serde(rename = "coulomb_Nm", default)]
    pub coulomb: f64,
    /// |dq| at which sign(dq) is smoothed, rad/s.
    #[serde(rename = "sign_smoothing_rad_per_s")]
    pub sign_smoothing: f64,
    /// Standard deviation of the torque without contacts, N·m.
    #[serde(rename = "sigma_Nm")]
    pub sigma: f64,
    /// Standard deviation of the other sources' difference to it about its slow part, at rest and in motion,
    /// N·m: what changes more is a contact.
    #[serde(rename = "change_sigma_Nm", default)]
    pub change_sigma: [f64; 2],
    /// Directions of the parameters' covariance: gain, offset, viscous, Coulomb.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncertainty: Vec<Vec<f64>>,
}

/// g: torque per fused torque, for fast changes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorsionGainTable {
    /// g, 1: 0.5 to 2.
    pub gain: f64,
    /// Its standard deviation, 1.
    pub sigma: f64,
}

/// Ranges that the training covered; outside of them every sigma grows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidityTable {
    /// Least and largest torque, N·m.
    #[serde(rename = "torque_Nm")]
    pub torque: [f64; 2],
    /// Least and largest q, rad.
    #[serde(rename = "angle_rad")]
    pub angle: [f64; 2],
    /// Largest |dq|, rad/s.
    #[serde(rename = "speed_rad_per_s")]
    pub speed: f64,
    /// Largest |d tau/dt|, N·m/s.
    #[serde(rename = "loading_Nm_per_s")]
    pub loading: f64,
    /// Time in motion, s.
    #[serde(rename = "moved_s")]
    pub moved: f64,
}

impl Default for CurrentTable {
    fn default() -> Self {
        Self {
            k_1: 0.0,
            k_2: 0.0,
            k_3: 0.0,
            k_4: 0.0,
            inertia: 0.0,
            offset: 0.0,
            sign_smoothing: 0.02,
            presliding: Vec::new(),
            low_pass_pole: 0.8,
            sigma: 0.0,
            uncertainty: Vec::new(),
        }
    }
}

/// S10.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeformationTable {
    /// k1..k5 (rad/(N·m)), constant (rad), current's powers 1 to 6 (motor side, rad/A^n), and per
    /// harmonic 1 to 3 cos and sin of q and of theta (rad).
    pub coefficients: [f64; COEFFICIENTS],
    /// Angular velocities in S9, instead of a constant spatial frequency.
    pub published_frequency: bool,
    /// Largest |i| of the training data, A.
    #[serde(rename = "current_limit_A")]
    pub current_limit: f64,
    /// Pole of the torque's low-pass, 0 to below 1.
    pub low_pass_pole: f64,
    /// Standard deviation of the torsion that the model leaves, rad.
    #[serde(rename = "torsion_sigma_rad")]
    pub torsion_sigma: f64,
}

/// Path of a trained file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedTable {
    /// The file, relative to the joint file's folder.
    pub file: String,
}

/// Noise of a Kalman filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KalmanTable {
    /// Q: variance that theta, omega, tau, dtau and d gain in a period, SI.
    pub process: [f64; ADDED_STATES],
    /// R: variances of theta and torsion, rad².
    pub measurement: [f64; 2],
    /// Whether the gear with slipping springs takes the place of Z's curves.
    #[serde(default)]
    pub hysteresis: bool,
}

/// Errors of the sources.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FusionTable {
    /// |dq| above which the joint moves, rad/s.
    #[serde(rename = "moving_rad_per_s")]
    pub moving_rate: f64,
    /// |rate of the torsion| at which the load changes slowly, faster, suddenly, rad/s.
    #[serde(rename = "loading_rad_per_s")]
    pub loading_rate: [f64; BOUNDS],
    /// Time over which the weights change, s.
    #[serde(rename = "blend_s")]
    pub blend: f64,
    /// The sources, by name.
    pub sources: BTreeMap<String, SourceTable>,
}

/// One source's errors: at rest and in motion, for loads that change hardly, slowly, faster,
/// suddenly.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceTable {
    /// Root mean square of the error, N·m.
    #[serde(rename = "rms_Nm")]
    pub rms: [f64; REGIMES],
    /// Root mean square of the sigma that the source reported, N·m.
    #[serde(rename = "sigma_Nm")]
    pub sigma: [f64; REGIMES],
    /// Whether it takes part in the fused torque; otherwise it is published beside it.
    #[serde(default = "yes")]
    pub fused: bool,
}

fn yes() -> bool {
    true
}
