//! The sources from the torsion as one, and torques that stand at their clamp.

use super::{Fusion, MAX_SOURCES, MAX_VARIANCE_RATIO};
use robot_state::{TorqueEstimate, torque_flags};

/// The torque of the sources from the torsion.
#[derive(Default)]
pub(super) struct Group {
    /// Sum of their weights; 0 without any.
    pub(super) sum: f64,
    pub(super) tau: f64,
    pub(super) variance: f64,
    pub(super) delay: f64,
    /// A source with a weight is at its clamp.
    pub(super) saturated: bool,
    /// The torque is a bound.
    pub(super) clamped: bool,
}

/// Whether a torque is a bound: the source stands at its clamp.
pub(super) fn clamped(estimate: &TorqueEstimate) -> bool {
    let marks = torque_flags::SATURATED | torque_flags::VALID;
    estimate.flags & marks == marks
}

impl Fusion {
    /// Excludes sources from the torsion that stand at their clamp while the gear does not: the torsion is within its
    /// range.
    pub(super) fn exclude_clamped(
        &self,
        variances: &mut [f64; MAX_SOURCES],
        sources: &[TorqueEstimate],
    ) {
        let valid = |i: usize| variances.get(i).is_some_and(|v| v.is_finite());
        let within = |i: &usize| valid(*i) && sources.get(*i).is_some_and(|e| !clamped(e));
        let Some(gear) = self.places.gear.filter(within) else {
            return;
        };
        for (i, (variance, source)) in variances.iter_mut().zip(sources).enumerate() {
            let apart = i == gear || self.places.stand_apart(i);
            if !apart && clamped(source) {
                *variance = f64::INFINITY;
            }
        }
    }

    /// The sources from the torsion, each with the more weight the nearer its variance is to the least of them.
    pub(super) fn group(&self, sources: &[TorqueEstimate], variances: &[f64], least: f64) -> Group {
        let mut group = Group::default();
        let mut bound = 0.0;
        for (i, (source, variance)) in sources.iter().zip(variances).take(self.sources).enumerate()
        {
            // Relative to the least: most for the best, down to 0 at the bound, without a step.
            let weight = (least / variance - 1.0 / MAX_VARIANCE_RATIO).max(0.0);
            let apart = self.places.stand_apart(i);
            if apart || weight.is_nan() || weight == 0.0 {
                continue;
            }
            group.sum += weight;
            group.tau += weight * source.tau;
            group.delay += weight * source.delay_s;
            // Errors count as fully correlated: averaging then reduces nothing.
            group.variance += weight * variance;
            bound += if clamped(source) { weight } else { 0.0 };
        }
        if group.sum > 0.0 {
            for mean in [&mut group.tau, &mut group.delay, &mut group.variance] {
                *mean /= group.sum;
            }
        }
        // The gear's clamp is that of the torsion.
        let gear = self.places.gear.and_then(|i| sources.get(i));
        group.saturated = bound > 0.0;
        group.clamped = gear.is_some_and(clamped) || bound > 0.5 * group.sum;
        group
    }
}
