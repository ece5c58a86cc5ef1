//! The estimators that a joint file switches on.

use crate::{ComplianceTable, FeedForwardTable, HysteresisTable, JointFile, KalmanTable};
use estimators::compliance::ComplianceEstimator;
use estimators::current_based::CurrentEstimator;
use estimators::deformation::DeformationEstimator;
use estimators::feed_forward::{CorrectionParameters, FeedForwardEstimator, FeedForwardParameters};
use estimators::fusion::{Fusion, FusionParameters, SourceError};
use estimators::hysteresis::{HysteresisEstimator, HysteresisParameters};
use estimators::joint::AnyEstimator;
use estimators::kalman::{ADDED_STATES, KalmanEstimator, KalmanParameters, STATES, Transform};
use estimators::local_gp::{LocalGp, LocalGpEstimator};
use estimators::network::NetworkEstimator;
use estimators::set::{EstimatorSet, ZeroParameters};
use estimators::tracking::TrackingParameters;
use problem::Problem;

/// Models without trained files, in the order in which they are shown.
const MODELS: [&str; 6] = [
    "compliance",
    "hysteresis",
    "deformation",
    "kalman",
    "unscented",
    "unscented_added",
];

impl JointFile {
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
        .with_uncertainty(&table.uncertainty, self.validity())
    }

    /// Parameters of a Kalman filter, with the compliance that it needs.
    ///
    /// # Errors
    /// No table `[compliance]`; `hysteresis` asked for without its table.
    pub fn kalman_parameters(&self, table: &KalmanTable) -> Result<KalmanParameters, Problem> {
        let needs = |table: &str| {
            Problem::new(
                "a Kalman filter needs the model of another table",
                format!("a table [{table}]"),
            )
        };
        let compliance = self
            .compliance
            .as_ref()
            .ok_or_else(|| needs("compliance"))?;
        let (gear, tracking) = if table.hysteresis {
            let table = self
                .hysteresis
                .as_ref()
                .ok_or_else(|| needs("hysteresis"))?;
            (Some(table.clone().into()), table.tracking())
        } else {
            (None, TrackingParameters::default())
        };
        let joint = self.estimator_parameters(compliance);
        Ok(KalmanParameters {
            meshing: self.current.as_ref().map_or(0.0, |table| table.k_4),
            sign_smoothing: joint.wave_generator.epsilon.max(1e-3),
            joint,
            gear,
            tracking,
            rotor_inertia: self.joint.rotor_inertia,
            process: table.process,
            measurement: table.measurement,
        })
    }

    /// One of the models; none if its table is not there.
    ///
    /// # Errors
    /// A name that no model has; tables that need others.
    pub fn model(&self, name: &str) -> Result<Option<AnyEstimator>, Problem> {
        let kalman = |table: &Option<KalmanTable>, transform, added: bool| {
            let Some(table) = table else { return Ok(None) };
            let p = self.kalman_parameters(table)?;
            Ok(Some(if added {
                Box::new(KalmanEstimator::<ADDED_STATES>::new(p, transform)) as AnyEstimator
            } else {
                Box::new(KalmanEstimator::<STATES>::new(p, transform))
            }))
        };
        Ok(match name {
            "compliance" => self.compliance.as_ref().map(|table| -> AnyEstimator {
                Box::new(ComplianceEstimator::new(self.estimator_parameters(table)))
            }),
            "hysteresis" => self
                .hysteresis
                .as_ref()
                .map(|table| -> AnyEstimator { Box::new(self.hysteresis_estimator(table)) }),
            "deformation" => self.deformation.as_ref().map(|table| -> AnyEstimator {
                Box::new(DeformationEstimator::new(
                    self.deformation_parameters(table),
                ))
            }),
            "kalman" => kalman(&self.kalman, Transform::Linear, false)?,
            "unscented" => kalman(&self.unscented, Transform::Unscented, false)?,
            "unscented_added" => kalman(&self.unscented_added, Transform::Unscented, true)?,
            other => {
                let reason = format!("model {other:?} is unknown");
                return Err(Problem::new(reason, MODELS.join(", ")));
            }
        })
    }

    /// A model as Gaussian processes correct it: Z's compliance with a short low-pass, as no residual
    /// compensates the low-pass's own delay.
    ///
    /// # Errors
    /// As [`Self::model`].
    pub fn gp_base(&self, name: &str) -> Result<Option<AnyEstimator>, Problem> {
        match (name, &self.compliance) {
            ("compliance", Some(table)) => {
                let pole = (-self.sample_period() / GP_TIME_CONSTANT_S).exp();
                let parameters = self.estimator_parameters(&ComplianceTable {
                    low_pass_pole: pole.min(table.low_pass_pole),
                    ..table.clone()
                });
                Ok(Some(Box::new(ComplianceEstimator::new(parameters))))
            }
            _ => self.model(name),
        }
    }

    /// Every estimator that is switched on, by name, without their fusion.
    ///
    /// # Errors
    /// Tables that need others.
    pub fn sources(&self) -> Result<Vec<(String, AnyEstimator)>, Problem> {
        let mut sources = Vec::new();
        for name in MODELS {
            if let Some(model) = self.model(name)? {
                sources.push((name.to_owned(), model));
            }
        }
        if let Some(trained) = &self.trained.network {
            let network = NetworkEstimator::new(trained.parameters.clone())?;
            sources.push(("network".to_owned(), Box::new(network)));
        }
        for (name, trained) in &self.trained.local_gp {
            let reserved = [CURRENT, FEED_FORWARD, FUSED];
            let taken = sources.iter().any(|(other, _)| other == name);
            if taken || reserved.contains(&name.as_str()) {
                let reason = format!("local_gp.{name}: another source has that name");
                return Err(Problem::new(reason, "each name once"));
            }
            let base = self.gp_base(&trained.base)?.ok_or_else(|| {
                let base = &trained.base;
                let reason = format!("local_gp.{name} corrects {base:?}, which is switched off");
                Problem::new(reason, format!("a table [{base}]"))
            })?;
            let gp =
                LocalGp::new(&trained.parameters).map_err(|p| p.of(format!("local_gp.{name}")))?;
            let estimator = LocalGpEstimator::new(base, gp, self.torque_limit());
            sources.push((name.clone(), Box::new(estimator)));
        }
        let current = CurrentEstimator::new(self.current_parameters());
        let table = self.current.as_ref();
        let uncertainty = table.map_or(&[][..], |table| &table.uncertainty);
        let current = current.with_uncertainty(uncertainty, self.validity());
        sources.push((CURRENT.to_owned(), Box::new(current)));
        if let Some(table) = &self.feed_forward {
            let estimator = self.feed_forward_estimator(table);
            sources.push((FEED_FORWARD.to_owned(), Box::new(estimator)));
        }
        Ok(sources)
    }

    /// The feed-forward as an estimator.
    #[must_use]
    pub fn feed_forward_estimator(&self, table: &FeedForwardTable) -> FeedForwardEstimator {
        FeedForwardEstimator::new(FeedForwardParameters {
            gain: table.gain,
            offset: table.offset,
            viscous: table.viscous,
            coulomb: table.coulomb,
            sign_smoothing: table.sign_smoothing,
            sigma: table.sigma,
            torque_limit: self.torque_limit(),
        })
        .with_uncertainty(&table.uncertainty, self.validity())
    }

    /// How the other sources differ from a feed-forward without contacts.
    #[must_use]
    pub fn correction_parameters(&self, change_sigma: [f64; 2]) -> CorrectionParameters {
        CorrectionParameters {
            change_sigma,
            loading: LOADING * self.joint.rated_torque,
            sample_period: self.sample_period(),
        }
    }

    /// The estimators that the loop runs: those whose torques are fused, or all without a fusion. The
    /// feed-forward is not among them: the loop compares the torque with its rigid-body model to find slips,
    /// drifts and contacts, and `tau_hat` has the model's level.
    ///
    /// # Errors
    /// As [`Self::estimators`].
    pub fn fused_estimators(&self) -> Result<EstimatorSet, Problem> {
        let mut joint = self.clone();
        let Some(table) = &mut joint.fusion else {
            return self.estimators();
        };
        table.sources.retain(|_, source| source.fused);
        table.sources.remove(FEED_FORWARD);
        joint.feed_forward = None;
        let mut sources = joint.sources()?;
        let kept = joint.fusion.as_ref().map(|table| &table.sources);
        sources.retain(|(name, _)| kept.is_some_and(|kept| kept.contains_key(name)));
        joint.set_of(sources)
    }

    /// Every estimator that is switched on, fused if there is a fusion.
    ///
    /// # Errors
    /// Tables that need others; a fusion of other sources than are switched on.
    pub fn estimators(&self) -> Result<EstimatorSet, Problem> {
        self.set_of(self.sources()?)
    }

    fn set_of(&self, sources: Vec<(String, AnyEstimator)>) -> Result<EstimatorSet, Problem> {
        let place = |name: &str| sources.iter().position(|(n, _)| n == name);
        let zero = ZeroParameters {
            unknown: self.encoders.as_ref().is_some_and(|e| e.zero_unknown),
            gear_ratio: self.joint.gear_ratio,
            stiffness: self.hysteresis.as_ref().map_or(0.0, |table| table.linear),
            gear: place(HYSTERESIS),
            current: place(CURRENT),
            feed_forward: place(FEED_FORWARD),
        };
        let Some(table) = &self.fusion else {
            return Ok(EstimatorSet::new(sources, None).with_zero(zero));
        };
        let missing = |name: &&String| place(name).is_none();
        if let Some(missing) = table.sources.keys().find(missing) {
            return Err(Problem::new(
                format!("fusion.sources.{missing}: {missing} is not switched on"),
                "sources that are; fit the fusion again after switching estimators on or off",
            ));
        }
        // A source without errors in the table takes no part.
        let error = |regime: usize, name: &String| {
            let of = table.sources.get(name);
            SourceError {
                variance: of.map_or(f64::INFINITY, |t| t.rms[regime].powi(2)),
                reported: of.map_or(0.0, |t| t.sigma[regime]),
            }
        };
        let takes_part = |name: &str| table.sources.get(name).is_some_and(|t| t.fused);
        let fused = |name: &str| takes_part(name).then(|| place(name)).flatten();
        let correction = (self.feed_forward.as_ref())
            .map(|table| self.correction_parameters(table.change_sigma));
        let left_out = (sources.iter().enumerate())
            .filter(|(_, (name, _))| !takes_part(name))
            .map(|(i, _)| i);
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
                rated_torque: self.joint.rated_torque,
                independent: fused(CURRENT),
                reference: fused(HYSTERESIS),
                feed_forward: fused(FEED_FORWARD).zip(correction),
                left_out: left_out.collect(),
                rest_factor: REST_FACTOR,
                zero_unknown: zero.unknown,
            },
        );
        Ok(EstimatorSet::new(sources, Some(fusion)).with_zero(zero))
    }
}

/// Factor of the current's variance at rest where the torsion's zero is known, by an unloaded turn or a tare. An
/// empirical constant, by no law: on 12 joints of the design part of the family of joints (`torque-judge`) the
/// fused error is 4 % larger with 1 than with 4 after an unloaded turn, on 16 of them without one, tared, 19 and
/// 12 % larger; 9 and 16 gain no more than 4 %, and the sigma is then too large (2026-11).
const REST_FACTOR: f64 = 4.0;
/// Time constant of the low-pass on a compliance model that is corrected, s.
const GP_TIME_CONSTANT_S: f64 = 0.002;

/// Names of the source from current and of the fusion.
const CURRENT: &str = "current";
const FUSED: &str = "fused";
/// Name of the feed-forward.
const FEED_FORWARD: &str = "feed_forward";
/// Rate of the feed-forward that counts as motion, of the rated torque per second.
const LOADING: f64 = 0.1;
/// Name of the gear with slipping springs, whose sigma knows its parameters.
const HYSTERESIS: &str = "hysteresis";
