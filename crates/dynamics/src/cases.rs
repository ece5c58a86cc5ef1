//! Evaluation of cases given as records: what `torquectl dynamics` prints, so that a model can be
//! checked against another library.

use crate::frames::{ReferenceFrame, frame_placement};
use crate::model::{Base, Model};
use crate::urdf::{UrdfError, UrdfOptions};
use crate::*;
use nalgebra::Matrix6xX;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Request.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cases {
    /// Names of the joints, in the order of `q dq ddq tau M`; all, in the model's order, if left out.
    /// A mimic joint that is named here is taken as independent.
    #[serde(default)]
    pub joints: Option<Vec<String>>,
    /// Links whose placement, motion and Jacobians are wanted too.
    #[serde(default)]
    pub frames: Vec<String>,
    /// States.
    pub cases: Vec<Case>,
}

/// One state.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// `q`, rad or m, one per joint.
    pub q: Vec<f64>,
    /// `dq`, rad/s; zero if left out.
    #[serde(default)]
    pub dq: Option<Vec<f64>>,
    /// `ddq`, rad/s²; zero if left out.
    #[serde(default)]
    pub ddq: Option<Vec<f64>>,
    /// Floating base; at the origin and at rest if left out.
    #[serde(default)]
    pub base: Option<BaseState>,
    /// External wrenches on links, N and N·m, linear first, in the link's axes and at its origin.
    #[serde(default)]
    pub f_ext: BTreeMap<String, [f64; 6]>,
}

/// State of a floating base.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseState {
    /// Position in the world, m.
    pub p: [f64; 3],
    /// Orientation in the world, normalised here.
    pub quat_xyzw: [f64; 4],
    /// Velocity, linear then angular, in base axes.
    #[serde(default)]
    pub v: [f64; 6],
    /// Spatial acceleration, linear then angular, in base axes.
    #[serde(default)]
    pub a: [f64; 6],
}

/// Answer.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Joints, in the order of all vectors below, after the base's six components.
    pub joints: Vec<String>,
    /// What the reader found odd in the model.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// One per case asked for.
    pub cases: Vec<CaseReport>,
}

/// Answer to one case; the base's six components come first.
#[derive(Clone, Debug, Serialize)]
#[allow(non_snake_case)]
pub struct CaseReport {
    /// Inverse dynamics.
    pub tau: Vec<f64>,
    /// Mass matrix, by rows.
    pub M: Vec<Vec<f64>>,
    /// Coriolis, centrifugal and gravity.
    pub nle: Vec<f64>,
    /// Gravity.
    pub g: Vec<f64>,
    /// Forward dynamics of `tau`: the accelerations again.
    pub ddq_of_tau: Vec<f64>,
    /// Centre of mass in the world.
    pub com: [f64; 3],
    /// Frames asked for.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub frames: BTreeMap<String, FrameReport>,
}

/// A frame in one state.
#[derive(Clone, Debug, Serialize)]
#[allow(non_snake_case)]
pub struct FrameReport {
    /// Position in the world.
    pub p: [f64; 3],
    /// Rotation matrix, by rows.
    pub R: Vec<Vec<f64>>,
    /// Twist in the frame's own axes.
    pub v: [f64; 6],
    /// Spatial acceleration in the frame's own axes.
    pub a: [f64; 6],
    /// Classical acceleration in the frame's own axes.
    pub a_classical: [f64; 6],
    /// Jacobian in the frame, by rows.
    pub J_local: Vec<Vec<f64>>,
    /// Jacobian in the world.
    pub J_world: Vec<Vec<f64>>,
    /// Jacobian at the frame's origin, in the world's axes.
    pub J_aligned: Vec<Vec<f64>>,
}

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
    let model = Model::from_urdf_with(urdf, file_name, &options).map_err(CasesError::Urdf)?;
    let evaluation = Evaluation::new(&model, request).map_err(CasesError::Request)?;
    let mut data = Data::new(&model);
    let mut cases = Vec::new();
    for (index, case) in request.cases.iter().enumerate() {
        let report = evaluation.case(&mut data, case);
        cases.push(report.map_err(|e| CasesError::Request(format!("cases[{index}].{e}")))?);
    }
    Ok(Report {
        joints: evaluation.names(),
        warnings: model.warnings().to_vec(),
        cases,
    })
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

struct Evaluation<'a> {
    model: &'a Model,
    /// Component of `v` of each of the answer's components.
    order: Vec<usize>,
    /// Index and name of each frame asked for.
    frames: Vec<(usize, &'a str)>,
}

