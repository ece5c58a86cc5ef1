//! Trained local Gaussian processes as a file.

use super::TrainedLocalGp;
use crate::FitError;
use crate::learned::{RegimesTable, feature_name, feature_set, read};
use estimators::local_gp::{LocalGp, LocalGpParameters, LocalModel};
use serde::{Deserialize, Serialize};

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
    pub fn to_text(&self) -> Result<String, FitError> {
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
        toml::to_string(&file).map_err(|e| FitError(format!("local Gaussian processes: {e}")))
    }

    /// Reads trained local Gaussian processes; `file` is what messages call it.
    ///
    /// # Errors
    /// Text that is not such a file, or numbers from which no prediction can be made.
    pub fn from_text(text: &str, file: &str) -> Result<Self, FitError> {
        let table: File = read(text, file)?;
        let fail = |message: String| FitError(format!("{file}: {message}"));
        let (before, after) = table.held_out_rms;
        if !(before.is_finite() && after.is_finite()) {
            return Err(fail(format!(
                "held_out_rms_Nm = [{before}, {after}]; allowed: finite numbers"
            )));
        }
        let model = |m: ModelTable| LocalModel {
            centre: m.centre,
            points: m.points,
            residuals: m.residuals,
            noise: m.noise,
        };
        let parameters = LocalGpParameters {
            features: feature_set(&table.features).map_err(|e| fail(e.0))?,
            inputs: table.inputs,
            signal_variance: table.signal_variance,
            noise_variance: table.noise_variance,
            models: table.model.into_iter().map(model).collect(),
            directions: table.directions,
            tolerance: table.tolerance,
            regimes: table.regimes.regimes().map_err(|e| fail(e.0))?,
            gear_ratio: table.gear_ratio,
        };
        LocalGp::new(&parameters).map_err(|e| fail(e.to_string()))?;
        Ok(Self {
            base: table.base,
            parameters,
            held_out_rms: table.held_out_rms,
        })
    }
}
