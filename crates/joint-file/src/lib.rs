//! JOINT.toml: one joint, and the parameters of every estimator that is switched on.
//!
//! The table `[joint]` suffices: torque from current alone. Every further table
//! switches an estimator on; `torquectl fit` writes them. Units stand in the keys.

#![deny(unsafe_code)]

mod building;
mod learned;
mod local_gp;
mod network;
mod registry;
mod source;
mod tables;

pub use local_gp::{TrainedLocalGp, feed_forward_base};
pub use network::TrainedNetwork;
pub use tables::*;

use estimators::compliance::JointEstimatorParameters;
use estimators::current_based::CurrentParameters;
use estimators::deformation::{AngularFrequency, DeformationParameters};
use estimators::encoder::EncoderParameters;
use estimators::features::FeatureSet;
use estimators::front_end::FrontEnd;
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::validity::Validity;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use problem::{Allowed, Problem};
use serde::{Deserialize, Serialize};
use source::Source;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// A joint and its estimators.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointFile {
    /// The joint.
    pub joint: JointTable,
    /// Skew and velocity filter.
    pub encoders: Option<EncodersTable>,
    /// Kinematic error (Z18).
    pub kinematic_error: Option<KinematicErrorTable>,
    /// Motor friction, motor side.
    pub friction: Option<FrictionTable>,
    /// Switches Z's compliance model on.
    pub compliance: Option<ComplianceTable>,
    /// Switches the gear with slipping springs on.
    pub hysteresis: Option<HysteresisTable>,
    /// Constants of the current-based torque (D3), which is always on.
    pub current: Option<CurrentTable>,
    /// Switches the feed-forward as a source on.
    pub feed_forward: Option<FeedForwardTable>,
    /// g: torque per fused torque, for fast changes.
    pub torsion_gain: Option<TorsionGainTable>,
    /// Switches S's deformation model on.
    pub deformation: Option<DeformationTable>,
    /// Switches the linear Kalman filter on (U: CM-KF).
    pub kalman: Option<KalmanTable>,
    /// Switches the unscented filter on (U: CM-UKF).
    pub unscented: Option<KalmanTable>,
    /// Switches the unscented filter with hysteresis and added states on.
    pub unscented_added: Option<KalmanTable>,
    /// Switches S's network on.
    pub network: Option<TrainedTable>,
    /// Switches a model corrected by local Gaussian processes on (G), by the name of the source.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub local_gp: BTreeMap<String, TrainedTable>,
    /// Switches the fusion on.
    pub fusion: Option<FusionTable>,
    /// Ranges that the training covered.
    pub validity: Option<ValidityTable>,
    /// Contents of the trained files.
    #[serde(skip)]
    pub trained: Trained,
}

/// Trained estimators, from files of their own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trained {
    /// S's network.
    pub network: Option<TrainedNetwork>,
    /// Local Gaussian processes, by the name of the source.
    pub local_gp: BTreeMap<String, TrainedLocalGp>,
}

const ALLOWED_GP: &str = "a file that `torquectl fit local-gp` wrote";
/// Default window of the velocity filter, s.
const VELOCITY_WINDOW_S: f64 = 0.02;
/// Default torque limit over the rated torque: the momentary overload of a harmonic drive.
const OVERLOAD: f64 = 2.5;

/// Slower than this is noise at rest, not a range of speeds, rad/s.
const MIN_COVERED_SPEED: f64 = 0.02;
/// Error of the friction at twice the covered speed, of the Coulomb friction.
const SPEED_ERROR: f64 = 0.2;

impl JointFile {
    /// A joint by its data sheet, with no estimator but that from current.
    #[must_use]
    pub fn new(joint: JointTable) -> Self {
        Self {
            joint,
            encoders: None,
            kinematic_error: None,
            friction: None,
            compliance: None,
            hysteresis: None,
            current: None,
            feed_forward: None,
            torsion_gain: None,
            deformation: None,
            kalman: None,
            unscented: None,
            unscented_added: None,
            network: None,
            local_gp: BTreeMap::new(),
            fusion: None,
            validity: None,
            trained: Trained::default(),
        }
    }

    /// Reads a joint file; `file` is its path, `read` gives the text of a trained file by its path.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, numbers that are not allowed, trained files
    /// that cannot be read.
    pub fn parse(
        text: &str,
        file: &str,
        read: &dyn Fn(&str) -> std::io::Result<String>,
    ) -> Result<Self, Problem> {
        let source = Source { text, file };
        let mut joint: Self = source.table()?;
        joint.check(source)?;
        joint.trained = joint.read_trained(source, read)?;
        Ok(joint)
    }

