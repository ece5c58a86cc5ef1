//! The algorithms run on one state after another: from a request to its report.

use super::report::{CaseReport, FrameMotion, FrameReport, More, Report, Rows};
use super::request::{BaseState, Case, Cases};
use dynamics::*;
use nalgebra::{DMatrix, Dim, Matrix, Matrix3xX, Matrix6xX, RawStorage};
use problem::Problem;
use std::collections::BTreeMap;

/// Evaluates cases on a URDF: texts or records, each with the name of its file.
pub(super) fn evaluate(
    (urdf, urdf_file): (&str, &str),
    base: Base,
    (request, request_file): (&Cases, &str),
) -> Result<Report, Problem> {
    let options = UrdfOptions {
        base,
        independent: request.joints.clone().unwrap_or_default(),
    };
    let mut model = Model::from_urdf_with(urdf, urdf_file, &options)?;
    let in_request = |problem: Problem| problem.or_at(request_file, 0);
    set_armatures(&mut model, request).map_err(in_request)?;
    let evaluation = Evaluation::new(&model, request).map_err(in_request)?;
    let mut data = Data::new(&model);
    let mut cases = Vec::new();
    for (index, case) in request.cases.iter().enumerate() {
        let report = evaluation.case(&mut data, case);
        cases.push(report.map_err(|mut problem| {
            problem.reason = format!("cases[{index}].{}", problem.reason);
            in_request(problem)
        })?);
    }
    let bodies = model.bodies().iter().map(|b| b.name.clone());
    Ok(Report {
        joints: evaluation.names(),
        warnings: model.warnings().to_vec(),
        bodies: if request.more {
            bodies.skip(usize::from(base == Base::Fixed)).collect()
        } else {
            Vec::new()
        },
        cases,
    })
}

fn set_armatures(model: &mut Model, request: &Cases) -> Result<(), Problem> {
    for (name, armature) in &request.armature {
        let joint = model.joint_index(name);
        let joint = joint.ok_or_else(|| no_joint("armature", name))?;
        if *armature < 0.0 {
            let reason = format!("armature.{name}: {armature}");
            return Err(Problem::new(reason, "a number >= 0"));
        }
        model.set_armature(joint, *armature);
    }
    Ok(())
}

fn no_joint(key: &str, name: &str) -> Problem {
    Problem::new(format!("{key}: \"{name}\" is no moving joint"), "")
}

fn no_link(key: &str, name: &str) -> Problem {
    Problem::new(format!("{key}: no link \"{name}\""), "")
}

/// A model and a request.
struct Evaluation<'a> {
    model: &'a Model,
    request: &'a Cases,
    /// Component of `v` of each of the report's components.
    order: Vec<usize>,
    /// Index and name of each requested frame.
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
    fn new(model: &'a Model, request: &'a Cases) -> Result<Self, Problem> {
        let find = |name: &'a String| {
            let frame = model.frame_index(name);
            let frame = frame.ok_or_else(|| no_link("frames", name))?;
            Ok((frame, name.as_str()))
        };
        let frames = request.frames.iter().map(find);
        Ok(Self {
            model,
            request,
            order: order(model, request)?,
            frames: frames.collect::<Result<_, Problem>>()?,
        })
    }

    fn names(&self) -> Vec<String> {
        let base = self.model.base_size().0;
        let name = |k: &usize| self.model.joints()[k - base].name.clone();
        self.order[base..].iter().map(name).collect()
    }

    fn case(&self, data: &mut Data, case: &Case) -> Result<CaseReport, Problem> {
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
        if report.is_finite() {
            Ok(report)
        } else {
            let reason = "q, dq, ddq, base, f_ext: too large, the result is not finite";
            Err(Problem::new(reason, ""))
        }
    }

    fn state(&self, case: &Case) -> Result<State, Problem> {
        let fixed = self.model.base() == Base::Fixed;
        let base = case.base.unwrap_or(BaseState::REST);
        if fixed && base != BaseState::REST {
            return Err(Problem::new(
                "base: the root link is fixed to the world's origin",
                "no base, or --floating",
            ));
        }
        Ok(State {
            q: self.vector("q", &base.pose()?, Some(&case.q))?,
            v: self.vector("dq", &base.v, case.dq.as_deref())?,
            a: self.vector("ddq", &base.a, case.ddq.as_deref())?,
            f_ext: self.wrenches(case)?,
        })
    }

    /// The model's vector: base part, then joints put in the model's order.
    fn vector(&self, key: &str, base: &[f64], joints: Option<&[f64]>) -> Result<Vec<f64>, Problem> {
        let joint_count = self.model.joint_count();
        let mut x = match self.model.base() {
            Base::Fixed => Vec::new(),
            Base::Floating => base.to_vec(),
        };
        let (bx, bv) = (x.len(), self.model.base_size().0);
        x.resize(bx + joint_count, 0.0);
        let Some(joints) = joints else { return Ok(x) };
        if joints.len() != joint_count {
            return Err(Problem::new(
                format!("{key}: {} numbers", joints.len()),
                format!("{joint_count}, one per joint"),
            ));
        }
        for (k, value) in self.order[bv..].iter().zip(joints) {
            x[bx + k - bv] = *value;
        }
        Ok(x)
    }

    /// External wrenches moved from links to their bodies.
    fn wrenches(&self, case: &Case) -> Result<Vec<Force>, Problem> {
        let mut all = vec![Force::zero(); self.model.bodies().len()];
        for (name, f) in &case.f_ext {
            let frame = self.model.frame_index(name);
            let frame = frame.ok_or_else(|| no_link("f_ext", name))?;
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

/// Component of `v` of each of the report's components: the base's, then the joints as named.
fn order(model: &Model, request: &Cases) -> Result<Vec<usize>, Problem> {
    let base = model.base_size().0;
    let Some(names) = &request.joints else {
        return Ok((0..model.nv()).collect());
    };
    let mut order: Vec<usize> = (0..base).collect();
    for name in names {
        let joint = model
            .joint_index(name)
            .ok_or_else(|| no_joint("joints", name))?;
        if order.contains(&(base + joint)) {
            let reason = format!("joints: \"{name}\" is named twice");
            return Err(Problem::new(reason, "each joint once"));
        }
        order.push(base + joint);
    }
    match (base..model.nv()).find(|k| !order.contains(k)) {
        None => Ok(order),
        Some(k) => {
            let name = &model.joints()[k - base].name;
            Err(Problem::new(
                format!("joints: \"{name}\" is missing"),
                "all moving joints (mimic joints as required), in any order",
            ))
        }
    }
}
