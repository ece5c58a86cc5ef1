//! Evaluation of cases given as records: what `torquectl dynamics` prints, so that a model can be
//! checked against another library.

mod evaluation;
mod report;
mod request;

pub use report::{CaseReport, FrameMotion, FrameReport, More, Report, Rows};
pub use request::{BaseState, Case, Cases};

use crate::data::Data;
use crate::model::{Base, Model};
use crate::urdf::{UrdfError, UrdfOptions};
use evaluation::Evaluation;

/// Evaluates cases on a URDF.
pub fn evaluate(
    urdf: &str,
    file_name: &str,
    base: Base,
    request: &Cases,
) -> Result<Report, CasesError> {
    let options = UrdfOptions {
        base,
        independent: request.joints.clone().unwrap_or_default(),
    };
    let mut model = Model::from_urdf_with(urdf, file_name, &options).map_err(CasesError::Urdf)?;
    set_armatures(&mut model, request).map_err(CasesError::Request)?;
    let evaluation = Evaluation::new(&model, request).map_err(CasesError::Request)?;
    let mut data = Data::new(&model);
    let mut cases = Vec::new();
    for (index, case) in request.cases.iter().enumerate() {
        let report = evaluation.case(&mut data, case);
        cases.push(report.map_err(|e| CasesError::Request(format!("cases[{index}].{e}")))?);
    }
    let bodies = model.bodies().iter().map(|b| b.name.clone());
    Ok(Report {
        joints: evaluation.names(),
        warnings: model.warnings().to_vec(),
        bodies: match request.more {
            true => bodies.skip(usize::from(base == Base::Fixed)).collect(),
            false => Vec::new(),
        },
        cases,
    })
}

fn set_armatures(model: &mut Model, request: &Cases) -> Result<(), String> {
    for (name, armature) in &request.armature {
        let joint = model.joint_index(name);
        let joint = joint.ok_or_else(|| format!("armature: \"{name}\" is no moving joint"))?;
        if *armature < 0.0 {
            return Err(format!(
                "armature.{name}: {armature}; allowed: a number >= 0"
            ));
        }
        model.set_armature(joint, *armature);
    }
    Ok(())
}

/// Why cases could not be evaluated.
#[derive(Clone, Debug)]
pub enum CasesError {
    /// The URDF was refused.
    Urdf(UrdfError),
    /// The request does not fit the model.
    Request(String),
}

impl std::fmt::Display for CasesError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            CasesError::Urdf(e) => e.fmt(f),
            CasesError::Request(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for CasesError {}
