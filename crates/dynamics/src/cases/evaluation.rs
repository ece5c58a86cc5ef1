//! The algorithms run on one state after another.

use super::report::{CaseReport, FrameMotion, FrameReport, More, Rows};
use super::request::{BaseState, Case, Cases};
use crate::*;
use nalgebra::{DMatrix, Dim, Matrix, Matrix3xX, Matrix6xX, RawStorage};
use std::collections::BTreeMap;

/// A model and what is asked of it.
pub(super) struct Evaluation<'a> {
    model: &'a Model,
    request: &'a Cases,
    /// Component of `v` of each of the answer's components.
    order: Vec<usize>,
    /// Index and name of each frame asked for.
    frames: Vec<(usize, &'a str)>,
}

/// A state in the model's order.
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    f_ext: Vec<Force>,
}

impl<'a> Evaluation<'a> {
    pub(super) fn new(model: &'a Model, request: &'a Cases) -> Result<Self, String> {
        let find = |name: &'a String| {
            let frame = model.frame_index(name);
            let frame = frame.ok_or_else(|| format!("frames: no link \"{name}\""))?;
            Ok((frame, name.as_str()))
        };
        let frames = request.frames.iter().map(find);
        Ok(Self {
            model,
            request,
            order: order(model, request)?,
            frames: frames.collect::<Result<_, String>>()?,
        })
    }

    pub(super) fn names(&self) -> Vec<String> {
        let base = self.model.base_size().0;
        let name = |k: &usize| self.model.joints()[k - base].name.clone();
        self.order[base..].iter().map(name).collect()
    }

    pub(super) fn case(&self, data: &mut Data, case: &Case) -> Result<CaseReport, String> {
        let state = self.state(case)?;
        let State { q, v, a, f_ext } = &state;
        let model = self.model;
        let tau = rnea(model, data, q, v, a, Some(f_ext)).to_vec();
        let ddq = aba(model, data, q, v, &tau, Some(f_ext)).to_vec();
        let report = CaseReport {
            tau: self.ordered(&tau),
            M: self.both_ordered(crba(model, data, q)),
            nle: self.ordered(nle(model, data, q, v)),
            g: self.ordered(gravity(model, data, q)),
            ddq_of_tau: self.ordered(&ddq),
            com: {
                forward_kinematics(model, data, q);
                center_of_mass(model, data).into()
            },
            more: self.request.more.then(|| self.more(data, &state, &tau)),
            frames: self.frames(data, &state),
        };
        let numbers = [&report.tau, &report.nle, &report.g].into_iter().flatten();
        let numbers = numbers.chain(report.M.iter().flatten()).chain(&report.com);
        if numbers.copied().all(f64::is_finite) {
            Ok(report)
        } else {
            Err("q, dq, ddq, base, f_ext: too large, the result is not finite".into())
        }
    }

    fn state(&self, case: &Case) -> Result<State, String> {
        let fixed = self.model.base() == Base::Fixed;
        let base = case.base.unwrap_or(BaseState::REST);
        if fixed && base != BaseState::REST {
            return Err(
                "base: the root link is fixed to the world's origin; allowed: no base, or --floating"
                    .into(),
            );
        }
        Ok(State {
            q: self.vector("q", &base.pose()?, Some(&case.q))?,
            v: self.vector("dq", &base.v, case.dq.as_deref())?,
            a: self.vector("ddq", &base.a, case.ddq.as_deref())?,
            f_ext: self.wrenches(case)?,
        })
    }

    /// The model's vector: base part, then joints put in the model's order.
    fn vector(&self, key: &str, base: &[f64], joints: Option<&[f64]>) -> Result<Vec<f64>, String> {
        let joint_count = self.model.joint_count();
        let mut x = match self.model.base() {
            Base::Fixed => Vec::new(),
            Base::Floating => base.to_vec(),
        };
        let (bx, bv) = (x.len(), self.model.base_size().0);
        x.resize(bx + joint_count, 0.0);
        let Some(joints) = joints else { return Ok(x) };
        if joints.len() != joint_count {
            return Err(format!(
                "{key}: {} numbers; allowed: {joint_count}, one per joint",
                joints.len()
            ));
        }
        for (k, value) in self.order[bv..].iter().zip(joints) {
            x[bx + k - bv] = *value;
        }
        Ok(x)
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

    fn more(&self, data: &mut Data, state: &State, tau: &[f64]) -> More {
        let State { q, v, a, f_ext } = state;
        let (model, nv) = (self.model, self.model.nv());
        let zero = vec![0.0; nv];
        let mut x = tau.to_vec();
        let bias = rnea(model, data, q, v, &zero, Some(f_ext));
        x.iter_mut().zip(bias).for_each(|(x, b)| *x -= b);
        crba(model, data, q);
        cholesky_decompose(model, data);
        cholesky_solve(model, data, &mut x);
        let first = usize::from(model.base() == Base::Fixed);
        let columns = PARAMETERS * (model.bodies().len() - first);
        let mut regressor = DMatrix::zeros(nv, columns);
        joint_torque_regressor(model, data, q, v, a, &mut regressor);
        let (mut j_com, mut map) = (Matrix3xX::zeros(nv), Matrix6xX::zeros(nv));
        forward_kinematics_velocity(model, data, q, v);
        center_of_mass_jacobian(model, data, &mut j_com);
        centroidal_map(model, data, &mut map);
        let row = |i: &usize| regressor.row(*i).iter().copied().collect();
        More {
            ddq_of_M: self.ordered(&x),
            J_com: self.columns_ordered(&j_com),
            h: centroidal_momentum(model, data).to_array(),
            A: self.columns_ordered(&map),
            kinetic_energy: kinetic_energy(model, data, v),
            potential_energy: potential_energy(model, data),
            regressor: self.order.iter().map(row).collect(),
        }
    }

    fn frames(&self, data: &mut Data, state: &State) -> BTreeMap<String, FrameReport> {
        use ReferenceFrame::{Local, LocalWorldAligned, World};
        let (model, State { q, v, a, .. }) = (self.model, state);
        forward_kinematics_acceleration(model, data, q, v, a);
        let mut still = data.clone();
        forward_kinematics_acceleration(model, &mut still, q, v, &vec![0.0; model.nv()]);
        let mut j = Matrix6xX::zeros(model.nv());
        let mut motion = |frame, reference| {
            frame_jacobian(model, data, frame, reference, &mut j);
            FrameMotion {
                v: frame_velocity(model, data, frame, reference).to_array(),
                a: frame_acceleration(model, data, frame, reference).to_array(),
                a_classical: frame_classical_acceleration(model, data, frame, reference).to_array(),
                J: self.columns_ordered(&j),
                dJ_v: frame_jacobian_rate_times_velocity(model, &still, frame, reference)
                    .to_array(),
            }
        };
        let mut all = BTreeMap::new();
        for &(frame, name) in &self.frames {
            let m = frame_placement(model, data, frame);
            let row = |r: usize| m.rotation.row(r).iter().copied().collect();
            let report = FrameReport {
                p: m.translation.into(),
                R: (0..3).map(row).collect(),
                local: motion(frame, Local),
                world: motion(frame, World),
                aligned: motion(frame, LocalWorldAligned),
            };
            all.insert(name.to_owned(), report);
        }
        all
    }

    fn ordered(&self, x: &[f64]) -> Vec<f64> {
        self.order.iter().map(|k| x[*k]).collect()
    }

    fn columns_ordered<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(
        &self,
        m: &Matrix<f64, R, C, S>,
    ) -> Rows {
        let row = |r: usize| self.order.iter().map(|k| m[(r, *k)]).collect();
        (0..m.nrows()).map(row).collect()
    }

    fn both_ordered(&self, m: &DMatrix<f64>) -> Rows {
        let row = |i: &usize| self.order.iter().map(|j| m[(*i, *j)]).collect();
        self.order.iter().map(row).collect()
    }
}

/// Component of `v` of each of the answer's components: the base's, then the joints as named.
fn order(model: &Model, request: &Cases) -> Result<Vec<usize>, String> {
    let base = model.base_size().0;
    let Some(names) = &request.joints else {
        return Ok((0..model.nv()).collect());
    };
    let mut order: Vec<usize> = (0..base).collect();
    for name in names {
        let joint = model
            .joint_index(name)
            .ok_or_else(|| format!("joints: \"{name}\" is no moving joint"))?;
        if order.contains(&(base + joint)) {
            return Err(format!("joints: \"{name}\" is named twice"));
        }
        order.push(base + joint);
    }
    match (base..model.nv()).find(|k| !order.contains(k)) {
        None => Ok(order),
        Some(k) => {
            let name = &model.joints()[k - base].name;
            Err(format!(
                "joints: \"{name}\" is missing; allowed: all moving joints (mimic joints as wished), in any order"
            ))
        }
    }
}
