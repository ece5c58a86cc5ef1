//! Every torque source that a joint file can switch on: a row each.

use crate::JointFile;
use crate::building::{kalman, unscented, unscented_added};
use estimators::compliance::ComplianceEstimator;
use estimators::deformation::DeformationEstimator;
use estimators::joint::AnyEstimator;
use estimators::network::NetworkEstimator;
use estimators::role::Role;
use problem::Problem;

/// A torque source.
pub(crate) struct Row {
    /// Its name, in files and on pages.
    pub(crate) name: &'static str,
    /// Its part in the joint's torque.
    pub(crate) role: Role,
    /// The estimator; none where its table is not there. Errors: tables that need others.
    pub(crate) build: fn(&JointFile) -> Result<Option<AnyEstimator>, Problem>,
}

const fn row(
    name: &'static str,
    role: Role,
    build: fn(&JointFile) -> Result<Option<AnyEstimator>, Problem>,
) -> Row {
    Row { name, role, build }
}

/// Sources from the torsion, in the order in which they are shown; Gaussian processes on them come behind.
pub(crate) const OF_TORSION: [Row; 7] = [
    row("compliance", Role::Torsion, |file| {
        let build = |table| ComplianceEstimator::new(file.estimator_parameters(table));
        Ok(file.compliance.as_ref().map(|table| boxed(build(table))))
    }),
    row("hysteresis", Role::Gear, |file| {
        let build = |table| file.hysteresis_estimator(table);
        Ok(file.hysteresis.as_ref().map(|table| boxed(build(table))))
    }),
    row("deformation", Role::Torsion, |file| {
        let build = |table| DeformationEstimator::new(file.deformation_parameters(table));
        Ok(file.deformation.as_ref().map(|table| boxed(build(table))))
    }),
    row("kalman", Role::Torsion, kalman),
    row("unscented", Role::Torsion, unscented),
    row("unscented_added", Role::GearFilter, unscented_added),
    row("network", Role::Torsion, |file| {
        let build = |p: &crate::TrainedNetwork| NetworkEstimator::new(p.parameters.clone());
        let network = file.trained.network.as_ref().map(build).transpose()?;
        Ok(network.map(boxed))
    }),
];

/// Sources that know nothing of the torsion.
pub(crate) const OTHERS: [Row; 2] = [
    row("current", Role::Current, |file| {
        Ok(Some(boxed(file.current_estimator())))
    }),
    row("feed_forward", Role::Model, |file| {
        let build = |table| file.feed_forward_estimator(table);
        Ok(file.feed_forward.as_ref().map(|table| boxed(build(table))))
    }),
];

/// Name of the fusion, which no source may have.
pub(crate) const FUSED: &str = "fused";

fn boxed(estimator: impl estimators::joint::JointTorqueEstimator + Send + 'static) -> AnyEstimator {
    Box::new(estimator)
}
