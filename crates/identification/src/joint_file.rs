//! JOINT.toml: one joint, and the parameters of every estimator that is switched on.
//!
//! The smallest that works is the table `[joint]`: torque from current alone. Every further table
//! switches an estimator on; `torquectl fit` writes them. Units stand in the keys.

mod tables;

pub use tables::*;

use crate::FitError;
use estimators::compliance::ComplianceEstimator;
use estimators::current_based::{CurrentEstimator, CurrentParameters};
use estimators::deformation::{AngularFrequency, DeformationEstimator, DeformationParameters};
use estimators::encoder::EncoderParameters;
use estimators::front_end::FrontEnd;
use estimators::fusion::{Fusion, FusionParameters, SourceError};
use estimators::hysteresis::{HysteresisEstimator, HysteresisParameters};
use estimators::joint::{JointEstimatorParameters, JointTorqueEstimator};
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::kinematic_error::KinematicErrorParameters;
use estimators::set::EstimatorSet;
use estimators::tracking::TrackingParameters;
use estimators::wave_generator::{FrictionRule, WaveGeneratorParameters};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::f64::consts::TAU;

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
    /// Switches S's deformation model on.
    pub deformation: Option<DeformationTable>,
    /// Switches the linear Kalman filter on (U: CM-KF).
    pub kalman: Option<KalmanTable>,
    /// Switches the unscented filter on (U: CM-UKF).
    pub unscented: Option<KalmanTable>,
    /// Switches the unscented filter with hysteresis and added states on.
    pub unscented_added: Option<KalmanTable>,
    /// Switches the fusion on.
    pub fusion: Option<FusionTable>,
}

/// Samples of the velocity filter at any rate, s, unless the file says otherwise.
const VELOCITY_WINDOW_S: f64 = 0.02;
/// Rated torques that a joint may be loaded with for a moment, unless the file says otherwise.
const OVERLOAD: f64 = 2.5;

impl JointFile {
    /// Reads a joint file; `file` is what messages call it.
    ///
    /// # Errors
    /// Text that is not TOML, unknown or missing keys, numbers that are not allowed.
    pub fn parse(text: &str, file: &str) -> Result<Self, FitError> {
        let joint: Self = toml::from_str(text)
            .map_err(|e| FitError(format!("{file}: {}", e.to_string().trim_end())))?;
        joint
            .check()
            .map_err(|e| FitError(format!("{file}: {e}")))?;
        Ok(joint)
    }

    /// The file's text.
    ///
    /// # Errors
    /// Numbers that TOML cannot hold.
    pub fn to_toml(&self) -> Result<String, FitError> {
        toml::to_string(self).map_err(|e| FitError(format!("joint file: {e}")))
    }

