//! What a joint's calibration gives to the loop: built estimators, and figures.

use super::JointParameters;
use estimators::compliance::ComplianceEstimator;
use estimators::joint::AnyEstimator;
use estimators::radius::AtRadius;
use joint_file::JointFile;
use problem::Problem;

/// A calibration that fits its joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointCalibration {
    file: JointFile,
}

impl JointCalibration {
    /// The calibration by a joint file.
    #[must_use]
    pub fn new(file: JointFile) -> Self {
        Self { file }
    }

    /// The joint file; the loop asks for no more than the other functions give.
    #[must_use]
    pub fn file(&self) -> &JointFile {
        &self.file
    }

    /// Skew between the encoders, s; none: it is not calibrated.
    #[must_use]
    pub fn skew(&self) -> Option<f64> {
        self.file.encoders.as_ref().map(|encoders| encoders.skew)
    }

    /// Samples of the straight line whose slope is a velocity.
    #[must_use]
    pub fn velocity_window(&self) -> usize {
        self.file.velocity_window()
    }

    /// g: torque per fused torque for fast changes, 1; 1 where it is not known.
    #[must_use]
    pub fn torsion_gain(&self) -> f64 {
        self.file
            .torsion_gain
            .as_ref()
            .map_or(1.0, |table| table.gain)
    }

    /// Whether it has a gear whose zero a tare can move.
    #[must_use]
    pub fn has_gear(&self) -> bool {
        self.file.hysteresis.is_some()
    }
}

impl JointParameters {
    /// The estimator of the joint's torque from encoders and current: the fused ones of its calibration, or Z's
    /// compliance without one; none where there is no second encoder.
    ///
    /// # Errors
    /// Estimators that cannot be built together.
    pub fn torque_estimator(&self) -> Result<Option<AnyEstimator>, Problem> {
        if !self.has_link_encoder {
            return Ok(None);
        }
        let Some(JointCalibration { file }) = &self.calibration else {
            return Ok(Some(Box::new(ComplianceEstimator::new(
                self.estimator.clone(),
            ))));
        };
        let fused = file.fused_estimators();
        let fused = Box::new(fused.map_err(|problem| problem.of(&self.name))?);
        Ok(Some(match file.joint.radius {
            Some(radius) => Box::new(AtRadius::new(fused, radius)),
            None => fused,
        }))
    }
}