    fn read_trained(
        &self,
        source: Source<'_>,
        read: &dyn Fn(&str) -> std::io::Result<String>,
    ) -> Result<Trained, Problem> {
        let folder = Path::new(source.file).parent().unwrap_or(Path::new(""));
        let text = |key: &str, table: &TrainedTable| {
            let path = folder.join(&table.file).display().to_string();
            match read(&path) {
                Ok(text) => Ok((text, path)),
                Err(e) => {
                    let key = format!("{key}.file");
                    Err(source.refusal(&key, format!("{key}: {path}: {e}"), ""))
                }
            }
        };
        let mut trained = Trained::default();
        if let Some(table) = &self.network {
            let (text, path) = text("network", table)?;
            trained.network = Some(TrainedNetwork::from_text(&text, &path)?);
        }
        for (name, table) in &self.local_gp {
            let (text, path) = text(&format!("local_gp.{name}"), table)?;
            let gp = TrainedLocalGp::from_text(&text, &path)?;
            if gp.parameters.features == FeatureSet::Motion {
                let what =
                    format!("{path}: its inputs are desired motions, not a joint's readings");
                return Err(source.refusal(&format!("local_gp.{name}.file"), what, ALLOWED_GP));
            }
            trained.local_gp.insert(name.clone(), gp);
        }
        Ok(trained)
    }

    /// The file's text.
    ///
    /// # Errors
    /// Numbers that TOML cannot hold.
    pub fn to_toml(&self) -> Result<String, Problem> {
        toml::to_string(self).map_err(|e| Problem::new(format!("joint file: {e}"), ""))
    }

    fn check(&self, source: Source<'_>) -> Result<(), Problem> {
        let j = &self.joint;
        let positive = [
            ("gear_ratio", j.gear_ratio),
            ("torque_constant_Nm_per_A", j.torque_constant),
            ("rotor_inertia_kg_m2", j.rotor_inertia),
            ("rated_torque_Nm", j.rated_torque),
            ("link_counts_per_turn", j.link_counts_per_turn),
            ("motor_counts_per_turn", j.motor_counts_per_turn),
            ("sample_rate_hz", j.sample_rate),
            ("torque_limit_Nm", self.torque_limit()),
            ("max_velocity_rad_per_s", j.max_velocity),
            ("stiffness_Nm_per_rad", j.stiffness.unwrap_or(1.0)),
            ("radius_m", j.radius.unwrap_or(1.0)),
            ("w_link", j.w_link.unwrap_or(1.0)),
        ];
        for (key, value) in positive {
            source.require(&format!("joint.{key}"), value, Allowed::Positive)?;
        }
        if let Some(table) = &self.torsion_gain {
            let (gain, sigma) = (table.gain, table.sigma);
            source.require("torsion_gain.gain", gain, Allowed::Within(0.5, 2.0))?;
            source.require("torsion_gain.sigma", sigma, Allowed::Positive)?;
        }
        if let Some(table) = &self.hysteresis {
            check_gear(table, source)?;
        }
        let longest = 16.0 * self.sample_period();
        let skew = self.encoders.as_ref().map_or(0.0, |e| e.skew);
        source.require("encoders.skew_s", skew, Allowed::Within(-longest, longest))
    }

    /// T: time between samples, s.
    #[must_use]
    pub fn sample_period(&self) -> f64 {
        1.0 / self.joint.sample_rate
    }

    /// Largest |tau| that is ever reported, N·m.
    #[must_use]
    pub fn torque_limit(&self) -> f64 {
        self.joint
            .torque_limit
            .unwrap_or(OVERLOAD * self.joint.rated_torque)
    }

    /// Samples of the straight line whose slope is a velocity.
    #[must_use]
    pub fn velocity_window(&self) -> usize {
        let window = self.encoders.as_ref().and_then(|e| e.velocity_window);
        let samples = (VELOCITY_WINDOW_S * self.joint.sample_rate)
            .round()
            .max(3.0);
        window.unwrap_or(samples as usize)
    }

    /// Encoders and velocities of this joint.
    ///
    /// # Errors
    /// A velocity window that no filter can have.
    pub fn front_end(&self) -> Result<FrontEnd, Problem> {
        let encoders = self.encoders.clone().unwrap_or_default();
        let parameters = EncoderParameters {
            gear_ratio: self.joint.gear_ratio,
            sample_period: self.sample_period(),
            max_velocity: self.joint.max_velocity,
            max_velocity_change: 0.0,
            motor_wrap: f64::INFINITY,
            link_wrap: f64::INFINITY,
            skew: encoders.skew,
        };
        FrontEnd::new(parameters, Some(self.velocity_window())).map_err(|p| p.of("encoders"))
    }

    /// Kinematic error (Z18); zero without its table.
    #[must_use]
    pub fn kinematic_error_parameters(&self) -> KinematicErrorParameters {
        let error = self.kinematic_error.clone();
        error
            .unwrap_or_else(|| self.joint.no_kinematic_error())
            .into()
    }

    /// Motor constants for Z's wave generator.
    #[must_use]
    pub fn wave_generator_parameters(&self) -> WaveGeneratorParameters {
        let friction = self.friction.clone().unwrap_or_default();
        WaveGeneratorParameters {
            torque_constant: self.joint.torque_constant,
            friction: friction.coulomb,
            viscous_friction: friction.viscous,
            epsilon: friction.epsilon,
            rule: if friction.published {
                FrictionRule::Published
            } else {
                FrictionRule::Physical
            },
        }
    }