impl<'a> Evaluation<'a> {
    fn new(model: &'a Model, request: &'a Cases) -> Result<Self, String> {
        let base = model.base_size().0;
        let mut order: Vec<usize> = (0..base).collect();
        match &request.joints {
            None => order.extend(base..model.nv()),
            Some(names) => {
                for name in names {
                    let joint = model
                        .joint_index(name)
                        .ok_or_else(|| format!("joints: \"{name}\" is no moving joint"))?;
                    if order.contains(&(base + joint)) {
                        return Err(format!("joints: \"{name}\" is named twice"));
                    }
                    order.push(base + joint);
                }
                let missing = (base..model.nv()).find(|k| !order.contains(k));
                if let Some(k) = missing {
                    let name = &model.joints()[k - base].name;
                    return Err(format!("joints: \"{name}\" is missing"));
                }
            }
        }
        let find = |name: &'a String| {
            let frame = model.frame_index(name);
            let frame = frame.ok_or_else(|| format!("frames: no link \"{name}\""))?;
            Ok((frame, name.as_str()))
        };
        let frames = request
            .frames
            .iter()
            .map(find)
            .collect::<Result<_, String>>()?;
        Ok(Self {
            model,
            order,
            frames,
        })
    }

    fn names(&self) -> Vec<String> {
        let base = self.model.base_size().0;
        let name = |k: &usize| self.model.joints()[k - base].name.clone();
        self.order[base..].iter().map(name).collect()
    }

    /// The model's vector: base part, then joints put in the model's order.
    fn vector(&self, key: &str, base: &[f64], joints: Option<&[f64]>) -> Result<Vec<f64>, String> {
        let joint_count = self.model.joint_count();
        let (bv, bq) = self.model.base_size();
        let mut x = base[..if key == "q" { bq } else { bv }].to_vec();
        let offset = x.len();
        x.resize(offset + joint_count, 0.0);
        if let Some(joints) = joints {
            if joints.len() != joint_count {
                return Err(format!(
                    "{key}: {} numbers; allowed: {joint_count}, one per joint",
                    joints.len()
                ));
            }
            for (k, value) in self.order[bv..].iter().zip(joints) {
                x[offset + k - bv] = *value;
            }
        }
        Ok(x)
    }

    fn case(&self, data: &mut Data, case: &Case) -> Result<CaseReport, String> {
        let base = case.base.unwrap_or(BaseState {
            p: [0.0; 3],
            quat_xyzw: [0.0, 0.0, 0.0, 1.0],
            v: [0.0; 6],
            a: [0.0; 6],
        });
        if base.quat_xyzw == [0.0; 4] {
            return Err("base.quat_xyzw: no rotation; allowed: any four numbers but zeros".into());
        }
        let pose = [base.p.as_slice(), base.quat_xyzw.as_slice()].concat();
        let q = self.vector("q", &pose, Some(&case.q))?;
        let v = self.vector("dq", &base.v, case.dq.as_deref())?;
        let a = self.vector("ddq", &base.a, case.ddq.as_deref())?;
        let f_ext = self.wrenches(case)?;
        let model = self.model;
        let tau = rnea(model, data, &q, &v, &a, Some(&f_ext)).to_vec();
        let ddq = aba(model, data, &q, &v, &tau, Some(&f_ext)).to_vec();
        let nle = self.ordered(nle(model, data, &q, &v));
        let g = self.ordered(gravity(model, data, &q));
        let m = crba(model, data, &q);
        let row = |i: &usize| self.order.iter().map(|j| m[(*i, *j)]).collect();
        let mass = self.order.iter().map(row).collect();
        forward_kinematics_acceleration(model, data, &q, &v, &a);
        Ok(CaseReport {
            tau: self.ordered(&tau),
            M: mass,
            nle,
            g,
            ddq_of_tau: self.ordered(&ddq),
            com: center_of_mass(model, data).into(),
            frames: self.frames(data),
        })
    }

    fn ordered(&self, x: &[f64]) -> Vec<f64> {
        self.order.iter().map(|k| x[*k]).collect()
    }

    /// External wrenches moved from links to their bodies.
    fn wrenches(&self, case: &Case) -> Result<Vec<Force>, String> {
        let mut all = vec![Force::zero(); self.model.bodies().len()];
        for (name, f) in &case.f_ext {
            let frame = self.model.frame_index(name);
            let frame = frame.ok_or_else(|| format!("f_ext: no link \"{name}\""))?;
            let frame = &self.model.frames()[frame];
            all[frame.body] += frame.placement.act_force(Force::from_array(*f));
        }
        Ok(all)
    }

    fn frames(&self, data: &Data) -> BTreeMap<String, FrameReport> {
        use ReferenceFrame::{Local, LocalWorldAligned, World};
        let model = self.model;
        let mut j = Matrix6xX::zeros(model.nv());
        let mut jacobian = |frame, reference| {
            frame_jacobian(model, data, frame, reference, &mut j);
            let row = |r: usize| self.order.iter().map(|k| j[(r, *k)]).collect();
            (0..6).map(row).collect()
        };
        let mut all = BTreeMap::new();
        for &(frame, name) in &self.frames {
            let m = frame_placement(model, data, frame);
            let row = |r: usize| m.rotation.row(r).iter().copied().collect();
            let report = FrameReport {
                p: m.translation.into(),
                R: (0..3).map(row).collect(),
                v: frame_velocity(model, data, frame, Local).to_array(),
                a: frame_acceleration(model, data, frame, Local).to_array(),
                a_classical: frame_classical_acceleration(model, data, frame, Local).to_array(),
                J_local: jacobian(frame, Local),
                J_world: jacobian(frame, World),
                J_aligned: jacobian(frame, LocalWorldAligned),
            };
            all.insert(name.to_owned(), report);
        }
        all
    }
}
