//! All configured sources of one joint's torque, and their fusion.

use crate::fusion::{Fusion, MAX_SOURCES};
use crate::joint::{AnyEstimator, JointSample, JointTorqueEstimator};
use robot_state::{TorqueEstimate, torque_flags};

/// Sources with their names, and their fusion if there is one.
pub struct EstimatorSet {
    names: Vec<String>,
    sources: Vec<AnyEstimator>,
    estimates: Vec<TorqueEstimate>,
    fusion: Option<Fusion>,
    fused: TorqueEstimate,
}

impl EstimatorSet {
    /// A set of named sources, at most [`MAX_SOURCES`]; `fusion` must be of the same sources in the same
    /// order.
    #[must_use]
    pub fn new(sources: Vec<(String, AnyEstimator)>, fusion: Option<Fusion>) -> Self {
        debug_assert!(sources.len() <= MAX_SOURCES);
        let (names, sources): (Vec<_>, Vec<_>) = sources.into_iter().unzip();
        let estimates = vec![TorqueEstimate::default(); sources.len()];
        Self {
            names,
            sources,
            estimates,
            fusion,
            fused: TorqueEstimate::default(),
        }
    }

    /// The sources' names, in order.
    #[must_use]
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Each source's own estimate of the last sample.
    #[must_use]
    pub fn estimates(&self) -> &[TorqueEstimate] {
        &self.estimates
    }

    /// Whether the sources are fused.
    #[must_use]
    pub fn fuses(&self) -> bool {
        self.fusion.is_some()
    }
}

impl JointTorqueEstimator for EstimatorSet {
    /// The fused torque; without a fusion, the first source that is valid.
    fn update(&mut self, sample: &JointSample) -> TorqueEstimate {
        for (source, estimate) in self.sources.iter_mut().zip(&mut self.estimates) {
            *estimate = source.update(sample);
        }
        self.fused = match &mut self.fusion {
            Some(fusion) => fusion.update(sample, &self.estimates),
            None => {
                let valid = |e: &&TorqueEstimate| e.flags & torque_flags::VALID != 0;
                self.fused.flags &= !torque_flags::VALID;
                self.estimates
                    .iter()
                    .find(valid)
                    .copied()
                    .unwrap_or(self.fused)
            }
        };
        self.fused
    }

    fn reset(&mut self) {
        self.sources.iter_mut().for_each(|source| source.reset());
        self.estimates.fill(TorqueEstimate::default());
        self.fused = TorqueEstimate::default();
        if let Some(fusion) = &mut self.fusion {
            fusion.reset();
        }
    }
}
