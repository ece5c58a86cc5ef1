//! Inputs and regimes in the files of network and Gaussian processes.

use crate::source::Source;
use estimators::features::FeatureSet;
use estimators::regimes::{Regime, Regimes};
use problem::{Allowed, Problem};
use serde::{Deserialize, Serialize};

/// Names of the sets of inputs in files.
const FEATURES: [(FeatureSet, &str); 5] = [
    (FeatureSet::Phase, "phase"),
    (FeatureSet::Published, "published"),
    (FeatureSet::Position, "position"),
    (FeatureSet::Load, "load"),
    (FeatureSet::Motion, "motion"),
];

pub(crate) fn feature_name(set: FeatureSet) -> String {
    let named = FEATURES.iter().find(|(s, _)| *s == set);
    named.map_or("phase", |(_, name)| name).to_owned()
}

pub(crate) fn feature_set(source: Source<'_>, name: &str) -> Result<FeatureSet, Problem> {
    let named = FEATURES.iter().find(|(_, n)| *n == name);
    named.map(|(set, _)| *set).ok_or_else(|| {
        let allowed = FEATURES.map(|(_, name)| name).join(", ");
        source.refusal("features", format!("features = {name:?}"), allowed)
    })
}

/// [`Regimes`] in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RegimesTable {
    speed_rad_per_s: f64,
    time_constant_s: f64,
    sample_period_s: f64,
    rest_gain: f64,
    #[serde(rename = "rest_sigma_Nm")]
    rest_sigma: f64,
    moving_gain: f64,
    #[serde(rename = "moving_sigma_Nm")]
    moving_sigma: f64,
}

impl From<&Regimes> for RegimesTable {
    fn from(r: &Regimes) -> Self {
        Self {
            speed_rad_per_s: r.speed,
            time_constant_s: r.time_constant,
            sample_period_s: r.sample_period,
            rest_gain: r.rest.gain,
            rest_sigma: r.rest.sigma,
            moving_gain: r.moving.gain,
            moving_sigma: r.moving.sigma,
        }
    }
}

impl RegimesTable {
    pub(crate) fn regimes(&self, source: Source<'_>) -> Result<Regimes, Problem> {
        for (key, value, allowed) in [
            ("speed_rad_per_s", self.speed_rad_per_s, Allowed::Positive),
            ("time_constant_s", self.time_constant_s, Allowed::Positive),
            ("sample_period_s", self.sample_period_s, Allowed::Positive),
            ("rest_sigma_Nm", self.rest_sigma, Allowed::Positive),
            ("moving_sigma_Nm", self.moving_sigma, Allowed::Positive),
            ("rest_gain", self.rest_gain, Allowed::Within(0.0, 1.0)),
            ("moving_gain", self.moving_gain, Allowed::Within(0.0, 1.0)),
        ] {
            source.require(&format!("regimes.{key}"), value, allowed)?;
        }
        let regime = |gain, sigma| Regime { gain, sigma };
        Ok(Regimes {
            speed: self.speed_rad_per_s,
            time_constant: self.time_constant_s,
            sample_period: self.sample_period_s,
            rest: regime(self.rest_gain, self.rest_sigma),
            moving: regime(self.moving_gain, self.moving_sigma),
        })
    }
}