    fn check(&self) -> Result<(), String> {
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
        ];
        for (key, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(format!(
                    "joint.{key} = {value}; allowed: a finite number > 0"
                ));
            }
        }
        if let Some(e) = &self.encoders {
            let longest = 16.0 * self.sample_period();
            if e.skew.is_nan() || e.skew.abs() > longest {
                let skew = e.skew;
                return Err(format!(
                    "encoders.skew_s = {skew}; allowed: within ±{longest}"
                ));
            }
        }
        let tables = toml::Value::try_from(self).map_err(|e| e.to_string())?;
        finite(&tables, "")
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

    /// Encoders and velocities of this joint.
    ///
    /// # Errors
    /// A velocity window that no filter can have.
    pub fn front_end(&self) -> Result<FrontEnd, FitError> {
        let window = (VELOCITY_WINDOW_S * self.joint.sample_rate)
            .round()
            .max(3.0) as usize;
        let encoders = self.encoders.clone().unwrap_or_default();
        let parameters = EncoderParameters {
            gear_ratio: self.joint.gear_ratio,
            sample_period: self.sample_period(),
            max_velocity: self.joint.max_velocity,
            motor_wrap: f64::INFINITY,
            link_wrap: f64::INFINITY,
            skew: encoders.skew,
        };
        let window = encoders.velocity_window.unwrap_or(window);
        FrontEnd::new(parameters, window).map_err(|e| FitError(format!("encoders: {e}")))
    }

    /// Z18 in this joint; none: no error.
    #[must_use]
    pub fn kinematic_error_parameters(&self) -> KinematicErrorParameters {
        self.kinematic_error.clone().unwrap_or_default().into()
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
            inertia: table.inertia,
            offset: table.offset,
            sign_smoothing: table.sign_smoothing,
            low_pass_pole: table.low_pass_pole,
            sigma: table.sigma,
            sample_period: self.sample_period(),
            torque_limit: self.torque_limit(),
        }
    }

    /// S's coefficients, if they are there.
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

    /// The gear with slipping springs as an estimator.
    #[must_use]
    pub fn hysteresis_estimator(&self, table: &HysteresisTable) -> HysteresisEstimator {
        HysteresisEstimator::new(HysteresisParameters {
            kinematic_error: self.kinematic_error_parameters(),
            gear_ratio: self.joint.gear_ratio,
            tracking: table.tracking(),
            torsion_sigma: table.torsion_sigma,
            sample_period: self.sample_period(),
            torque_limit: self.torque_limit(),
            gear: table.clone().into(),
        })
    }

    /// Parameters of a Kalman filter, with the compliance that it needs.
    ///
    /// # Errors
    /// No table `[compliance]`; `hysteresis` asked for without its table.
    pub fn kalman_parameters(&self, table: &KalmanTable) -> Result<KalmanParameters, FitError> {
        let needs = |what: &str| FitError(format!("a Kalman filter needs a table `[{what}]`"));
        let compliance = self
            .compliance
            .as_ref()
            .ok_or_else(|| needs("compliance"))?;
        let (gear, tracking) = match table.hysteresis {
            true => {
                let table = self
                    .hysteresis
                    .as_ref()
                    .ok_or_else(|| needs("hysteresis"))?;
                (Some(table.clone().into()), table.tracking())
            }
            false => (None, TrackingParameters::default()),
        };
        let joint = self.estimator_parameters(compliance);
        Ok(KalmanParameters {
            sign_smoothing: joint.wave_generator.epsilon.max(1e-3),
            joint,
            gear,
            tracking,
            rotor_inertia: self.joint.rotor_inertia,
            process: table.process,
            measurement: table.measurement,
        })
    }

    /// Every estimator that is switched on, without their fusion.
    ///
    /// # Errors
    /// Tables that need others.
    pub fn sources(&self) -> Result<EstimatorSet, FitError> {
        Ok(EstimatorSet::new(self.named_sources()?, None))
    }

    fn named_sources(&self) -> Result<Vec<Source>, FitError> {
        let mut sources: Vec<Source> = Vec::new();
        if let Some(table) = &self.compliance {
            let estimator = ComplianceEstimator::new(self.estimator_parameters(table));
            sources.push(("compliance".to_owned(), Box::new(estimator)));
        }
        if let Some(table) = &self.hysteresis {
            let estimator = self.hysteresis_estimator(table);
            sources.push(("hysteresis".to_owned(), Box::new(estimator)));
        }
        if let Some(table) = &self.deformation {
            let estimator = DeformationEstimator::new(self.deformation_parameters(table));
            sources.push(("deformation".to_owned(), Box::new(estimator)));
        }
        if let Some(table) = &self.kalman {
            let p = self.kalman_parameters(table)?;
            let estimator = KalmanEstimator::<STATES>::new(p, Transform::Linear);
            sources.push(("kalman".to_owned(), Box::new(estimator)));
        }
        if let Some(table) = &self.unscented {
            let p = self.kalman_parameters(table)?;
            let estimator = KalmanEstimator::<STATES>::new(p, Transform::Unscented);
            sources.push(("unscented".to_owned(), Box::new(estimator)));
        }
        if let Some(table) = &self.unscented_added {
            let p = self.kalman_parameters(table)?;
            let estimator = KalmanEstimator::<ADDED_STATES>::new(p, Transform::Unscented);
            sources.push(("unscented_added".to_owned(), Box::new(estimator)));
        }
        let current = CurrentEstimator::new(self.current_parameters());
        sources.push(("current".to_owned(), Box::new(current)));
        Ok(sources)
    }

    /// Every estimator that is switched on, fused if there is a fusion.
    ///
    /// # Errors
    /// Tables that need others; a fusion of other sources than are switched on.
    pub fn estimators(&self) -> Result<EstimatorSet, FitError> {
        let sources = self.named_sources()?;
        let Some(table) = &self.fusion else {
            return Ok(EstimatorSet::new(sources, None));
        };
        let names: BTreeSet<&String> = sources.iter().map(|(name, _)| name).collect();
        if !names.iter().copied().eq(table.sources.keys()) {
            return Err(FitError(format!(
                "fusion.sources has {:?}, switched on are {names:?}; allowed: the same; fit the \
                 fusion again after switching estimators on or off",
                table.sources.keys()
            )));
        }
        let error = |regime: usize, name: &String| SourceError {
            variance: table.sources[name].rms[regime].powi(2),
            reported: table.sources[name].sigma[regime],
        };
        let fusion = Fusion::new(
            sources.len(),
            FusionParameters {
                moving: table.moving_rate,
                loading: table.loading_rate,
                errors: std::array::from_fn(|regime| {
                    sources
                        .iter()
                        .map(|(name, _)| error(regime, name))
                        .collect()
                }),
                blend: table.blend,
                gear_ratio: self.joint.gear_ratio,
                sample_period: self.sample_period(),
                torque_limit: self.torque_limit(),
            },
        );
        Ok(EstimatorSet::new(sources, Some(fusion)))
    }
}

type Source = (String, Box<dyn JointTorqueEstimator + Send>);

/// Names the first number that is not finite.
fn finite(value: &toml::Value, key: &str) -> Result<(), String> {
    let dot = if key.is_empty() { "" } else { "." };
    match value {
        toml::Value::Float(x) if !x.is_finite() => {
            Err(format!("{key} = {x}; allowed: a finite number"))
        }
        toml::Value::Array(items) => items
            .iter()
            .enumerate()
            .try_for_each(|(i, item)| finite(item, &format!("{key}[{i}]"))),
        toml::Value::Table(table) => table
            .iter()
            .try_for_each(|(k, v)| finite(v, &format!("{key}{dot}{k}"))),
        _ => Ok(()),
    }
}