    fn estimator_parameters(&self, table: &ComplianceTable) -> JointEstimatorParameters {
        let j = &self.joint;
        JointEstimatorParameters {
            gear_ratio: j.gear_ratio,
            torque_limit: self.torque_limit(),
            sample_period: self.sample_period(),
            low_pass_pole: table.low_pass_pole,
            link_resolution: TAU / j.link_counts_per_turn,
            motor_resolution: TAU / j.motor_counts_per_turn,
            torsion_sigma: table.torsion_sigma,
            current_sigma: 0.0,
            compliance: table.clone().into(),
            wave_generator: self.wave_generator_parameters(),
            kinematic_error: self.kinematic_error_parameters(),
        }
    }

    /// Constants of the current-based torque; without a table those of a motor without friction.
    #[must_use]
    pub fn current_parameters(&self) -> CurrentParameters {
        let j = &self.joint;
        let table = self.current.clone().unwrap_or_else(|| CurrentTable {
            k_1: j.gear_ratio * j.torque_constant,
            sigma: 0.1 * j.rated_torque,
            ..CurrentTable::default()
        });
        CurrentParameters {
            k_1: table.k_1,
            k_2: table.k_2,
            k_3: table.k_3,
            k_4: table.k_4,
            inertia: table.inertia,
            offset: table.offset,
            sign_smoothing: table.sign_smoothing,
            presliding: std::array::from_fn(|k| {
                table.presliding.get(k).copied().unwrap_or_default()
            }),
            gear_ratio: j.gear_ratio,
            low_pass_pole: table.low_pass_pole,
            sigma: table.sigma,
            sample_period: self.sample_period(),
            torque_limit: self.torque_limit(),
        }
    }

    /// Ranges that the training covered; without a table they have no bounds.
    #[must_use]
    pub fn validity(&self) -> Validity {
        let friction = self.current.as_ref().map_or(0.0, |c| c.k_3);
        self.validity
            .as_ref()
            .map_or(Validity::default(), |t| Validity {
                torque: t.torque,
                angle: t.angle,
                speed: t.speed.max(MIN_COVERED_SPEED),
                loading: t.loading,
                speed_error: SPEED_ERROR * friction,
            })
    }

    /// Parameters of S's model.
    fn deformation_parameters(&self, table: &DeformationTable) -> DeformationParameters {
        DeformationParameters {
            rated_torque: self.joint.rated_torque,
            coefficients: table.coefficients,
            frequency: if table.published_frequency {
                AngularFrequency::Published
            } else {
                AngularFrequency::Spatial
            },
            current_limit: table.current_limit,
            gear_ratio: self.joint.gear_ratio,
            low_pass_pole: table.low_pass_pole,
            torsion_sigma: table.torsion_sigma,
            sample_period: self.sample_period(),
            torque_limit: self.torque_limit(),
        }
    }
}

/// Reader for joint files without trained files: refuses every path.
///
/// # Errors
/// Always.
pub fn no_files(_path: &str) -> std::io::Result<String> {
    Err(std::io::ErrorKind::NotFound.into())
}

/// Springs have a length, dampers a time, and none gives energy by creeping; tracking filters are stable.
fn check_gear(table: &HysteresisTable, source: Source<'_>) -> Result<(), Problem> {
    let springs = [
        ("wind_up", &table.wind_up),
        ("slipping", &table.slipping),
        ("creeping", &table.creeping),
        ("bearing", &table.bearing),
    ];
    let of = |(name, pairs): (&'static str, &Vec<(f64, f64)>)| {
        let pairs = pairs.clone().into_iter().enumerate();
        pairs.map(move |(k, pair)| (name, k, pair))
    };
    for (name, k, (length, stiffness)) in springs.into_iter().flat_map(of) {
        let key = format!("hysteresis.{name}");
        let refused = |place: usize, value: f64, allowed: Allowed| {
            let reason = format!("{key}[{k}][{place}] = {value}");
            source.refusal(&key, reason, allowed.to_string())
        };
        if !Allowed::Positive.admits(length) {
            return Err(refused(0, length, Allowed::Positive));
        }
        if name == "creeping" && !Allowed::NonNegative.admits(stiffness) {
            return Err(refused(1, stiffness, Allowed::NonNegative));
        }
    }
    for (k, &pole) in table.tracking_poles.iter().enumerate() {
        let key = "hysteresis.tracking_poles";
        if !Allowed::Below(0.0, 1.0).admits(pole) {
            let allowed = Allowed::Below(0.0, 1.0).to_string();
            return Err(source.refusal(key, format!("{key}[{k}] = {pole}"), allowed));
        }
    }
    source.require(
        "hysteresis.tracking_sigma_rad",
        table.tracking_sigma,
        Allowed::NonNegative,
    )
}
