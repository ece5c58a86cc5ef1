//! A trained network as a file.

use crate::learned::{RegimesTable, feature_name, feature_set};
use crate::source::Source;
use estimators::network::{Layer, NetworkEstimator, NetworkParameters};
use problem::{Allowed, Problem};
use serde::{Deserialize, Serialize};

/// A trained network and its error.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedNetwork {
    /// Parameters of the estimator.
    pub parameters: NetworkParameters,
    /// Root mean square error on held-out blocks, without the low-pass, N·m.
    pub held_out_rms: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    features: String,
    gear_ratio: f64,
    #[serde(rename = "torque_limit_Nm")]
    torque_limit: f64,
    #[serde(rename = "torque_mean_Nm")]
    torque_mean: f64,
    #[serde(rename = "torque_spread_Nm")]
    torque_spread: f64,
    #[serde(rename = "held_out_rms_Nm")]
    held_out_rms: f64,
    low_pass_pole: f64,
    #[serde(rename = "current_filter_A2")]
    current_filter: [f64; 3],
    /// Mean and half of the range of each input.
    inputs: Vec<(f64, f64)>,
    regimes: RegimesTable,
    layer: Vec<LayerTable>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LayerTable {
    bias: Vec<f64>,
    weights: Vec<Vec<f64>>,
}

impl TrainedNetwork {
    /// The file's text.
    ///
    /// # Errors
    /// Numbers that TOML cannot hold.
    pub fn to_text(&self) -> Result<String, Problem> {
        let p = &self.parameters;
        let file = File {
            features: feature_name(p.features),
            gear_ratio: p.gear_ratio,
            torque_limit: p.torque_limit,
            torque_mean: p.torque.0,
            torque_spread: p.torque.1,
            held_out_rms: self.held_out_rms,
            low_pass_pole: p.low_pass_pole,
            current_filter: p.current_filter,
            inputs: p.inputs.clone(),
            regimes: (&p.regimes).into(),
            layer: (p.layers.iter())
                .map(|l| LayerTable {
                    bias: l.bias.clone(),
                    weights: l.weights.clone(),
                })
                .collect(),
        };
        toml::to_string(&file).map_err(|e| Problem::new(format!("network: {e}"), ""))
    }

    /// Reads a trained network; `file` is its name in messages.
    ///
    /// # Errors
    /// Text that is not such a file, or numbers from which no estimator can be built.
    pub fn from_text(text: &str, file: &str) -> Result<Self, Problem> {
        let source = Source { text, file };
        let table: File = source.table()?;
        for (key, value) in [
            ("gear_ratio", table.gear_ratio),
            ("torque_limit_Nm", table.torque_limit),
            ("torque_spread_Nm", table.torque_spread),
            ("held_out_rms_Nm", table.held_out_rms),
            ("current_filter_A2", table.current_filter[0]),
            ("current_filter_A2", table.current_filter[1]),
            ("current_filter_A2", table.current_filter[2]),
        ] {
            source.require(key, value, Allowed::Positive)?;
        }
        let pole = table.low_pass_pole;
        source.require("low_pass_pole", pole, Allowed::Below(0.0, 1.0))?;
        let layer = |l: LayerTable| Layer {
            weights: l.weights,
            bias: l.bias,
        };
        let parameters = NetworkParameters {
            features: feature_set(source, &table.features)?,
            inputs: table.inputs,
            torque: (table.torque_mean, table.torque_spread),
            layers: table.layer.into_iter().map(layer).collect(),
            regimes: table.regimes.regimes(source)?,
            low_pass_pole: pole,
            current_filter: table.current_filter,
            gear_ratio: table.gear_ratio,
            torque_limit: table.torque_limit,
        };
        NetworkEstimator::new(parameters.clone()).map_err(|p| p.at(file, 0))?;
        Ok(Self {
            parameters,
            held_out_rms: table.held_out_rms,
        })
    }
}
