//! Trained local Gaussian processes as a file.

use crate::learned::{RegimesTable, feature_name, feature_set};
use crate::source::Source;
use estimators::local_gp::{LocalGp, LocalGpParameters, LocalModel};
use problem::Problem;
use serde::{Deserialize, Serialize};

/// Trained local Gaussian processes and their errors.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainedLocalGp {
    /// Name of the model that is corrected.
    pub base: String,
    /// Parameters of the correction.
    pub parameters: LocalGpParameters,
    /// Root mean square of the residual on held-out blocks before and after the correction, N·m.
    pub held_out_rms: (f64, f64),
}

/// Torque that a learned feed-forward of a robot's joint corrects.
#[must_use]
pub fn feed_forward_base(joint: &str) -> String {
    format!("inverse dynamics of {joint}")
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    base: String,
    features: String,
    gear_ratio: f64,
    #[serde(rename = "signal_variance_Nm2")]
    signal_variance: f64,
    #[serde(rename = "noise_variance_Nm2")]
    noise_variance: f64,
    directions: usize,
    #[serde(rename = "tolerance_Nm")]
    tolerance: f64,
    /// Before and after the correction.
    #[serde(rename = "held_out_rms_Nm")]
    held_out_rms: (f64, f64),
    /// Mean and kernel width of each input.
    inputs: Vec<(f64, f64)>,
    regimes: RegimesTable,
    #[serde(default)]
    model: Vec<ModelTable>,
}

/// One model; points in scaled inputs.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelTable {
    centre: Vec<f64>,
    #[serde(rename = "residuals_Nm")]
    residuals: Vec<f64>,
    #[serde(rename = "noise_Nm2")]
    noise: Vec<f64>,
    points: Vec<f64>,
}

impl TrainedLocalGp {
    /// The file's text.
    ///
    /// # Errors
    /// Numbers that TOML cannot hold.
    pub fn to_text(&self) -> Result<String, Problem> {
        let p = &self.parameters;
        let file = File {
            base: self.base.clone(),
            features: feature_name(p.features),
            gear_ratio: p.gear_ratio,
            signal_variance: p.signal_variance,
            noise_variance: p.noise_variance,
            directions: p.directions,
            tolerance: p.tolerance,
            held_out_rms: self.held_out_rms,
            inputs: p.inputs.clone(),
            regimes: (&p.regimes).into(),
            model: (p.models.iter())
                .map(|m| ModelTable {
                    centre: m.centre.clone(),
                    residuals: m.residuals.clone(),
                    noise: m.noise.clone(),
                    points: m.points.clone(),
                })
                .collect(),
        };
        toml::to_string(&file)
            .map_err(|e| Problem::new(format!("local Gaussian processes: {e}"), ""))
    }

    /// Reads trained local Gaussian processes; `file` is its name in messages.
    ///
    /// # Errors
    /// Text that is not such a file, or numbers from which no prediction can be made.
    pub fn from_text(text: &str, file: &str) -> Result<Self, Problem> {
        let source = Source { text, file };
        let table: File = source.table()?;
        let model = |m: ModelTable| LocalModel {
            centre: m.centre,
            points: m.points,
            residuals: m.residuals,
            noise: m.noise,
        };
        let parameters = LocalGpParameters {
            features: feature_set(source, &table.features)?,
            inputs: table.inputs,
            signal_variance: table.signal_variance,
            noise_variance: table.noise_variance,
            models: table.model.into_iter().map(model).collect(),
            directions: table.directions,
            tolerance: table.tolerance,
            regimes: table.regimes.regimes(source)?,
            gear_ratio: table.gear_ratio,
        };
        LocalGp::new(&parameters).map_err(|p| p.at(file, 0))?;
        Ok(Self {
            base: table.base,
            parameters,
            held_out_rms: table.held_out_rms,
        })
    }
}
